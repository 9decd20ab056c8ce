"""References for estimates: a simulator's truth, and a joint's torque sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.checks.cross_check import Sensed
from vsalog.checks.sensor import without_clipped
from vsalog.core.errors import VsalogError
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimation.job import Options
from vsalog.readers import open_reader, read
from vsalog.rig.schema import AntagonisticJoint, Joint
from vsalog.validation.references import Smoothed, true_stiffness, truth_channels

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class References:
    """The references in one log.

    Attributes
    ----------
    truth : channels of a simulator's truth; None where there are none
    sensors : joint → its torque sensors [N·m], on the joint's side of the gear
    joints : of the rig
    """

    truth: Recording | None = None
    sensors: Mapping[str, JointSignals] = field(default_factory=dict)
    joints: Mapping[str, Joint] = field(default_factory=dict)

    def stiffness(self, joint: str, transmission: str, trace: Trace) -> Array | None:
        """Return the true stiffness at the rows of a trace, shape (N,) [N·m/rad]; None where there is none."""
        if self.truth is None:
            return None
        two = isinstance(self.joints[joint], AntagonisticJoint)
        suffix = ("_total" if transmission == "total" else f"_{transmission}") if two else ""
        rows = Smoothed(trace.time, trace.stamps, np.zeros(trace.time.size, dtype=np.bool_), {})
        return true_stiffness(self.truth.channels, joint, suffix, rows)

    def torque(self, joint: str, transmission: str, trace: Trace) -> Array | None:
        """Return the measured torque of a transmission at the rows of a trace, shape (N,) [N·m]; None where there is none."""
        signals = self.sensors.get(joint)
        if signals is None:
            return None
        roles = ["torque_sensor"]
        if isinstance(self.joints[joint], AntagonisticJoint):
            both = ["torque_sensor_1", "torque_sensor_2"]
            roles = [f"torque_sensor_{transmission}"] if transmission != "total" else both
            if transmission == "total" and "torque_sensor" in signals.roles:
                roles = ["torque_sensor"]
        if not set(roles) <= set(signals.roles):
            return None
        return np.asarray(
            np.sum([Sensed(signals.stamps, signals.roles[r], signals.period).at(trace.stamps) for r in roles], axis=0)
        )


def references_of(log: Path, options: Options, joints: Mapping[str, Joint]) -> References:
    """Find references for the estimates of a log's joints; unreadable ones are left out.

    Parameters
    ----------
    log : its path
    options : how it is read
    joints : name → joint of the rig
    """
    sensors = {}
    for name, joint in joints.items():
        roles = tuple(role for role in offered_roles(joint) if role.startswith("torque_sensor"))
        try:
            if roles:
                recording = _read(log, options, wanted_channels(joint, log.name, roles))
                sensors[name] = without_clipped(bind([recording], name, joint, roles))
        except VsalogError:
            continue
    try:
        known = open_reader(log, options.rate).catalogue().channels
        wanted = {channel for name in joints for channel in truth_channels(name) if channel in known}
        truth = _read(log, options, wanted) if wanted else None
    except VsalogError:
        truth = None
    return References(truth, sensors, joints)


def _read(log: Path, options: Options, wanted: set[str]) -> Recording:
    return read(log, wanted, options.time, options.rate, options.start, options.end)
