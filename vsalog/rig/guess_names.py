"""The quantity that a channel measures, from its name, unit and message type."""

from __future__ import annotations

import re
from dataclasses import dataclass

from vsalog.core.errors import UnitError
from vsalog.core.recording import Channel
from vsalog.core.unit_tables import COUNTS
from vsalog.core.units import is_counts, kind_of, parse_unit, si_factor

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[θφτδ]")
_GREEK = {"θ": "theta", "φ": "phi", "τ": "tau", "δ": "delta"}


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


POSITION = _words("position positions pos angle angles ang encoder encoders enc theta q rotation winkel")
DEFLECTION = _words("deflection defl deformation torsion delta phi twistangle")
TORQUE = _words("torque torques effort efforts tau moment trq torq tor tq loadcell")
CURRENT = _words("current currents curr cur amps iq i")
SETPOINT = _words("setpoint stiffness lever pretension preload cocontraction slider")
COMMAND = _words("command commands cmd commanded desired des ref reference target goal demand demanded")
# Of a stream, not of a field.
CONTROL = _words("control controls action actions")
MEASURED = _words("actual act measured meas mes present feedback fb fbk")
ABSOLUTE = _words("abs absolute")
# Of another channel: unfiltered, filtered, or where a motion ends.
VARIANTS = _words("raw filtered filt goal")
STATE = MEASURED | _words("state states")
END_EFFECTOR = _words("tcp flange eef pose cartesian cart")
AXES = _words("x y z")
# A gain, a term, an error, in front of the i of their integral.
TERMS = _words("k t e")
# Derivatives, housekeeping, computed values, end effectors: never a role.
OTHER = END_EFFECTOR | _words(
    "velocity velocities vel speed speeds omega dq qd dtheta thetad "
    "ddq qdd rate dot acceleration acc accel jerk gyro temperature temp "
    "voltage pwm status seq header time timestamp stamp id count counter error err power energy pressure "
    "force duty frame mode flag est estimated estimate predicted model gravity limit max min kp kd ki gain "
    "battery batt bat bus supply"
)
VELOCITY = _words("velocity velocities vel speed speeds omega dq qd dtheta thetad")
BODY = END_EFFECTOR | _words("imu gyro twist odom angular linear base")
# Topics of bodies; a robot's base may be one that has joints.
BODY_TOPICS = BODY - {"base"}
MOTOR = _words("motor motors mot mtr rotor rotors servo servos actuator actuators primary drive drives")
# Its output is where a spring begins, on the motor's side of it; "gear output" is the link.
GEAR = _words("gear gearbox")
LINK = _words("link output load")
BY_SENSOR = _words("sensor loadcell")
SENSOR = BY_SENSOR | _words("spring transmission ft measured meas mes elastic wrench")
SERIES = _words("se")
SECONDARY = _words("secondary stiffener")
EXTERNAL = _words("external ext disturbance")
ACCELERATION = _words("acceleration acc accel accelerometer")
FILLER = _words(
    "joint joints data state states raw msg field value values side sensors stamped topic of the in cell "
    "scope logsout simout log filtered filt"
) | (MEASURED | ABSOLUTE | AXES)
# A letter after the symbol of a quantity, as in theta_m and tau_J_d.
SUBSCRIPTS = {"m": "motor", "l": "link", "j": "link", "s": "sensor", "d": "command", "c": "secondary"}
_SHORT = {"jnt": "joint", "jt": "joint", "joi": "joint", "th": "theta"}
# Words that may be the symbol of what a channel's unit says that it is: alpha_m [rad], T_m [N*m].
SYMBOLS = {"position": _words("alpha beta gamma psi"), "torque": _words("t m")}
# Two words for one.
_TOGETHER = {
    ("load", "cell"): "loadcell", ("i", "q"): "iq", ("i", "d"): "id", ("set", "point"): "setpoint", ("state", "ext"): "state",
}  # fmt: skip

