"""The gaps of a guessed rig that no log can fill, and which command can use it as it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from msgspec import Struct

from vsalog.rig.guess_types import JointGuess
from vsalog.rig.roles import COMMANDS

Command = Literal["estimate", "identify", "simulate"]

Answers = Mapping[str, str]
"""By key below the joint, such as ``motor.torque_constant``: a value as TOML writes it."""


class Gap(Struct, frozen=True):
    """What the rig of a joint lacks: a number, or one of several values.

    Attributes
    ----------
    key : below the joint, such as ``signals.link_position.counts_per_turn``; its last part names the missing number
    unit : SI; "" for a plain number
    channel : that it is about
    guess : from the log; None where it shows none
    choices : the possible values as TOML writes them; empty for a number
    """

    key: str
    unit: str
    channel: str
    guess: float | None = None
    choices: tuple[str, ...] = ()


SIDES, SIGNS = ('"rotor"', '"joint"'), ("1", "-1")


def gaps_of(joint: JointGuess, answers: Answers) -> Iterator[Gap]:
    """Yield what the rig of a guessed joint lacks for stiffness or torques in SI.

    Parameters
    ----------
    joint : guessed
    answers : those so far: an encoder on the joint's side needs no gear ratio
    """
    for role, guess in joint.roles.items():
        if guess.unit == "counts":
            yield Gap(counts_key(role), "", guess.channel, guess.counts_per_turn)
    for suffix in ("", "_1", "_2"):
        motor, torque = joint.roles.get(f"motor_position{suffix}"), joint.roles.get(f"motor_torque{suffix}")
        side = f"signals.motor_position{suffix}.side"
        if motor is not None and motor.unit == "counts":
            yield Gap(side, "", motor.channel, choices=SIDES)
        if motor is not None and (motor.side == "rotor" or (motor.unit == "counts" and answers.get(side) != SIDES[1])):
            yield Gap(f"motor{suffix}.gear_ratio", "", motor.channel, joint.whole_gear_ratio)
        elif torque is not None and torque.side == "rotor":
            yield Gap(f"motor{suffix}.gear_ratio", "", torque.channel if motor is None else motor.channel)
        if torque is not None and torque.is_current:
            yield Gap(f"motor{suffix}.torque_constant", "N*m/A", torque.channel)
        if torque is not None and joint.kind != "rigid" and not _has_sensor(joint):
            yield Gap(f"motor{suffix}.inertia", "kg*m^2", torque.channel)
    torque_role = "torque_sensor" if _has_sensor(joint) else "motor_torque"
    for role, guess in joint.roles.items():
        if joint.kind != "rigid" and not guess.has_sign and role.startswith(("motor_position", torque_role)):
            yield Gap(f"signals.{role}.sign", "", guess.channel, choices=SIGNS)


def counts_key(role: str) -> str:
    """Return the key of the counts of a role's encoder, below the joint."""
    return f"signals.{role}.counts_per_turn"


def waits_for(joint: JointGuess, answers: Answers) -> tuple[str, ...]:
    """Return the keys without which a command refuses a joint: counts, or an angle before an unknown gear, are no angle of it."""
    if not joint.roles:
        return ("signals",)
    keys = [
        counts_key(role)
        for role, guess in joint.roles.items()
        if guess.unit == "counts" and guess.counts_per_turn is None
    ]
    keys += [
        f"motor{role.removeprefix('motor_position')}.gear_ratio"
        for role, guess in joint.roles.items()
        if role.startswith("motor_position") and SIDES[0] in (answers.get(f"signals.{role}.side"), f'"{guess.side}"')
    ]
    return tuple(key for key in keys if key not in answers)


def command_for(joint: JointGuess, answers: Answers) -> Command:
    """Return the command that can use a guessed joint, once nothing is missing: the most informative one."""
    roles = set(joint.roles)
    if not roles:
        return "estimate"
    if joint.kind == "rigid":
        moves = "motor_torque" in roles or not roles.isdisjoint(COMMANDS)
        return "identify" if moves and "link_position" in roles else "simulate"
    suffixes = ("_1", "_2") if joint.kind == "antagonistic" else ("",)
    if not all(f"deflection{s}" in roles or {f"motor_position{s}", "link_position"} <= roles for s in suffixes):
        return "simulate"
    if _has_sensor(joint) or all(_has_motor_side(joint, suffix, answers) for suffix in suffixes):
        return "estimate"
    return "identify" if joint.kind == "elastic" and "motor_torque" in roles else "simulate"


def _has_sensor(joint: JointGuess) -> bool:
    both = {"torque_sensor_1", "torque_sensor_2"}
    return "torque_sensor" in joint.roles or both <= set(joint.roles)


def _has_motor_side(joint: JointGuess, suffix: str, answers: Answers) -> bool:
    torque = joint.roles.get(f"motor_torque{suffix}")
    if torque is None or f"motor{suffix}.inertia" not in answers:
        return False
    return not torque.is_current or f"motor{suffix}.torque_constant" in answers
