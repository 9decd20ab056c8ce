"""The catalogue of causes: rows of the effects' tables, and classes of the modules of this package.

Third parties add causes by an entry point in the group ``vsalog.causes`` that names a module with subclasses of `Cause`, or rows
by one in the group ``vsalog.effects``.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from vsalog.core.errors import ExtensionError
from vsalog.core.extensions import extensions
from vsalog.diagnosis.causes.base import Cause
from vsalog.diagnosis.causes.one_number import OneNumberCause
from vsalog.effects import effects


@cache
def catalogue() -> dict[str, Cause]:
    """Return name → cause, all there are.

    Raises
    ------
    ExtensionError
        A third party's cannot be used.
    """
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    dict(extensions("vsalog.causes"))  # once they are imported, their classes are known
    rows = [OneNumberCause(row) for effect in effects().values() for row in effect.causes]
    causes = (*rows, *(kind() for kind in _kinds(Cause)))
    names = [cause.name for cause in causes]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ExtensionError(f"two causes are called '{twice}': rename the one of the package that you added")
    return {c.name: c for c in sorted(causes, key=lambda c: (c.order, c.name))}


def _kinds(base: type[Cause]) -> list[type[Cause]]:
    found = []
    for kind in base.__subclasses__():
        found += ([kind] if hasattr(kind, "name") else []) + _kinds(kind)
    return found
