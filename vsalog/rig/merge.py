"""Merges rigs' tables: a file into its preset, a `--set` into a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Table = dict[str, Any]


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> Table:
    """Return `below` with the values of `above` replacing its own, table by table; neither is changed."""
    result: Table = dict(below)
    for key, value in above.items():
        result[key] = _over(result.get(key), value, inside_signals=False, key=key)
    return result


def _over(old: Any, new: Any, inside_signals: bool, key: str) -> Any:
    if not isinstance(new, dict):
        return new
    if inside_signals:
        return _signal_over(old, new)
    if not isinstance(old, dict) or _is_other_type(old, new):
        return new
    result: Table = dict(old)
    for name, value in new.items():
        result[name] = _over(result.get(name), value, inside_signals=key == "signals", key=name)
    return result


def _is_other_type(old: Table, new: Table) -> bool:
    """Return whether a transmission changes its type, so that the old one's parameters have no meaning any more."""
    return "type" in new and new["type"] != old.get("type")


def _signal_over(old: Any, new: Table) -> Table:
    """Merge a role's table into the old value, which may be a table, or a channel's name or number in short."""
    if isinstance(old, str):
        old = {"channel": old}
    if not isinstance(old, dict):
        return new
    if "constant" in new and "channel" not in new:
        # The sensor of a channel does not apply to a constant.
        unit = {"unit": old["unit"]} if "unit" in old and not isinstance(new["constant"], str) else {}
        return {**unit, **new}
    result = {**old, **new}
    if "channel" in new and "constant" not in new:
        result.pop("constant", None)
    return result
