"""Effects: one physical or sensing effect per file, and the table of them.

Third parties add one by an entry point in the group ``vsalog.effects`` that names a module with an `EFFECT`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from vsalog.core.extensions import extensions
from vsalog.effects.base import Effect


@cache
def effects() -> dict[str, Effect]:
    """Return name → effect, those of third parties last."""
    own = {m.name: import_module(f"{__name__}.{m.name}") for m in iter_modules(__path__)}
    found: dict[str, Effect] = {name: own[name].EFFECT for name in sorted(own) if hasattr(own[name], "EFFECT")}
    for name, module in extensions("vsalog.effects"):
        found.setdefault(name, module.EFFECT)
    return found
