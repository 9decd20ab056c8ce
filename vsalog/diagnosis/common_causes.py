"""Causes that two parts of a joint have in common: one factor on both motors, springs or encoders of an antagonistic joint.

Machines are built of equal parts, from one lot, with one data sheet: an error of both costs one unknown, not two.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Site

Array = NDArray[np.float64]


def common_sites(sites: Iterable[Site]) -> list[Site]:
    """Return one site for each pair of sites whose numbers, or whose factors on the rig's numbers, may be the same.

    Causes that begin with a shape, or happen once, belong to one part.
    """
    pairs = dict[tuple[str, str], list[Site]]()
    for site in sites:
        if site.part.endswith(("_1", "_2")) and site.starts is None and not site.transient:
            pairs.setdefault((site.cause, site.part[:-2]), []).append(site)
    return [_of_both(*pair) for pair in pairs.values() if len(pair) == 2 and _alike(*pair)]


def _alike(one: Site, other: Site) -> bool:
    names = [[p.name for p in s.parameters] for s in (one, other)]
    both = zip(one.start, other.start, strict=False)
    return names[0] == names[1] and all((a == 0.0) == (b == 0.0) and a * b >= 0.0 for a, b in both)


def _of_both(one: Site, other: Site) -> Site:
    members = (one, other)

    def apply(joint: Any, values: Sequence[float]) -> Any:
        for member, scale in zip(members, scales(members), strict=True):
            joint = member.apply(joint, [v * s for v, s in zip(values, scale, strict=True)])
        return joint

    return Site(
        one.cause,
        f"{one.part}+{other.part}",
        one.parameters,
        apply,
        excludes=one.excludes,
        doubles=one.doubles,
        members=members,
    )


def scales(members: Sequence[Site]) -> Array:
    """Return the members' numbers over those of the first, shape (members, parameters): as the rig has them."""
    start = np.array([m.start for m in members])
    return np.asarray(np.where(start[0] == 0.0, 1.0, start / np.where(start[0] == 0.0, 1.0, start[0])))
