"""A joint's channels as recorded, passed through one and the same filter, and copies of them with noise like their own.

Every equation is formed from channels that went through the same filter, so that the filter changes both sides of an
equation alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import MOST_RATE_ERROR
from vsalog.core.resolution import noise_of, step_of
from vsalog.core.signals import JointSignals
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights
from vsalog.residuals.memory import remembered

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

DEGREE = 4
"""Of the polynomial that is fitted to each window: its second derivative is a parabola."""
WINDOW = 0.03
"""Seconds of a window: a motion of 10 Hz loses 0.1 % of its second derivative."""
WINDOWS = 5
"""Windows of the filter over which the motion of a sensor that rounds is smoothed: so that its steps average out.

From three on the noise of a sine's derivatives, at up to six steps a sample, is right to 6 %; with one it is 20 to 40 % less.
"""
THIN = 10
"""Samples of a window with which equations are formed."""


@dataclass(frozen=True, slots=True)
class Noise:
    """The error that a sensor adds to the truth: white noise of a standard deviation, then rounding to steps [both SI].

    Attributes
    ----------
    deviation : of the white noise
    step : of the rounding; 0 for none
    share : of the deviation that a sample has; less than 1 where samples are interpolated, see `signals.Interpolated`
    """

    deviation: float
    step: float
    share: float = 1.0

    @property
    def floor(self) -> float:
        """Standard deviation of a sample."""
        return float(np.hypot(self.share * self.deviation, self.step / 12.0**0.5))


@dataclass(frozen=True, slots=True)
class Channels:
    """Filtered channels of a joint.

    Attributes
    ----------
    period : T [s]
    time : shape (N,), from the log's start [s]
    roles : role → value and first and second derivative, shape (3, N), as recorded (SI, nothing of a sensor undone); NaN where
        the filter's window is not whole
    raw : role → shape (N,), before the filter
    starts : shape (N,), where a run begins
    noise : role → of its sensor
    window : of the filter, in samples
    spread : role → standard deviation of its noise after the filter, were it white
    every : of the filtered samples only every n-th is kept
    whole : the channels with all samples; none where these are they
    log : shape (N,), which of several logs each sample is of; none where there is one
    held : of each of several logs, its own sample time over the grid's: for so long its drive held a torque; empty for one log
    """

    period: float
    time: Array
    roles: Mapping[str, Array]
    raw: Mapping[str, Array]
    starts: Flags
    noise: Mapping[str, Noise]
    window: int
    spread: Mapping[str, float]
    every: int = 1
    whole: Channels | None = None
    log: Integers | None = None
    held: tuple[float, ...] = ()

    def __len__(self) -> int:
        return int(self.time.shape[0])

    def thinned(self) -> Channels:
        """Return the channels with as many filtered samples as still resolve their motion: equations are formed so often."""
        every = max(1, self.window // THIN)
        if every == 1:
            return self
        part = slice(None, None, every)
        starts = np.zeros(self.time[part].size, dtype=np.bool_)
        starts[np.minimum(-(-np.flatnonzero(self.starts) // every), starts.size - 1)] = True
        return replace(
            self, period=self.period * every, time=self.time[part], roles={r: v[:, part] for r, v in self.roles.items()},
            raw={r: v[part] for r, v in self.raw.items()}, starts=starts, every=every, whole=self,
            log=None if self.log is None else self.log[part],
        )  # fmt: skip

    def held_at(self, sample: int) -> float:
        """Return for how long a drive held a torque then, over the sample time."""
        return self.held[0 if self.log is None else int(self.log[sample])] if self.held else 1.0

    def in_logs(self) -> list[Channels]:
        """Return the channels of each of several logs, which follow one another."""
        assert self.log is not None
        return self._cut_at(tuple(np.searchsorted(self.log, np.arange(int(self.log[-1]) + 2)).tolist()))

    def _cut_at(self, edges: tuple[int, ...]) -> list[Channels]:
        whole = None if self.whole is None else self.whole._cut_at(tuple(e * self.every for e in edges))
        time, starts = remembered(_pieces, self.time, edges), remembered(_pieces, self.starts, edges)
        roles = {r: remembered(_pieces, v, edges) for r, v in self.roles.items()}
        raw = {r: remembered(_pieces, v, edges) for r, v in self.raw.items()}
        wholes = [None] * (len(edges) - 1) if whole is None else whole
        return [
            replace(
                self, time=time[k], starts=starts[k], log=None, held=self.held[k : k + 1], whole=wholes[k],
                roles={r: v[k] for r, v in roles.items()}, raw={r: v[k] for r, v in raw.items()},
            )
            for k in range(len(edges) - 1)
        ]  # fmt: skip

    def driven_by(self, raw: Mapping[str, Array]) -> Channels:
        """Return the channels with other samples before the filter, and those of what passes no filter after it, too."""
        passed = {r: np.stack([raw[r], v[1], v[2]]) if r.startswith("valve") else v for r, v in self.roles.items()}
        return replace(self, raw=raw, roles=passed)

    @property
    def taps(self) -> Array:
        """The filter's own weights for a value, among the samples that are kept."""
        return np.asarray(savgol_weights(max(DEGREE + 1, round(self.window / self.every) | 1), DEGREE)[0])

    def with_noise(self, seed: int, only: str | None = None) -> Channels:
        """Return the channels with the noise of one more measurement added to what was recorded, filtered.

        The smooth part is taken as the motion; noise is drawn and the sum rounded as the sensor rounds, from where its steps
        happen to be. So the error of an encoder at rest, or moving slowly, is realistic: not white. A motion that is
        smooth over one window only follows the steps of the one measurement, and rounded once more it hardly errs.

        Parameters
        ----------
        seed : of the noise
        only : the role that is measured once more; all when absent
        """
        if self.whole is not None:
            noisy, part = self.whole.with_noise(seed, only), slice(None, None, self.every)
            again = self.roles if only is None else (only,)
            roles, raw = {r: noisy.roles[r][:, part] for r in again}, {r: noisy.raw[r][part] for r in again}
            return replace(self, roles={**self.roles, **roles}, raw={**self.raw, **raw})
        added = {}
        measured = {role: x for role, x in self.raw.items() if only in (None, role)}
        rounded = {role: x for role, x in measured.items() if self.noise[role].step}
        longer = _filtered(rounded, self.starts, self.period, (self.window * WINDOWS) | 1, 0)
        for i, role in enumerate(self.raw):
            if role in measured:
                x, rng = measured[role], np.random.default_rng([seed, i])
                values = _first_known(longer[role][0] if role in longer else x, self.roles[role][0], x)
                added[role] = _sensed(values, self.noise[role], rng) - values
        # The filter is linear: the filtered noise is added, and the motion is not filtered twice.
        filtered = _filtered(added, self.starts, self.period, self.window)
        roles = {role: self.roles[role] + more for role, more in filtered.items()}
        raw = {role: _first_known(self.roles[role][0], x) + added[role] for role, x in measured.items()}
        return replace(self, roles={**self.roles, **roles}, raw={**self.raw, **raw})


