"""The result of a simulated experiment: what was recorded, and the truth behind it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.recording import Channel, Recording, Stream
from vsalog.rig.schema import RigFile
from vsalog.simulation.channels import JOINT_STATE, recorded_columns, topic_parts

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]

# Simulated logs carry a plausible epoch, and the same one on every run.
EPOCH = datetime(2026, 1, 1, tzinfo=UTC)

TRUTH_TOPIC = "/truth/"
FLOAT64 = "std_msgs/msg/Float64"


@dataclass(frozen=True, slots=True)
class JointRecord:
    """The motion of one joint, and its sensors' readings.

    Attributes
    ----------
    measured : role → shape (N,), the sensors' readings, SI, on the joint's side of the gear; a ``setpoint`` that is recorded in
        a unit of length is the lever arm [m], else the secondary motor's angle [rad]
    truth : name → shape (N,), SI, on the joint's side: ``link_position``, ``link_velocity``, ``link_acceleration``,
        ``external_torque``, and per motor and transmission (with ``_1``, ``_2`` in an antagonistic joint) ``motor_position``,
        ``motor_velocity``, ``motor_acceleration``, ``motor_torque`` (commanded), ``deflection``, ``flexibility_torque`` (of the
        spring alone), ``transmission_torque`` (with damping and hysteresis), ``stiffness``; antagonistic: the sums
        ``flexibility_torque_total``, ``transmission_torque_total``, ``stiffness_total``; serial: ``secondary_position``,
        ``secondary_velocity``, ``secondary_torque``, ``lever_arm`` [m], ``reaction_torque``
    resolution : role → least step of its sensor [SI], 0 for one without steps
    late : role → shape (N,), how far its stamps are off [s]; the same array for all roles of a topic, absent where they are right
    kept : role → shape (N,), False for samples that were lost; likewise
    """

    measured: Mapping[str, Array]
    truth: Mapping[str, Array]
    resolution: Mapping[str, float] = field(default_factory=dict)
    late: Mapping[str, Array] = field(default_factory=dict)
    kept: Mapping[str, Flags] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Experiment:
    """Joints that were moved, and their sensors' readings.

    Attributes
    ----------
    name : of the experiment
    rig : the nominal rig, with the channels of the recording; what a log of it would carry
    period : T [s]
    stamps : shape (N,), int64 ns since the epoch
    time : shape (N,), seconds from the start, k · T
    joints : name in the rig → its motion and readings
    """

    name: str
    rig: RigFile
    period: float
    stamps: Stamps
    time: Array
    joints: Mapping[str, JointRecord]

    @property
    def joint(self) -> str:
        """Name of the first joint; most rigs have one."""
        return next(iter(self.joints))

    @property
    def measured(self) -> Mapping[str, Array]:
        """The readings of the first joint's sensors."""
        return self.joints[self.joint].measured

    @property
    def truth(self) -> Mapping[str, Array]:
        """The truth about the first joint."""
        return self.joints[self.joint].truth

    @property
    def resolution(self) -> Mapping[str, float]:
        """The least steps of the first joint's sensors."""
        return self.joints[self.joint].resolution

    def recording(self, truth: bool = False) -> Recording:
        """Return the recording that a reader would give of the experiment's log.

        Parameters
        ----------
        truth : also give the truth, as ``/truth/NAME.data``, or ``/truth/JOINT/NAME.data`` where there are several joints
            (std_msgs/msg/Float64 topics), in SI

        Raises
        ------
        SimulationError
            A channel has a place-holder for runs, or two roles share a channel.
        """
        channels: dict[str, Channel] = {}
        clocks: dict[tuple[int, int], Stamps] = {}
        for name, record in self.joints.items():
            for c in recorded_columns(self.rig.joint[name], record.measured):
                if c.name in channels:
                    raise SimulationError(
                        f"joint '{name}': {c.name} is recorded of another joint already; give it another channel in the rig"
                    )
                late, kept = record.late.get(c.role), record.kept.get(c.role)
                # Channels of one topic share one array of stamps.
                clock = id(late), id(kept)
                if clock not in clocks:
                    clocks[clock] = self._stamps(late, kept)
                values = c.values if kept is None else c.values[kept]
                channels[c.name] = Channel(c.name, clocks[clock], values, c.unit, c.stream, c.type)
        if truth:
            channels |= {c.name: c for c in self._truth()}
        streams = {
            c.stream: Stream(c.stream, c.type, int(c.stamps.size), "header" if c.type == JOINT_STATE else "log")
            for c in channels.values()
        }
        return Recording(path=Path(self.name), format="simulation", channels=channels, streams=streams)

    def _stamps(self, late: Array | None, kept: Flags | None) -> Stamps:
        if late is None:
            return self.stamps if kept is None else self.stamps[kept]
        # Messages stay in order, however much their stamps are off.
        stamps = np.sort(self.stamps + np.round(late * 1e9).astype(np.int64))
        order = np.arange(stamps.size)
        stamps = np.maximum.accumulate(stamps - order) + order
        return stamps if kept is None else stamps[kept]

    def _truth(self) -> Iterator[Channel]:
        parts = topic_parts(self.joints)
        for joint, record in self.joints.items():
            for name, values in record.truth.items():
                topic = f"{TRUTH_TOPIC}{name}" if len(self.joints) == 1 else f"{TRUTH_TOPIC}{parts[joint]}/{name}"
                yield Channel(f"{topic}.data", self.stamps, values, None, topic, FLOAT64)


def sample_stamps(count: int, period: float) -> Stamps:
    """Return the stamps of `count` samples [ns since the epoch], each rounded to the nanosecond."""
    return int(EPOCH.timestamp()) * 10**9 + np.round(np.arange(count) * (period * 1e9)).astype(np.int64)
