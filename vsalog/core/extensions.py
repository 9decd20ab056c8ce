"""What packages of third parties add by entry points."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from typing import Any

from vsalog.core.errors import ExtensionError


def extensions(group: str) -> Iterator[tuple[str, Any]]:
    """Yield name and object of each entry point in a group.

    Parameters
    ----------
    group : such as ``vsalog.checks``

    Raises
    ------
    ExtensionError
        One cannot be loaded.
    """
    for point in entry_points(group=group):
        try:
            found = point.load()
        except Exception as error:  # whatever the code of others raises
            package = f" of package {point.dist.name}" if point.dist else ""
            raise ExtensionError(
                f"the entry point '{point.name} = {point.value}' in '{group}'{package} cannot be loaded"
                f" ({type(error).__name__}: {error}); correct the package, or uninstall it"
            ) from error
        yield point.name, found