def _first_known(*signals: Array) -> Array:
    """Return of several signals, shape (N,) each, the first finite one, at every sample."""
    out = signals[-1]
    for signal in signals[-2::-1]:
        out = np.where(np.isfinite(signal), signal, out)
    return out


def _pieces(values: NDArray[Any], edges: tuple[int, ...]) -> list[NDArray[Any]]:
    """Return the samples, shape (…, N), between edges, as arrays of their own."""
    return [np.ascontiguousarray(values[..., a:b]) for a, b in pairwise(edges)]


def span_of(values: Array) -> float:
    """Return the greatest less the least finite value, 0 where there is none."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def channels_of(signals: JointSignals, several: bool = False) -> Channels:
    """Filter the bound roles of a joint.

    Parameters
    ----------
    signals : bound without undoing what the rig states of the sensors
    several : whether its runs are logs of their own
    """
    period = signals.period
    # Two samples more than a polynomial fits exactly.
    window = max(DEGREE + 3, round(WINDOW / period) | 1)
    raw = {role: np.ascontiguousarray(values) for role, values in signals.roles.items()}
    noise = {role: noise_in(values) for role, values in raw.items()}
    # A command of a few steps was not rounded to them, and a position that is commanded has no noise at all.
    noise |= {role: replace(own, step=0.0) for role, own in noise.items() if role.startswith("valve")}
    noise |= {role: Noise(0.0, 0.0) for role in noise if role.startswith("commanded")}
    noise |= {r: Noise(own.deviation, 0.0, own.share) for r, own in signals.interpolated.items() if r in noise}
    filtered = _filtered(raw, signals.starts, period, window)
    left = float(np.linalg.norm(savgol_weights(window, DEGREE)))
    spread = {role: replace(own, share=1.0).floor * left for role, own in noise.items()}
    log = signals.run.astype(np.int64) if several else None
    held = tuple(own / period if abs(own / period - 1.0) > MOST_RATE_ERROR else 1.0 for own in signals.periods)
    return Channels(
        period,
        signals.time,
        filtered,
        raw,
        signals.starts,
        noise,
        window,
        spread,
        log=log,
        held=held if several else (),
    )


def filtered(values: Array, starts: Flags, period: float, window: int) -> Array:
    """Return value and first and second derivative of a signal, shape (3, N), through the filter that channels pass."""
    return _filtered({"": values}, starts, period, window)[""]


def noise_in(values: Array) -> Noise:
    """Estimate white noise and steps of a channel from its samples."""
    step = step_of(values) or 0.0
    deviation = noise_of(values) or 0.0
    # Rounding alone looks like white noise of a third of a step wherever the signal moves.
    own = 0.0 if deviation < 0.5 * step else max(deviation**2 - step**2 / 12.0, 0.0) ** 0.5
    return Noise(own, step)


def _sensed(values: Array, noise: Noise, rng: np.random.Generator) -> Array:
    reading = values + noise.deviation * rng.standard_normal(values.size) if noise.deviation else values
    if not noise.step:
        return reading
    shift = rng.uniform(-0.5, 0.5) * noise.step
    return np.asarray(np.round((reading + shift) / noise.step) * noise.step - shift)


def _filtered(
    raw: Mapping[str, Array], starts: Flags, period: float, window: int, derivatives: int = 2
) -> dict[str, Array]:
    weights = savgol_weights(window, DEGREE, derivatives, period)
    edges = [0, *(int(k) for k in np.flatnonzero(starts) if k > 0), starts.size]
    out = {}
    for role, values in raw.items():
        if role.startswith("valve"):
            # A voltage steps, and the valve's map has corners: what is computed from it passes the filter, see `Equation.shaped`.
            out[role] = np.stack([values, np.zeros_like(values), np.zeros_like(values)])
            continue
        if span_of(values) == 0.0:
            out[role] = np.stack([values, np.zeros_like(values), np.zeros_like(values)])
            continue
        found = np.full((derivatives + 1, values.size), np.nan)
        for first, last in pairwise(edges):
            if last - first >= window:
                part = savgol_filter(values[first:last], weights)
                found[:, first + window // 2 : first + window // 2 + part.shape[1]] = part
        out[role] = found
    return out
