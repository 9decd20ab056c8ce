"""A rig file to start from: the guesses filled in, the gaps as comments, each line with its reason.

The text always loads, so that it can be tried at once and filled in step by step.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vsalog.core.finding_texts import sentence
from vsalog.core.printable import printable
from vsalog.core.recording import Recording
from vsalog.core.resolution import noise_of, step_of
from vsalog.core.units import shown
from vsalog.rig.checks import RUN
from vsalog.rig.guess_answers import with_answers
from vsalog.rig.guess_gaps import SIDES, SIGNS, Answers, Command, command_for, counts_key, gaps_of
from vsalog.rig.guess_types import Guess, JointGuess, RoleGuess
from vsalog.rig.load import Rig
from vsalog.rig.schema import Joint, Signal

COLUMN = 48
"""Character at which comments begin, if the line leaves room."""

_MOTORS = {
    "elastic": ("motor",),
    "serial": ("motor", "secondary_motor"),
    "antagonistic": ("motor_1", "motor_2"),
    "rigid": (),
}
_TRANSMISSIONS = {
    "elastic": ("transmission",),
    "serial": ("transmission",),
    "antagonistic": ("transmission_1", "transmission_2"),
}


def rig_template(
    recording: Recording,
    guess: Guess,
    answers: Mapping[str, Answers] = MappingProxyType({}),
    *,
    with_beginnings: bool = True,
) -> str:
    """Return a `rig.toml` for the joints guessed in a recording.

    Parameters
    ----------
    recording, guess : the log, and the guess about it
    answers : per joint, the answers about its gaps
    with_beginnings : write initial values, where a command needs some; else only numbers from the log
    """
    lines = [*_head(recording, guess), ""]
    for name, joint in named_joints(guess):
        known = answers.get(name, {})
        joint = with_answers(joint, recording, known)
        lines.extend(_joint(name, joint, known, command_for(joint, known) if with_beginnings else "estimate"))
        lines.extend([] if joint.roles else _channels(recording))
    return "\n".join(lines).rstrip("\n") + "\n"


def _channels(recording: Recording) -> Iterator[str]:
    """Yield the channels of a log as comments, to choose from."""
    yield "# Channels of the log:"
    for channel in recording.channels.values():
        values = channel.values[np.isfinite(channel.values)]
        facts = [f"{values.min():.5g} to {values.max():.5g}" if values.size else "no numbers"]
        facts += [] if (step := step_of(values)) is None else [f"step {step:.3g}"]
        facts += [] if (noise := noise_of(values)) is None else [f"noise {noise:.3g}"]
        yield _gap("channel", toml_string(channel.name), ", ".join([channel.unit or "no unit", *facts]))


def preset_template(recording: Recording, guess: Guess, name: str) -> str:
    """Return a `rig.toml` that starts from a preset and takes its channels from a recording.

    Raises
    ------
    RigError
        There is no such preset.
    """
    rig = Rig.preset(name)
    lines = [*_head(recording, guess), "", f"preset = {toml_string(name)}", ""]
    guesses = {joint.name: joint for joint in guess.joints}
    in_order = list(guess.joints)
    for i, (joint_name, joint) in enumerate(rig.joints.items()):
        found = guesses.get(joint_name) or (in_order[i] if i < len(in_order) else None)
        lines.append(f"[joint.{toml_key(joint_name)}.signals]")
        lines.extend(_preset_signals(recording, joint, found))
        lines.append("")
    lines.extend([] if guess.joints else _channels(recording))
    return "\n".join(lines).rstrip("\n") + "\n"


def channels_lacking(rig: Rig, recording: Recording) -> Iterator[str]:
    """Yield the keys of a rig's roles whose channels a recording lacks."""
    for name, joint in rig.joints.items():
        for role in joint.signals.__struct_fields__:
            channel = _channel(joint, role)
            if channel is not None and RUN not in channel and channel not in recording.channels:
                yield f"joint.{toml_key(name)}.signals.{role}"


def toml_string(text: str) -> str:
    """Write any text as a TOML string."""
    escaped = []
    for c in text:
        if c in '"\\':
            escaped.append("\\" + c)
        elif c.isprintable():
            escaped.append(c)
        elif 0xD800 <= ord(c) <= 0xDFFF:
            escaped.append("�")  # half a character is no text
        else:
            escaped.append(f"\\U{ord(c):08X}")
    return '"' + "".join(escaped) + '"'


