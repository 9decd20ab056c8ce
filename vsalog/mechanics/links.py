"""A link with what it carries: one place for a payload."""

from __future__ import annotations

from vsalog.rig.parts import Link


def link_inertia(link: Link) -> float:
    """Return M of a link with its payload [kg·m²]."""
    return link.inertia + (link.payload.inertia if link.payload else 0.0)


def link_weight(link: Link) -> float:
    """Return the torque that holds a link with its payload horizontal [N·m]; a link without gravity has none with one either."""
    carried = link.payload.weight if link.payload and link.gravity_torque else 0.0
    return link.gravity_torque + carried
