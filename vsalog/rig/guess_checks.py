"""Guesses from the numbers of a joint's roles: gear ratio, signs, and torques that are no measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import msgspec

from vsalog.core.finding import Evidence, Finding
from vsalog.core.recording import Channel
from vsalog.rig import guess_data
from vsalog.rig.guess_data import CORRELATED, Line, Ratio
from vsalog.rig.guess_load import factor_of, motor_load
from vsalog.rig.guess_types import Kind, RoleGuess

DEGREES = math.degrees(1.0)


@dataclass(slots=True)
class Checked:
    """Roles with sides and signs filled in, and the findings.

    Attributes
    ----------
    gear_ratio : of the motor; None for none, with NaN for an unknown one
    stiffness : slope of the torque sensor over the deflection [N·m/rad]; None where it does not follow, or a scale is unknown
    """

    roles: dict[str, RoleGuess]
    gear_ratio: Ratio | None = None
    stiffness: float | None = None
    findings: list[Finding] = field(default_factory=list)

    @property
    def whole_gear_ratio(self) -> int | None:
        """The only whole number in the interval of the gear ratio."""
        wholes = range(0) if self.gear_ratio is None else self.gear_ratio.wholes
        return wholes[0] if len(wholes) == 1 else None

    @property
    def known_gear_ratio(self) -> float | None:
        """1 where there is no gear, None where no other estimate of it is good enough for a deflection."""
        if self.gear_ratio is None:
            return 1.0
        is_stated = self.gear_ratio.low == self.gear_ratio.high
        return self.gear_ratio.value if is_stated else self.whole_gear_ratio

    @property
    def gear_ratios(self) -> tuple[float, ...]:
        """The known gear ratio, or the ends of its interval; none where it has none."""
        if self.known_gear_ratio is None and self.gear_ratio is not None:
            ends = (self.gear_ratio.low, self.gear_ratio.high)
            return ends if all(map(math.isfinite, ends)) else ()
        return (float(self.known_gear_ratio or 1),)


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
    if "motor_torque" in checked.roles:
        _motor_torque(checked, channels)
    checked.stiffness = _sensed_stiffness(checked, channels)
    return checked


def confirm_again(roles: Mapping[str, RoleGuess], channels: Mapping[str, Channel], gear_ratio: Ratio | None) -> Checked:
    """Return the roles of a joint with one motor, with the signs that the numbers show since the scales are known.

    Parameters
    ----------
    roles, channels : as for `confirm`; a sign that is known is kept
    gear_ratio : as for `Checked`
    """
    checked = Checked(dict(roles), gear_ratio)
    for role, check in (("torque_sensor", partial(_torque, suffix="")), ("motor_torque", _motor_torque)):
        if role in roles and not roles[role].has_sign:
            check(checked, channels)
    checked.stiffness = _sensed_stiffness(checked, channels)
    return checked


def _gear(checked: Checked, channels: Mapping[str, Channel]) -> None:
    """Detect a gear between the two positions, and a motor with the opposite sign."""
    if "motor_position" not in channels or "link_position" not in channels:
        return
    motor, link = channels["motor_position"], channels["link_position"]
    found = guess_data.gear_between(motor, link)
    if found is None or found.slope == 0.0:
        return
    guess = msgspec.structs.replace(checked.roles["motor_position"], has_sign=True)
    if found.slope < 0.0:
        guess = _changed(guess, "it moves against the link", sign=-1)
    size = _motor_per_link(checked, channels)
    springs = [channels[role] for role in ("deflection", "torque_sensor") if role in channels]
    for some in () if size is None else (springs, []):
        moves = guess_data.ratio_between(motor, link, some)
        ratio = None if moves is None else moves.times(1.0 / (size or 1.0))
        # An interval with and without a gear determines nothing; near 1 a deflection is likelier.
        if ratio is not None and not ratio.holds(1.0):
            guess = _before_the_gear(checked, guess, ratio) if round(ratio.value) > 1 else guess
            break
    checked.roles["motor_position"] = guess
    if "motor_velocity" in checked.roles:
        rate, unit = checked.roles["motor_velocity"], "deg/s" if guess.unit == "deg" else None
        checked.roles["motor_velocity"] = msgspec.structs.replace(
            rate, side=guess.side, sign=guess.sign, unit=unit or rate.unit
        )


def _before_the_gear(checked: Checked, guess: RoleGuess, ratio: Ratio) -> RoleGuess:
    """Return a motor's position on the rotor's side of a gear, or in degrees where these are the ratio."""
    far = f"it moves about {ratio.value:.2g} times as far as the link"
    if not ratio.wholes and ratio.holds(DEGREES):
        return _changed(guess, f"{far}: in degrees", unit="deg")
    checked.gear_ratio = ratio
    if math.isnan(ratio.low):
        checked.findings.append(Finding(code="guess.gear_ratio", value=ratio.value))
    else:
        evidence: Evidence = {"low": ratio.low, "high": ratio.high}
        checked.findings.append(Finding(code="guess.gear_ratio_bounded", value=ratio.value, evidence=evidence))
    return _changed(guess, f"{far}: before the gear", side="rotor")


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
        guess = _changed(guess, f"it falls with {name}, while τ_e = k (q − θ) rises", sign=-1, has_sign=True)
    elif line.correlation > CORRELATED:
        guess = _changed(guess, f"it rises with {name}", has_sign=True)
    checked.roles[role] = guess


def _motor_torque(checked: Checked, channels: Mapping[str, Channel]) -> None:
    """Detect the sign of a motor's torque, and one before the gear, by what it moves."""
    gear = checked.known_gear_ratio
    by_angle, by_torque = (motor_load(checked.roles, channels, gear, s) for s in ("deflection", "torque_sensor"))
    guess = checked.roles["motor_torque"]
    sign = next((load.sign for load in (by_torque, by_angle) if load is not None and load.sign), 0)
    if sign < 0:
        guess = _changed(guess, "it falls with what inertia and spring take of it", sign=-1, has_sign=True)
    elif sign > 0:
        guess = msgspec.structs.replace(guess, has_sign=True)
    if by_torque is not None and by_torque.sign and not guess.is_current:
        ratio = abs(1.0 / by_torque.spring)
        # Losses of a gear take a part of its torque.
        nearest = ratio if checked.gear_ratio is None else checked.gear_ratio.value
        near = abs(math.log(ratio / nearest)) < abs(math.log(ratio))
        if near and round(ratio) > 1 and not by_torque.low <= by_torque.sign <= by_torque.high:
            why = f"the spring's torque is about {ratio:.2g} times as large: before the gear"
            guess = _changed(guess, why, side="rotor")
            checked.gear_ratio = checked.gear_ratio or Ratio(ratio)
    checked.roles["motor_torque"] = guess


