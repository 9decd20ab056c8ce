"""The contract of an effect, for authors of effects: tested when its package is loaded, before anything is computed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from inspect import getattr_static
from typing import Any, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.effects.base import Default, Effect, Key, OneNumber, Place
from vsalog.effects.body_torque import BodyTorque
from vsalog.effects.counterpart import Counterpart, Whole
from vsalog.effects.reading_error import ReadingError

Array = NDArray[np.float64]

TRIED = np.linspace(-1.3, 1.7, 7)
"""Positions, velocities, readings and times at which formulas are tested, in SI: of both signs, and beyond 1."""


def keep_contract(effect: Any) -> None:
    """Test an effect.

    Raises
    ------
    ValueError
        It breaks the contract of an effect; the text states where.
    """
    _require(isinstance(effect, Effect), "EFFECT is no vsalog.effects.base.Effect")
    for name, kind in (("keys", Key), ("tolerances", Default), ("causes", OneNumber), ("counterparts", Counterpart)):
        members = getattr(effect, name)
        whole = isinstance(members, tuple) and all(isinstance(member, kind) for member in members)
        _require(whole, f"{name} has to be a tuple of {kind.__name__}")
    for cause in effect.causes:
        _require(cause.place in get_args(Place), f"cause {cause.name}: there is no place '{cause.place}'")
    for item in effect.counterparts:
        _require(item.part in get_args(Whole), f"counterpart of {item.keys}: there is no part '{item.part}'")
        _require(isinstance(item.keys, tuple), f"counterpart of {item.keys}: its keys have to be a tuple of names")
    for key in effect.keys:
        base = {"motor": BodyTorque, "link": BodyTorque, "signal": ReadingError}.get(key.part)
        _require(base is not None, f"key {key.name}: there is no part '{key.part}', but motor, link and signal")
        _require(key.name.isidentifier(), f"'{key.name}' is no name of a key")
        assert base is not None
        fitting = isinstance(key.table, type) and issubclass(key.table, base)
        _require(fitting, f"key {key.name}: the table of a {key.part} extends {base.__name__}")
        trial: Callable[[Any], Array] = _try_torque if base is BodyTorque else _try_error
        does = trial(_example(key.table, all_ones=False))
        trial(_example(key.table, all_ones=True))
        absent = not key.many and not any(field.required for field in msgspec.structs.fields(key.table))
        _require(
            not absent or not np.any(does),
            f"{key.table.__name__} has defaults that do something where the rig has none",
        )


def _require(condition: Any, words: str) -> None:
    if not condition:
        raise ValueError(words)


def _example(table: Any, *, all_ones: bool) -> Any:
    """Return a table with its defaults and with 1 where there is none, or with 1 wherever a key may have it."""
    fields = msgspec.structs.fields(table)
    made = msgspec.convert({f.encode_name: 1.0 for f in fields if f.required}, table)
    for field in fields if all_ones else ():
        with suppress(msgspec.ValidationError):
            made = msgspec.convert({**msgspec.to_builtins(made), field.encode_name: 1.0}, table)
    return made


def _try_torque(table: BodyTorque) -> Array:
    kind = type(table).__name__
    own = isinstance(getattr_static(table, "formula"), staticmethod) and type(table).formula is not BodyTorque.formula
    _require(own, f"{kind} needs a formula of its own, a staticmethod")
    for ratio in (1.0, 2.0):
        numbers = table.numbers(ratio)
        sound = isinstance(numbers, tuple) and bool(np.isfinite(np.array(numbers, dtype=np.float64)).all())
        _require(sound, f"{kind}.numbers has to return a tuple of finite numbers")
        slopes = np.array(table.slopes(ratio), dtype=np.float64)
        sound = slopes.shape == (2,) and bool(np.all(np.isfinite(slopes) & (slopes >= 0.0)))
        _require(sound, f"{kind}.slopes has to return two finite numbers that are not negative")
    _require(
        len(numbers) == len(table.numbers(1.0)), f"{kind}.numbers has to return as many numbers for each gear ratio"
    )
    _require(isinstance(table.geared(2.0), type(table)), f"{kind}.geared has to return such a table")
    p = np.array(numbers, dtype=np.float64)
    return _values(f"{kind}.formula", lambda x, v, t: table.formula(x, v, t, p, 0), TRIED, TRIED[::-1], TRIED + 2.0)


def _try_error(table: ReadingError) -> Array:
    kind = type(table).__name__
    _require(isinstance(getattr(type(table), "UNIT", None), str), f"{kind}.UNIT has to be an SI unit")
    errors = _values(f"{kind}.error", table.error, TRIED)
    for name in ("slope", "curvature"):
        _values(f"{kind}.{name}", getattr(table, name), TRIED)
    largest = np.array(table.largest, dtype=np.float64)
    _require(largest.shape == (2,) and np.all(largest >= 0.0), f"{kind}.largest has to be two bounds of sizes")
    _require(isinstance(table.scaled(2.0), type(table)), f"{kind}.scaled has to return such a table")
    return errors


def _values(name: str, formula: Callable[..., Any], *at: Array) -> Array:
    """Return a formula of arrays, which must agree with the formula of single numbers and must not change its arguments."""
    inputs = [values.copy() for values in at]
    whole = np.asarray(formula(*inputs), dtype=np.float64)
    _require(whole.shape == TRIED.shape, f"{name} has to return an array of its arguments' shape")
    _require(all(map(np.array_equal, inputs, at)), f"{name} changes its arguments")
    alone = np.array([float(formula(*(float(values[k]) for values in at))) for k in range(TRIED.size)])
    _require(np.allclose(whole, alone, equal_nan=True), f"{name} gives another result for arrays than for numbers")
    return whole
