"""TOML tables → the structures of `vsalog.rig.schema`, with messages that name the key, the value and the remedy.

msgspec could do the conversion alone, but it stops at "Expected `float` - at `$.joint[...]`". Here the tables are walked
along the structures' types: unknown keys are refused with the nearest known one, quantities become SI, and msgspec only
builds the structures.

A quantity's tolerance is carried by the number itself (`uncertain.UncertainNumber`) until the structures are built.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Any, NoReturn, TypeVar

import msgspec
from msgspec import inspect

from vsalog.core.errors import RigError, UnitError, did_you_mean
from vsalog.core.printable import LONGEST_NAME
from vsalog.core.units import is_counts, matching, quantity, shown, si_factor
from vsalog.rig.roles import role_units
from vsalog.rig.schema import RigFile
from vsalog.rig.uncertain import Path as Path  # for callers that refuse a key
from vsalog.rig.uncertain import (
    Tolerance,
    UncertainNumber,
    collect,
    parse_stated,
    parse_stated_number,
    states_tolerance,
    uncertain,
)

Table = dict[str, Any]
Structure = TypeVar("Structure", bound=msgspec.Struct)

_TORQUE_OF_CURRENT = "give the torque it makes on the joint's side: current × torque_constant × gear_ratio"

_NO_QUANTITY = "but this is a choice, not a quantity that is measured; write the value alone"

# Advice on an impossible value, by the key's name.
_HINTS = {
    "inertia": "leave the key out if it is not known",
    "counts_per_turn": "it is the number of encoder counts per turn of the encoder's shaft, e.g. 4096",
    "gear_ratio": "it is the number of rotor turns per turn of the joint, e.g. 50",
    "torque_constant": "reverse the signal with sign = -1 if necessary, and leave the key out if it is not known",
    "stiffness": 'give the transmission type = "unknown" if it is not known',
    "geometry": "the VSA-II's four-bar mechanism only exists with C > 1",
    "resolution": "leave the key out to have it taken from the data",
    "sign": "write 1, or -1 for a sensor with the opposite sign",
    "damping": "friction dissipates energy; 0 if it is not known",
}


def decode_rig(raw: Mapping[str, Any]) -> tuple[RigFile, dict[Path, Tolerance]]:
    """Return the structures for a rig's tables, and the tolerances they state, by their keys' paths.

    Raises
    ------
    RigError
        A key is unknown or missing, or a value is not possible; the message begins with the key's path.
    """
    return _decode(raw, RigFile)


def decode(raw: Mapping[str, Any], into: type[Structure]) -> Structure:
    """Return a structure for the tables of a file without tolerances; errors are those of `decode_rig`."""
    structure, tolerances = _decode(raw, into)
    for path in tolerances:
        refuse(path, "a tolerance has no meaning here, only in a rig; write the value alone")
    return structure


def _decode(raw: Mapping[str, Any], into: type[Structure]) -> tuple[Structure, dict[Path, Tolerance]]:
    root = inspect.type_info(into)
    assert isinstance(root, inspect.StructType)
    tolerances: dict[Path, Tolerance] = {}
    checked = collect(_struct(dict(raw), root, ()), tolerances)
    return msgspec.convert(checked, into), tolerances


def key_path(path: Path) -> str:
    """Write a path as TOML does: ``joint.elbow.motor``, ``joint."left elbow".run[0]``."""
    parts: list[str] = []
    for part in path:
        if part.startswith("["):
            parts[-1] += part
        elif re.fullmatch(r"[A-Za-z0-9_-]+", part):
            parts.append(part)
        else:
            parts.append(f'"{shown(part)}"')
    return ".".join(parts)


def refuse(path: Path, reason: str) -> NoReturn:
    """Raise a RigError about the key at `path`."""
    raise RigError(f"{key_path(path)}: {reason}" if path else reason)


def _value(value: Any, kind: inspect.Type, path: Path) -> Any:
    """Check one value against its type and return it in SI."""
    if isinstance(kind, inspect.UnionType):
        return _union(value, kind, path)
    if isinstance(kind, inspect.Metadata):
        extra = kind.extra or {}
        if extra.get("exact") and isinstance(value, str) and states_tolerance(value):
            refuse(path, f"{_written(value)} states a tolerance, {_NO_QUANTITY}")
        if "units" in extra:
            value = _si(value, extra["units"], path)
        return _value(value, kind.type, path)
    if isinstance(kind, inspect.StructType):
        return _struct(_table(value, path), kind, path)
    if isinstance(kind, inspect.DictType):
        return {_name(k, path): _value(v, kind.value_type, (*path, k)) for k, v in _table(value, path).items()}
    if isinstance(kind, inspect.VarTupleType):
        return _list(value, kind, path)
    return _leaf(value, kind, path)


def _union(value: Any, kind: inspect.UnionType, path: Path) -> Any:
    tagged = [t for t in kind.types if isinstance(t, inspect.StructType) and t.tag is not None]
    if tagged:
        return _tagged(_table(value, path), tagged, path)
    possible = [t for t in kind.types if not isinstance(t, inspect.NoneType)]
    if isinstance(value, str) and any(isinstance(t, inspect.StrType) for t in possible):
        return value
    (only,) = [t for t in possible if len(possible) == 1 or not isinstance(t, inspect.StrType)]
    return _value(value, only, path)


def _tagged(value: Table, kinds: list[inspect.StructType], path: Path) -> Table:
    """Choose the structure that the table's `kind` or `type` names."""
    field = kinds[0].tag_field
    assert field is not None
    known = {str(k.tag): k for k in kinds}
    among = ", ".join(f'"{name}"' for name in known)
    if field not in value:
        refuse(path, f"'{field}' is missing; it is one of {among}")
    tag = value[field]
    if not isinstance(tag, str) or tag not in known:
        hint = did_you_mean(tag, known) if isinstance(tag, str) else ""
        refuse((*path, field), f"{_written(tag)} is not one of {among}{hint}")
    return _struct(value, known[tag], path)


