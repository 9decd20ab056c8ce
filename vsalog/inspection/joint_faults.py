"""What is wrong with the channels of joints that were guessed, by the checks that the other commands use."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

import numpy as np

from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.checks import sensor
from vsalog.checks.channel import channel_findings
from vsalog.checks.check import without_superseded
from vsalog.checks.recording_faults import RecordingFaults, findings_of, read_roles
from vsalog.checks.signals import signal_findings
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.rig import Rig
from vsalog.rig.guess_types import Guess
from vsalog.rig.schema import Joint, Motor, RigidJoint
from vsalog.rig.template import rig_template


BOUND = ("sensor.stuck", "recording.outliers")
"""Findings of binding that are about what was recorded, and not about the rig."""


def joint_faults(recording: Recording, guess: Guess) -> Iterator[Finding]:
    """Yield what is wrong with the channels of the joints that were guessed, as they were recorded."""
    try:
        joints = Rig.from_toml(rig_template(recording, guess), "the guessed rig").joints
    except VsalogError:
        return
    for name, joint in joints.items():
        currents = [role for role, signal in offered_roles(joint).items() if signal.unit == "A"]
        plain = _as_recorded(joint)
        roles = [role for role in read_roles(offered_roles(plain)) if _is_recorded(recording, plain, role)]
        if not roles:
            continue
        try:
            signals = bind([recording], name, plain, roles, acting=False)
        except VsalogError:
            continue  # what cannot be bound is said by those who need it
        yield from _of(recording, name, plain, signals, currents)


def _of(
    recording: Recording, name: str, joint: Joint, signals: JointSignals, currents: list[str]
) -> Iterator[Finding]:
    found = [finding for finding in signals.findings if finding.code in BOUND]
    found += channel_findings([recording], name, joint)
    found += sensor.passing(signals) if _is_rigid(joint) else signal_findings(device_of(name, joint), signals)
    yield from without_superseded((*found, *findings_of(signals, currents)), RecordingFaults.supersedes)


def _is_rigid(joint: Joint) -> bool:
    return isinstance(joint, RigidJoint)


def _as_recorded(joint: Joint) -> Joint:
    """Return a guessed joint without what the guess did about signs and gears; a current counts as it is."""
    plain = {role: replace(signal, sign=1, side="joint") for role, signal in offered_roles(joint).items()}
    motors = {motor: replace(getattr(joint, motor) or Motor(), torque_constant=1.0) for motor in motors_of(joint)}
    return replace(joint, signals=replace(joint.signals, **plain), **motors)


def motors_of(joint: Joint) -> list[str]:
    """Return the names of a joint's motors."""
    return [name for name in ("motor", "motor_1", "motor_2") if hasattr(joint, name)]


def _is_recorded(recording: Recording, joint: Joint, role: str) -> bool:
    names = wanted_channels(joint, recording.path.name, [role]) or {""}
    found = [recording.channels.get(name) for name in names]
    return all(channel is not None and np.isfinite(channel.values).any() for channel in found)
