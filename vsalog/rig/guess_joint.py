"""Guesses one joint: the roles of its channels by name, then by the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from vsalog.core.errors import UnitError
from vsalog.core.finding import Finding
from vsalog.core.recording import Channel
from vsalog.core.units import is_counts, matching
from vsalog.rig import guess_data
from vsalog.rig.guess_checks import confirm
from vsalog.rig.guess_load import motor_load
from vsalog.rig.guess_names import ABSOLUTE, words_of
from vsalog.rig.guess_types import Candidate, JointGuess, Kind, RoleGuess
from vsalog.rig.roles import COMMANDS, VELOCITIES, role_units
from vsalog.rig.schema import AntagonisticSignals, SerialSignals, SingleSignals

_ROLES: dict[str, tuple[str, ...]] = {
    "rigid": SingleSignals.__struct_fields__,
    "elastic": SingleSignals.__struct_fields__,
    "serial": SerialSignals.__struct_fields__,
    "antagonistic": AntagonisticSignals.__struct_fields__,
}

# Roles that no estimator reads: recorded in few logs, and not reported as missing in the others.
EXTRA = (
    "commanded_position", "commanded_velocity", *VELOCITIES, "link_acceleration", "external_torque", "secondary_torque",
    "accelerometer_x", "accelerometer_y", "accelerometer_z",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Option:
    """A role a channel could have."""

    role: str
    candidate: Candidate
    confidence: float
    reason: str
    unit: str | None = None


def guess_joint(name: str, group: list[Candidate], has_set_runs: bool) -> JointGuess:
    """Guess kind and roles of one joint.

    Parameters
    ----------
    name : of the joint
    group : the channels that belong to this joint by their names
    has_set_runs : the log contains runs whose names give a set-point
    """
    moving, still = _without_constants(group)
    if any(c.meaning.quantity in ("torque", "current") for c in still):
        moving = [c for c in moving if c.meaning.quantity != "commanded_torque"]  # the drive did not follow
    moving = _sided(_with_absolute(_without_targets(moving)))
    findings: list[Finding] = []
    numbers = _motor_numbers(moving)
    options = [option for c in moving for option in _options(c, moving)]
    if len(numbers) == 2:
        options = list(_numbered(options, numbers))
    chosen = _choose(options)
    chosen = _spring_at_rest(chosen, moving)
    kind, confidence, reason = _kind(chosen, numbers, has_set_runs, _count_positions(moving))
    chosen = _torque_of_rigid(chosen) if kind == "rigid" else chosen
    channels = {role: option.candidate.channel for role, option in chosen.items() if role in _ROLES[kind]}
    roles = {role: _role_guess(chosen[role], findings) for role in _ROLES[kind] if role in channels}
    checked = confirm(roles, channels, kind)
    findings += checked.findings
    if kind == "antagonistic" and confidence < 0.7:
        findings.append(Finding(code="guess.two_motors", value=confidence, limit=0.7))
    if kind != "rigid" and not any(role.startswith(("motor_torque", "torque_sensor")) for role in roles):
        findings.append(Finding(code="guess.no_torque"))
    gaps = [role for role in _ROLES[kind] if role not in roles and _base(role) not in EXTRA]
    load = motor_load(checked.roles, channels, checked.known_gear_ratio, "deflection")
    whys = {role: _why_missing(role, kind, roles, still) for role in gaps}
    return JointGuess(
        name,
        kind,
        reason,
        confidence,
        checked.roles,
        {role: why for role, (why, _) in whys.items()},
        None if checked.gear_ratio is None else checked.gear_ratio.value,
        checked.whole_gear_ratio,
        findings=tuple(findings),
        not_needed=tuple(role for role, (_, needed) in whys.items() if not needed),
        load=load,
        stiffness=checked.stiffness,
    )


def _without_constants(group: list[Candidate]) -> tuple[list[Candidate], list[Candidate]]:
    """Separate channels that never change: no position or torque, though a set-point or a command may be constant, and with it
    the joint.
    """
    commands = [c for c in group if c.meaning.quantity in COMMANDS]
    held = bool(commands) and all(guess_data.is_constant(c.channel) for c in commands)
    able = ("position", *COMMANDS) if held else COMMANDS
    still = [
        c for c in group if not (_is_setpoint(c) or c.meaning.quantity in able) and guess_data.is_constant(c.channel)
    ]
    return [c for c in group if c not in still], still


def _without_targets(group: list[Candidate]) -> list[Candidate]:
    """Take a torque by an ambiguous name, without a unit, as the target of a position whose numbers it has: ``tq``, ``q``."""
    positions = [c for c in group if c.meaning.quantity == "position"]

    def is_target(candidate: Candidate) -> bool:
        is_doubtful = candidate.meaning.quantity == "torque" and not (candidate.meaning.part or candidate.channel.unit)
        return is_doubtful and any(guess_data.is_the_same(c.channel, candidate.channel) for c in positions)

    return [
        replace(
            c, meaning=replace(c.meaning, quantity="commanded_position"), because="it has the position's own numbers"
        )
        if is_target(c)
        else c
        for c in group
    ]


def _with_absolute(group: list[Candidate]) -> list[Candidate]:
    """Take an absolute encoder next to another of the same name as the link's, and the other as the motor's; velocities too."""
    found: dict[str, Candidate] = {}
    unsided = [c for c in group if c.meaning.quantity in ("position", "velocity") and c.meaning.part in ("", "link")]
    named = {(c.meaning.quantity, *words_of(c.channel.name)): c for c in unsided}
    for (quantity, *words), link in named.items():
        motor = named.get((quantity, *(word for word in words if word not in ABSOLUTE)))
        if motor is not None and motor is not link:
            why = "of two encoders, the absolute one is likelier the link's"
            found |= {motor.channel.name: motor.with_part("motor", why), link.channel.name: link.with_part("link", why)}
    return [found.get(c.channel.name, c) for c in group]


def _sided(group: list[Candidate]) -> list[Candidate]:
    """Return the channels with the parts of positions whose names do not contain it, as far as the numbers show."""
    named = {c.meaning.part for c in group if c.meaning.quantity == "position"}
    unsided = [c for c in group if c.meaning.quantity == "position" and c.meaning.part in ("", "series")]
    found: dict[str, Candidate] = {}
    if (
        len(unsided) == 2
        and not named & {"motor", "link"}
        and not any(c.meaning.quantity == "deflection" for c in group)
    ):
        found = _motor_and_link(*unsided)
    elif len(unsided) == 1:
        other = next(
            (c for c in group if c.meaning.quantity == "position" and c.meaning.part in ("motor", "link")), None
        )
        found = {} if other is None else _beside(unsided[0], other)
    return [found.get(c.channel.name, c) for c in group]


def _motor_and_link(first: Candidate, second: Candidate) -> dict[str, Candidate]:
    """Return two positions that move together as motor and link: in front of a gear the motor's is the larger."""
    between = guess_data.gear_between(first.channel, second.channel)
    if between is None:
        return {}
    sizes = [guess_data.si_of(c.channel, c.meaning.unit) or 1.0 for c in (first, second)]
    ratio = abs(between.slope) * sizes[1] / sizes[0]
    if round(max(ratio, 1.0 / ratio)) > 1:
        motor, link = (first, second) if ratio < 1.0 else (second, first)
        why = "of two positions that move together, the one that moves {} is likelier the {}'s"
        motor, link = (
            motor.with_part("motor", why.format("more", "motor")),
            link.with_part("link", why.format("less", "link")),
        )
    else:
        why = "of two positions that move together, the {} is likelier the {}'s"
        motor = first.with_part("motor", why.format("first", "motor"))
        link = second.with_part("link", why.format("second", "link"))
    return {c.channel.name: c for c in (motor, link)}