def _struct(value: Table, kind: inspect.StructType, path: Path) -> Table:
    """Check a table against a structure: no unknown key, none missing, each value of its type."""
    fields = {f.encode_name: f for f in kind.fields}
    result: Table = {}
    for key, item in value.items():
        if key == kind.tag_field:
            result[key] = item
        elif key not in fields:
            _refuse_key(key, kind, path)
        elif key == "signals":
            result[key] = _signals(_table(item, (*path, key)), fields[key].type, value, (*path, key))
        elif key == "run":
            result[key] = _runs(item, fields[key].type, value, (*path, key))
        else:
            result[key] = _value(item, fields[key].type, (*path, key))
    missing = [name for name, field in fields.items() if field.required and name not in value]
    if missing:
        names = " and ".join(f"'{name}'" for name in missing)
        refuse(path, f"{names} {'is' if len(missing) == 1 else 'are'} missing{_of_kind(kind)}")
    return result


def _refuse_key(key: str, kind: inspect.StructType, path: Path) -> NoReturn:
    known = [f.encode_name for f in kind.fields] + ([kind.tag_field] if kind.tag_field else [])
    hint = did_you_mean(key, known) or f"; known here: {', '.join(known) or 'none'}"
    refuse((*path, key), f"there is no such key{_of_kind(kind)}{hint}")


def _of_kind(kind: inspect.StructType) -> str:
    if kind.tag_field is None:
        return ""
    what = "a joint of kind" if kind.tag_field == "kind" else "a part of type"
    if kind.cls.__name__.endswith("Transmission"):
        what = "a transmission of type"
    return f' in {what} "{kind.tag}"'


