"""The catalogue of causes: every module of this package may hold some, and each is found by itself."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from vsalog.diagnosis.causes.base import Cause


@cache
def catalogue() -> dict[str, Cause]:
    """Return name → cause, all there are."""
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    return {c.name: c for c in sorted((kind() for kind in _kinds(Cause)), key=lambda c: (c.order, c.name))}


def _kinds(base: type[Cause]) -> list[type[Cause]]:
    found = []
    for kind in base.__subclasses__():
        found += ([kind] if hasattr(kind, "name") else []) + _kinds(kind)
    return found
