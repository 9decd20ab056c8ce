"""Guesses from the numbers of a joint's roles: gear ratio, signs, and torques that are no measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from vsalog.core.finding import Evidence, Finding
from vsalog.core.recording import Channel
from vsalog.rig import guess_data
from vsalog.rig.guess_data import CORRELATED, Line
from vsalog.rig.guess_types import Kind, RoleGuess


@dataclass(slots=True)
class Checked:
    """Roles with sides and signs filled in, and the findings."""

    roles: dict[str, RoleGuess]
    gear_ratio: float | None = None
    findings: list[Finding] = field(default_factory=list)


def confirm(roles: Mapping[str, RoleGuess], channels: Mapping[str, Channel], kind: Kind) -> Checked:
    """Return the roles with side and sign as the numbers show them.

    Parameters
    ----------
    roles : by name
    channels : role → channel
    kind : of the joint; an antagonistic joint's motors may well move against the link
    """
    checked = Checked(dict(roles))
    if kind != "antagonistic":
        _gear(checked, channels)
    for suffix in ("", "_1", "_2"):
        if f"torque_sensor{suffix}" in checked.roles:
            _torque(checked, channels, suffix)
    return checked


def _gear(checked: Checked, channels: Mapping[str, Channel]) -> None:
    """Detect a gear between the two positions, and a motor with the opposite sign."""
    if "motor_position" not in channels or "link_position" not in channels:
        return
    found = guess_data.gear_between(channels["motor_position"], channels["link_position"])
    if found is None or found.slope == 0.0:
        return
    guess = checked.roles["motor_position"]
    if found.slope < 0.0:
        guess = _changed(guess, "it moves against the link", sign=-1)
    size = _motor_per_link(checked, channels, "")
    ratio = 0.0 if size is None else 1.0 / abs(found.slope) / size
    if round(ratio) > 1:  # else a deflection is likelier
        checked.gear_ratio = float(f"{ratio:.4g}")
        guess = _changed(guess, f"it moves {ratio:.4g} times as far as the link: before the gear", side="rotor")
        checked.findings.append(Finding(code="guess.gear_ratio", value=checked.gear_ratio))
    checked.roles["motor_position"] = guess
    if "motor_velocity" in checked.roles:
        checked.roles["motor_velocity"] = msgspec.structs.replace(
            checked.roles["motor_velocity"], side=guess.side, sign=guess.sign
        )


def _torque(checked: Checked, channels: Mapping[str, Channel], suffix: str) -> None:
    """Detect a torque that was computed from the deflection, and one with the opposite sign."""
    role = f"torque_sensor{suffix}"
    torque = channels[role]
    name, line = _over_deflection(torque, checked, channels, suffix)
    if line is None:
        return
    guess = checked.roles[role]
    if line.residual < guess_data.EXACT:
        evidence: Evidence = {"factor": float(line.slope), "source": name}
        checked.findings.append(Finding(code="torque.computed", part=f"'{torque.name}'", evidence=evidence))
        guess = msgspec.structs.replace(guess, confidence=round(guess.confidence * 0.6, 2))
    if line.correlation < -CORRELATED:
        guess = _changed(guess, f"it falls with {name}, while τ_e = k (q − θ) rises", sign=-1)
    elif line.correlation > CORRELATED:
        guess = _changed(guess, f"it rises with {name}")
    checked.roles[role] = guess


def _over_deflection(
    torque: Channel, checked: Checked, channels: Mapping[str, Channel], suffix: str
) -> tuple[str, Line | None]:
    """Fit the torque over the recorded deflection, or over link minus motor."""
    deflection = channels.get(f"deflection{suffix}")
    if deflection is not None:
        return f"'{deflection.name}'", guess_data.torque_over_deflection(torque, deflection)
    motor, link = channels.get(f"motor_position{suffix}"), channels.get("link_position")
    # A gear ratio from the ranges is too rough for a deflection.
    if motor is None or link is None or checked.gear_ratio is not None:
        return "", None
    size = _motor_per_link(checked, channels, suffix)
    if size is None:
        return "", None
    sign = checked.roles[f"motor_position{suffix}"].sign
    return "link − motor position", guess_data.torque_over_difference(torque, link, motor, sign * size)


def _motor_per_link(checked: Checked, channels: Mapping[str, Channel], suffix: str) -> float | None:
    """Return the motor's reading for a link's reading of 1 at equal angles, by their units."""
    motor, link = (
        guess_data.si_of(channels[role], checked.roles[role].unit)
        for role in (f"motor_position{suffix}", "link_position")
    )
    return None if motor is None or link is None else link / motor


def _changed(guess: RoleGuess, reason: str, **fields: object) -> RoleGuess:
    return msgspec.structs.replace(guess, reasons=(*guess.reasons, reason), **fields)
