"""The functions that a log needs of a spring: pieces of its ranges, corners and loops, by the evidence of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.core.look import LONGEST_RUN, spread_over
from vsalog.core.precision import ROUNDING
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.estimators.combined_equation import CombinedEquation
from vsalog.estimators.corners import corners_of
from vsalog.estimators.device import Device, deflection_of, setpoint_borders
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.loops import Element, Loop, elements_of, refined, with_another
from vsalog.estimators.smoothing import BasisEvidence, SmootherSolver, SmootherState, Surroundings
from vsalog.filters.conditioning import Conditioned, Conditioner

Array = NDArray[np.float64]


class Shape(NamedTuple):
    """What a basis gets where the log needs it.

    Attributes
    ----------
    knots : on either side of zero [1]: corners in between cost half a percent
    setpoint_knots : pieces of the range of the set-point [1]: a change within half of one looks sudden
    beyond : part of the samples beyond the first and the last place of a corner [1]: fewer show none
    slips : friction elements [1], which slip after a half of the largest deflection … a thirty-second: shorter ones noise hides
    gain : in the logarithm of the evidence, for which loops are fitted once more [1]: what one more unknown has to explain
    """

    knots: int = 16
    setpoint_knots: int = 8
    beyond: float = 1e-3
    slips: int = 9
    gain: float = 1.0

    @property
    def parts(self) -> Array:
        """Of the largest deflection, after which friction elements slip: a loop between two that are √2 apart is their sum."""
        return np.asarray(0.5 * np.geomspace(1.0, 1.0 / 16.0, self.slips))


SHAPE = Shape()
# Logarithm of how many times as probable more functions have to be as fewer.
SURE = -math.log(FALSE_ALARM)


class ShapedFold(Protocol):
    """A fold of equations of one joint, whose functions can be replaced."""

    device: Device
    conditioner: Conditioner
    equations: tuple[CombinedEquation, ...]
    solver: SmootherSolver

    def with_shape(self, basis: PolynomialBasis, elements: tuple[Element, ...], wait: Element | None = None) -> Self:
        """Return the same fold with other functions and friction elements."""

    def collected(self, blocks: Iterable[Conditioned]) -> list[SmootherState]:
        """Return what the solvers collect from blocks."""


class _Tried(NamedTuple):
    """A fold, and how much the log says for it.

    Attributes
    ----------
    fold : with the functions
    found : of each of its solvers
    choices : logarithm of how many such folds it was chosen from
    """

    fold: ShapedFold
    found: tuple[BasisEvidence, ...]
    choices: float = 0.0

    @property
    def evidence(self) -> float:
        """Logarithm of its probability, but for a constant."""
        return sum(own.logarithm for own in self.found) - self.choices

    @property
    def basis(self) -> PolynomialBasis:
        """Its functions."""
        return self.fold.device.basis

    @property
    def is_polynomial(self) -> bool:
        """Whether pieces of the deflection's range are probably not needed, by all equations together."""
        p = np.clip([own.polynomial for own in self.found], ROUNDING, 1.0 - ROUNDING)
        return bool(np.sum(np.log(p / (1.0 - p))) > 0.0)

    @property
    def surroundings(self) -> Surroundings:
        """What fits of other functions of the first equation take as known."""
        known = self.found[0].surroundings
        assert known is not None
        return known

    def is_needed_after(self, other: _Tried) -> bool:
        """Return whether it is a thousand times as probable as one with fewer functions."""
        return self.evidence - other.evidence > SURE


