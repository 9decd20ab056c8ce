"""Loops of a spring, each a friction element of Bouc and Wen, found by linear fits.

A torque that yields is its stiffness times a strain, which depends on the deflection at which it slips, on how sharply and on the
shape of its branches. Strains of neighbouring elements, at the corners of a simplex of these three, add up to nearly that of one
in between, at the mean weighted by their stiffnesses: simplex by simplex, ever smaller, a loop is found, as a corner is
(`corners.py`). The last simplex is kept, so that a fit of its stiffnesses is one of the three numbers as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from vsalog.core.significance import DETECTED, FALSE_ALARM
from vsalog.estimators.corners import solved
from vsalog.filters.random_walk import triangle_of

Array = NDArray[np.float64]


class Element(NamedTuple):
    """A spring in series with friction: its strain is its deflection at first, and at most that at which it slips.

    Attributes
    ----------
    slip : that deflection [rad]
    sharpness : 1 over the exponent of the Bouc–Wen loop as which it begins to slip, 0: at once (Prandtl and Ishlinskii)
    shape : of that loop
    """

    slip: float
    sharpness: float = 0.0
    shape: float = 1.0

    @property
    def is_sudden(self) -> bool:
        """Whether it slips at once."""
        return self.sharpness < SEARCH.sudden


# Of elements, triangle [R z] of a fit with noise of variance one: the last unknowns are their stiffnesses.
Fit = Callable[[tuple[Element, ...]], Array]


class Search(NamedTuple):
    """Numbers of the search.

    Attributes
    ----------
    sharpness, shapes : at which a loop is looked for at first [1]: from the smoothest that there is to nearly sudden
    sudden : sharpness below which an element slips at once [1]: its strain is another by a hundredth of the slip at most
    blurred : sharpness that filters and rounding of encoders give one that slips at once [1]: 0.04 with steps of 1/60 of its slip
    closer : a simplex is than the one before [1]: as of corners
    farther : a simplex is smaller than the one before that a loop was outside of [1]: so that it ends within twice its sides
    settled : by how much the sum of squares still changes in the end, with noise of variance one [1]: a tenth of one unknown's
    rounds : of simplices that come closer, at most [1]
    """

    sharpness: tuple[float, ...] = (0.25, 0.5, 1.0)
    shapes: tuple[float, ...] = (0.5, 1.0, 2.0)
    sudden: float = 0.01
    blurred: float = 0.05
    closer: float = 0.25
    farther: float = 0.5
    settled: float = 0.1
    rounds: int = 12


SEARCH = Search()


class Simplex(NamedTuple):
    """Four elements, one of which is the others' neighbour in logarithm of the slip, sharpness and shape.

    Attributes
    ----------
    first : these of the one, shape (3,)
    sides : by how much another has more, shape (3,)
    """

    first: Array
    sides: Array

    @classmethod
    def around(cls, place: Array, sides: Array, low: Array, high: Array) -> Simplex:
        """Return the simplex whose mean is a place, moved to where all of it is between bounds."""
        sides = np.minimum(sides, high - low)
        return cls(np.clip(place - 0.25 * sides, low, high - sides), sides)

    @classmethod
    def of(cls, elements: Sequence[Element]) -> Simplex | None:
        """Return the simplex whose corners elements are; None where they are no such corners."""
        corners = np.array([(math.log(slip), sharpness, shape) for slip, sharpness, shape in elements])
        sides = corners[1:] - corners[0]
        return (
            cls(corners[0], np.diag(sides).copy())
            if sides.shape == (3, 3) and not np.any(sides - np.diag(np.diag(sides)))
            else None
        )

    @property
    def elements(self) -> tuple[Element, ...]:
        """Its corners: the one, and the others in the order of the three numbers."""
        corners = self.first + np.vstack((np.zeros(3), np.diag(self.sides)))
        return tuple(Element(math.exp(slip), float(sharpness), float(shape)) for slip, sharpness, shape in corners)


class Form(NamedTuple):
    """What a rig has of a loop but its torque.

    Attributes
    ----------
    width, width_std : and its standard deviation [rad]
    exponent, least, most : and between what it is with a standard deviation [1]
    shape, shape_std : and its standard deviation [1]
    """

    width: float
    width_std: float
    exponent: float
    least: float
    most: float
    shape: float
    shape_std: float


class Loop(NamedTuple):
    """A loop that a simplex has shown.

    Attributes
    ----------
    simplex : its elements
    stiffness, stiffness_std : what those of the elements add up to, and its standard deviation [N·m/rad]
    place, std : logarithm of the slip, sharpness and shape, shape (3,), and their standard deviations
    """

    simplex: Simplex
    stiffness: float
    stiffness_std: float
    place: Array
    std: Array

    @classmethod
    def of(cls, simplex: Simplex, stiffnesses: Array, covariance: Array) -> Loop:
        """Return the loop of a simplex whose stiffnesses (4,) were fitted, with their covariance."""
        total = float(stiffnesses.sum()) or math.ulp(1.0)
        shares = stiffnesses[1:] / total
        # The derivative of the shares in the stiffnesses.
        gradient = (np.hstack((np.zeros((3, 1)), np.eye(3))) - shares[:, None]) / total
        std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", gradient, covariance, gradient), 0.0))
        own = math.sqrt(max(float(covariance.sum()), 0.0))
        return cls(simplex, total, own, simplex.first + simplex.sides * shares, simplex.sides * std)

    @property
    def shown(self) -> bool:
        """Whether it resists significantly."""
        return self.stiffness > DETECTED * self.stiffness_std

    @property
    def torque(self) -> float:
        """Half of its height [N·m]."""
        return self.stiffness * math.exp(self.place[0])

    @property
    def is_sudden(self) -> bool:
        """Whether the log does not show that it slips at all smoothly."""
        return bool(self.place[1] - DETECTED * self.std[1] < SEARCH.blurred)

    @property
    def form(self) -> Form:
        """What a rig has of it; the exponent is no larger than is known."""
        slip, sharpness, shape = (float(own) for own in self.place)
        width_std, doubt, shape_std = math.exp(slip) * float(self.std[0]), float(self.std[1]), float(self.std[2])
        exponent, least, most = (
            1.0 / min(max(own, doubt), 1.0) for own in (sharpness, sharpness + doubt, sharpness - doubt)
        )
        shape = min(max(shape, min(SEARCH.shapes)), max(SEARCH.shapes))
        return Form(math.exp(slip), width_std, exponent, least, most, shape, shape_std)

    def choices(self, slips: Sequence[float]) -> float:
        """Return the logarithm of how many such simplices there are in the range that was searched."""
        low, high = _bounds(slips)
        return float(np.log((high - low) / self.simplex.sides).sum())


def loops_among(elements: Sequence[Element], stiffnesses: Array, covariance: Array) -> list[Loop]:
    """Return the loops of simplices' elements whose stiffnesses (n,) were fitted, with their covariance; none of others."""
    found = []
    for first in range(0, len(elements) - 3, 4):
        own = slice(first, first + 4)
        if (simplex := Simplex.of(elements[own])) is not None:
            found.append(Loop.of(simplex, stiffnesses[own], covariance[own, own]))
    return found


