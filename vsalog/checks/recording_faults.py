"""Faults of a recording: what changed channels between a sensor and the log, as findings.

`fault_search.py` searches them in the relations between a joint's channels. Of a sound recording one joint in a thousand
(`FALSE_ALARM`) has a finding by chance.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np

from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.checks.channel import channel_findings
from vsalog.checks.check import Context, OfSignals
from vsalog.checks.fault import RULE, Fault, Found, Kind
from vsalog.checks.fault_search import exchanged_between, faults_of, with_exchanged
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Evidence, Finding, Text, of_log
from vsalog.core.finding_texts import add_texts
from vsalog.core.look import LOOK_ROWS, spread_over
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.rig.schema import Joint

READ = ("motor_position", "link_position", "deflection", "motor_torque", "torque_sensor", "setpoint")
"""Roles, without their numbers, that the equations read."""

TOO = ("motor_velocity", "link_velocity", "commanded_position")
"""Roles that they read along with these, where these are not cut short by them."""

CODES: Mapping[Kind, str] = {
    "sign": "signal.sign",
    "unit": "signal.unit",
    "scale": "signal.scale",
    "late": "signal.late",
    "drift": "signal.clock_rate",
    "exchanged": "signal.exchanged",
    "unsigned": "torque.unsigned",
    "gravity": "torque.without_gravity",
}


# A magnitude may rest at 0.
FOLLOWING = tuple(code for code in CODES.values() if code != "torque.unsigned")


class RecordingFaults:
    """Compares a joint's channels with one another; one sound joint in a thousand has a finding (`FALSE_ALARM`)."""

    name = "recording_faults"
    supersedes: Mapping[str, Sequence[str]] = {
        "signal.sign": ("encoder.sign",),
        "torque.unsigned": ("sensor.saturated", "sensor.clipped", "torque.dropouts"),
        "signal.unit": ("encoder.deflection_unit", "encoder.unit", "encoder.zero"),
        "signal.scale": ("encoder.deflection_unit", "encoder.unit", "encoder.zero"),
        "signal.interpolated": ("sensor.clipped", "sensor.frozen"),
        # Channels that were clipped or stuck for a while fit others less well, whatever is undone.
        **dict.fromkeys(
            ("sensor.clipped", "sensor.frozen", "sensor.saturated", "sensor.stuck", "encoder.stuck", "torque.stuck"),
            FOLLOWING,
        ),
    }

    def start(self, context: Context) -> OfSignals:
        """Check the roles, also those that the estimator does not read if they are recorded."""
        look = context.look if context.signals.in_file else None
        return OfSignals(log_findings(context.recordings, context.look.joint, context.joint, context.setpoints, look))


def log_findings(
    recordings: Sequence[Recording],
    name: str,
    joint: Joint,
    setpoints: Sequence[float | None] = (),
    look: JointSignals | None = None,
) -> list[Finding]:
    """Return the faults of a joint's channels, each by itself and together.

    Parameters
    ----------
    recordings : with those of the joint's channels that were read
    name, joint : of the rig
    setpoints : as for `bind`
    look : signals to check instead of all of a log that is too long for memory
    """
    found = list(channel_findings(recordings, name, joint))
    if look is not None and len(recordings) == 1:
        found += findings_of(look)
    elif len(recordings) == 1:
        found += _together(recordings[0], name, joint, setpoints)
    elif look is not None:
        for name_of_run, (begin, end) in zip(look.run_names, pairwise(_edges(look)), strict=False):
            found += of_log(name_of_run, findings_of(look[begin:end]))
    else:
        # A fault belongs to one recording, and so do the spring, the load and the set-point that the equations presume.
        for i, one in enumerate(recordings):
            found += of_log(one.path.name, _together(one, name, joint, setpoints[i : i + 1]))
    # `inspect` reports clock rates, from all of a log: a stretch is too short to measure one.
    return [finding for finding in found if finding.code != CODES["drift"]]