def _signals(value: Table, kind: inspect.Type, joint: Table, path: Path) -> Table:
    assert isinstance(kind, inspect.StructType)
    roles = [f.encode_name for f in kind.fields]
    for role in value:
        if role not in roles:
            hint = did_you_mean(role, roles) or f"; the roles of this joint are {', '.join(roles)}"
            refuse((*path, role), f"there is no such role in this kind of joint{hint}")
    checked = {role: _signal(item, role, kind, (*path, role)) for role, item in value.items()}
    setpoint = checked.get("setpoint")
    if isinstance(setpoint, dict) and "constant" in setpoint and setpoint.get("unit") == "rad":
        arm = _lever_arm(setpoint["constant"], joint, (*path, "setpoint"))
        checked["setpoint"] = setpoint if arm is None else {"constant": arm, "unit": "m"}
    return checked


def _signal(value: Any, role: str, signals: inspect.StructType, path: Path) -> Any:
    """Check the value of a role: a channel's name, a number, or a table."""
    if isinstance(value, list):
        refuse(path, f"{len(value)} values for one role: one role, one channel")
    if isinstance(value, str):
        return _channel(value, path)
    if not isinstance(value, dict):
        return _finite(value, path)
    (union,) = [f.type for f in signals.fields if f.encode_name == role]
    assert isinstance(union, inspect.UnionType)
    (kind,) = [t for t in union.types if isinstance(t, inspect.StructType)]
    return _signal_table(value, kind, role_units(role), path)


def _signal_table(value: Table, kind: inspect.StructType, units: tuple[str, ...], path: Path) -> Table:
    if "channel" in value and "constant" in value:
        refuse(path, "both a channel and a constant are given; keep one of them")
    if "channel" not in value and "constant" not in value:
        refuse(path, "neither a channel nor a constant is given; a role needs one of them")
    if "channel" in value:
        _channel(value["channel"], (*path, "channel"))
    plain = dict(value)
    if "unit" in value:
        _unit(value["unit"], units, (*path, "unit"))
    if "constant" in value:
        idle = [key for key in value if key not in ("constant", "unit")]
        if idle:
            refuse((*path, idle[0]), "does nothing next to a constant; write the constant as it is on the joint's side")
        plain.update(_constant(value, units, (*path, "constant")))
    for key in ("offset", "resolution", "noise"):
        if isinstance(value.get(key), str):
            plain[key] = _end_value(value[key], units, (*path, key))
    if isinstance(value.get("drift"), str):
        plain["drift"] = _end_value(value["drift"], tuple(f"{unit}/s" for unit in units), (*path, "drift"))
    checked = _struct(plain, kind, path)
    if "counts_per_turn" in checked:
        counts = checked.pop("counts_per_turn")
        checked["unit"] = _unit_of_counts(counts, value.get("unit"), units, (*path, "counts_per_turn"))
    return checked


def _channel(value: Any, path: Path) -> str:
    if isinstance(value, list):
        refuse(path, f"{len(value)} channels for one role: one role, one channel")
    if not isinstance(value, str):
        refuse(path, f"{_written(value)} is not a channel's name")
    if not value.strip():
        refuse(path, "the channel's name is empty; leave the key out where there is no channel")
    return value


def _unit(value: Any, units: tuple[str, ...], path: Path) -> None:
    if not isinstance(value, str):
        refuse(path, f'{_written(value)} is not a unit; write it as text, such as "deg"')
    if is_counts(value) and _is_angle(units):
        return  # loads, as `init` writes it; commands that need the angle refuse it
    try:
        matching(value, units)
    except UnitError as error:
        refuse(path, str(error))


def _is_angle(units: tuple[str, ...]) -> bool:
    return not {"rad", "rad/s"}.isdisjoint(units)


