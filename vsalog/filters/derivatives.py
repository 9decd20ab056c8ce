"""Values and derivatives of signals by one filter: a fold over blocks, late by half a window.

Whatever is a sum of such derivatives has passed through one and the same filter: no term is late against the others, or smaller.
Rates alone come from the Savitzky–Golay filter, which leaves less noise for its window; where higher derivatives are compared
with them, all come from `derivative_weights`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import FilterError
from vsalog.core.signals import LONGER, JointSignals
from vsalog.filters.conditioning import Preparation
from vsalog.filters.derivative_weights import derivative_polynomials, derivative_weights
from vsalog.filters.savitzky_golay import filter_together, samples_of, savgol_lag, savgol_polynomials, savgol_weights

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Differentiated:
    """One block, never across a gap.

    Attributes
    ----------
    rows : the samples the output belongs to, as they went into the filter
    of : role → shape (order + 1, N), value and derivatives [SI, per s each]; NaN where the window does not determine it
    """

    rows: JointSignals
    of: Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class DerivativesState:
    """Samples of the run so far, those that windows to come still need, and the state of the preparation."""

    seen: int = 0
    tail: JointSignals | None = None
    prepared: Any = None


class Derivatives:
    """The filter.

    Parameters
    ----------
    orders : role → highest derivative wanted
    period : T [s]
    window : of the filter [s]
    degree : of its polynomial
    before : what the signals go through first

    Raises
    ------
    FilterError
        The window is too long, or too short for the degree.
    """

    def __init__(
        self, orders: Mapping[str, int], period: float, window: float, degree: int, before: Preparation | None = None
    ) -> None:
        self.orders, self.period, self.before = dict(orders), period, before
        self.window = samples_of(window, period, degree)
        highest = max(orders.values(), default=0)
        if highest <= 1:
            self.weights = savgol_weights(self.window, degree, highest, period)
            self.polynomials = savgol_polynomials(self.window, degree)
        else:
            self.weights = derivative_weights(self.window, degree, highest, period)
            self.polynomials = derivative_polynomials(self.window, degree, highest)

    def check_length(self, longest: int) -> None:
        """Refuse a log in which no run is long enough for the filter.

        Raises
        ------
        FilterError
            The filter would never produce a sample.
        """
        if longest < self.window:
            raise FilterError(
                f"the longest stretch without a gap has {longest} samples, but the savitzky-golay filter needs"
                f" {self.window} ({self.window * self.period:.3g} s); {LONGER}, or shorten it with --tune window=SECONDS"
            )

    def whole(self, signals: JointSignals) -> Differentiated:
        """Filter a whole log at once, gaps included.

        Raises
        ------
        FilterError
            No run is long enough for the filter.
        """
        self.check_length(signals.longest_run)
        state, parts = self.step(self.start(), signals)
        parts += self.finish(state)[1]
        rows = parts[0].rows
        for part in parts[1:]:
            rows = rows.joined(part.rows)
        return Differentiated(rows, {r: np.concatenate([p.of[r] for p in parts], axis=1) for r in self.orders})

    def start(self) -> DerivativesState:
        """Return the state before the first sample."""
        return DerivativesState(prepared=None if self.before is None else self.before.start())

    def step(self, state: DerivativesState, block: JointSignals) -> tuple[DerivativesState, list[Differentiated]]:
        """Take a block; give the new state and the rows whose windows are complete."""
        if self.before is None:
            return self._filter(state, [block])
        prepared, blocks = self.before.step(state.prepared, block)
        state, out = self._filter(state, blocks)
        return replace(state, prepared=prepared), out

    def finish(self, state: DerivativesState) -> tuple[DerivativesState, list[Differentiated]]:
        """Give out the rows that are still held back; they never have a whole window."""
        out: list[Differentiated] = []
        if self.before is not None:
            state, out = self._filter(state, self.before.finish(state.prepared)[1])
        return self.start(), [*out, *self._flush(state)]

    def _filter(
        self, state: DerivativesState, blocks: list[JointSignals]
    ) -> tuple[DerivativesState, list[Differentiated]]:
        out: list[Differentiated] = []
        for piece in (piece for block in blocks for piece in block.between_gaps()):
            if piece.starts[0]:
                out += self._flush(state)
                state = DerivativesState()
            state, found = self._within_run(state, piece)
            out.append(found)
        return state, out

    def _within_run(self, state: DerivativesState, piece: JointSignals) -> tuple[DerivativesState, Differentiated]:
        joined = piece if state.tail is None else state.tail.joined(piece)
        seen, lag = state.seen + len(piece), savgol_lag(self.window)
        first, last = max(state.seen - lag, 0), max(seen - lag, 0)
        offset = seen - len(joined)  # index within the run of joined's first sample
        channels = {role: joined.roles[role] for role in self.orders}
        filtered = filter_together(channels, self.orders, self.weights, self.polynomials)
        of = {role: _at_end(values, last - first) for role, values in filtered.items()}
        kept = joined[max(len(joined) - self.window + 1, 0) :]
        return DerivativesState(seen, kept), Differentiated(joined[first - offset : last - offset], of)

    def _flush(self, state: DerivativesState) -> list[Differentiated]:
        if state.tail is None:
            return []
        pending = min(savgol_lag(self.window), state.seen)
        nothing = {role: np.full((order + 1, pending), np.nan) for role, order in self.orders.items()}
        return [Differentiated(state.tail[len(state.tail) - pending :], nothing)]


def _at_end(values: Array, length: int) -> Array:
    """Return `length` columns that end with those of `values`, NaN in front where there are fewer."""
    missing = max(length - values.shape[1], 0)
    return np.concatenate(
        (np.full((values.shape[0], missing), np.nan), values[:, values.shape[1] - (length - missing) :]), axis=1
    )