def _edges(look: JointSignals) -> list[int]:
    """Return where runs begin, and the end."""
    return [0, *(np.flatnonzero(np.diff(look.run)) + 1).tolist(), len(look)]


def _together(recording: Recording, name: str, joint: Joint, setpoints: Sequence[float | None]) -> Iterable[Finding]:
    """Return the faults that channels of one recording show together."""
    roles, signals = [role for role in offered_roles(joint) if _recorded([recording], joint, role)], None
    # Callers that need a role report if it cannot be bound.
    with suppress(VsalogError):
        if read := read_roles(roles):
            signals = bind([recording], name, joint, read, setpoints)
            signals = with_more(signals, [recording], joint, roles, setpoints)
    return () if signals is None else findings_of(spread_over(signals, LOOK_ROWS))


def _recorded(recordings: Sequence[Recording], joint: Joint, role: str) -> bool:
    """Return whether recordings have numbers for a role."""
    names = {(one.path, channel) for one in recordings for channel in wanted_channels(joint, one.path.name, [role])}
    found = {(one.path, channel.name) for one in recordings for channel in one.channels.values()}
    return names <= found


def read_roles(roles: Collection[str]) -> list[str]:
    """Return those of a joint's roles that the equations read."""
    return [role for role in roles if role.removesuffix("_1").removesuffix("_2") in READ]


def with_more(
    signals: JointSignals,
    recordings: Sequence[Recording],
    joint: Joint,
    roles: Collection[str],
    setpoints: Sequence[float | None] = (),
    *,
    acting: bool = True,
) -> JointSignals:
    """Return a joint's signals with its velocities and commands, where these cover them.

    Parameters
    ----------
    signals : of the roles of `read_roles`
    recordings, joint, setpoints, acting : as of `bind`
    roles : of the joint that are recorded
    """
    more = [role for role in roles if role.removesuffix("_1").removesuffix("_2") in TOO]
    # Commands may come now and then only.
    for some in filter(None, (more, [role for role in more if "velocity" in role])):
        with suppress(VsalogError):
            every = bind(recordings, signals.joint, joint, [*read_roles(roles), *some], setpoints, acting=acting)
            if len(every) >= RULE.kept * len(signals) and every.starts.sum() <= signals.starts.sum():
                return every
    return signals


def findings_of(signals: JointSignals, unknown_scale: Collection[str] = ()) -> Iterator[Finding]:
    """Yield the faults of a joint's channels.

    Parameters
    ----------
    signals : of the joint
    unknown_scale : roles whose unit is none of a torque's, such as a current without its constant
    """
    for found in faults_of(signals, unknown_scale):
        yield _finding(signals, found)


def exchanged_joints(joints: Mapping[str, JointSignals]) -> tuple[Finding | None, Mapping[str, JointSignals]]:
    """Return that channels of two joints are exchanged, and the joints with these put right; None where they are not.

    Parameters
    ----------
    joints : of one log, by name
    """
    found = exchanged_between(joints)
    if found is None:
        return None, joints
    (a, b), what = found
    role = what.fault.roles[0]
    evidence: Evidence = {"first": a, "second": b, "p_value": what.p_value, "left": what.left}
    finding = Finding(code="signal.joints_exchanged", part=role, value=what.left, limit=RULE.left, evidence=evidence)
    return finding, with_exchanged(joints, a, b, role)


def _finding(signals: JointSignals, found: Found) -> Finding:
    fault = found.fault
    alike = (fault, *(one for one in found.instead if one.kind == fault.kind))
    value, limit, unit = _measured(signals, fault)
    evidence: Evidence = {"factor": fault.factor, "p_value": found.p_value, "left": found.left}
    return Finding(
        code=CODES[fault.kind],
        joint=signals.joint,
        part=" or ".join(dict.fromkeys(" and ".join(one.roles) for one in alike)),
        value=found.left if value is None else value,
        limit=RULE.left if value is None else limit,
        unit=unit,
        evidence=evidence,
    )