UNITS = {
    "deg": "deg", "degs": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "mrad": "mrad", "mdeg": "mdeg", "rev": "rev", "revs": "rev", "turn": "rev", "turns": "rev", "nm": "N*m", "mnm": "mN*m",
    "ncm": "N*cm", "nmm": "N*mm", "ma": "mA", "amp": "A", "amps": "A", "rpm": "rpm", "radps": "rad/s", "rad_s": "rad/s",
    "rad_per_s": "rad/s", "degps": "deg/s", "dps": "deg/s", "deg_s": "deg/s", "deg_per_s": "deg/s",
    **dict.fromkeys(COUNTS, "counts"),
}  # fmt: skip
"""Endings of a name that are its unit."""
_UNIT_AT_END = re.compile(
    r"(?P<name>.*?[^\W_])(?:[\W_]+|(?-i:(?<=[a-z\d])(?=[A-Z])))\(?(?P<unit>"
    + "|".join(sorted(UNITS, key=len, reverse=True))
    + r"|(?-i:A))\)?(?P<index>[_\W]*\d+\]?)?",
    re.IGNORECASE | re.DOTALL,
)

_VOCABULARY = (
    POSITION
    | DEFLECTION
    | TORQUE
    | CURRENT
    | SETPOINT
    | COMMAND
    | OTHER
    | MOTOR
    | GEAR
    | LINK
    | SENSOR
    | SERIES
    | SECONDARY
    | FILLER
    | EXTERNAL
    | ACCELERATION
)
# A number after one of these counts the motors or transmissions of a joint.
_NUMBERED = (
    POSITION | VELOCITY | DEFLECTION | TORQUE | CURRENT | COMMAND | MOTOR | LINK | SENSOR | EXTERNAL | {"m", "c", "d"}
)
# Words that also name a part: θ is the motor's angle and q the link's throughout the literature.
_SYMBOLS = {"theta": "motor", "q": "link", "dtheta": "motor", "thetad": "motor", "dq": "link", "qd": "link"}

_PART_OF = {
    **dict.fromkeys(SENSOR, "sensor"),
    **dict.fromkeys(LINK, "link"),
    **dict.fromkeys(MOTOR, "motor"),
    **dict.fromkeys(GEAR, "motor by its gear"),
    **dict.fromkeys(SERIES, "series"),
    **dict.fromkeys(EXTERNAL, "external"),
    **dict.fromkeys(SECONDARY, "secondary"),
}
# The order of priority where a name has words for several parts.
_SUREST = (
    "secondary", "external", "motor", "series", "sensor", "link", "motor by its gear", "motor by its symbol",
    "link by its symbol",
)  # fmt: skip

_QUANTITY_OF_KIND = {
    "an angle": "position",
    "a torque": "torque",
    "a current": "current",
    "a plain number": None,
    "a length": "length",
}


@dataclass(frozen=True, slots=True)
class Meaning:
    """The meaning of a name.

    Attributes
    ----------
    quantity : ``position``, ``velocity``, ``deflection``, ``torque``, ``current``, ``setpoint``, ``length``,
        ``commanded_position``, ``commanded_velocity``, ``commanded_torque``, ``link_acceleration``,
        ``accelerometer_x`` (``_y``, ``_z``) or ``other``
    part : ``motor``, ``link``, ``sensor``, ``series``, ``secondary``, ``external`` or ""
    index : the number after the part, e.g. 2 of ``motor_2``; None without one
    joint : the remaining words: the joint's name
    symbol : the one of these that may be the symbol of the quantity, which only the unit shows; else ""
    label : the element's name in a message that names its elements, else ""
    in_command_topic : by the topic's name these are commands
    in_motor_topic : by the topic's name these are a motor's
    is_measured : by the name
    is_variant : of another channel, by the name
    is_element : the index is that of a list, not part of the name
    unit : that the name ends in, where the log states none; else None
    """

    quantity: str
    part: str
    index: int | None
    joint: tuple[str, ...]
    label: str
    in_command_topic: bool
    in_motor_topic: bool = False
    is_measured: bool = False
    is_variant: bool = False
    is_element: bool = False
    unit: str | None = None
    symbol: str = ""


