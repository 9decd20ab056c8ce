"""Roles of other joints that a method reads in addition to its own joint's signals, written ``JOINT/ROLE``."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from vsalog.rig.schema import Joint

Neighbours = Mapping[str, tuple[Joint, Collection[str]]]


def role_of(joint: str, role: str, own: str) -> str:
    """Name a role as the method for joint `own` reads it: plain where it is its own, else with the joint in front."""
    return role if joint == own else f"{joint}/{role}"


def own_and_others(roles: Collection[str], joints: Mapping[str, Joint]) -> tuple[tuple[str, ...], Neighbours]:
    """Part a method's roles into those of its own joint, and joint → its roles for the others.

    Parameters
    ----------
    roles : as `role_of` names them; no role has a stroke in its name, though a joint may
    joints : of the rig, by name
    """
    own: list[str] = []
    others: dict[str, tuple[Joint, list[str]]] = {}
    for named in roles:
        joint, stroke, role = named.rpartition("/")
        if stroke:
            others.setdefault(joint, (joints[joint], []))[1].append(role)
        else:
            own.append(role)
    return tuple(own), others
