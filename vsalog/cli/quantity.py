"""Options that are a positive quantity, as a number in SI or with a unit."""

from __future__ import annotations

from collections.abc import Callable

import rich_click as click


def positive(unit: str, kind: str) -> Callable[[click.Context, click.Parameter, str | None], float | None]:
    """Return a click callback that reads a quantity in SI; None where the option is absent.

    Parameters
    ----------
    unit : SI unit of a bare number
    kind : what it has to be, such as "a time longer than zero"
    """

    def read(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
        from vsalog.core.errors import UnitError
        from vsalog.core.units import positive_quantity

        if value is None:
            return None
        try:
            return positive_quantity(value, unit, kind)
        except UnitError as error:
            raise click.BadParameter(str(error), context, parameter) from None

    return read
