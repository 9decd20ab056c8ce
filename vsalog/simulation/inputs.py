"""What drives a joint over time: torques as functions or held samples, position servos, prescribed motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.core.errors import SimulationError
from vsalog.rig.parts import Motor

Array = NDArray[np.float64]

# A continuous function of an array of times [s], or one value per sample that is held until the next, as a motor drive does.
TorqueInput = Callable[[Array], ArrayLike] | ArrayLike


@dataclass(frozen=True, slots=True)
class Servo:
    """A sampled proportional-derivative position loop on a motor: τ = clip(K_p (θ_d − θ) + K_d (θ̇_d − θ̇), ±limit).

    Attributes
    ----------
    reference : θ_d, a function of an array of times [s], one value per sample, or a constant [rad], on the joint's side; or
        θ_d and θ̇_d of each sample, shape (N, 2), which a controller may write while time goes on
    stiffness : K_p [N·m/rad]
    damping : K_d [N·m·s/rad]
    limit : the largest torque the loop asks for [N·m]
    """

    reference: TorqueInput
    stiffness: float
    damping: float
    limit: float = float("inf")


def loop_gains(motor: Motor, load: float, rate: float, least: float, period: float) -> tuple[float, float]:
    """Return K_p [N·m/rad] and K_d [N·m·s/rad] of a critically damped position loop.

    Parameters
    ----------
    motor : on the joint's side
    load : inertia that moves with it [kg·m²]
    rate : natural frequency [rad/s]
    least : K_p at least, which makes the loop faster [N·m/rad]
    period : sample time, which bounds the gains [s]
    """
    own = motor.inertia or 1e-3
    inertia = own + load
    stiff = max(inertia * rate**2 + motor.damping * rate, least)
    damping = max(2.0 * math.sqrt(stiff * inertia) - motor.damping, 0.0)
    # A sampled loop that removes more than a share of the motor's momentum per sample oscillates.
    return stiff, min(damping, 0.3 * own / period)


@dataclass(frozen=True, slots=True)
class Motion:
    """A motor that moves as prescribed, whatever torque it takes.

    Attributes
    ----------
    position : θ, a function of an array of times [s], one value per sample, or a constant [rad], on the joint's side
    """

    position: TorqueInput


Signal = Callable[[Array], Array]

# Inputs that a motor's role may have; the link's external torque and a valve take a torque's form only.
Input = TorqueInput | Servo | Motion


def constant(value: float) -> Signal:
    """Return the same value at all times."""

    def signal(t: Array) -> Array:
        return np.full_like(t, value)

    return signal


def sine(amplitude: float, frequency: float, phase: float = 0.0, offset: float = 0.0) -> Signal:
    """Return offset + amplitude · sin(2π · frequency · t + phase); frequency in Hz, phase in rad."""

    def signal(t: Array) -> Array:
        return np.asarray(offset + amplitude * np.sin(2.0 * np.pi * frequency * t + phase))

    return signal


def soft_square(amplitude: float, period: float, rise: float = 0.1) -> Signal:
    """Return amplitude · tanh(sin(2πt / period) / rise): a square wave whose edges are smooth.

    With rise = 0.1 an edge takes some 3 % of the period.
    """

    def signal(t: Array) -> Array:
        return np.asarray(amplitude * np.tanh(np.sin(2.0 * np.pi * t / period) / rise))

    return signal


def square(amplitude: float, frequency: float, phase: float = 0.0, duty: float = 0.5) -> Signal:
    """Return +amplitude over the share `duty` of each period and −amplitude over the rest, with sharp edges.

    Frequency in Hz, phase in rad; at phase 0 the first edge upwards is at t = 0.
    """

    def signal(t: Array) -> Array:
        return np.where(_turns(t, frequency, phase) < duty, amplitude, -amplitude)

    return signal


def sawtooth(amplitude: float, frequency: float, phase: float = 0.0) -> Signal:
    """Return a ramp from −amplitude to +amplitude over each period, through zero at t = 0 where the phase is 0.

    Frequency in Hz, phase in rad; a negative amplitude ramps downwards.
    """

    def signal(t: Array) -> Array:
        return np.asarray(amplitude * (2.0 * _turns(t, frequency, phase + np.pi) - 1.0))

    return signal


def steps(times: Sequence[float], values: Sequence[float], rise: float = 0.0) -> Signal:
    """Return values[i] from times[i] on, and zero before the first.

    Parameters
    ----------
    times : when each value begins, rising [s]
    values : as many
    rise : how long each change takes, along half a cosine [s]; a change that comes sooner adds to it. Sharp when zero
    """
    changes = np.diff(np.asarray(values, dtype=np.float64), prepend=0.0)

    def signal(t: Array) -> Array:
        total = np.zeros_like(t)
        for start, change in zip(times, changes, strict=True):
            if rise > 0.0:
                total += change * 0.5 * (1.0 - np.cos(np.pi * np.clip((t - start) / rise, 0.0, 1.0)))
            else:
                total += np.where(t >= start, change, 0.0)
        return total

    return signal


def linear_chirp(amplitude: float, start: float, end: float, duration: float, phase: float = 0.0) -> Signal:
    """Return a sine whose frequency runs evenly from `start` to `end` [Hz] over `duration` [s], and stays there."""

    def signal(t: Array) -> Array:
        within = np.minimum(t, duration)
        turns = start * within + (end - start) * within**2 / (2.0 * duration) + end * (t - within)
        return np.asarray(amplitude * np.sin(2.0 * np.pi * turns + phase))

    return signal


def logarithmic_chirp(amplitude: float, start: float, end: float, duration: float, phase: float = 0.0) -> Signal:
    """Return a sine whose frequency runs from `start` to `end` [Hz] by equal factors in equal times, and stays there."""
    if start == end:
        return sine(amplitude, start, phase)
    growth = np.log(end / start) / duration

    def signal(t: Array) -> Array:
        within = np.minimum(t, duration)
        turns = start * np.expm1(growth * within) / growth + end * (t - within)
        return np.asarray(amplitude * np.sin(2.0 * np.pi * turns + phase))

    return signal


def multisine(rms: float, frequencies: Sequence[float], seed: int | None = None) -> Signal:
    """Return the sum of equally strong cosines.

    Parameters
    ----------
    rms : of the sum
    frequencies : of the N cosines, distinct [Hz]
    seed : of random phases; when absent they are Schroeder's (1970), −π k (k − 1) / N, whose sum has a low crest
    """
    count = len(frequencies)
    k = np.arange(1, count + 1)
    random = seed is not None
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, count) if random else -np.pi * k * (k - 1) / count
    amplitude = rms * np.sqrt(2.0 / count)

    def signal(t: Array) -> Array:
        total = np.zeros_like(t)
        for frequency, phase in zip(frequencies, phases, strict=True):
            total += amplitude * np.cos(2.0 * np.pi * frequency * t + phase)
        return total

    return signal


def trapezoid(
    amplitude: float,
    rise: float,
    hold: float,
    fall: float | None = None,
    start: float = 0.0,
    period: float | None = None,
) -> Signal:
    """Return a ramp up, a plateau and a ramp down.

    Parameters
    ----------
    amplitude : of the plateau
    rise, hold, fall : how long each takes [s]; the fall as long as the rise when absent
    start : when it begins [s]
    period : after which it begins again [s], at least rise + hold + fall; once when absent
    """
    down = rise if fall is None else fall
    corners = np.cumsum([0.0, rise, hold, down])

    def signal(t: Array) -> Array:
        since = t - start
        if period is not None:
            since = np.where(since >= 0.0, np.mod(since, period), since)
        return np.asarray(amplitude * np.interp(since, corners, [0.0, 1.0, 1.0, 0.0]))

    return signal


def rest_to_rest(amplitude: float, rise: float, start: float = 0.0) -> Signal:
    """Return zero until `start`, then amplitude · (126 u⁵ − 420 u⁶ + 540 u⁷ − 315 u⁸ + 70 u⁹) with u = (t − start) / rise to 1.

    It is the polynomial of least degree whose first four derivatives vanish at both ends.
    """

    def signal(t: Array) -> Array:
        u = np.clip((t - start) / rise, 0.0, 1.0)
        return np.asarray(amplitude * u**5 * (126.0 + u * (-420.0 + u * (540.0 + u * (-315.0 + 70.0 * u)))))

    return signal


def table(times: Array, values: Array, held: bool = False) -> Signal:
    """Return a signal given at some times; its ends hold before the first and after the last of them.

    Parameters
    ----------
    times : rising, shape (n,) [s]
    values : shape (n,)
    held : each value holds until the next; else they are interpolated linearly
    """

    def signal(t: Array) -> Array:
        if not held:
            return np.asarray(np.interp(t, times, values))
        return np.asarray(values[np.maximum(np.searchsorted(times, t, side="right") - 1, 0)])

    return signal


def sum_of(*parts: Callable[[Array], ArrayLike]) -> Signal:
    """Return the sum of functions of time."""

    def signal(t: Array) -> Array:
        total = np.zeros_like(t)
        for part in parts:
            total = total + np.asarray(part(t), dtype=np.float64)
        return total

    return signal


def bridged(values: Array) -> Array:
    """Interpolate gaps of a sample or two linearly; a longer gap begins a new run.

    Raises
    ------
    SimulationError
        No value is a number.
    """
    finite = np.isfinite(values)
    if finite.all():
        return values
    if not finite.any():
        raise SimulationError("a role that drives the replay holds no number in a run of the recording")
    index = np.arange(values.size)
    return np.interp(index, index[finite], values[finite])


def at_samples(torque: TorqueInput, time: Array) -> Array:
    """Return the torque at the samples, shape of `time`.

    Raises
    ------
    SimulationError
        An array's length is not that of `time`, or a value is not finite.
    """
    values = np.asarray(torque(time) if callable(torque) else torque, dtype=np.float64)
    if values.ndim == 0:
        values = np.full_like(time, float(values))
    if values.shape != time.shape:
        raise SimulationError(
            f"a torque input has shape {values.shape}; one value per sample is needed, {time.shape[0]} in all"
        )
    if not bool(np.all(np.isfinite(values))):
        raise SimulationError("a torque input holds values that are not finite")
    return values


def at_steps(torque: TorqueInput, time: Array, steps: int) -> Array:
    """Return the torque at the ends and middles of the integrator's steps, shape (N − 1, 2 · steps + 1).

    Parameters
    ----------
    torque : function of time or samples; samples are held over their period
    time : shape (N,), uniform [s]
    steps : integration steps per period
    """
    if not callable(torque):
        held = at_samples(torque, time)
        return np.repeat(held[:-1, None], 2 * steps + 1, axis=1)
    fraction = np.arange(2 * steps + 1) / (2 * steps)
    grid = time[:-1, None] + (time[1:] - time[:-1])[:, None] * fraction
    return at_samples(torque, grid.ravel()).reshape(grid.shape)


def _turns(t: Array, frequency: float, phase: float) -> Array:
    """Return where in its period a signal is, 0 to 1."""
    return np.asarray(np.mod(frequency * t + phase / (2.0 * np.pi), 1.0))
