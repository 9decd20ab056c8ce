"""How long a Savitzky–Golay window must be for rates: long enough against encoder quantisation, no longer than the
motion.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of, spread
from vsalog.estimators.equation import NEGLIGIBLE_SHARE, REPORTED_CHANGE, REPORTED_MISFIT, power_kept
from vsalog.estimators.tuning import Tuning
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights
from vsalog.uncertainty.errors_in_variables import MOST_NOISE
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]
T = TypeVar("T", bound=Tuning)


def _octaves_of_the_usual(first: int, end: int) -> tuple[int, ...]:
    """Return windows, in samples, that are some powers of two times as long as the usual one."""
    half = Tuning.default_window // 2
    return tuple(2 * round(half * 2.0**k) + 1 for k in range(first, end))


# Windows that are tried, in samples; and where even the first attenuates the motion, because samples are few, shorter ones.
WINDOWS, SHORTER = _octaves_of_the_usual(0, 6), _octaves_of_the_usual(-3, 0)
# Those of `derivative_weights` are so much wider [1]: they pass as much as the Savitzky–Golay filter, motion and noise.
WIDER = 1.5
# No joint's motion is attenuated by a window as short as this [s]; a still shorter one keeps noise, and jolts of friction.
SHORT_WINDOW = 0.15
# A window is short enough for a motion when the rate keeps this part of its power [1]; less will do where all orders keep the
# same; and of a window shorter than the usual more, for what biases a stiffness is its share of the amplitude.
KEPT, KEPT_ALIKE = power_kept(NEGLIGIBLE_SHARE), power_kept(REPORTED_CHANGE)
KEPT_BY_SHORTER = 0.9995
# A run loses half a window at either end: no window is longer than this part of the longest run [1].
PART_OF_RUN = 0.1


class Behind(NamedTuple):
    """The rates behind a window: φ̇ of each transmission and its noise, root mean squares [rad/s]."""

    window: int
    rates: Array
    noises: Array
    kept: float = KEPT

    @property
    def quiet(self) -> bool:
        """Whether noise is a part of every rate that is not reported: a stiffness loses the square of that part."""
        return bool(np.all(self.noises <= REPORTED_MISFIT * self.rates))

    @property
    def loud(self) -> bool:
        """Whether noise is so much of some rate that it does not show which motion a window would have to keep."""
        return bool(np.any(self.noises > MOST_NOISE * self.rates))

    @property
    def motion(self) -> Array:
        """The motion without noise, mean squares."""
        return self.rates**2 - self.noises**2

    @property
    def least_kept(self) -> Array:
        """What a longer window has to keep: the size of noise is known no better than to its own size."""
        return (KEPT_BY_SHORTER if self.window < WINDOWS[0] else self.kept) * self.motion - self.noises**2


def suitable_windows(device: Device, signals: JointSignals, tuning: Tuning, order: int | None = None) -> list[int]:
    """Return the windows, in samples, with low noise in φ̇ of every transmission that keep the motion, shortest first.

    Where none has, the longest; where a window is given, that one. They are for `Derivatives` up to an order, or for the
    Savitzky–Golay filter.
    """
    if tuning.window is not None:
        return [2 * round(0.5 * tuning.window / signals.period) + 1]
    tried = [*_shorter(signals, tuning, WINDOWS[0]), *WINDOWS]
    if order is not None:
        tried = [round(WIDER * part * window) | 1 for window in tried for part in (1.0, 2.0**0.5)]
    longest = PART_OF_RUN * signals.longest_run
    fitting = [w for w in tried if w >= WINDOWS[0] and tuning.degree < w <= longest] or [WINDOWS[0]]
    quiet: list[int] = []
    kept = np.zeros(len(device.transmissions))
    for window in (*(w for w in tried if w < WINDOWS[0]), *fitting):
        behind = _behind(device, signals[:ENOUGH], tuning, window, order)
        if behind.quiet and np.all(behind.motion >= kept):
            quiet.append(window)
            kept = np.maximum(kept, behind.least_kept)
    return [window for window in quiet if window >= WINDOWS[0]] or quiet[-1:] or fitting[-1:]


def keeping_window(device: Device, signals: JointSignals, tuning: T, usual: int) -> T:
    """Return the tuning with a window of `usual` samples, or the longest shorter one where that attenuates the motion.

    Where a window is given, or another filter, nothing is changed.
    """
    shorter = _shorter(signals, tuning, usual)
    if tuning.window is not None or tuning.filter != "savitzky-golay" or not shorter:
        return tuning
    part = most_moved(signals, {r for view in device.transmissions for r in view.deflection_roles(signals.roles)})
    found, kept = usual, np.zeros(len(device.transmissions))
    for window in (*shorter, usual):
        behind = _behind(device, part, tuning, window)
        if behind.loud:
            continue
        if np.any(behind.motion < kept):
            break
        found, kept = window, np.maximum(kept, behind.least_kept)
    return with_window(tuning, signals, found)


def _shorter(signals: JointSignals, tuning: Tuning, usual: int) -> list[int]:
    """Return the windows shorter than a usual one that have more samples than a polynomial of the degree needs.

    A log that is too short for the usual one is refused rather than filtered hardly at all.
    """
    if usual * signals.period <= SHORT_WINDOW or signals.longest_run < usual:
        return []
    return [window for window in SHORTER if tuning.degree + 1 < window < usual]


def motor_window(device: Device, signals: JointSignals, tuning: T) -> T:
    """Return the tuning with the shortest window of 51 samples or more with little encoder noise in the motor's torque.

    The quantisation noise of B θ̈ is compared with the motor's torque; where the rig does not have B, their share of θ̇ counts.
    A window has to keep the motion, where need be a shorter one, and be short for the runs. Where a window is given, or another
    filter, nothing is changed.
    """
    if tuning.window is not None or tuning.filter != "savitzky-golay":
        return tuning
    part = most_moved(signals, [view.motor_position for view in device.transmissions])
    longest = signals.longest_run
    found, anyhow, kept = None, None, np.zeros(len(device.transmissions))
    usual = (w for w in WINDOWS if w == WINDOWS[0] or w <= PART_OF_RUN * longest)
    for window in (*_shorter(signals, tuning, WINDOWS[0]), *usual):
        behind = _behind(device, part, tuning, window)
        quiet = window >= WINDOWS[0] and _quiet(device, part, tuning, window)
        if behind.loud:
            anyhow = window if quiet and anyhow is None else anyhow
            continue
        if np.any(behind.motion < kept):
            break
        found, kept = window, np.maximum(kept, behind.least_kept)
        if quiet:
            break
    return with_window(tuning, signals, found or anyhow or WINDOWS[0])


def most_moved(signals: JointSignals, roles: Collection[str]) -> JointSignals:
    """Return the stretch of a log in which some motor moves most."""
    spreads = [sum(spread(b.roles[r]) for r in roles) for b in signals.blocks(ENOUGH)]
    first = int(np.argmax(spreads)) * ENOUGH
    return signals[first : first + ENOUGH]


def _behind(device: Device, signals: JointSignals, tuning: Tuning, window: int, order: int | None = None) -> Behind:
    if order is None:
        weights, kept = savgol_weights(window, tuning.degree, 1, signals.period), KEPT
    else:
        weights, kept = derivative_weights(window, tuning.degree, order, signals.period)[:2], KEPT_ALIKE
    return Behind(window, *rates_of(device, signals, weights), kept)


def _quiet(device: Device, signals: JointSignals, tuning: Tuning, window: int) -> bool:
    """Return whether the quantisation noise of the motors' torques, or of their speeds, is small."""
    weights = savgol_weights(window, tuning.degree, 2, signals.period)
    return all(_quiet_motor(view, signals, weights) for view in device.transmissions)


