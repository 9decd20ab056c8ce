"""The table of estimators: the modules of `vsalog.estimators.methods`, and those of third parties.

Third parties add a method by an entry point in the group ``vsalog.estimators`` that names a module with `NAME`, `SUMMARY`,
`TUNING`, `roles` and `build`, as the modules of `vsalog.estimators.methods` have them. Nothing heavy is imported before a
method is asked for: the help texts list the names.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import vsalog.estimators.methods
from vsalog.core.errors import EstimatorError, did_you_mean

if TYPE_CHECKING:
    from vsalog.estimators.fold import Method


def built_in() -> dict[str, str]:
    """Return the name and the module of each method of ours; a name is its file's."""
    package = vsalog.estimators.methods
    return {m.name.replace("_", "-"): f"{package.__name__}.{m.name}" for m in iter_modules(package.__path__)}


def methods() -> Mapping[str, str]:
    """Return every method's name and module, those of third parties last."""
    found = built_in()
    for point in entry_points(group="vsalog.estimators"):
        found.setdefault(point.name, point.value)
    return found


def method(name: str) -> Method:
    """Return a method by name.

    Raises
    ------
    EstimatorError
        There is no such method; the nearest names are suggested.
    """
    known = methods()
    if name not in known:
        raise EstimatorError(
            f"there is no estimator '{name}'{did_you_mean(name, known) or '.'} There are: auto, {', '.join(known)}"
        )
    module: Method = import_module(known[name])
    return module
