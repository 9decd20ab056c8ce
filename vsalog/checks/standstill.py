"""Whether an encoder that stands still for a while, as the other one moves, was stuck, judged by the torque.

A motor that is held stands still, too, and then the spring deflects. The spring as the rest of the log shows it separates both
cases: where the deflection is true, it predicts the torque. Where it predicts the torque of that stretch worse than a constant
does, and the error is larger than the rest of the log makes likely for one more stretch, the deflection is not true. A single
event is no mean of blocks; it is compared with the distribution of the others (a prediction interval; of logarithms, since the
noise is non-stationary).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context
from vsalog.checks.encoder import Standstill, standstills
from vsalog.checks.residual import basis_rows
from vsalog.checks.samples import with_both_positions
from vsalog.core.dependence import LEAST_BLOCKS, least_squares, one_more_above
from vsalog.core.finding import Finding
from vsalog.core.resolution import ENOUGH
from vsalog.core.significance import FALSE_ALARM
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, deflection_of
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.row_moments import RowMoments, row_moments_block, row_moments_start

Array = NDArray[np.float64]


class StandstillOfEncoder:
    """Checks stretches in which one encoder of a spring stands still and the other one moves."""

    name = "standstill"
    supersedes: Mapping[str, Sequence[str]] = {}

    def start(self, context: Context) -> Standstills | None:
        """Find the stretch of each spring in which the other encoder moves farthest; None where none stands still."""
        signals, found = context.signals, dict[str, Standstill]()
        for block in signals.blocks(ENOUGH):
            for view in with_both_positions(context.device, block):
                own = [s for s in standstills(block, view) if s.moved <= s.spring]
                own += [found[view.name]] if view.name in found else []
                if own:
                    found[view.name] = max(own, key=lambda s: s.moved)
        stretches = {}
        for view in context.device.transmissions:
            if view.name in found:
                phi = deflection_of(context.look.roles, view)[~found[view.name].holds(context.look.stamps)]
                stretches[view.name] = _Stretch(found[view.name], (float(np.nanmin(phi)), float(np.nanmax(phi))))
        filtered = round(context.fold.conditioner.window * signals.period * 1e9)
        return Standstills(context.device, stretches, filtered) if stretches else None


@dataclass(slots=True)
class _Stretch:
    """A stretch, and moments of 1, the basis' functions and the torque within it and elsewhere.

    Attributes
    ----------
    standstill : what is known of it
    known : range of deflections in which the spring is fitted elsewhere [rad]; others do not count
    within, elsewhere : moments
    """

    standstill: Standstill
    known: tuple[float, float]
    within: RowMoments | None = None
    elsewhere: RowMoments | None = None


class Standstills:
    """The torque of a joint's springs while one of their encoders stands still.

    Parameters
    ----------
    device : of the joint
    stretches : by transmission
    filtered : window of the filter before [ns]: a stretch's ends, where an encoder may jump, do not count
    """

    def __init__(self, device: Device, stretches: Mapping[str, _Stretch], filtered: int) -> None:
        self.device, self.stretches, self.filtered = device, stretches, filtered

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        for name, stretch in self.stretches.items():
            for begin in range(0, len(trace) if name in trace.transmissions else 0, BLOCK):
                self._add(stretch, trace.transmissions[name], trace.stamps, slice(begin, begin + BLOCK))

    def _add(
        self, stretch: _Stretch, columns: Mapping[str, NDArray[np.generic]], stamps: NDArray[np.int64], part: slice
    ) -> None:
        phi, torque = (np.asarray(columns[c], float)[part] for c in ("deflection", "flexibility_torque"))
        z = np.column_stack((np.ones_like(phi), basis_rows(self.device.basis, columns, part), torque))
        held, near = (stretch.standstill.holds(stamps[part], n * self.filtered) for n in (-1, 1))
        low, high = stretch.known
        within, elsewhere = (m or row_moments_start(z.shape[1]) for m in (stretch.within, stretch.elsewhere))
        none = np.zeros_like(held)
        stretch.within = row_moments_block(within, z, held & (phi >= low) & (phi <= high), none, 1)
        stretch.elsewhere = row_moments_block(elsewhere, z, ~near, none, 1)

    def findings(self) -> list[Finding]:
        """Return which encoders were stuck."""
        stuck = (s.standstill for s in self.stretches.values() if _untrue(s) * len(self.stretches) <= FALSE_ALARM)
        return [s.finding(self.device.joint, s.enough) for s in stuck]


def _untrue(stretch: _Stretch) -> float:
    """Return the probability that the spring of the rest of the log predicts so badly by chance."""
    if stretch.within is None or stretch.elsewhere is None:
        return 1.0
    within, elsewhere = stretch.within.blocks, stretch.elsewhere.blocks
    if len(within) == 0 or len(elsewhere) < LEAST_BLOCKS:
        return 1.0
    whole = within.sum(axis=0)
    constant, spring = np.zeros((2, len(whole)))
    constant[-1] = spring[-1] = 1.0
    spring[:-1] = -least_squares(elsewhere.sum(axis=0), range(len(whole) - 1))
    usual = _squares(elsewhere, spring) / stretch.elsewhere.sizes
    for error in (constant, spring):
        # The means over the stretch are left out.
        error[0] -= error @ whole[:, 0] / whole[0, 0]
    squares = _squares(within, spring)
    if squares.sum() <= _squares(within, constant).sum():
        return 1.0
    return one_more_above(float(np.mean(np.log(squares / stretch.within.sizes))), np.log(usual))


def _squares(moments: Array, error: Array) -> Array:
    """Return the squares of a combination of columns, shape (K,), in each block, shape (B,)."""
    return np.asarray(np.maximum(np.einsum("i,bij,j->b", error, moments, error), np.finfo(float).tiny))