def _over_deflection(
    torque: Channel, checked: Checked, channels: Mapping[str, Channel], suffix: str
) -> tuple[str, Line | None]:
    """Fit the torque over the recorded deflection, or over link minus motor."""
    deflection = channels.get(f"deflection{suffix}")
    if deflection is not None:
        return f"'{deflection.name}'", guess_data.torque_over_deflection(torque, deflection)
    motor, link = channels.get(f"motor_position{suffix}"), channels.get("link_position")
    if motor is None or link is None:
        return "", None
    of_link = factor_of(link, checked.roles["link_position"], None)
    of_motor = [factor_of(motor, checked.roles[f"motor_position{suffix}"], gear) for gear in checked.gear_ratios]
    lines = [
        guess_data.torque_over_difference(torque, link, motor, of_link / size)
        for size in of_motor
        if size is not None and of_link is not None
    ]
    known = [line for line in lines if line is not None]
    if not known or len(known) < len(of_motor) or len({line.correlation > 0.0 for line in known}) > 1:
        return "", None
    return "link − motor position", min(known, key=lambda line: abs(line.correlation))


def _sensed_stiffness(checked: Checked, channels: Mapping[str, Channel]) -> float | None:
    """Return the slope of the torque sensor over the deflection in SI, as for `Checked`."""
    angle = "deflection" if "deflection" in channels else "link_position"
    if "torque_sensor" not in checked.roles or angle not in channels:
        return None
    torque = channels["torque_sensor"]
    _, line = _over_deflection(torque, checked, channels, "")
    of_torque = factor_of(torque, checked.roles["torque_sensor"], checked.known_gear_ratio, "N*m")
    of_angle = factor_of(channels[angle], checked.roles[angle], None)
    is_exact = angle == "deflection" or checked.known_gear_ratio is not None
    if line is None or abs(line.correlation) < CORRELATED or of_torque is None or of_angle is None or not is_exact:
        return None
    return float(abs(line.slope * of_torque / of_angle))


def _motor_per_link(checked: Checked, channels: Mapping[str, Channel]) -> float | None:
    """Return the motor's reading for a link's reading of 1 at equal angles, by their units."""
    motor, link = (
        guess_data.si_of(channels[role], checked.roles[role].unit) for role in ("motor_position", "link_position")
    )
    return None if motor is None or link is None else link / motor


def _changed(guess: RoleGuess, reason: str, **fields: object) -> RoleGuess:
    return msgspec.structs.replace(guess, reasons=(*guess.reasons, reason), **fields)