def _quiet_motor(view: TransmissionView, signals: JointSignals, weights: Array) -> bool:
    theta, torque = signals.roles[view.motor_position], signals.roles[view.motor_torque]
    added, inertia = sensor_error(theta, weights.shape[1]), view.motor.reflected_inertia
    if inertia is not None:
        # Noise that the deflection shares with B θ̈ does not average out.
        bias = inertia * abs(added.product(weights[0], weights[2]))
        moved = spread(deflection_of(signals.roles, view)) * spread(torque)
        return bool(
            inertia * added.rms(weights[2]) <= REPORTED_MISFIT * spread(torque) and bias <= NEGLIGIBLE_SHARE * moved
        )
    return not (speed := rms(savgol_filter(theta, weights[1:2])[0])) or bool(
        added.rms(weights[1]) <= REPORTED_MISFIT * speed
    )


def noisy_rates(device: Device, signals: JointSignals, weights: Array) -> list[Finding]:
    """Find where a filter of such weights, of value and first derivative at least, leaves φ̇ noisy."""
    rates, noises = rates_of(device, signals[:ENOUGH], weights[:2])
    return [
        Finding(
            code="filter.noisy_rate",
            joint=device.joint,
            part=view.name,
            value=float(noise / rate),
            limit=REPORTED_MISFIT,
        )
        for view, rate, noise in zip(device.transmissions, rates, noises, strict=True)
        if noise > REPORTED_MISFIT * rate > 0.0
    ]


def with_window(tuning: T, signals: JointSignals, window: int) -> T:
    """Return the tuning with a window of a given number of samples."""
    return msgspec.structs.replace(tuning, window=(window - 1) * signals.period)


def rates_of(device: Device, signals: JointSignals, weights: Array) -> tuple[Array, Array]:
    """Return φ̇ of each transmission and its noise, root mean squares [rad/s]; zero where nothing is known.

    `weights` are those of value and first derivative.
    """
    rates, noises = [], []
    for view in device.transmissions:
        rates.append(rms(savgol_filter(deflection_of(signals.roles, view), weights[1:])[0]))
        added = (sensor_error(signals.roles[role], weights.shape[1]) for role in view.deflection_roles(signals.roles))
        noises.append(np.sqrt(sum(sensor.product(weights[1], weights[1]) for sensor in added)))
    return np.array(rates), np.array(noises)


def rms(values: Array) -> float:
    """Return the root mean square of what is finite; zero where nothing is."""
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else 0.0