def _unit_of_counts(counts: float, unit: str | None, units: tuple[str, ...], path: Path) -> str:
    """Return the unit of an encoder's counts: ``rev/4096`` where 4096 make a turn, of a velocity ``rev/4096/s``."""
    if not _is_angle(units):
        refuse(
            path, f"is for an encoder, but this is {quantity(units[0])}; state its unit, and a gain where it is no SI"
        )
    if unit is not None and not is_counts(unit):
        refuse(path, f"also states the unit; remove unit = {_written(unit)}, or counts_per_turn")
    exact = format(Decimal(counts).normalize(), "f")
    text = f"rev/{exact}/s" if "rad/s" in units else f"rev/{exact}"
    _unit(text, units, path)
    return text


def _constant(signal: Table, units: tuple[str, ...], path: Path) -> Table:
    """Return `constant` in SI with its `unit`: which of a role's units it has may matter later (a current, an angle)."""
    value, unit = signal["constant"], signal.get("unit")
    try:
        if isinstance(value, str):
            if unit is not None:
                refuse(path, f"{_written(value)} has its own unit; remove unit = {_written(unit)}")
            number, like = _torque_not_current(value, units, path)
            return {"constant": number, "unit": like}
        number = _finite(value, path)
        if unit is None:
            return {"constant": number}
        like = matching(unit, units)
        if like == "A":
            refuse(path, f"'{shown(unit)}' is a current; {_TORQUE_OF_CURRENT}")
        return {"constant": number * si_factor(unit, like), "unit": like}
    except UnitError as error:
        refuse(path, str(error))


def _end_value(text: str, units: tuple[str, ...], path: Path) -> float:
    """Return an offset or a step in SI; it applies to the end value, so for a current it is a torque."""
    try:
        return _torque_not_current(text, units, path)[0]
    except UnitError as error:
        refuse(path, str(error))


def _torque_not_current(text: str, units: tuple[str, ...], path: Path) -> tuple[float, str]:
    """Return a quantity in SI and its unit, one of `units`; a current is refused with advice."""
    quantity = parse_stated(text)
    like = matching(quantity.unit, units)
    if like.startswith("A"):
        refuse(path, f"'{shown(quantity.unit)}' is a current; {_TORQUE_OF_CURRENT}")
    return quantity.to(like), like


def _runs(value: Any, kind: inspect.Type, joint: Table, path: Path) -> list[Table]:
    assert isinstance(kind, inspect.VarTupleType)
    runs: list[Table] = _list(value, kind, path)
    for i, run in enumerate(runs):
        if isinstance(run.get("setpoint"), str):
            at = (*path, f"[{i}]", "setpoint")
            run["setpoint"] = _finite(_run_setpoint(run["setpoint"], joint, at), at)
    return runs


def _run_setpoint(text: str, joint: Table, path: Path) -> float:
    """Return a run's set-point in SI: the lever arm r where the joint has a lever, even if an angle was given."""
    try:
        quantity = parse_stated(text)
        like = matching(quantity.unit, role_units("setpoint"))
        number = quantity.to(like)
    except UnitError as error:
        refuse(path, str(error))
    arm = _lever_arm(number, joint, path) if like == "rad" else None
    return number if arm is None else arm


def _lever_arm(angle: float, joint: Table, path: Path) -> float | None:
    """Return the lever arm r = start − travel · angle [m]; None in a joint without a lever.

    Its tolerance is the angle's; start and travel keep their own.
    """
    lever = joint.get("lever")
    if not isinstance(lever, dict) or not {"start", "travel"} <= set(lever):
        return None
    start = _finite(_si(lever["start"], ("m",), path), path)
    travel = _finite(_si(lever["travel"], ("m/rad",), path), path)
    arm = start - travel * angle
    if not isinstance(angle, UncertainNumber):
        return arm
    try:
        return uncertain(arm, abs(travel) * angle.tolerance.half_width, "m")
    except UnitError as error:
        refuse(path, str(error))


def _si(value: Any, units: tuple[str, ...], path: Path) -> Any:
    """Return a quantity written as text in SI; other values go to the check of their type."""
    if not isinstance(value, str):
        return value
    try:
        quantity = parse_stated(value)
        return quantity.to(matching(quantity.unit, units))
    except UnitError as error:
        refuse(path, str(error))


