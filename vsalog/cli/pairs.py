"""Options of the form NAME=VALUE that may be repeated."""

from __future__ import annotations

import rich_click as click


def pairs(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """Return NAME → VALUE; a click callback."""
    out = {}
    for value in values:
        name, equals, text = value.partition("=")
        if not equals or not name.strip():
            raise click.BadParameter(f"'{value}' is not NAME=VALUE", context, parameter)
        out[name.strip()] = text.strip()
    return out
