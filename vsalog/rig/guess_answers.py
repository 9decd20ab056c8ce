"""What the numbers of a log show of a joint once the scales that no log contains are answered."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from vsalog.core.errors import UnitError
from vsalog.core.recording import Recording
from vsalog.rig.guess_checks import confirm_again
from vsalog.rig.guess_data import Ratio, without_outliers
from vsalog.rig.guess_gaps import Answers, counts_key
from vsalog.rig.guess_load import motor_load
from vsalog.rig.guess_types import JointGuess, RoleGuess
from vsalog.rig.uncertain import parse_stated


def with_answers(joint: JointGuess, recording: Recording, answers: Answers) -> JointGuess:
    """Return a guessed joint with the signs and the load that its answered scales show, and without the findings they settle."""
    if not answers:
        return joint
    said = {key: _number(value) for key, value in answers.items()}
    roles = {role: _answered(role, guess, said) for role, guess in joint.roles.items()}
    channels = {
        role: without_outliers(recording.channels[guess.channel])
        for role, guess in roles.items()
        if guess.channel in recording.channels
    }
    there = {role: guess for role, guess in roles.items() if role in channels}
    checked = confirm_again(there, channels, _gear_ratio(joint, said))
    constant = said.get("motor.torque_constant", 1.0)
    load = motor_load(checked.roles, channels, checked.known_gear_ratio, "deflection", constant)
    settled = {guess.channel for role, guess in roles.items() if counts_key(role) in answers}
    open_ones = (one for one in joint.findings if one.code != "guess.raw_counts" or one.part not in settled)
    return replace(
        joint,
        roles={**roles, **checked.roles},
        load=load,
        stiffness=checked.stiffness,
        findings=(*open_ones, *checked.findings),
    )


def _answered(role: str, guess: RoleGuess, said: Mapping[str, Any]) -> RoleGuess:
    sign = f"signals.{role}.sign"
    return replace(
        guess,
        side=said.get(f"signals.{role}.side", guess.side),
        sign=said.get(sign, guess.sign),
        has_sign=guess.has_sign or sign in said,
        counts_per_turn=said.get(counts_key(role), guess.counts_per_turn),
    )


def _gear_ratio(joint: JointGuess, said: Mapping[str, Any]) -> Ratio | None:
    """Return the gear ratio as `confirm_again` takes it: exact where it is answered or the log allows one only."""
    motor, side = joint.roles.get("motor_position"), "signals.motor_position.side"
    stated = said.get("motor.gear_ratio", joint.whole_gear_ratio)
    if motor is not None and motor.unit == "counts" and side not in said:
        return Ratio(math.nan)  # of an encoder that may be on either side of the gear
    if stated is not None:
        return Ratio(stated, stated, stated)
    is_behind = joint.gear_ratio is None and said.get(side) != "rotor"
    return None if is_behind else Ratio(math.nan)


def _number(answer: str) -> Any:
    """Return an answer's value: a number in SI, or a word."""
    value = tomllib.loads(f"value = {answer}")["value"]
    try:
        return parse_stated(value).to("N*m/A") if isinstance(value, str) else value
    except UnitError:
        return value