def _beside(candidate: Candidate, other: Candidate) -> dict[str, Candidate]:
    """Return a position whose name does not contain its part, next to one of a motor or a link."""
    if guess_data.gear_between(candidate.channel, other.channel) is None:
        return {}
    part = "link" if other.meaning.part == "motor" else "motor"
    return {candidate.channel.name: candidate.with_part(part, f"it moves with the {other.meaning.part}'s position")}


def _is_setpoint(candidate: Candidate) -> bool:
    return candidate.meaning.quantity == "setpoint" or candidate.meaning.part == "secondary"


def _motor_numbers(group: list[Candidate]) -> list[int]:
    """Return the numbers of the motors (or deflections) that the names count, in order."""
    return sorted(
        {
            c.meaning.index
            for c in group
            if c.meaning.index is not None
            and (c.meaning.quantity == "deflection" or (c.meaning.part == "motor" and c.meaning.quantity == "position"))
        }
    )


def _options(candidate: Candidate, group: list[Candidate]) -> Iterator[_Option]:
    """Yield the roles a channel could have, judged by its name."""
    meaning, channel = candidate.meaning, candidate.channel
    less = 0.25 if meaning.in_command_topic else 0.0
    less += 0.05 if meaning.joint and not meaning.label and len(group) > 1 else 0.0
    less += 0.2 if candidate.because else 0.0
    is_angle = meaning.quantity not in ("setpoint", "torque", "current")
    less += 0.3 if is_angle and not channel.unit and guess_data.looks_like_counts(channel) else 0.0
    for role, confidence, reason, unit in _by_name(candidate, group):
        reason, unit = candidate.because or reason, meaning.unit if _fits(meaning.unit, role) else unit
        yield _Option(role, candidate, round(max(confidence - less, 0.05), 2), reason, unit)


