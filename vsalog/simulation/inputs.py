"""What drives a joint over time: torques as functions or held samples, position servos, prescribed motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.errors import SimulationError

Array = NDArray[np.float64]

# A continuous function of an array of times [s], or one value per sample that is held until the next, as a motor drive does.
TorqueInput = Callable[[Array], ArrayLike] | ArrayLike


@dataclass(frozen=True, slots=True)
class Servo:
    """A sampled proportional-derivative position loop on a motor: τ = clip(K_p (θ_d − θ) + K_d (θ̇_d − θ̇), ±limit).

    Attributes
    ----------
    reference : θ_d, a function of an array of times [s], one value per sample, or a constant [rad], on the joint's side
    stiffness : K_p [N·m/rad]
    damping : K_d [N·m·s/rad]
    limit : the largest torque the loop asks for [N·m]
    """

    reference: TorqueInput
    stiffness: float
    damping: float
    limit: float = float("inf")


@dataclass(frozen=True, slots=True)
class Motion:
    """A motor that moves as prescribed, whatever torque it takes.

    Attributes
    ----------
    position : θ, a function of an array of times [s], one value per sample, or a constant [rad], on the joint's side
    """

    position: TorqueInput


# What a motor's role may be given; the link's external torque and a valve take a torque's form only.
Input = TorqueInput | Servo | Motion


def sine(amplitude: float, frequency: float, phase: float = 0.0) -> Callable[[Array], Array]:
    """Return amplitude · sin(2π · frequency · t + phase) as a function of time; frequency in Hz, phase in rad."""

    def torque(t: Array) -> Array:
        return np.asarray(amplitude * np.sin(2.0 * np.pi * frequency * t + phase))

    return torque


def soft_square(amplitude: float, period: float, rise: float = 0.1) -> Callable[[Array], Array]:
    """Return amplitude · tanh(sin(2πt / period) / rise): a square wave whose edges are smooth.

    With rise = 0.1 an edge takes some 3 % of the period.
    """

    def torque(t: Array) -> Array:
        return np.asarray(amplitude * np.tanh(np.sin(2.0 * np.pi * t / period) / rise))

    return torque


def sum_of(*parts: Callable[[Array], ArrayLike]) -> Callable[[Array], Array]:
    """Return the sum of functions of time."""

    def torque(t: Array) -> Array:
        total = np.zeros_like(t)
        for part in parts:
            total = total + np.asarray(part(t), dtype=np.float64)
        return total

    return torque


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
