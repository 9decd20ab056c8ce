"""Preprocessing between a joint's raw signals and an estimator: the pair of filters of Flacco 2014 §VI, or one of them.

Three settings, all folds over blocks:

- ``kinematic``: causal. Positions and velocities by the MKKF, torques as they are.
- ``pair``: causal output. The data to fit pass through one and the same Savitzky–Golay filter, late by half a window;
  the stiffness is evaluated at the MKKF's present deflection (Flacco 2014 eq. 30).
- ``savitzky-golay``: non-causal. Both come from the Savitzky–Golay filter; the output is late by half a window and belongs to
  the window's centre. Its derivatives may be those of the filtered signal itself (`derivative_weights.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import FilterError
from vsalog.core.signals import LONGER, JointSignals
from vsalog.filters.derivative_weights import derivative_polynomials, derivative_weights
from vsalog.filters.kinematic import KinematicSettings, kinematic_filter
from vsalog.filters.savitzky_golay import (
    Polynomials,
    filter_together,
    samples_of,
    savgol_lag,
    savgol_polynomials,
    savgol_weights,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
FilterName = Literal["kinematic", "pair", "savitzky-golay"]


@dataclass(frozen=True, slots=True)
class Conditioned:
    """Filtered signals of one block, never across a gap.

    Attributes
    ----------
    rows : the samples the output belongs to (their stamps, times and runs)
    fit : role → values to fit; also ``velocity:ROLE`` and ``acceleration:ROLE`` of the motor positions, and the velocity
        of others asked for
    now : role → values to evaluate at (positions, deflections and the set-point)
    use : shape (N,), where every value to fit is there and the filters have settled
    loading_fit, loading_now : transmission → shape (N,), whether it is being loaded; empty where not asked for
    """

    rows: JointSignals
    fit: Mapping[str, Array]
    now: Mapping[str, Array]
    use: Flags
    loading_fit: Mapping[str, Flags] = field(default_factory=dict)
    loading_now: Mapping[str, Flags] = field(default_factory=dict)


class Preparation(Protocol):
    """A fold that the signals go through before they are filtered, and that may hold samples back."""

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles that it adds."""

    def start(self) -> Any:
        """Return the state before the first sample."""

    def step(self, state: Any, block: JointSignals) -> tuple[Any, list[JointSignals]]:
        """Take a block; give the new state and what is ready."""

    def finish(self, state: Any) -> tuple[Any, list[JointSignals]]:
        """Give out what is held back."""


@dataclass(slots=True)
class ConditionerState:
    """Filter states of the run in progress, the samples still inside the window, and the state of the preparation."""

    kalman: dict[str, Array] = field(default_factory=dict)
    seen: int = 0
    tail: JointSignals | None = None
    tail_kalman: dict[str, Array] = field(default_factory=dict)
    prepared: Any = None