def toml_key(name: str) -> str:
    """Write a name as a TOML key, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def _head(recording: Recording, guess: Guess) -> list[str]:
    lines = [
        f"# Rig of {printable(recording.path.name)}, guessed by 'vsalog init'.",
        "# A percentage is the confidence in a guess; check them all. Lines that begin with '# key =' are gaps to fill in.",
        '# Numbers are SI; any other unit goes into the text: "7.3 kg*m*mm", "500 N*mm/rad", "deg".',
    ]
    if recording.rig_text is not None:
        lines.append("# The log carries a rig of its own, which is used when no other is given.")
    for finding in guess.findings:
        lines.extend(_note(sentence(finding)))
    return lines


def named_joints(guess: Guess) -> Iterator[tuple[str, JointGuess]]:
    """Yield the joints under the names that the rig has for them."""
    taken: set[str] = set()
    for joint in guess.joints:
        name = shown(joint.name).strip() or "joint"
        while name in taken:
            name += "_"
        taken.add(name)
        yield name, joint


def _joint(name: str, joint: JointGuess, answers: Answers, command: Command) -> Iterator[str]:
    path = f"joint.{toml_key(name)}"
    yield f"[{path}]"
    yield _line(f'kind = "{joint.kind}"', f"{_percent(joint.confidence)}: {joint.reason}")
    for finding in joint.findings:
        yield from _note(sentence(finding))
    yield ""
    begin = command != "estimate"
    if begin:
        fits = (
            "fits them to the log" if command == "identify" else "simulates them; the log lacks signals for a stiffness"
        )
        yield f"# Initial values: 'vsalog {command}' {fits}."
    for motor in _MOTORS[joint.kind]:
        yield from _motor(f"{path}.{motor}", motor, joint, answers, begin)
    for transmission in _TRANSMISSIONS.get(joint.kind, ()):
        yield from _transmission(f"{path}.{transmission}", joint, answers, begin)
    if joint.kind == "serial":
        yield from _lever(path, begin)
    if joint.kind != "rigid":
        yield from _basis(path)
        if begin and command == "simulate":
            yield from (f"[{path}.link]", 'inertia = "1 kg*m^2"', "")
    elif "motor_torque" in joint.roles and not joint.is_driven and command == "identify":
        yield from _motor(f"{path}.motor", "motor", joint, answers, begin)
    elif begin:
        yield from _servo(path)
    yield f"[{path}.signals]"
    for role, guess in joint.roles.items():
        yield _signal(role, guess, bool(joint.runs), answers, lacks=_lacks(joint, role, answers, command))
        open_keys = [gap.key for gap in gaps_of(joint, answers) if gap.choices and gap.key not in answers]
        yield from _otherwise(role, guess, answers, [key for key in open_keys if key.startswith(f"signals.{role}.")])
    for role, why in joint.missing.items():
        if role != "setpoint" or not joint.runs:
            yield _gap(role, '"…"', why)
    yield ""
    for run in joint.runs:
        yield f"[[{path}.run]]"
        yield f"name = {toml_string(run.name)}"
        if run.setpoint is not None and joint.kind == "serial":
            yield _line(
                f"setpoint = {run.setpoint!r}",
                f'from the name, its unit is unknown: write "{run.setpoint:g} mm" or "{run.setpoint:g} deg"',
            )
        yield ""


def _lacks(joint: JointGuess, role: str, answers: Answers, command: Command) -> str | None:
    """Return the key of a motor without which a torque would stop a command that does not need it; None for none."""
    guess, motor = joint.roles[role], f"motor{role.removeprefix('motor_torque')}"
    key = "torque_constant" if guess.is_current else "gear_ratio"
    if command != "estimate" or f"{motor}.{key}" in answers or not role.startswith("motor_torque"):
        return None
    motors = joint.roles.get(role.replace("torque", "position"))
    # A position before the gear needs the ratio in any case.
    before = guess.side == "rotor" and (motors is None or motors.side == "joint")
    return key if guess.is_current or before else None


def _servo(path: str) -> Iterator[str]:
    """Yield a position loop of a few hertz, of a joint whose inertia is 1: initial values of an identification."""
    yield f"[{path}.motor]"
    yield _line('inertia = "1 kg*m^2 ± 0"', "not fitted; write the known value, else torques are per unit of inertia")
    yield 'damping = "20 N*m*s/rad"'
    yield 'friction = { coulomb = "1 N*m" }'
    yield ""
    yield f"[{path}.link]"
    yield _line('inertia = "0.001 kg*m^2 ± 0"', "part of the motor's; here for its weight")
    yield 'gravity_torque = "1 N*m"'
    yield 'gravity_angle = "0 rad ± 90 deg"'
    yield ""
    yield f"[{path}.drive]"
    yield _line('kind = "position-servo"', "leave the table out where a recorded torque moves the joint")
    yield 'kp = "400 N*m/rad"'
    yield 'kd = "10 N*m*s/rad"'
    yield 'delay = "50 ms"'
    yield _line(
        'acceleration_limit = "40 rad/s^2"', "of the motion that the drive plans; leave it out where it plans none"
    )
    yield ""


def _basis(path: str) -> Iterator[str]:
    yield f"[{path}.basis]"
    yield _line("odd = false", "a constant term absorbs offsets of encoders and sensors; true once these are zeroed")
    yield _gap("order", "4", "terms in the deflection: more where the curve has knees")
    yield _gap(
        "branches", "true", "loading and unloading separately, where the torque has a wide loop over the deflection"
    )
    yield ""


def _motor(path: str, key: str, joint: JointGuess, answers: Answers, begin: bool) -> Iterator[str]:
    if key == "secondary_motor":
        yield f"[{path}]" if begin else f"# [{path}]"
        yield from ('inertia = "1 kg*m^2"',) if begin else ()
        yield _gap("gear_ratio", "23.0", "of the motor that sets the stiffness, where its position is the rotor's")
        yield ""
        return
    yield f"[{path}]"
    if begin and f"{key}.inertia" not in answers:
        inertia = 0.0 if joint.load is None else joint.load.inertia
        size, why = (f"{inertia:.3g}", _by_motion(joint, answers)) if inertia > 0.0 else ("1", "made up")
        yield _line(f'inertia = "{size} kg*m^2"', why)
    else:
        why = "not in any log; needed where the torque comes from the motor's side"
        yield _known(answers, f"{key}.inertia", '"2.3e-5 kg*m^2"', why)
    yield _gap("damping", '"0.001 N*m*s/rad"', "0 when left out")
    yield _gap("side", '"rotor"', "where inertia and damping are the rotor's own, not yet times gear_ratio²")
    why = "1 when left out; needed for whatever is measured on the rotor's side"
    if joint.whole_gear_ratio is not None:
        why = "the only whole number that motor and link allow, no datum: look it up"
    elif joint.gear_ratio is not None:
        why = "as the log roughly shows, no datum: look it up"
    ratio = joint.whole_gear_ratio or float(f"{joint.gear_ratio or 50.0:.2g}")
    yield _known(answers, f"{key}.gear_ratio", str(ratio), why)
    suffix = key.removeprefix("motor")
    torque = joint.roles.get(f"motor_torque{suffix}")
    if torque is not None and torque.is_current:
        if begin and f"{key}.torque_constant" not in answers:
            yield _line(
                'torque_constant = "1 N*m/A ± 0"', "not fitted; write the known value, else torques are currents"
            )
        else:
            why = "needed for the motor torque, which is recorded as a current"
            yield _known(answers, f"{key}.torque_constant", '"0.05 N*m/A"', why)
    yield ""


def _known(answers: Answers, key: str, example: str, why: str) -> str:
    """Return the line of a key with its answer, or else as a gap."""
    name = key.rpartition(".")[2]
    return f"{name} = {answers[key]}" if key in answers else _gap(name, example, why)


def _stiffness(joint: JointGuess, answers: Answers, begin: bool) -> tuple[float, str] | None:
    """Return a guess of the stiffness [N·m/rad] and its evidence: by the torque sensor, else by the motor's torque.

    A current is a torque only where the rig states a torque constant: an answer, or the one of the initial values.
    """
    if joint.stiffness is not None:
        return joint.stiffness, "by torque sensor and deflection"
    if joint.load is None or joint.load.spring <= 0.0 or not (begin or _has_torque(joint, answers)):
        return None
    return joint.load.spring, _by_motion(joint, answers)


def _has_torque(joint: JointGuess, answers: Answers) -> bool:
    return not joint.roles["motor_torque"].is_current or "motor.torque_constant" in answers


def _by_motion(joint: JointGuess, answers: Answers) -> str:
    return "by torque and motion" if _has_torque(joint, answers) else "by current and motion, for this torque_constant"


def _transmission(path: str, joint: JointGuess, answers: Answers, begin: bool) -> Iterator[str]:
    yield f"[{path}]"
    found = _stiffness(joint, answers, begin)
    choices = "linear, cubic, polynomial, exponential" + (", vsa2 or awas" if joint.kind == "serial" else " or vsa2")
    law = f"{choices} where the spring's law is known; then its parameters go here too"
    if not begin:
        yield _line('type = "unknown"', law)
        if found is not None:
            why = f"{found[1]}; with type = \"linear\" 'vsalog identify' can begin there"
            yield _gap("stiffness", f'"{found[0]:.3g} N*m/rad"', why)
    elif joint.kind == "serial":
        yield _line('type = "awas"', law)
        yield 'spring_stiffness = "40 kN/m"'
    else:
        yield _line('type = "linear"', law)
        size, why = found or (400.0, "made up")
        yield _line(f'stiffness = "{size:.3g} N*m/rad"', why)
    yield ""


def _lever(path: str, begin: bool) -> Iterator[str]:
    yield f"[{path}.lever]" if begin else f"# [{path}.lever]"
    if begin:
        yield from ('start = "100 mm"', 'travel = "2.5 mm/rev"', "")
        return
    yield _gap(
        "start", '"100 mm"', "where the set-point is an angle that moves a lever arm: r = start − travel · angle"
    )
    yield _gap("travel", '"2.5 mm/rev"', "both or none")
    yield ""


def _signal(
    role: str,
    guess: RoleGuess,
    has_runs: bool,
    answers: Answers = MappingProxyType({}),
    *,
    lacks: str | None = None,
) -> str:
    counts = answers.get(counts_key(role), guess.counts_per_turn)
    value = _value(role, guess, answers)
    why = f"{_percent(guess.confidence)}: {'; '.join(guess.reasons)}"
    if RUN in guess.channel and not has_runs:
        return _gap(role, value, f"{why}; but its name contains {RUN}, which is replaced by a run")
    if lacks is not None:
        return _gap(role, value, f"{why}; write the motor's {lacks}, and remove the #")
    if guess.unit == "counts" and counts is None:
        why = f"write counts_per_turn = 4096, or its number, for the unit; {why}"
    return _line(f"{role} = {value}", why)


def _value(role: str, guess: RoleGuess, answers: Answers) -> str:
    """Return a role's channel with its unit, side and sign, as TOML writes it."""
    parts = []
    counts = answers.get(counts_key(role), guess.counts_per_turn)
    if guess.unit == "counts" and counts is not None:
        parts.append(f"counts_per_turn = {counts}")
    elif guess.unit is not None:
        parts.append(f"unit = {toml_string(guess.unit)}")
    # A motor's velocity is its position's derivative.
    of = role.replace("velocity", "position") if role.startswith("motor_velocity") and guess.unit == "counts" else role
    side, sign = (
        answers.get(f"signals.{of}.side", f'"{guess.side}"'),
        answers.get(f"signals.{of}.sign", str(guess.sign)),
    )
    parts += [] if side == SIDES[1] else [f"side = {side}"]
    parts += [] if sign == SIGNS[0] else [f"sign = {sign}"]
    channel = toml_string(guess.channel)
    return f"{{ channel = {channel}, {', '.join(parts)} }}" if parts else channel