def words_of(name: str) -> list[str]:
    """Split a name into lower-case words: ``servo1_positionRaw`` → servo, 1, position, raw."""
    words: list[str] = []
    for found in _WORD.findall(name):
        word = found.lower()
        word = _GREEK.get(word) or _SHORT.get(word, word)
        for part in _split_compound(word):
            both = _TOGETHER.get((words[-1], part)) if words else None
            if both is None:
                words.append(part)
            else:
                words[-1] = both
    return words


def split_unit(name: str) -> tuple[str, str | None]:
    """Split the unit off that a name ends in: ``motor_deg[0]`` → ``motor[0]``, deg; (name, None) where it ends in none.

    A lone A is ampere after a current only: ``leg_A`` is a leg.
    """
    match = _UNIT_AT_END.fullmatch(name)
    if match is None or (match["unit"] == "A" and not CURRENT & set(words_of(match["name"]))):
        return name, None
    unit = UNITS.get(match["unit"].lower(), match["unit"])
    return match["name"] + (match["index"] or ""), unit


def meaning_of(channel: Channel, *, with_stream: bool = True) -> Meaning:
    """Return the meaning of a channel's name and unit; the stream's name counts unless it is a run's name only."""
    topic, field, label, element = _parts(channel)
    topic = topic if with_stream else ""
    field, by_name = split_unit(field)
    unit = channel.unit or by_name
    field_words, label_words, topic_words = words_of(field), words_of(label), words_of(topic)
    quantity = _quantity(field_words, label_words, topic_words, unit)
    named = label_words if label else [*topic_words, *field_words]
    part, index, joint = _part(named, quantity)
    index = index if element is None else element
    if label and not (part or joint) and (quantity == "velocity" or _named_quantity(field_words)):
        joint = label_words  # a joint may have the name of a quantity: Rotation
    if label and not part and any(word in SENSOR for word in topic_words) and quantity == "torque":
        part = "sensor"
    elif label and not part and any(word in MOTOR for word in topic_words) and quantity == "torque":
        part = "motor"
    elif label and not part:
        part = _part(field_words, quantity)[0]
    if not label and not part and "joint" in named and quantity in ("position", "torque"):
        part = "link" if quantity == "position" else ""
    if quantity in ("position", "velocity") and not (part or joint or label or AXES.isdisjoint(field_words)):
        quantity = "other"  # a body's: a joint has one angle
    in_command_topic = any(word in COMMAND for word in topic_words)
    in_motor_topic = any(word in MOTOR for word in topic_words)
    return Meaning(
        quantity,
        part,
        index,
        tuple(joint),
        label,
        in_command_topic,
        in_motor_topic,
        is_measured=not (MEASURED | BY_SENSOR).isdisjoint(field_words),
        is_variant=not VARIANTS.isdisjoint(field_words),
        is_element=element is not None,
        unit=None if channel.unit else by_name,
        symbol=""
        if _named_quantity([*named, *field_words])
        else next((w for w in joint if w in SYMBOLS.get(quantity, ())), ""),
    )


def _parts(channel: Channel) -> tuple[str, str, str, int | None]:
    """Split a full name into topic, field path, the element's label and the element's number in a list."""
    name = channel.name
    # A stream that is a part of a topic is called "/topic (field …)".
    names = channel.stream, channel.stream.rpartition(" (")[0]
    topic = next((stream for stream in names if stream and name.startswith(f"{stream}.")), "")
    rest = name[len(topic) + 1 :] if topic else name
    match = re.fullmatch(r"(.*)\[([^\[\]()]*)\]", rest, re.DOTALL)
    if match is None:
        return topic, rest, "", None
    if match[2].isdecimal() and len(match[2]) < 6:
        return topic, match[1], "", int(match[2])
    return topic, match[1], match[2], None