class ShapeSearch:
    """The search for the functions that a log needs: more have to be a thousand times as probable as fewer.

    Of a long log stretches are looked at: they show a shape as well. All folds are compared on the same rows.
    """

    def __init__(self, plain: ShapedFold, signals: JointSignals) -> None:
        self._plain, self._signals = plain, spread_over(signals, LONGEST_RUN)
        self._filtered: dict[PolynomialBasis, list[Conditioned]] = {}
        self._slips = tuple(plain.device.basis.deflection_scale * part for part in SHAPE.parts)
        # Elements that remember longest: of those that are compared at first, and one as wide as the largest deflection.
        self._short, self._long = Element(self._slips[0]), Element(2.0 * self._slips[0], 1.0)

    @property
    def found(self) -> tuple[PolynomialBasis, tuple[Element, ...], Element | None]:
        """What `with_shape` takes: basis, friction elements, and one that has to have forgotten what was before."""
        plain = self._plain
        straight = self._with_setpoint_pieces(self._tried(plain.device.basis))
        basis = straight.basis
        # Runs with a set-point each hardly determine how a piece depends on it.
        spline = basis if plain.solver.constant else replace(basis, knots=max(basis.knots, SHAPE.knots))
        best = straight if spline == basis else self._tried(spline)
        # Fewer functions resolve a change in shorter intervals: in long ones it may look like another shape.
        best = straight if straight.is_needed_after(best) else best
        # With branches a corner would be one of either; what a causal filter delays looks like a loop.
        if basis.branches or plain.conditioner.kind != "savitzky-golay":
            return self._chosen(best)
        sudden = self._tried(spline, tuple(Element(slip) for slip in self._slips))
        loop = sudden.is_needed_after(max(straight, best, key=lambda own: own.evidence))
        if _is_curve(best.fold) and not (sudden if loop else best).is_polynomial:
            best = self._with_corners(best, spline)
        return self._chosen(self._with_loops(best, max(straight, best, key=lambda own: own.evidence), sudden))

    def _chosen(self, best: _Tried) -> tuple[PolynomialBasis, tuple[Element, ...], Element | None]:
        own = best.fold.equations[0]
        return self._probable_basis(best), own.elements, own.wait if own.elements else None

    def _probable_basis(self, best: _Tried) -> PolynomialBasis:
        """Return the basis of the best one; of a spline that of a polynomial, if this is the more probable."""
        basis, knots = best.basis, self._plain.device.basis.knots
        return replace(basis, knots=knots) if basis.knots > knots and best.is_polynomial else basis

    def _tried(
        self,
        basis: PolynomialBasis,
        elements: tuple[Element, ...] = (),
        choices: float = 0.0,
        wait: Element | None = None,
    ) -> _Tried:
        fold, states = self._collected(basis, elements, wait)
        found = tuple(fold.solver.evidence(own) for own in states)
        return _Tried(fold, found, choices)

    def _collected(
        self, basis: PolynomialBasis, elements: tuple[Element, ...], wait: Element | None
    ) -> tuple[ShapedFold, list[SmootherState]]:
        """Return a fold with other functions, and what its solvers have collected from all signals."""
        fold = self._plain.with_shape(basis, elements, wait or self._short)
        return fold, fold.collected(self._conditioned(fold))

    def _conditioned(self, fold: ShapedFold) -> list[Conditioned]:
        """Return the filtered signals for a fold's functions, which some filters take in; those of the last ones are kept."""
        basis = fold.device.basis
        if basis not in self._filtered:
            filters, blocks = fold.conditioner.start(), list[Conditioned]()
            for part in self._signals.blocks(BLOCK):
                filters, ready = fold.conditioner.step(filters, part)
                blocks += ready
            blocks += fold.conditioner.finish(filters)[1]
            self._filtered = {basis: [block for block in blocks if len(block.rows)]}
        return self._filtered[basis]

    def _with_setpoint_pieces(self, best: _Tried) -> _Tried:
        if self._plain.solver.constant or best.basis.setpoint_order == 1 or best.basis.setpoint_knots:
            return best
        setpoint = self._signals.roles.get("setpoint", np.zeros(0))
        if not (borders := setpoint_borders(setpoint, SHAPE.setpoint_knots)):
            return best
        pieces = self._tried(replace(best.basis, setpoint_knots=borders))
        return pieces if pieces.is_needed_after(best) else best

    def _with_corners(self, best: _Tried, spline: PolynomialBasis) -> _Tried:
        """Return the spline with corners, if it is needed after the best one without."""
        low, high = _range_of_deflection(best.fold, self._signals)
        plain = self._plain.device.basis
        like: Surroundings | None = None

        def ramps(corners: tuple[float, ...]) -> Array:
            nonlocal like
            fold, states = self._collected(replace(plain, corners=corners), (), None)
            # Of the first fit, which has most of them.
            like = like or fold.solver.evidence(states[0]).surroundings
            assert like is not None
            rows = fold.solver.information(states[0], like)
            # Coefficients are of the scaled deflection.
            rows[:, -1 - len(corners) : -1] *= plain.deflection_scale
            return rows

        if not (corners := corners_of(ramps, low, high)):
            return best
        pairs = tuple(at for own in corners for at in (own.below, own.above))
        # Any pair in the range could have been that of a corner.
        choices = sum(math.log(0.5 * (high - low) / own.width) for own in corners)
        cornered = self._tried(replace(spline, corners=pairs), choices=choices)
        return cornered if cornered.is_needed_after(best) else best

    def _with_loops(self, best: _Tried, probable: _Tried, sudden: _Tried) -> _Tried:
        """Return the best one with friction elements, if these are needed after the most probable one without.

        Parameters
        ----------
        best, probable : the best one, and the most probable one
        sudden : a spline with elements that slip at once
        """
        if best.basis.corners == sudden.basis.corners:
            return self._looped(sudden) if sudden.is_needed_after(probable) else best
        cornered = self._tried(best.basis, sudden.fold.equations[0].elements, best.choices)
        if not cornered.is_needed_after(probable):
            return best
        # What looked like a corner may be where an element slips.
        return max(self._looped(cornered), self._looped(sudden), key=lambda own: own.evidence)

    def _looped(self, best: _Tried) -> _Tried:
        """Return the best one of a basis with friction elements, by one with elements that slip at once."""
        if len(self._plain.device.transmissions) > 1:
            smooth = self._tried(best.basis, tuple(Element(slip, 1.0) for slip in self._slips), best.choices)
            return max(best, smooth, key=lambda own: own.evidence)
        short, best = best, self._tried(best.basis, best.fold.equations[0].elements, best.choices, self._long)
        if best.found[0].surroundings is None:
            return short
        others, loops = best.choices, list[Loop]()
        # A polynomial determines a loop more closely than a spline: it is looked for as it will be used.
        basis = self._probable_basis(best)
        looped: _Tried | None = None

        def with_elements(more: Sequence[Loop]) -> _Tried:
            # Any simplex could have been that of a loop.
            choices = others + sum(own.choices(self._slips) for own in more)
            return self._tried(basis, elements_of(more), choices, self._long)

        def strains(elements: tuple[Element, ...]) -> Array:
            like = best if looped is None else max(best, looped, key=lambda own: own.evidence)
            fold, states = self._collected(basis, elements, self._long)
            rows = fold.solver.information(states[0], like.surroundings)
            if like.basis != basis:
                return rows
            deviations = like.surroundings.deviations
            before = np.zeros((deviations.size, rows.shape[1]))
            np.fill_diagonal(before[:, -1 - len(elements) - deviations.size :], 1.0 / deviations)
            return np.vstack((rows, before))

        # One loop alone may be less than nine elements are, where there are several.
        while len(more := with_another(strains, self._slips, loops)) > len(loops):
            better = with_elements(more)
            if looped is not None and not better.is_needed_after(looped):
                break
            looped, loops = better, more
            # What the noise was taken for had the misfit of the fit before in it.
            while more := refined(strains, self._slips, loops):
                if (better := with_elements(more)).evidence - looped.evidence <= SHAPE.gain:
                    break
                looped, loops = better, more
        return best if looped is None else max(best, looped, key=lambda own: own.evidence)


def _is_curve(fold: ShapedFold) -> bool:
    """Return whether a torque is a function of one deflection alone, of which no corner is known."""
    basis = fold.device.basis
    return len(fold.device.transmissions) == 1 and not (basis.has_setpoint or basis.branches or basis.corners)


def _range_of_deflection(fold: ShapedFold, signals: JointSignals) -> tuple[float, float]:
    """Return the deflections between which nearly all of a log is [rad]."""
    phi = deflection_of(signals.roles, fold.device.transmissions[0])
    low, high = np.nanquantile(phi, (SHAPE.beyond, 1.0 - SHAPE.beyond))
    return float(low), float(high)