def _otherwise(role: str, guess: RoleGuess, answers: Answers, unknown: Sequence[str]) -> Iterator[str]:
    """Yield the line of a role with the other value of each key that the log does not show."""
    whys = {
        "side": "where it is on the motor's shaft, before the gear (then write gear_ratio, too)",
        "sign": "where it counts the other way round: φ = q − θ, and torques that rise with it, are positive",
    }
    names = [key.rpartition(".")[2] for key in unknown]
    values = {"side": SIDES[0], "sign": SIGNS[1]}
    if names:
        counts = {counts_key(role): "4096"} if guess.unit == "counts" and guess.counts_per_turn is None else {}
        other = {f"signals.{role}.{name}": values[name] for name in names}
        why = "; ".join(f"{name}: {whys[name]}" for name in names)
        yield _gap(role, _value(role, guess, {**counts, **answers, **other}), f"unknown, {why}")


def _preset_signals(recording: Recording, joint: Joint, found: JointGuess | None) -> Iterator[str]:
    """Yield a line per role: as the preset has it, as guessed, or a gap."""
    kept = {c for role in joint.signals.__struct_fields__ if (c := _channel(joint, role)) in recording.channels}
    for role in joint.signals.__struct_fields__:
        there = _channel(joint, role)
        guess = found.roles.get(role) if found is not None else None
        if there in recording.channels:
            yield _gap(role, toml_string(str(there)), "as in the preset: the log has this channel")
        elif guess is not None and guess.channel not in kept:
            yield _signal(role, guess, has_runs=False)
        elif there is not None:
            yield _gap(role, '"…"', f"not found: the preset has '{there}', which the log lacks")


def _channel(joint: Joint, role: str) -> str | None:
    spec: str | float | Signal | None = getattr(joint.signals, role)
    channel = spec.channel if isinstance(spec, Signal) else spec
    return channel if isinstance(channel, str) else None


def _line(text: str, comment: str) -> str:
    return f"{text:<{COLUMN}}# {printable(comment)}" if len(text) < COLUMN else f"{text}  # {printable(comment)}"


def _gap(key: str, value: str, why: str) -> str:
    return _line(f"# {key} = {value}", why)


def _note(text: str) -> list[str]:
    return textwrap.wrap(f"Note: {printable(text)}", 116, initial_indent="# ", subsequent_indent="#   ")


def _percent(confidence: float) -> str:
    return f"{round(100 * confidence)} %"