def _split_compound(word: str) -> list[str]:
    """Split ``motorposition``; a word that is in the vocabulary, or whose halves are not, stays whole."""
    if word in _VOCABULARY or len(word) < 6:
        return [word]
    for i in range(3, len(word) - 2):
        if word[:i] in _VOCABULARY and word[i:] in _VOCABULARY:
            return [word[:i], word[i:]]
    return [word]


def _quantity(field: list[str], label: list[str], topic: list[str], unit: str | None) -> str:
    words = [*field, *label]
    by_unit = _by_unit(unit)
    # Simulations write true values along with the sensors' readings.
    is_truth = "truth" in topic
    if not is_truth and not _is_command([*words, *topic]) and (role := _acceleration(field, [*words, *topic], unit)):
        return role
    if not is_truth and BODY.isdisjoint(field) and _is_command([*words, *topic]) and _is_velocity(field, unit):
        return "commanded_velocity"
    if not is_truth and _is_joint_velocity(field, [*words, *topic], unit):
        return "velocity"
    if any(word in OTHER for word in field) or by_unit == "other" or is_truth:
        return "other"
    if _is_command(words):
        named = _named_quantity([w for w in words if w != "setpoint"]) or by_unit
        return f"commanded_{named}" if named in ("position", "torque") and by_unit in (None, named) else "other"
    named = _named_quantity(field) or _named_quantity(label) or _named_quantity(topic)
    if by_unit == "length":
        return "setpoint" if named in ("setpoint", "position") and _is_setpoint(words) else "other"
    if named == "torque" and not (CURRENT - {"i"}).isdisjoint(field):
        return "other" if "from" in field else "current"  # computed from a current, or the current that makes torque
    if by_unit == "current" and named in (None, "torque"):
        return "current"
    if named == "position" and by_unit in (None, "position") and _is_command_topic(topic):
        return "commanded_position"
    if by_unit in ("position", "torque") and named in (None, "setpoint"):
        return named or by_unit
    return named or by_unit or "other"


def _is_command_topic(topic: list[str]) -> bool:
    """Return whether a stream contains commands, as ``/joint_commands`` or a table called ``control``, and no state."""
    return any(word in COMMAND or word in CONTROL for word in topic) and not any(word in STATE for word in topic)


def _is_velocity(field: list[str], unit: str | None) -> bool:
    """Return whether a channel is an angular velocity by its name, and not something else by its unit."""
    if not any(word in VELOCITY for word in field):
        return False
    try:
        return unit is None or bool(si_factor(unit, "rad/s"))
    except UnitError:
        return False


def _is_joint_velocity(field: list[str], words: list[str], unit: str | None) -> bool:
    """Return whether a channel is the rate of a position: no body's velocity, error, or rate of something else."""
    derived = _is_deflection(field) or any(word in OTHER and word not in VELOCITY for word in field)
    is_bodys = not BODY.isdisjoint(field) or not BODY_TOPICS.isdisjoint(words)
    return _is_velocity(field, unit) and not derived and not is_bodys


def _acceleration(field: list[str], words: list[str], unit: str | None) -> str | None:
    """Return the role of an acceleration that is named without doubt: ``accelerometer_x``, ``link_acceleration``."""
    if "accelerometer" in words:
        role = f"accelerometer_{field[-1]}" if field and field[-1] in ("x", "y", "z") else None
    else:
        named = any(w in ACCELERATION for w in field) and any(w in LINK for w in words)
        role = "link_acceleration" if named and not {"linear", "motor"} & set(words) else None
    try:
        if role and unit:
            si_factor(unit, "m/s^2" if "accelerometer" in words else "rad/s^2")
    except UnitError:
        return None
    return role


def _is_setpoint(words: list[str]) -> bool:
    return any(word in SETPOINT or word in SECONDARY for word in words) or _is_symbol(words)