class Conditioner:
    """Filter the roles of a joint, block by block.

    Parameters
    ----------
    roles : the roles to filter
    signals : a block or the whole, for its period and the sensors' resolutions
    kind : which filters
    window : of the Savitzky–Golay filter [s]
    degree : of the Savitzky–Golay filter
    shape : α of the MKKF (Flacco 2012 eq. 20)
    settle : time the MKKF is given after a start before its output is used [s]
    rates : other positions and deflections whose velocity is wanted
    before : what the signals go through first; the roles it adds are filtered like torques
    present : whether values to evaluate at are wanted too; without them `now` is empty, and only ``savitzky-golay`` works
    exact : whether derivatives are those of the filtered signal, so that a linear equation stays true however fast a motion is;
        then all rates come with an acceleration
    near : window of the Savitzky–Golay filter of values to evaluate at, no longer than `window` [s]; those to fit without

    Raises
    ------
    FilterError
        The window is too long, or the degree does not fit it.
    """

    def __init__(
        self,
        roles: tuple[str, ...],
        signals: JointSignals,
        kind: FilterName,
        *,
        window: float = 1.0,
        degree: int = 20,
        shape: float = 6.0,
        settle: float | None = None,
        rates: tuple[str, ...] = (),
        before: Preparation | None = None,
        present: bool = True,
        exact: bool = False,
        near: float | None = None,
    ) -> None:
        self.kind, self.given, self.exact = kind, roles, exact and kind != "kinematic"
        self._prepare(before)
        self.period = signals.period
        self.motor_roles = tuple(r for r in roles if r.startswith("motor_position"))
        self.rated = {*self.motor_roles, *rates}
        self.accelerated = self.rated if self.exact else set(self.motor_roles)
        self.moving = tuple(r for r in roles if "torque" not in r and present)
        self.settings = {
            role: KinematicSettings.for_resolution(signals.resolution.get(role, 0.0), self.period, shape)
            for role in self.moving
        }
        self.settle = 100 if settle is None else round(settle / self.period)
        self.window = 2 * round(0.5 * window / self.period) + 1
        if kind != "kinematic":
            self.window = samples_of(window, self.period, degree)
            if self.exact:
                self.weights = derivative_weights(self.window, degree, 2, self.period)
                self.polynomials = derivative_polynomials(self.window, degree, 2)
            else:
                self.weights = savgol_weights(self.window, degree, 2, self.period)
                self.polynomials = savgol_polynomials(self.window, degree)
        self.near = None
        if near is not None and kind == "savitzky-golay":
            samples = 2 * round(0.5 * near / self.period) + 1
            self.near = savgol_weights(samples, degree), savgol_polynomials(samples, degree)

    def _prepare(self, before: Preparation | None) -> None:
        self.before, self.roles = before, self.given if before is None else (*self.given, *before.roles)

    def behind(self, before: Preparation | None) -> Conditioner:
        """Return the same filters with another preparation."""
        other = copy(self)
        other._prepare(before)
        return other

    def check_length(self, longest_run: int) -> None:
        """Refuse a log in which no run is long enough for the filter.

        Raises
        ------
        FilterError
            The filter would never produce a sample.
        """
        needed = self.window if self.kind != "kinematic" else self.settle + 1
        if longest_run < needed:
            raise FilterError(
                f"the longest stretch without a gap has {longest_run} samples, but the {self.kind} filter needs"
                f" {needed:.6g} ({needed * self.period:.3g} s); {LONGER}, or shorten it with --tune"
                f" {'window' if self.kind != 'kinematic' else 'settle'}=SECONDS"
            )

    def start(self) -> ConditionerState:
        """Return the state before the first sample."""
        return ConditionerState(prepared=None if self.before is None else self.before.start())

    def step(self, state: ConditionerState, block: JointSignals) -> tuple[ConditionerState, list[Conditioned]]:
        """Filter a block; the output may belong to earlier samples and be shorter or longer than the block."""
        if self.before is None:
            return self._filter(state, [block])
        prepared, blocks = self.before.step(state.prepared, block)
        state, out = self._filter(state, blocks)
        return replace(state, prepared=prepared), out

    def finish(self, state: ConditionerState) -> tuple[ConditionerState, list[Conditioned]]:
        """Give out what is still inside the window."""
        out: list[Conditioned] = []
        if self.before is not None:
            state, out = self._filter(state, self.before.finish(state.prepared)[1])
        return self.start(), [*out, *self._flush(state)]

    def _filter(
        self, state: ConditionerState, blocks: list[JointSignals]
    ) -> tuple[ConditionerState, list[Conditioned]]:
        out: list[Conditioned] = []
        for piece in (piece for block in blocks for piece in block.between_gaps()):
            if piece.starts[0]:
                out += self._flush(state)
                state = ConditionerState()
            state, conditioned = self._within_run(state, piece)
            out.append(conditioned)
        return state, out

    def _within_run(self, state: ConditionerState, piece: JointSignals) -> tuple[ConditionerState, Conditioned]:
        states = dict(state.kalman)
        kalman: dict[str, Array] = {}
        for role in self.moving:
            raw = piece.roles[role]
            position, velocity, states[role] = kinematic_filter(raw, self.period, self.settings[role], states.get(role))
            # The filter goes on over a missing sample, but its prediction there is no measurement.
            kalman[role] = np.where(np.isnan(raw), np.nan, position)
            if role in self.rated:
                kalman[f"velocity:{role}"] = velocity
        seen = state.seen + len(piece)
        if self.kind == "kinematic":
            fit = {**kalman, **{r: piece.roles[r] for r in self.roles if r not in self.moving}}
            index = np.arange(state.seen, seen)
            use = _complete({r: piece.roles[r] for r in self.roles}) & (index >= self.settle)
            now = {r: kalman[r] for r in self.moving}
            return ConditionerState(states, seen), Conditioned(piece, fit, now, use)
        joined = piece if state.tail is None else state.tail.joined(piece)
        joined_kalman = {
            r: np.concatenate((state.tail_kalman[r], kalman[r])) if r in state.tail_kalman else kalman[r]
            for r in self.moving
        }
        smooth = self._smooth(joined)
        keep = max(len(joined) - self.window + 1, 0)
        new = ConditionerState(states, seen, joined[keep:], {r: v[keep:].copy() for r, v in joined_kalman.items()})
        if self.kind == "pair":
            fit = {r: _at_end(v, len(piece)) for r, v in smooth.items()}
            now = {r: kalman[r] for r in self.moving}
            return new, Conditioned(piece, fit, now, _complete(fit))
        return new, self._centred(joined, joined_kalman, smooth, state.seen, seen)

    def _smooth(self, joined: JointSignals) -> dict[str, Array]:
        orders = {role: 2 if role in self.accelerated else int(role in self.rated) for role in self.roles}
        channels = {role: joined.roles[role] for role in self.roles}
        smooth: dict[str, Array] = {}
        for role, values in filter_together(channels, orders, self.weights, self.polynomials).items():
            names = role, f"velocity:{role}", f"acceleration:{role}"
            smooth |= dict(zip(names, values, strict=False))
        return smooth

    def _centred(
        self, joined: JointSignals, kalman: dict[str, Array], smooth: dict[str, Array], before: int, seen: int
    ) -> Conditioned:
        """Give out the rows whose window is now complete, and at a run's beginning those that never have one."""
        lag = savgol_lag(self.window)
        first, last = max(before - lag, 0), max(seen - lag, 0)
        offset = seen - len(joined)  # index within the run of joined's first sample
        rows = slice(first - offset, last - offset)
        fit = {r: _at_end(v, last - first) for r, v in smooth.items()}
        use = _complete(fit)
        near = fit if self.near is None else {r: v[rows] for r, v in self._nearby(joined, *self.near).items()}
        now = {r: np.where(np.isfinite(near[r]), near[r], kalman[r][rows]) for r in self.moving}
        return Conditioned(joined[rows], fit, now, use)

    def _nearby(self, joined: JointSignals, weights: Array, polynomials: Polynomials) -> dict[str, Array]:
        """Return the values to evaluate at of each sample of `joined`, NaN where their window is not whole."""
        channels, half = {role: joined.roles[role] for role in self.moving}, weights.shape[1] // 2
        found = filter_together(channels, dict.fromkeys(channels, 0), weights, polynomials)
        nothing = np.full(half, np.nan)
        # A run may be shorter than the window.
        return {role: _at_end(np.concatenate((nothing, v[0], nothing)), len(joined)) for role, v in found.items()}

    def _flush(self, state: ConditionerState) -> list[Conditioned]:
        if self.kind != "savitzky-golay" or state.tail is None:
            return []
        pending = min(savgol_lag(self.window), state.seen)
        rows = state.tail[len(state.tail) - pending :]
        nothing = np.full(pending, np.nan)
        names = [*self.roles, *(f"velocity:{r}" for r in self.rated), *(f"acceleration:{r}" for r in self.accelerated)]
        now = {r: v[len(state.tail) - pending :] for r, v in state.tail_kalman.items()}
        if self.near is not None:
            near = {r: v[len(state.tail) - pending :] for r, v in self._nearby(state.tail, *self.near).items()}
            now = {r: np.where(np.isfinite(near[r]), near[r], now[r]) for r in self.moving}
        return [Conditioned(rows, dict.fromkeys(names, nothing), now, np.zeros(pending, dtype=np.bool_))]


def _complete(values: Mapping[str, Array]) -> Flags:
    use: Flags | None = None
    for v in values.values():
        finite = np.isfinite(v)
        use = finite if use is None else use & finite
    if use is None:
        raise FilterError("there is no signal to filter")
    return use


def _at_end(values: Array, length: int) -> Array:
    """Return `length` values that end with `values`, NaN in front where there are fewer."""
    if values.shape[0] >= length:
        return values[values.shape[0] - length :]
    return np.concatenate((np.full(length - values.shape[0], np.nan), values))
