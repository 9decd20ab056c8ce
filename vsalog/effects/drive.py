"""A motor's drive: the torque that acts, torque_gain · τ + torque_offset, of the recorded τ rounded to its least step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.quantisation import rounded

Array = NDArray[np.float64]


def delivered(commanded: Array, gain: float, offset: float, step: float = 0.0) -> Array:
    """Return the torque that acts [N·m], its delay aside; a perfect drive gives back the same array.

    Parameters
    ----------
    commanded : shape (N,), as recorded [N·m]
    gain : torque made per torque recorded
    offset : torque made when none is recorded [N·m]
    step : least step of a command [N·m]; none when 0
    """
    made: Array = rounded(commanded, step)
    if gain != 1.0:
        made = gain * made
    return made + offset if offset else made


def commanded_for(torque: Array, gain: float, offset: float) -> Array:
    """Return what a drive has to be commanded for a torque to act [N·m], its resolution aside."""
    return (torque - offset) / gain


EFFECT = Effect(
    tolerances=(
        Default(
            ("torque_constant", "torque_gain", "motor_torque.gain", "secondary_torque.gain"),
            "data sheets allow ± 10 %, and warm magnets are weaker",
            share=0.1,
        ),
        Default(("torque_offset",), "offset of a drive's current measurement", share_of_scale=0.05),
    ),
    causes=(
        OneNumber(
            name="motor.torque_constant", place="motor", key="torque_gain", number="gain", unit="1", step=0.01,
            low=0.05, high=20.0,
            title="The {part} makes another torque than is recorded of it: its torque constant is off",
            says="its motor equation is off in proportion to the motor's torque",
            confirm="Hold the link against a force gauge and command several torques: compare.",
            reference="Flacco 2012 eq. 4, τ",
            signature="motor equation: τ",
        ),
        OneNumber(
            name="motor.torque_offset", place="motor", key="torque_offset", number="torque", unit="N*m",
            step=lambda s: 1e-3 * s.torque, scale=lambda s: s.torque,
            title="The {part} makes a torque when none is recorded: its drive has an offset",
            says="its motor equation is off by a constant",
            confirm="Command no torque and see on which side the joint comes to rest, or which torque holds it still.",
            reference="Flacco 2012 eq. 4, τ",
            signature="motor equation: 1",
        ),
    ),
)  # fmt: skip
