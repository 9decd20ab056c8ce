"""Delay: a sensor that is late, a torque that acts later than it is recorded, a clock that is fast.

Binding moves stamps by it; what has passed a filter is moved by a part of a sample (`shifted`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.base import Default, Effect, OneNumber, Sizes
from vsalog.effects.counterpart import Counterpart, term

Array = NDArray[np.float64]

LATEST = 0.05
"""Seconds that no channel is late by, or early."""


def shifted(values: Array, samples: float) -> Array:
    """Return the values `samples` later, shape (3, N): the cubic through four samples carries a fraction of one.

    A straight line between two would take a part in a hundred off what swings at a twentieth of the sample rate. Beyond the ends
    the last sample is held.
    """
    if samples == 0.0:
        return values
    whole = int(np.floor(samples))
    part, last = samples - whole, values.shape[1] - 1
    there = values.take(np.arange(whole - 1, last + whole + 3), axis=1, mode="clip")
    before, here, after, beyond = (there[:, k : k + last + 1] for k in range(4))
    if part == 0.0:
        return np.asarray(here)
    # Lagrange's weights, p of the way from here to after.
    p, q = part, 1.0 - part
    outer, inner = -p * q / 6.0, (1.0 + p) * (1.0 + q) / 2.0
    return np.asarray(inner * (q * here + p * after) + outer * ((1.0 + q) * before + (1.0 + p) * beyond))


def late(x: Array, time: Array, delay: float) -> Array:
    """Return x(t − delay), shape (N,); beyond the ends it goes on as it does there, with its velocity and acceleration."""
    asked = time - delay
    found = np.interp(asked, time, x)
    period = time[1] - time[0]
    for end, inner, beyond in ((0, (1, 2), asked < time[0]), (-1, (-2, -3), asked > time[-1])):
        # The parabola through the last three samples, Newton's form.
        u = np.abs(asked[beyond] - time[end]) / period
        first = x[inner[0]] - x[end]
        second = x[inner[1]] - 2.0 * x[inner[0]] + x[end]
        found[beyond] = x[end] - u * first + 0.5 * u * (u + 1.0) * second
    return np.asarray(found)


def _half_a_sample(sizes: Sizes) -> float:
    """Return the standard deviation of a delay uniform within a sample [s]: few logs show whether torques were held."""
    deviation: float = sizes.period / 12.0**0.5
    return deviation


EFFECT = Effect(
    counterparts=(Counterpart("motor", ("torque_delay",), lambda m: term("actuator", delay=m.torque_delay)),),
    tolerances=(
        Default(("torque_delay", "delay"), "two cycles of a 1 kHz fieldbus", least="2 ms"),
    ),
    causes=(
        OneNumber(
            name="motor.torque_delay", place="motor", key="torque_delay", number="delay", unit="s",
            step=lambda s: 0.25 * s.period, low=0.0, high=LATEST, blur=_half_a_sample,
            where=lambda s: not (s.one_clock or s.commanded),
            title="The torque of the {part} acts later than it is recorded",
            says="its motor equation is off in proportion to the rate of the motor's torque",
            confirm="Command a step of torque and look at when the motor begins to accelerate.",
            reference="a drive's current loop and its bus",
            signature="motor equation: dτ/dt",
        ),
        OneNumber(
            name="sensor.torque_delay", place="torque sensor", key="delay", number="delay", unit="s",
            step=lambda s: 0.25 * s.period, low=-LATEST, high=LATEST,
            title="The {part} is late against the other channels",
            says="it is off in proportion to the torque's rate",
            confirm="Tap the link and see when each channel responds.",
            reference="amplifiers' filters and buses",
            signature="transmission equation: dτ/dt; motor and link equations agree with each other",
        ),
        OneNumber(
            name="sensor.clock_skew", place="clock", key="delay", number="delay", unit="s",
            step=lambda s: 0.25 * s.period, low=-LATEST, high=LATEST,
            blur=lambda s: _half_a_sample(s) if s.one_clock else 0.0, doubles=("motor.torque_delay",),
            doubled=lambda s: s.one_clock, where=lambda s: not s.commanded,
            title="The {part} channel is late or early against the others",
            says="what is computed from it is off in proportion to its rate",
            confirm="Tap the joint and see when each channel responds; look at how the channels get their stamps.",
            reference="stamps given on arrival instead of on measurement",
            signature="all equations with φ: ẋ σ(φ)",
        ),
    ),
)  # fmt: skip
