"""The fold of the methods that follow a stiffness by the observer of Grioli and Bicchi, wherever their torque comes from.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011) §II-A, eq. 4–7 and 13: the observer's gain by how well it predicts, its
uncertainty by the residual of its predictions, its columns in the trace.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.averaging_error import AveragingError, averaging_error
from vsalog.estimators.device import Device, spread
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.screening import Screening
from vsalog.estimators.state_observer import Columns, StateObserver, state_columns
from vsalog.estimators.torque_rates import Rates, prediction_error, typical_speed
from vsalog.estimators.transmission_torque import TransmissionTorque
from vsalog.estimators.tuning import Positive, Tuning
from vsalog.filters.derivatives import Derivatives, DerivativesState, Differentiated
from vsalog.filters.stiffness_observer import observe_stiffness, observer_start

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
T = TypeVar("T", float, Array)

# Memories of the observer that are tried where no gain is asked for [s].
MEMORIES = tuple(np.geomspace(0.003, 3.0, 13).tolist())
# Radians that the noise of rates turns within a filter's window [rad]: of its derivative of first order, nearly a turn.
SWINGS = 6.0
# Estimates count when this share of the memory is filled [1].
FILLED_MEMORY = 0.95


class ObserverTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of the methods that follow a stiffness.

    Attributes
    ----------
    alpha : gain α of the stiffness observer [1/rad]; when absent the one whose estimate up to a filter's window
        before predicts the present torque's rate best
    derivative : ``filter`` takes rates from the Savitzky–Golay filter, ``difference`` from one sample to the next (Serio 2011
        eq. 15), which is noisy
    """

    alpha: Positive | None = None
    derivative: Literal["filter", "difference"] = "filter"

    def __post_init__(self) -> None:
        if self.filter != "savitzky-golay":
            raise ValueError("rates come from the Savitzky–Golay filter; derivative=difference is causal")

    def window_for(self, signals: JointSignals) -> float:
        """Return the filter's window [s]."""
        return self.window if self.window is not None else (self.default_window - 1) * signals.period


class Observers(NamedTuple):
    """Of one transmission: the observer, one twice as fast, and the speed and the time that it remembers, observed alike."""

    slow: Array
    fast: Array
    speed: Array
    when: Array


@dataclass(slots=True)
class ObserverState:
    """State of the fold: of the filters, of each transmission's observers, the last sample's torque and deflection, and what else
    a method estimates.
    """

    filters: DerivativesState
    observers: dict[str, Observers]
    last: dict[str, tuple[float, float]] = field(default_factory=dict)
    further: Any = None