def elements_of(loops: Sequence[Loop]) -> tuple[Element, ...]:
    """Return the elements of the loops' simplices."""
    return _elements([one.simplex for one in loops])


def with_another(fit: Fit, slips: Sequence[float], known: Sequence[Loop]) -> list[Loop]:
    """Return the loops that are known and another one, if it is significant with a false alarm rate of `FALSE_ALARM`.

    Its elements slip at deflections between the least and twice the largest of `slips` [rad].
    """
    low, high = _bounds(slips)
    grid = [Element(slip) for slip in slips]
    grid += [Element(*own) for own in product(slips, SEARCH.sharpness, SEARCH.shapes)]
    sides = (high - low) * np.array([2.0 / (len(slips) - 1), 0.5, 1.0])
    simplices = [one.simplex for one in known]
    if (at := _best(fit((*_elements(simplices), *grid)), len(grid))) is None:
        return list(known)
    place = np.array([math.log(grid[at].slip), grid[at].sharpness, grid[at].shape])
    return _refined(fit, [*simplices, Simplex.around(place, sides, low, high)], low, high)


def refined(fit: Fit, slips: Sequence[float], known: Sequence[Loop]) -> list[Loop]:
    """Return the loops that are known, of a fit with another noise; `slips` as of `with_another`."""
    return _refined(fit, [one.simplex for one in known], *_bounds(slips))


def _refined(fit: Fit, simplices: list[Simplex], low: Array, high: Array) -> list[Loop]:
    """Return the loops that simplices show, ever smaller ones; only those that are significant."""
    found, before = list[Loop](), math.inf
    for _ in range(SEARCH.rounds):
        stiffnesses, covariance, left = solved(fit(_elements(simplices)), 4 * len(simplices))
        own = [slice(4 * i, 4 * i + 4) for i in range(len(simplices))]
        found = [Loop.of(each, stiffnesses[i], covariance[i, i]) for each, i in zip(simplices, own, strict=True)]
        small = all(np.all(SEARCH.closer * one.simplex.sides <= one.std) for one in found)
        if small and abs(left - before) <= SEARCH.settled:
            break
        simplices, before = [_next(one, low, high) for one in found], left
    return [one for one in found if one.shown]


def _elements(simplices: Sequence[Simplex]) -> tuple[Element, ...]:
    return tuple(element for simplex in simplices for element in simplex.elements)


def _bounds(slips: Sequence[float]) -> tuple[Array, Array]:
    """Return between what a loop is looked for: logarithm of the slip, sharpness and shape, shape (3,) each."""
    low, high = (math.log(min(slips)), 0.0, min(SEARCH.shapes)), (math.log(2.0 * max(slips)), 1.0, max(SEARCH.shapes))
    return np.array(low), np.array(high)


def _next(found: Loop, low: Array, high: Array) -> Simplex:
    """Return a simplex around the loop that one has shown: a smaller one if it is inside."""
    sides, first = found.simplex.sides, found.simplex.first
    # As far as two sides at a time: a fit is linear no farther.
    place = np.clip(np.clip(found.place, first - 2.0 * sides, first + 3.0 * sides), low, high)
    inside = np.all((place >= first) & (place <= first + sides))
    return Simplex.around(
        place, np.maximum((SEARCH.closer if inside else SEARCH.farther) * sides, found.std), low, high
    )


def _best(rows: Array, count: int) -> int | None:
    """Return the number of the element among the last `count` that explains most; None where none is significant."""
    R = triangle_of(rows)
    base, strains, z = R[:, : -1 - count], R[:, -1 - count : -1], R[:, -1]
    Q = np.linalg.qr(base)[0]
    left, own = z - Q @ (Q.T @ z), strains - Q @ (Q.T @ strains)
    size = np.linalg.norm(own, axis=0)
    along = own.T @ left / np.where(size > 0.0, size, np.inf)
    # Friction resists.
    gains = np.where(along > 0.0, along, 0.0) ** 2
    at = int(np.argmax(gains))
    return at if gains[at] > chdtri(1, FALSE_ALARM / count) else None