def _list(value: Any, kind: inspect.VarTupleType, path: Path) -> list[Any]:
    if not isinstance(value, list):
        tables = isinstance(kind.item_type, inspect.StructType)
        refuse(
            path, f"a list of {f'tables is needed here: write [[{key_path(path)}]]' if tables else 'numbers is needed'}"
        )
    return [_value(item, kind.item_type, (*path, f"[{i}]")) for i, item in enumerate(value)]


def _table(value: Any, path: Path) -> Table:
    if not isinstance(value, dict):
        refuse(path, f"{_written(value)} is given, but a table is needed: [{key_path(path)}]")
    return value


def _name(name: str, path: Path) -> str:
    if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
        refuse(path, f"'{shown(name)}' is not usable as a name: one to {LONGEST_NAME} printable characters")
    return name


def _leaf(value: Any, kind: inspect.Type, path: Path) -> Any:
    if isinstance(value, str) and states_tolerance(value):
        value = _uncertain(value, kind, path)
    if isinstance(kind, inspect.FloatType):
        return _bounded(_finite(value, path), kind, path)
    if isinstance(kind, inspect.IntType):
        if not isinstance(value, int) or isinstance(value, bool):
            refuse(path, f"{_written(value)} is not a whole number")
        return _bounded(value, kind, path)
    if isinstance(kind, inspect.LiteralType):
        if type(value) is not type(kind.values[0]) or value not in kind.values:
            among = " or ".join(_written(v) for v in kind.values)
            refuse(path, f"{_written(value)} is not {among}{_hint(path)}")
        return value
    wanted = bool if isinstance(kind, inspect.BoolType) else str
    if not isinstance(value, wanted):
        refuse(path, f"{_written(value)} is not {'true or false' if wanted is bool else 'a text in quotes'}")
    return value


def _uncertain(text: str, kind: inspect.Type, path: Path) -> Any:
    """Return a number without unit that states a tolerance; a name, which may contain the sign, stays unchanged."""
    if isinstance(kind, inspect.StrType):
        return text
    if not isinstance(kind, inspect.FloatType):
        refuse(path, f"{_written(text)} states a tolerance, {_NO_QUANTITY}")
    try:
        return parse_stated_number(text).to("")
    except UnitError as error:
        refuse(path, str(error))


def _finite(value: Any, path: Path) -> float:
    if isinstance(value, str):
        refuse(path, f"{_written(value)} is a text, but a plain number without unit is needed")
    if isinstance(value, bool) or not isinstance(value, int | float):
        refuse(path, f"{_written(value)} is not a number")
    try:
        number = value if isinstance(value, float) else float(value)  # a float may carry a tolerance
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        refuse(path, f"{_written(value)} is not a finite number")
    return number


def _bounded(number: float, kind: inspect.FloatType | inspect.IntType, path: Path) -> float:
    broken = None
    if kind.gt is not None and not number > kind.gt:
        broken = f"greater than {kind.gt:g}"
    elif kind.ge is not None and not number >= kind.ge:
        broken = f"at least {kind.ge:g}"
    elif kind.le is not None and not number <= kind.le:
        broken = f"at most {kind.le:g}"
    if broken:
        refuse(path, f"{_written(number)} is not possible: it has to be {broken}{_hint(path)}")
    return number


def _hint(path: Path) -> str:
    # A servo's stiffness and damping are gains: advice on mechanical ones does not apply.
    gain = len(path) > 1 and "servo" in path[-2]
    hint = None if gain else _HINTS.get(path[-1])
    return f"; {hint}" if hint else ""


def _written(value: Any) -> str:
    """Show a value as written in the file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return (
            shown(f"{value:g}")
            if isinstance(value, float)
            else shown(f"{value:d}")
            if abs(value) < 1e20
            else "a huge number"
        )
    if isinstance(value, str):
        return f'"{shown(value)}"'
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "a list"
    return f"a {type(value).__name__}"