class ObserverFold(StateObserver):
    """The observer of each transmission as an estimator: a fold over blocks of signals that gives a trace.

    Parameters
    ----------
    name, modality : of the method
    device : of the joint
    signals : the whole log, from which the gain is derived
    tuning : of the method
    torques : of each transmission
    conditioner : gives the derivatives these need
    look : findings about the log before the first sample

    Raises
    ------
    EstimatorError
        The deflection never changes.
    """

    def __init__(
        self, name: str, modality: str, device: Device, signals: JointSignals, tuning: ObserverTuning,
        torques: Sequence[TransmissionTorque], conditioner: Derivatives, look: Screening,
    ) -> None:  # fmt: skip
        self.name, self.modality, self.device, self.period, self.tuning = name, modality, device, signals.period, tuning
        self.torques, self.conditioner = torques, conditioner
        self.difference = signals.period if tuning.derivative == "difference" else None
        self.look = look
        whole = conditioner.whole(signals)
        filtered = [Rates(t.rate(whole.of), t.deflection(whole.of, 1)) for t in torques]
        speed = typical_speed(device, filtered)
        self.alpha = tuning.alpha if tuning.alpha is not None else self._best_alpha(filtered, speed)
        self.rate_noise = {t.view.name: t.rate_noise(signals, conditioner.weights, self.difference) for t in torques}
        self.swing = np.pi * max(spread(t.deflection(whole.of, 0)) for t in torques) / speed
        self.averages = self._averages_of(whole, speed)
        # Change of the stiffness with a shorter window, where a method looks at that [N·m/rad].
        self.smoothed_away = 0.0

    @property
    def derived(self) -> dict[str, float]:
        """The gain and the uncertainty's parts that were derived from the log."""
        seen = self.averages.values()
        within = np.hypot(max(a.within for a in seen), self.smoothed_away)
        return {"alpha": self.alpha, "alike": max(a.alike for a in seen), "within": float(within)}

    def start(self) -> ObserverState:
        """Return the state before the first sample."""
        observers = {t.view.name: Observers(*(observer_start() for _ in Observers._fields)) for t in self.torques}
        return ObserverState(self.conditioner.start(), observers, further=self.start_further())

    def step(self, state: ObserverState, block: JointSignals) -> tuple[ObserverState, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""
        return self._follow(state, *self.conditioner.step(state.filters, block))

    def finish(self, state: ObserverState) -> tuple[ObserverState, list[Trace]]:
        """Give out the rows that are still held back."""
        return self._follow(state, *self.conditioner.finish(state.filters))

    def findings(self, state: ObserverState) -> tuple[Finding, ...]:
        """Return the findings about the estimate."""
        return self.look.findings

    def start_further(self) -> Any:
        """Return the state, before the first sample, of what a method estimates in addition to the stiffness."""
        return None

    def block_further(self, further: Any, rows: JointSignals, begins: bool) -> tuple[Any, Columns]:
        """Estimate what a method does in addition to the stiffness; return its new state and the columns it adds to the total.

        Parameters
        ----------
        further : of `start_further` or the block before
        rows : as they went into the filters, never across a gap
        begins : whether a run begins with them
        """
        return further, {}

    def _follow(
        self, state: ObserverState, filters: DerivativesState, ready: list[Differentiated]
    ) -> tuple[ObserverState, list[Trace]]:
        new = ObserverState(filters, dict(state.observers), dict(state.last), state.further)
        return new, [self._trace(new, part) for part in ready]

    def _trace(self, state: ObserverState, part: Differentiated) -> Trace:
        begins = len(part.rows) > 0 and bool(part.rows.starts[0])
        if begins:
            state.last = {}
        parts = {t.view.name: self._observed(state, part, t) for t in self.torques}
        state.further, more = self.block_further(state.further, part.rows, begins)
        parts["total"] = {**total_columns(list(parts.values())), **more}
        return Trace.of_rows(part.rows, parts)

    def _observed(self, state: ObserverState, part: Differentiated, borne: TransmissionTorque) -> Columns:
        name, rates = borne.view.name, self._rates(state, part, borne)
        before, use = state.observers[name], rates.use
        stiffness, deviation, learnt, slow = observe_stiffness(before.slow, *rates, use, self.alpha, self.period)
        quick, _, _, fast = observe_stiffness(before.fast, *rates, use, 2.0 * self.alpha, self.period)
        # With a torque whose rate is |φ̇| φ̇, or t φ̇, it remembers |φ̇|, or the time of its data.
        rate = rates.deflection
        speed, _, _, speeds = observe_stiffness(before.speed, np.abs(rate) * rate, rate, use, self.alpha, self.period)
        when, _, _, times = observe_stiffness(before.when, part.rows.time * rate, rate, use, self.alpha, self.period)
        state.observers[name] = Observers(slow, fast, speeds, times)
        # An observer is late; one that is half as late is between it and the truth. And it averages over whole swings.
        late, noise, average = quick - stiffness, self.rate_noise[name], self.averages[name]
        phi = borne.deflection(part.of, 0)
        learning = np.maximum(deviation**2 * average.alike, self._least_variance(noise.left(stiffness), speed))
        age = np.abs(part.rows.time - when)
        missed = average.square(phi) + (average.drift * age / self.period) ** 2 + self.smoothed_away**2
        std = np.sqrt(learning + late**2 + (noise.bias(stiffness) / speed**2) ** 2 + missed)
        # A gain beyond all numbers leaves no variance at all, which is no certainty.
        std[std == 0.0] = np.nan
        supported = use & (learnt >= FILLED_MEMORY) & (age <= self._stale(speed)) & (name not in self.look.blind)
        return state_columns(phi, borne.torque(part.of), stiffness, std, supported)

    def _stale(self, speed: T) -> T:
        """Return the age at which an estimate at a speed is out of date [s].

        Hardly any of it is in memory by then, and the deflection has swung to and fro once more.
        """
        return -math.log(NEGLIGIBLE_SHARE) / (self.alpha * speed) + self.swing

    def _least_variance(self, noise: Array, speed: Array) -> Array:
        """Return the least noise of a stiffness from the noise of the rates.

        Within a window it swings to and fro, and its sum over a longer memory cancels.
        """
        swings = SWINGS / (self.alpha * speed * self.conditioner.window * self.period)
        return noise / speed**2 / (1.0 + swings**2)

    def _rates(self, state: ObserverState, part: Differentiated, borne: TransmissionTorque) -> Rates:
        if self.difference is None:
            return Rates(borne.rate(part.of), borne.deflection(part.of, 1))
        samples = borne.samples(part)
        before = state.last.get(borne.view.name, (np.nan, np.nan))
        if len(part.rows):
            state.last[borne.view.name] = float(samples[0][-1]), float(samples[1][-1])
        return Rates(*(np.diff(v, prepend=b) / self.period for v, b in zip(samples, before, strict=True)))

    def _best_alpha(self, rates: Iterable[Rates], speed: float) -> float:
        """Return the gain of the observer that predicts best: a long memory averages noise, a short one follows the stiffness."""
        shortest = self.conditioner.window * self.period / SWINGS
        memories = [memory for memory in MEMORIES if memory >= shortest] or [shortest]
        off = np.zeros(len(memories))
        for known in rates:
            for i, memory in enumerate(memories):
                found = observe_stiffness(observer_start(), *known, known.use, 1.0 / (memory * speed), self.period)[0]
                off[i] += prediction_error(known, found, self.conditioner.window)
        return float(1.0 / (memories[int(np.argmin(off))] * speed))

    def _averages_of(self, whole: Differentiated, speed: float) -> dict[str, AveragingError]:
        """Return the residual of each transmission's observer on a whole log."""
        seen: dict[str, AveragingError] = {}
        for borne in self.torques:
            known = Rates(borne.rate(whole.of), borne.deflection(whole.of, 1))
            if self.difference is not None:
                known = Rates(*(np.diff(v, prepend=np.nan) / self.period for v in borne.samples(whole)))
            phi, known = borne.deflection(whole.of, 0)[known.use], Rates(*(v[known.use] for v in known))
            found = observe_stiffness(observer_start(), *known, known.use, self.alpha, self.period)[0]
            if SWINGS / (self.alpha * speed) < self.conditioner.window * self.period:
                # It follows every swing of the noise without a residual: that counts of its estimate a window before.
                ahead = self.conditioner.window
                phi, known, found = phi[ahead:], Rates(*(v[ahead:] for v in known)), found[:-ahead]
            typical = float(np.nanmedian(found)) if np.isfinite(found).any() else 0.0
            noise = float(self.rate_noise[borne.view.name].left(typical)) ** 0.5
            lag = round(min(self._stale(speed) / self.period, phi.size))
            memory = round(min(1.0 / (self.alpha * speed * self.period), phi.size))
            seen[borne.view.name] = averaging_error(phi, known, found, noise, lag, memory)
        return seen


def total_columns(parts: Sequence[Mapping[str, NDArray[Any]]]) -> Columns:
    """The device's: torques and stiffnesses add up (Flacco 2012 eq. 9–10), standard deviations in squares."""
    if len(parts) == 1:
        return dict(parts[0])
    torque, stiffness = (np.sum([p[name] for p in parts], axis=0) for name in ("flexibility_torque", "stiffness"))
    std = np.sqrt(np.sum([p["stiffness_std"] ** 2 for p in parts], axis=0))
    excited = np.logical_and.reduce([p["excited"] for p in parts])
    nothing = np.full(torque.shape, np.nan)  # of two deflections neither is the joint's
    return state_columns(nothing, torque, stiffness, std, excited)