def _measured(signals: JointSignals, fault: Fault) -> tuple[float | None, float | None, str]:
    """Return a fault's size, its least reported value, and their unit; None for a ratio of squared residuals."""
    if fault.kind == "late":
        return fault.delay, RULE.finest * signals.period, "s"
    if fault.kind == "drift":
        return 1e6 * fault.rate, 1e6 * signals.period / float(signals.time[-1] - signals.time[0]), "ppm"
    return None, None, ""


# Symptoms of an estimate from inconsistent channels.
SYMPTOMS = (
    "cross_check.torque_scale", "cross_check.torque_unrelated",
    "estimate.partly_excited", "filter.noisy_rate", "motor.inertia_differs", "residual.follows_motion", "residual.not_noise",
    "sampling.too_slow", "sampling.too_slow_for_total", "spring.bouc_wen", "spring.corner", "spring.loop",
    "spring.not_polynomial", "spring.setpoint_not_polynomial", "spring.slip",
    "stiffness.changed",
    "stiffness.drifts", "stiffness.negative", "stiffness.scale", "torque.gain_differs",
)  # fmt: skip

TEXTS = {
    "signal.sign": Text(
        "{part} has the wrong sign: with it reversed, the squared residual of the joint's equations is {left:.1%} of the"
        " present one.",
        "Reverse its sign in the rig: 'sign = -1', or remove that where the rig has it already.",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "signal.unit": Text(
        "{part} is {factor:.4g} times what the other channels require, as in another unit: divided by it, the squared residual of"
        " the joint's equations is {left:.1%} of the present one.",
        "Give its unit in the rig: \"deg\" instead of \"rad\", \"N*mm\" instead of \"N*m\".",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "signal.scale": Text(
        "{part} is {factor:.4g} times what the other channels require: divided by it, the squared residual of the joint's"
        " equations is {left:.1%} of the present one. A position is then on the rotor's side of the gear, or in encoder counts;"
        " a torque on the rotor's side, or a current.",
        "Set 'side = \"rotor\"' of it in the rig with the motor's gear_ratio, or 'unit = \"A\"' with its torque_constant.",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "signal.late": Text(
        "{part} is {value:.3g} s later than the other channels (below 0: earlier; delays are tried in steps of {limit:.2g} s):"
        " with it shifted, the squared residual of the joint's equations is {left:.1%} of the present one.",
        "Set 'delay' of the role in the rig, which may be a part of a sample, or stamp samples where they are taken.",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "signal.clock_rate": Text(
        "{part} becomes later by {value:.4g} µs per second: it is on another clock than the other channels.",
        "Stamp all channels with one clock; --time log may do.",
        FALSE_ALARM,
    ),
    "signal.exchanged": Text(
        "{part} are exchanged: with them swapped, the squared residual of the joint's equations is {left:.1%} of the present"
        " one.",
        "Exchange their channels in the rig. Next to a torque sensor alone, exchanged positions look like its wrong sign:"
        " set 'sign = -1' of torque_sensor if the positions are right.",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "signal.joints_exchanged": Text(
        "{part} of {first} and of {second} are exchanged: with them swapped, the squared residual of the joints' equations"
        " is {left:.1%} of the present one.",
        "Exchange their channels in the rig.",
        FALSE_ALARM,
    ),
    "torque.unsigned": Text(
        "{part} is a magnitude: it is never negative, and with the sign from motion and load the squared residual of the joint's"
        " equations is {left:.1%} of the present one. An estimate from it is wrong wherever the torque reverses.",
        "Record the signed value, or leave the channel out of the rig.",
        FALSE_ALARM,
        SYMPTOMS,
    ),
    "torque.without_gravity": Text(
        "gravity was taken out of {part}: with a gravity torque added, the joint's equations leave {left:.1%} of what they leave"
        " now.",
        "Record the torque as it is measured, or take gravity out of the other one too.",
        FALSE_ALARM,
    ),
}  # fmt: skip
add_texts(TEXTS)