def _fits(unit: str | None, role: str) -> bool:
    """Return whether a name ends in a unit that the role may have: ``torque_deg`` does not."""
    units = role_units(role)
    if unit is None or is_counts(unit):
        return unit is not None and units == ("rad",)
    try:
        return bool(matching(unit, units))
    except UnitError:
        return False


def _by_name(candidate: Candidate, group: list[Candidate]) -> Iterator[tuple[str, float, str, str | None]]:
    meaning, channel = candidate.meaning, candidate.channel
    part = meaning.part
    if meaning.quantity == "deflection":
        yield "deflection", 0.9, "by its name", None
    elif meaning.quantity == "setpoint":
        yield "setpoint", 0.6, "its name is that of a set-point", None
    elif meaning.quantity in EXTRA and part != "secondary":
        yield meaning.quantity, 0.8, "by its name", None
    elif meaning.quantity == "position" and part in ("sensor", "series"):
        yield "deflection", 0.7, "a spring's angle", None
    elif meaning.quantity == "position":
        yield _position(part, group)
    elif meaning.quantity == "commanded_torque" and part in ("", "motor"):
        yield "motor_torque", 0.3, "a commanded torque, as far as the drive follows", None
    elif meaning.quantity == "velocity" and part in ("", "motor", "link"):
        yield _velocity(part, group)
    elif meaning.quantity == "current" and part in ("", "motor"):
        unit = None if channel.unit else "A"
        sure = 0.5 if part else 0.35
        yield (
            "motor_torque",
            sure,
            f"a {part or ''} current; the torque constant converts it to a torque".replace("  ", " "),
            unit,
        )
    elif meaning.quantity == "torque":
        yield from _torque(part, channel)


def _position(part: str, group: list[Candidate]) -> tuple[str, float, str, str | None]:
    if part == "motor":
        return "motor_position", 0.9, "its name contains motor and position", None
    if part == "secondary":
        return "setpoint", 0.8, "the secondary motor's position sets the stiffness", None
    if part == "link":
        return "link_position", 0.85, "a joint's or link's position by its name", None
    positions = {c.meaning.part for c in group if c.meaning.quantity == "position"}
    if "motor" in positions or any(c.meaning.quantity == "deflection" for c in group):
        return "link_position", 0.7, "a position next to the motor's", None
    if sum(c.meaning.quantity == "position" for c in group) > 1:
        return "link_position", 0.3, "one of several positions, not identified by its name", None
    return "link_position", 0.5, "the only position of this joint", None


