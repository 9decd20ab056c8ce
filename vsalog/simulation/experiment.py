"""The result of a simulated experiment: what was recorded, and the truth behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.recording import Channel, Recording, Stream
from vsalog.rig.schema import RigFile
from vsalog.simulation.channels import JOINT_STATE, RecordedColumn, recorded_columns

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

# 2026-01-01T00:00:00Z: simulated logs carry a plausible epoch, and the same one on every run.
EPOCH_NS = 1_767_225_600 * 10**9

TRUTH_TOPIC = "/truth/"
FLOAT64 = "std_msgs/msg/Float64"


@dataclass(frozen=True, slots=True)
class Experiment:
    """A joint that was moved, watched by its sensors.

    Attributes
    ----------
    name : of the experiment
    rig : the rig as it is believed to be, with the channels of the recording; what a log of it would carry
    joint : the joint's name in the rig
    period : T [s]
    stamps : shape (N,), int64 ns since the epoch
    time : shape (N,), seconds from the start, k · T
    measured : role → shape (N,), what the sensors say, SI, on the joint's side of the gear
    truth : name → shape (N,), SI, on the joint's side. ``link_position``, ``link_velocity``, and per transmission (with
        ``_1``, ``_2`` in an antagonistic joint) ``motor_position``, ``motor_velocity``, ``motor_torque``, ``deflection``,
        ``flexibility_torque``, ``stiffness``; antagonistic: ``flexibility_torque_total``, ``stiffness_total``; AwAS:
        ``secondary_position``, ``secondary_velocity``, ``secondary_torque``, ``lever_arm`` [m], ``reaction_torque``
    resolution : role → least step of its sensor [SI], 0 for an ideal one
    """

    name: str
    rig: RigFile
    joint: str
    period: float
    stamps: Stamps
    time: Array
    measured: Mapping[str, Array]
    truth: Mapping[str, Array]
    resolution: Mapping[str, float] = field(default_factory=dict)

    def recording(self, truth: bool = False) -> Recording:
        """Return what a reader would make of the experiment's log.

        Parameters
        ----------
        truth : also give the truth, as ``/truth/NAME.data`` (std_msgs/msg/Float64 topics), in SI
        """
        columns = recorded_columns(self.rig.joint[self.joint], self.measured)
        if truth:
            columns += [
                RecordedColumn(f"{TRUTH_TOPIC}{name}.data", values, None, f"{TRUTH_TOPIC}{name}", FLOAT64)
                for name, values in self.truth.items()
            ]
        channels = {c.name: Channel(c.name, self.stamps, c.values, c.unit, c.stream, c.type) for c in columns}
        streams = {
            c.stream: Stream(c.stream, c.type, int(self.stamps.shape[0]), "header" if c.type == JOINT_STATE else "log")
            for c in channels.values()
        }
        return Recording(path=Path(self.name), format="simulation", channels=channels, streams=streams)


def sample_stamps(count: int, period: float) -> Stamps:
    """Return the stamps of `count` samples [ns since the epoch], each rounded to the nanosecond."""
    return EPOCH_NS + np.round(np.arange(count) * (period * 1e9)).astype(np.int64)
