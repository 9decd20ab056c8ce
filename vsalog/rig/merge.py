"""Laying one rig's tables over another's: a file over its preset, a `--set` over a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Table = dict[str, Any]


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> Table:
    """Return `below` with what stands in `above` put over it, table by table; neither is changed."""
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
    """Tell whether a transmission changes its type, so that the old one's parameters mean nothing any more."""
    return "type" in new and new["type"] != old.get("type")


def _signal_over(old: Any, new: Table) -> Table:
    """Put a role's table over what was there, which may be a table, or a channel's name or number in short."""
    if isinstance(old, str):
        old = {"channel": old}
    if not isinstance(old, dict):
        return new
    if "constant" in new and "channel" not in new:
        # What the sensor of a channel does says nothing about a constant.
        unit = {"unit": old["unit"]} if "unit" in old and not isinstance(new["constant"], str) else {}
        return {**unit, **new}
    result = {**old, **new}
    if "channel" in new and "constant" not in new:
        result.pop("constant", None)
    return result
