"""Effects: one physical or sensing effect per file, and the table of them.

Third parties add one by an entry point in the group ``vsalog.effects`` that names a module with an `EFFECT`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from vsalog.core.extensions import extensions
from vsalog.effects.base import Effect
from vsalog.effects.contract import keep_contract


@cache
def effects() -> dict[str, Effect]:
    """Return name → effect, those of third parties last."""
    own = {m.name: import_module(f"{__name__}.{m.name}") for m in iter_modules(__path__)}
    found: dict[str, Effect] = {name: own[name].EFFECT for name in sorted(own) if hasattr(own[name], "EFFECT")}

    def check(name: str, module: Any) -> None:
        if name in found:
            raise ValueError(f"there is an effect '{name}' already")
        keep_contract(module.EFFECT)
        keys = [(key.part, key.name) for effect in (*found.values(), module.EFFECT) for key in effect.keys]
        if twice := next((key for key in keys if keys.count(key) > 1), None):
            raise ValueError(f"a {twice[0]} has a key '{twice[1]}' already")

    for name, module in extensions("vsalog.effects", check):
        found[name] = module.EFFECT
    return found
