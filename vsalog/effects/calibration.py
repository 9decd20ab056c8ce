"""Calibration of a sensor: m = gain · x + offset + drift · t."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.base import Default, Effect, OneNumber

Array = NDArray[np.float64]


def reading(x: Array, time: Array, gain: float, offset: float, drift: float) -> Array:
    """Return what a sensor reads for x, shape (N,); `time` counts from the log's start [s]."""
    return gain * x + offset + drift * time


def zeroed(m: Array, time: Array | None, offset: float, drift: float) -> Array:
    """Return gain · x of a reading m, shape (N,); a sensor that does not drift needs no time."""
    if offset:
        m = m - offset
    return m if time is None or not drift else m - drift * time


# An encoder's key is named with its role: an angle is measured better than anything else.
_ENCODERS = ("motor_position", "link_position", "deflection")


def _of_encoders(key: str) -> tuple[str, ...]:
    return tuple(f"{role}.{key}" for role in _ENCODERS)


EFFECT = Effect(
    tolerances=(
        Default(_of_encoders("gain"), "a disc has whole lines per turn; the rest is the mounting", share=0.001),
        Default(_of_encoders("offset"), "a zero set by eye or against a stop", least="1 deg"),
        Default(_of_encoders("drift"), "a coupling or a magnet that creeps, over the log", share_of_scale=0.01),
        Default(("gain",), "calibration of a sensor as it is mounted, cross-talk included", share=0.05),
        Default(("offset",), "a zero that is not taken before each log", share_of_scale=0.05),
        Default(("drift",), "warming up, over the log", share_of_scale=0.05),
    ),
    causes=(
        OneNumber(
            name="sensor.torque_gain", place="torque sensor", key="gain", number="gain", unit="1", step=0.01, low=0.05,
            high=20.0, doubles=("sensor.torque_not_independent",), doubled=lambda s: s.computable,
            title="The {part} reads a multiple of the torque: its calibration is off",
            says="it is off by one factor against all the other equations",
            confirm="Hang a known weight on a known lever and read the sensor.",
            reference="Flacco 2012 §6.2, the torque sensor as reference",
            signature="transmission equation: τ_sensor; motor and link equations agree with each other",
        ),
        OneNumber(
            name="sensor.torque_offset", place="torque sensor", key="offset", number="offset", unit="N*m",
            step=lambda s: 1e-3 * s.torque, scale=lambda s: s.torque,
            title="The {part} reads a torque when there is none: it has an offset",
            says="it is off by a constant",
            confirm="Read the sensor with the joint unloaded.",
            reference="Flacco 2012 §6.2, the torque sensor as reference",
            signature="transmission equation: 1",
        ),
        OneNumber(
            name="sensor.torque_drift", place="torque sensor", key="drift", number="rate", unit="N*m/s",
            step=lambda s: 1e-3 * s.torque / s.duration, scale=lambda s: s.torque / s.duration,
            title="The zero of the {part} drifts",
            says="it is off by an amount that grows with time",
            confirm="Record the unloaded sensor for as long as the experiment lasts.",
            reference="strain gauges that warm up",
            signature="transmission equation: t",
        ),
        OneNumber(
            name="sensor.encoder_offset", place="encoder", key="offset", number="offset", unit="rad",
            step=lambda s: 1e-3 * s.deflection,
            title="The zero of the {part} encoder is not where the rig has it",
            says="the deflection is off by a constant",
            confirm="Unload the joint completely: motor and link encoder must agree.",
            reference="Flacco 2012 §6.1, alignment of the encoders",
            signature="all equations with φ: σ(φ)",
        ),
        OneNumber(
            name="sensor.encoder_scale", place="encoder", key="gain", number="gain", unit="1", step=1e-3, low=0.2,
            high=5.0,
            title="The {part} encoder counts too much or too little: its pulses per turn, or the gear ratio, are off",
            says="the deflection is off in proportion to the position",
            confirm="Turn the joint by a known angle, a whole turn if it can, and read the encoder.",
            reference="Flacco 2012 §6.1",
            signature="all equations with φ: x σ(φ)",
        ),
    ),
)  # fmt: skip