def _velocity(part: str, group: list[Candidate]) -> tuple[str, float, str, str | None]:
    """Return whose velocity it is: that of the only position, where its name does not contain it."""
    parts = {c.meaning.part for c in group if c.meaning.quantity == "position"}
    is_motors = part == "motor" if part else parts == {"motor"}
    return "motor_velocity" if is_motors else "link_velocity", 0.8, "by its name", None


def _torque(part: str, channel: Channel) -> Iterator[tuple[str, float, str, str | None]]:
    if part == "motor":
        yield "motor_torque", 0.85, "its name contains motor and torque", None
    elif part in ("sensor", "series"):
        yield "torque_sensor", 0.85, "a sensor's or the transmission's torque by its name", None
    elif part == "external":
        yield "external_torque", 0.8, "an external torque by its name", None
    elif part == "secondary":
        yield "secondary_torque", 0.8, "the secondary motor's torque by its name", None
    elif part == "link":
        yield "torque_sensor", 0.6, "a torque on the link's side", None
    elif part == "" and channel.type.endswith("JointState"):
        yield "motor_torque", 0.45, "a JointState's effort is the actuator's by convention", None
        yield "torque_sensor", 0.4, "a JointState's effort may be measured", None
    elif part == "":
        yield "torque_sensor", 0.5, "a torque, not identified by its name", None
        yield "motor_torque", 0.4, "a torque, not identified by its name", None


def _numbered(options: list[_Option], numbers: list[int]) -> Iterator[_Option]:
    """Give roles the numbers 1 and 2 of an antagonistic joint's motors and transmissions."""
    for option in options:
        number = option.candidate.meaning.index
        role = option.role
        if role in ("link_position", "setpoint", *(extra for extra in EXTRA if extra != "motor_velocity")) or (
            role == "torque_sensor" and number is None
        ):
            yield option
        elif number in numbers:
            yield _Option(
                f"{role}_{numbers.index(number) + 1}",
                option.candidate,
                option.confidence,
                option.reason,
                option.unit,
            )


def _choose(options: list[_Option]) -> dict[str, _Option]:
    """Give each role the channel of highest confidence and each channel one role; then measured ones, those with a unit and
    short names win.
    """
    ordered = sorted(
        options,
        key=lambda o: (
            -o.confidence,
            _spread_rank(o),
            not o.candidate.meaning.is_measured,
            o.candidate.meaning.is_variant,
            not (o.unit or o.candidate.channel.unit),
            len(o.candidate.channel.name),
        ),
    )
    chosen: dict[str, _Option] = {}
    taken: set[str] = set()
    for option in ordered:
        if option.role not in chosen and option.candidate.channel.name not in taken:
            chosen[option.role] = option
            taken.add(option.candidate.channel.name)
    return chosen


def _spread_rank(option: _Option) -> float:
    """Of a wrench's three axes the one that moves most is the joint's."""
    return -guess_data.span(option.candidate.channel) if ".torque." in option.candidate.channel.name else 0.0


def _spring_at_rest(chosen: dict[str, _Option], group: list[Candidate]) -> dict[str, _Option]:
    """Take a lone angle as the deflection where a torque follows it: a spring fixed at its other end.

    Not for a JointState: there gravity makes the torque follow the angle.
    """
    position, torque = chosen.get("link_position"), chosen.get("torque_sensor")
    others = {"motor_position", "deflection"} & set(chosen)
    if position is None or torque is None or others or position.candidate.channel.type.endswith("JointState"):
        return chosen
    follows = guess_data.torque_over_deflection(torque.candidate.channel, position.candidate.channel)
    if follows is None or abs(follows.correlation) < guess_data.CORRELATED:
        return chosen
    reason = (
        f"the only angle, and the torque follows it (correlation {follows.correlation:.2f}) as that of a spring that is"
        " fixed at its other end"
    )
    spring = _Option("deflection", position.candidate, 0.5, reason, position.unit)
    return {"deflection": spring, **{role: o for role, o in chosen.items() if role != "link_position"}}


def _count_positions(group: list[Candidate]) -> int:
    return sum(c.meaning.quantity == "position" and not _is_setpoint(c) for c in group)


