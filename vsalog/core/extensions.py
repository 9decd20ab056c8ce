"""Extensions by packages of third parties, through entry points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from typing import Any

from vsalog.core.errors import ExtensionError
from vsalog.core.printable import printable


def extensions(group: str, check: Callable[[str, Any], None] | None = None) -> Iterator[tuple[str, Any]]:
    """Yield name and object of each entry point in a group.

    Parameters
    ----------
    group : such as ``vsalog.checks``
    check : raises what is wrong with one

    Raises
    ------
    ExtensionError
        One cannot be loaded, or something is wrong with it.
    """
    for point in entry_points(group=group):
        try:
            found = point.load()
            if check is not None:
                check(point.name, found)
        except Exception as error:  # whatever the code of others raises
            package = f" of package {point.dist.name}" if point.dist else ""
            raise ExtensionError(
                f"the entry point '{point.name} = {point.value}' in '{group}'{package} cannot be used"
                f" ({type(error).__name__}: {printable(str(error))}); correct the package, or uninstall it"
            ) from error
        yield point.name, found
