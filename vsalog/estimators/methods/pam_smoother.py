"""pam-smoother: a joint of two pneumatic muscles from its pressures alone, each sample by the whole log.

The filter of `pam_ukf` forward (Shin, Ibayashi, Kogiso 2021, eq. 13–24), then the unscented Rauch–Tung–Striebel smoother backward
(Särkkä, IEEE Transactions on Automatic Control 53(3), 2008).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.methods.pam_ukf import OTHERS, PamEstimate, PamFoldState, PamTuning, estimate_of, printed
from vsalog.estimators.methods.pam_ukf import roles as filter_roles
from vsalog.estimators.spool import Spool
from vsalog.estimators.state_observer import StateObserver, Unfiltered
from vsalog.filters.square_root_ukf import UnscentedTrace

__all__ = ["NAME", "SUMMARY", "TUNING", "build", "printed", "roles"]

NAME = "pam-smoother"
SUMMARY = "pam-ukf forward, then a smoother backward: each sample by the whole log (Shin 2021, Särkkä 2008)"
TUNING = PamTuning

# What is stored of a sample: state and factor, inputs until the next, and whether the filter begins or has diverged.
ROW = np.dtype([("x", "f8", (4,)), ("S", "f8", (4, 4)), ("u", "f8", (3,)), ("begins", "?"), ("diverged", "?")])


def roles(device: Device, offered: Collection[str], tuning: PamTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return filter_roles(device, offered, tuning, NAME)


def build(device: Device, signals: JointSignals, tuning: PamTuning) -> PamSmoother:
    """Assemble the smoother for a joint's signals; raises EstimatorError as the filter does."""
    return PamSmoother(estimate_of(NAME, device, signals, tuning, correct=True))


class PamSmootherState(NamedTuple):
    """State of the fold: the filter, the rows put aside, and how many of them have been given out, None while filtering."""

    filtered: PamFoldState
    spool: Spool
    given: int | None = None


class PamSmoother(StateObserver):
    """The smoother as an estimator: it filters and puts aside, smooths that backward, and gives it out the second time."""

    passes = 2
    modality = "STATES"
    conditioner = Unfiltered()

    def __init__(self, filter: PamEstimate) -> None:
        self.filter, self.name, self.device = filter, filter.name, filter.device

    @property
    def derived(self) -> dict[str, float]:
        """The noise that was derived from the log and the rig."""
        return self.filter.derived

    def start(self) -> PamSmootherState:
        """Return the state before the first sample."""
        return PamSmootherState(self.filter.start(), Spool(ROW))

    def step(self, state: PamSmootherState, block: JointSignals) -> tuple[PamSmootherState, list[Trace]]:
        """Take a block of samples; the second time give their trace."""
        filtered, spool, given = state
        traces = []
        for piece in block.between_gaps():
            if given is None:
                filtered, rows = self._put_aside(filtered, piece)
                spool.append(rows)
            else:
                rows = spool.read(given, given + len(piece))
                given += len(piece)
                found = UnscentedTrace(rows["x"], rows["S"], np.empty(0), rows["diverged"])
                filtered, trace = self.filter.traced(filtered, piece, found)
                traces.append(trace)
        return PamSmootherState(filtered, spool, given), traces

    def _put_aside(self, state: PamFoldState, piece: JointSignals) -> tuple[PamFoldState, NDArray[np.void]]:
        rows = np.zeros(len(piece), ROW)
        before = self.filter.before(state, piece)
        rows["begins"][0] = before is not state.filter
        rows["u"] = self.filter.fold.acting(before, len(piece), *(piece.roles.get(role) for role in OTHERS))[0]
        state, found = self.filter.follow(state, piece)
        rows["x"], rows["S"], rows["diverged"] = found.x, found.S, found.diverged
        return state, rows

    def freeze(self, state: PamSmootherState) -> PamSmootherState:
        """Smooth from the last sample to the first, and go back to that."""
        x_next, S_next, informs = np.empty(4), np.empty((4, 4)), False
        for rows in state.spool.backwards():
            x, S, u = (np.ascontiguousarray(rows[name]) for name in ("x", "S", "u"))
            # A sample after a gap, or one at which the filter diverged, has no information on the one before.
            informed = ~(rows["begins"] | rows["diverged"])
            self.filter.fold.smooth(
                x, S, u, np.append(informed[1:], informs) & np.isfinite(x).all(axis=1), x_next, S_next
            )
            x_next, S_next, informs = x[0], S[0], bool(informed[0])
            rows["x"], rows["S"] = x, S
        return state._replace(given=0)

    def findings(self, state: PamSmootherState) -> tuple[Finding, ...]:
        """Return the filter's findings, and where the smoothed angle is not known."""
        return self.filter.findings(state.filtered)
