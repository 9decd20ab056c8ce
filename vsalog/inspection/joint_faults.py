"""Faults in the channels of guessed joints, by the checks of the other commands."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from msgspec.structs import replace

from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.checks import sensor, torque
from vsalog.checks.channel import channel_findings
from vsalog.checks.check import without_superseded
from vsalog.checks.recording_faults import RecordingFaults, exchanged_joints, findings_of, read_roles, with_more
from vsalog.checks.signals import signal_findings
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.rig import Rig
from vsalog.rig.guess_types import Guess, JointGuess, RoleGuess
from vsalog.rig.schema import Joint, Motor, RigidJoint
from vsalog.rig.template import named_joints, rig_template

GEAR = ("signal.scale", "encoder.unit", "encoder.deflection_unit", "encoder.zero")
"""Findings that a gear between two positions, or counts, give rise to."""

BOUND = ("sensor.stuck", "recording.outliers")
"""Findings of binding that are about what was recorded, and not about the rig."""


def joint_faults(recording: Recording, guess: Guess) -> Iterator[Finding]:
    """Yield the faults in the channels of the guessed joints that the guess does not name itself."""
    try:
        joints = Rig.from_toml(_rig_of_all_channels(recording, guess), "the guessed rig").joints
    except VsalogError:
        return
    bound: dict[str, JointSignals] = {}
    joints = {name: _currents_as_torques(joint) for name, joint in joints.items()}
    for name, joint in list(joints.items()):
        # Callers that need a role report if it cannot be bound.
        with suppress(VsalogError):
            if (signals := _signals(recording, name, joint)) is None:
                continue
            # A delay may look like a sign: where something else than signs explains the channels as counted, that is reported.
            guessed = any(signal.sign < 0 for signal in offered_roles(joint).values())
            if guessed and not any(True for _ in findings_of(signals)):
                counted = _signals(recording, name, _as_counted(joint))
                if counted is not None and any(one.code != "signal.sign" for one in findings_of(counted)):
                    joints[name], signals = _as_counted(joint), counted
            bound[name] = signals
    exchanged, put_right = exchanged_joints(bound) if len(bound) > 1 else (None, bound)
    if exchanged is not None:
        yield exchanged
    stated = dict(named_joints(guess))
    for name, signals in bound.items():
        found = _alone(recording, joints[name], stated[name], signals, put_right[name])
        yield from (finding for finding in found if not _is_stated(finding, stated[name], joints[name]))


def _signals(recording: Recording, name: str, joint: Joint) -> JointSignals | None:
    """Return the roles of a joint that are recorded; None for none.

    Raises
    ------
    VsalogError
        They cannot be bound.
    """
    roles = [role for role in offered_roles(joint) if _is_recorded(recording, joint, role)]
    if not (read := read_roles(roles)):
        return None
    return with_more(bind([recording], name, joint, read, acting=False), [recording], joint, roles, acting=False)


def _as_counted(joint: Joint) -> Joint:
    """Return a joint without the guessed signs, but for that of a motor's torque, which its inertia shows too."""
    plain = {
        r: replace(signal, sign=1) for r, signal in offered_roles(joint).items() if not r.startswith("motor_torque")
    }
    return replace(joint, signals=replace(joint.signals, **plain))


def _is_stated(finding: Finding, guess: JointGuess, checked: Joint) -> bool:
    """Return whether the guess states a finding itself: a sign that was not applied, or a scale that it leaves open."""
    roles = {role for some in finding.part.split(" or ") for role in some.split(" and ")}
    if finding.code == "signal.sign":
        signs = {role: signal.sign for role, signal in offered_roles(checked).items()}
        return any(guess.roles[role].sign != signs.get(role) for role in roles & set(guess.roles))
    has_gear = guess.gear_ratio is not None and guess.whole_gear_ratio is None
    is_open = has_gear and any("position" in role for role in roles)
    return finding.code in GEAR and (is_open or any(count in role for role in roles for count in _counts(guess)))


def _rig_of_all_channels(recording: Recording, guess: Guess) -> str:
    """Return a rig in which currents, counts and motors before a gear have channels, too, though their scale is unknown."""
    bare = replace(guess, joints=tuple(replace(joint, roles=dict(_checked(joint))) for joint in guess.joints))
    constants = {f"motor{suffix}.torque_constant": "1.0" for suffix in ("", "_1", "_2")}
    answers = {
        name: constants | ({"motor.gear_ratio": str(joint.whole_gear_ratio)} if joint.whole_gear_ratio else {})
        for name, joint in named_joints(bare)
    }
    return rig_template(recording, bare, answers, with_beginnings=False)


def _checked(joint: JointGuess) -> Iterator[tuple[str, RoleGuess]]:
    """Yield the roles, as recorded where the guess leaves a scale open."""
    for role, guess in joint.roles.items():
        side = guess.side if joint.whole_gear_ratio is not None else "joint"
        yield role, replace(guess, side=side, unit=None if guess.unit == "counts" else guess.unit)


def _alone(
    recording: Recording, joint: Joint, guess: JointGuess, signals: JointSignals, put_right: JointSignals
) -> Iterator[Finding]:
    """Yield the faults of one joint's channels; `put_right` has exchanged channels corrected."""
    name = signals.joint
    currents = [role for role, one in guess.roles.items() if one.is_current]
    found = [finding for finding in signals.findings if finding.code in BOUND]
    found += channel_findings([recording], name, joint)
    rigid = isinstance(joint, RigidJoint)
    found += (
        (*sensor.passing(signals), *torque.stuck(signals))
        if rigid
        else signal_findings(device_of(name, joint), put_right)
    )
    compared = findings_of(_without_counts(put_right, guess), currents)
    yield from without_superseded((*found, *compared), RecordingFaults.supersedes)


def _without_counts(signals: JointSignals, guess: JointGuess) -> JointSignals:
    """Return the signals without raw counts, which are in proportion to no other channel."""
    kept = {role: values for role, values in signals.roles.items() if role not in _counts(guess)}
    return signals if len(kept) == len(signals.roles) else dataclasses.replace(signals, roles=kept)


def _counts(guess: JointGuess) -> set[str]:
    return {role for role, one in guess.roles.items() if one.unit == "counts"}


def _currents_as_torques(joint: Joint) -> Joint:
    """Return a joint whose motors make 1 N·m per ampere."""
    motors = [name for name in ("motor", "motor_1", "motor_2") if hasattr(joint, name)]
    return replace(joint, **{name: replace(getattr(joint, name) or Motor(), torque_constant=1.0) for name in motors})


def _is_recorded(recording: Recording, joint: Joint, role: str) -> bool:
    names = wanted_channels(joint, recording.path.name, [role]) or {""}
    found = [recording.channels.get(name) for name in names]
    return all(channel is not None and np.isfinite(channel.values).any() for channel in found)