def _is_symbol(words: list[str]) -> bool:
    """Return whether an r at the end is the symbol of the set-point; in front of other words it is the right side."""
    named = [word for word in words if not word.isdigit()]
    return named[-1:] == ["r"] and FILLER.issuperset(named[:-1])


def _is_command(words: list[str]) -> bool:
    """Return whether a name is of a command: ``position_command``, ``position_setpoint``."""
    if any(word in COMMAND or _subscript(words, i) == "command" for i, word in enumerate(words)):
        return True
    return "setpoint" in words and _named_quantity([w for w in words if w != "setpoint"]) not in (None, "setpoint")


def _named_quantity(words: list[str]) -> str | None:
    if _is_deflection(words):
        return "deflection"
    for quantity, vocabulary in (("torque", TORQUE), ("current", CURRENT - {"i"})):
        if any(word in vocabulary for word in words):
            return quantity
    if any(word in SETPOINT for word in words) or _is_symbol(words):
        return "setpoint"
    if any(word in POSITION or word == "phi" for word in words):
        return "position"
    return "current" if any(w == "i" and b not in TERMS for b, w in zip(["", *words], words, strict=False)) else None


def _is_deflection(words: list[str]) -> bool:
    """Return whether a name is of a deflection: φ is one alone, and next to a motor or link, as in phi_m, that one's angle."""
    return any(
        word in DEFLECTION and (word != "phi" or _part(words, "position")[0] not in ("motor", "link")) for word in words
    )


def _by_unit(unit: str | None) -> str | None:
    """Return the quantity a unit implies, ``other`` for one that no role has, None where it implies none."""
    if not unit:
        return None
    if is_counts(unit):
        return "position"
    try:
        kind = kind_of(parse_unit(unit).dimension)
    except UnitError:
        return "other" if unit.strip().lower().endswith(("degc", "°c", "celsius")) else None
    return _QUANTITY_OF_KIND.get(kind, "other")


def _subscript(words: list[str], i: int, quantity: str = "") -> str | None:
    """Return the meaning of a letter after a quantity's symbol: ``m`` in theta_m, ``d`` in dq_d and tau_J_d."""
    symbols = TORQUE | POSITION | VELOCITY | {"phi"} | SYMBOLS.get(quantity, frozenset())
    before = [word for word in words[:i] if not word.isdigit()]
    behind = before[-1] if before else ""
    if behind in SUBSCRIPTS and len(before) > 1:
        behind = before[-2]
    return SUBSCRIPTS.get(words[i]) if behind in symbols else None


def _part(words: list[str], quantity: str) -> tuple[str, int | None, list[str]]:
    """Return part, its number, and the words that are neither: the joint's name."""
    found, index = set[str](), None
    left: list[str] = []
    previous, is_subscript = "", False
    for i, word in enumerate(words):
        follower = words[i + 1] if i + 1 < len(words) else ""
        subscript = _subscript(words, i, quantity)
        if word.isdigit():
            # "joint_1" is a name, "motor_1" is the first of a joint's motors.
            if previous == "joint":
                left.extend(["joint", word])
            elif previous in _NUMBERED or is_subscript:
                index = int(word)
            else:
                left.append(word)
        elif part := _PART_OF.get(word) or subscript:
            found.add(part)
        elif word in _SYMBOLS:
            found.add(f"{_SYMBOLS[word]} by its symbol")
        elif word == "r" and quantity == "setpoint" and SETPOINT.isdisjoint(words):
            pass
        elif word not in _VOCABULARY and not (word == "joint" and follower.isdigit()):
            left.append(word)
        previous, is_subscript = word, subscript is not None
    if quantity in ("position", "velocity", "current") and "spring" not in words:
        found.discard("sensor")  # a measured angle is the joint's; a spring's is a deflection
    part = next((part for part in _SUREST if part in found), "")
    return part.partition(" ")[0], index, left