def _torque_of_rigid(chosen: dict[str, _Option]) -> dict[str, _Option]:
    """Take a torque without an owner in its name as the motor's, where no spring can have it.

    A current is no torque yet, and has lower priority.
    """
    torque, motors = chosen.get("torque_sensor"), chosen.get("motor_torque")
    if torque is None or torque.candidate.meaning.part or torque.candidate.meaning.is_measured:
        return chosen
    if motors is not None and motors.candidate.meaning.quantity != "current":
        return chosen
    moved = replace(torque, role="motor_torque", reason="a torque, and there is no spring that it could belong to")
    return {"motor_torque": moved, **{r: o for r, o in chosen.items() if r not in ("torque_sensor", "motor_torque")}}


def _kind(
    chosen: dict[str, _Option], numbers: list[int], has_set_runs: bool, positions: int
) -> tuple[Kind, float, str]:
    """Return the joint's kind, the confidence in it, and why."""
    if len(numbers) == 2:
        both_torques = {"motor_torque_1", "motor_torque_2"} <= set(chosen) or {
            "torque_sensor_1",
            "torque_sensor_2",
        } <= set(chosen)
        return "antagonistic", 0.85 if both_torques else 0.5, "its names count two motors"
    has_deflection = "deflection" in chosen or {"motor_position", "link_position"} <= set(chosen)
    if has_deflection and "setpoint" in chosen:
        return "serial", 0.8, "there is a deflection, and a set-point that may change the stiffness"
    if has_deflection and has_set_runs:
        return "serial", 0.7, "there is a deflection, and runs whose names give a set-point"
    if has_deflection:
        return "elastic", 0.8, "there is a deflection and no set-point"
    if positions > 1:
        return "rigid", 0.4, "none of its positions is known to be at the spring's other end, so there is no deflection"
    return "rigid", 0.6, "there is one position only, so no deflection"


def _role_guess(option: _Option, findings: list[Finding]) -> RoleGuess:
    channel = option.candidate.channel
    meaning, unit, turn = option.candidate.meaning, option.unit, None
    is_angle = meaning.quantity in ("position", "commanded_position", "deflection")
    if is_angle and (unit == "counts" or guess_data.looks_like_counts(channel)):
        unit, turn = "counts", guess_data.counts_of_turn(channel)
        findings.append(Finding(code="guess.raw_counts", part=channel.name))
    is_current = meaning.quantity == "current"
    return RoleGuess(
        channel.name, option.confidence, (option.reason,), unit, is_current=is_current, counts_per_turn=turn
    )


def _why_missing(role: str, kind: Kind, roles: dict[str, RoleGuess], still: list[Candidate]) -> tuple[str, bool]:
    """Return why a role has no channel, and whether an estimate may need it."""
    base = _base(role)
    constant = [c.channel.name for c in still if _could_be(base, c)]
    if constant:
        return f"not found: '{constant[0]}' never changes", True
    if kind == "rigid" and base in ("motor_position", "deflection"):
        return "not found: a stiffness needs a second position, on the motor's side of the spring", True
    if base == "deflection" and _has_both(role, roles):
        return "not needed where both positions are recorded", False
    if base in ("motor_position", "link_position") and role.replace(base, "deflection") in roles:
        return "not found; not needed along with the deflection unless the motor's inertia matters", False
    if role == "torque_sensor" and kind == "antagonistic":
        return "not needed: one sensor for the whole joint, where not every transmission has its own", False
    if base == "motor_torque":
        return "not found: neither a motor torque nor a motor current", True
    if base == "torque_sensor":
        return "not found; not needed where motor torque and inertia are known", False
    return "not found", True


def _has_both(role: str, roles: dict[str, RoleGuess]) -> bool:
    return role.replace("deflection", "motor_position") in roles and "link_position" in roles


def _base(role: str) -> str:
    return role.removesuffix("_1").removesuffix("_2")


def _could_be(base: str, candidate: Candidate) -> bool:
    """Return whether a constant channel would have been this role's."""
    return any(role == base for role, *_ in _by_name(candidate, []))
