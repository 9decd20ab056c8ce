"""Corners of a spring: deflections at which its stiffness jumps, found by linear fits.

A stiffness that jumps by Δ at a deflection c has a ramp Δ (φ − c)⁺ in its torque. Two ramps that begin at c ∓ δ, with the slopes
a and b of a linear fit, are nearly one of a + b that begins at their mean, weighted by a and b: pair by pair, ever closer, c is
found (after Muggeo, "Estimating regression models with unknown break-points", Statistics in Medicine 22(19), 2003, who has the
ramp's derivative in the place of a second ramp). The last pair is kept, so that a fit of its slopes is one of c as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from vsalog.core.precision import ROUNDING
from vsalog.core.significance import DETECTED, FALSE_ALARM, INTERVAL
from vsalog.filters.random_walk import triangle_of

Array = NDArray[np.float64]
# Of ramps that begin at given deflections, triangle [R z] of a fit with noise of variance one: the last unknowns are theirs.
Fit = Callable[[tuple[float, ...]], Array]


class Corner(NamedTuple):
    """A deflection at which the stiffness jumps, between the beginnings of two ramps.

    Attributes
    ----------
    below, above : where these begin [rad]
    jump, jump_std : of the stiffness, what the ramps' slopes add up to, and its standard deviation [N·m/rad]
    place, std : of the corner, and its standard deviation [rad]
    """

    below: float
    above: float
    jump: float
    jump_std: float
    place: float
    std: float

    @classmethod
    def between(cls, below: float, above: float, slopes: Array, covariance: Array) -> Corner:
        """Return the corner of two ramps whose slopes (2,) were fitted, with their covariance."""
        a, b = (float(own) for own in slopes)
        jump, apart = a + b or ROUNDING, above - below
        # The derivative of the weighted mean in a and b.
        gradient = apart / jump**2 * np.array([-b, a])
        stds = (math.sqrt(max(float(row @ covariance @ row), 0.0)) for row in (np.ones(2), gradient))
        return cls(below, above, jump, next(stds), below + apart * b / jump, next(stds))

    @property
    def width(self) -> float:
        """Half of the distance between the ramps [rad]."""
        return 0.5 * (self.above - self.below)

    @property
    def inside(self) -> bool:
        """Whether it is between the ramps."""
        return self.below <= self.place <= self.above

    @property
    def shown(self) -> bool:
        """Whether its jump is significant."""
        return abs(self.jump) > DETECTED * self.jump_std

    @property
    def closest(self) -> float:
        """Half of the distance that a pair has to have for its corner to be in between [rad]."""
        return INTERVAL * self.std


class Search(NamedTuple):
    """Numbers of the search.

    Attributes
    ----------
    places : in the range of the deflection, at which a corner is looked for at first [1]: two between two of them are one
    most : pairs at first [1]: a shape with more corners is smooth
    closer : a pair is than the one before [1]: a quarter of it is ten times what is left of the error
    rounds : of pairs that come closer, and of exchanges, at most [1]
    """

    places: int = 31
    most: int = 4
    closer: float = 0.25
    rounds: int = 8


SEARCH = Search()


def corners_of(fit: Fit, low: float, high: float) -> list[Corner]:
    """Return the corners that a log shows between two deflections [rad], in ascending order.

    Each has to be significant with a false alarm rate of `FALSE_ALARM` over all places. A smooth shape may have some, too:
    whether it is better described by them the caller compares.
    """
    grid = np.linspace(low, high, SEARCH.places + 2)[1:-1].tolist()
    pairs = _merged([(grid[i], grid[i + 1]) for i in _selected(fit(tuple(grid)))])
    found: list[Corner] = []
    for _ in range(SEARCH.rounds if pairs else 0):
        slopes, covariance, _ = solved(fit(tuple(at for pair in pairs for at in pair)), 2 * len(pairs))
        own = [slice(2 * i, 2 * i + 2) for i in range(len(pairs))]
        found = [Corner.between(*pair, slopes[i], covariance[i, i]) for pair, i in zip(pairs, own, strict=True)]
        shown = [one for one in found if low < one.place < high]
        # Of two around one corner neither is significant next to the other.
        if least := [one for one in shown if not one.shown]:
            shown.remove(min(least, key=lambda one: abs(one.jump) / (one.jump_std or 1.0)))
        if len(shown) == len(found) and all(one.inside and SEARCH.closer * one.width < one.closest for one in found):
            break
        pairs = _merged([_next(one) for one in shown])
        if not pairs:
            break
    return [one for one in found if one.shown and low < one.place < high]


def _next(found: Corner) -> tuple[float, float]:
    """Return a pair around the corner that a pair has shown: a closer one if it is inside."""
    if not found.inside:
        shift = math.copysign(found.width, found.place - found.below)
        return found.below + shift, found.above + shift
    width = max(SEARCH.closer * found.width, found.closest)
    return found.place - width, found.place + width


def _merged(pairs: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return pairs in ascending order, those that touch as one."""
    merged: list[tuple[float, float]] = []
    for below, above in sorted(pairs):
        if merged and below <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(above, merged[-1][1])
        else:
            merged.append((below, above))
    return merged


def _selected(rows: Array) -> list[int]:
    """Return the numbers of ramps that explain most, each with the next: one pair after the other, and exchanged."""
    count = SEARCH.places
    R = triangle_of(rows)
    base, ramps, z = R[:, : -1 - count], R[:, -1 - count : -1], R[:, -1]
    taken: list[int] = []
    least = float(chdtri(2, FALSE_ALARM / (count - 1)))

    def best(others: list[int]) -> tuple[int, float]:
        Q = _range_of(np.column_stack((base, *(ramps[:, [i, i + 1]] for i in others))))
        left, own = z - Q @ (Q.T @ z), ramps - Q @ (Q.T @ ramps)
        gains = [float(np.sum((_range_of(own[:, i : i + 2]).T @ left) ** 2)) for i in range(count - 1)]
        at = int(np.argmax(gains))
        return at, gains[at]

    while len(taken) < SEARCH.most:
        at, gain = best(taken)
        if gain <= least or at in taken:
            break
        taken.append(at)
        # The first pair stands for all corners until there are others.
        for _ in range(SEARCH.rounds):
            before = list(taken)
            for i in range(len(taken)):
                at, _ = best(taken[:i] + taken[i + 1 :])
                taken[i] = taken[i] if at in taken else at
            if taken == before:
                break
    return taken


def _range_of(columns: Array) -> Array:
    """Return an orthonormal basis of what columns span, shape (m, rank)."""
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return np.asarray(u[:, s > ROUNDING * s.max(initial=0.0)])


def solved(rows: Array, count: int) -> tuple[Array, Array, float]:
    """Return the last `count` unknowns of a fit, their covariance and the sum of squares that is left."""
    R = triangle_of(rows)[-1 - count :, -1 - count :]
    inverse = np.linalg.pinv(R[:count, :count])
    return np.asarray(inverse @ R[:count, -1]), np.asarray(inverse @ inverse.T), float(R[-1, -1] ** 2)
