"""Quantities with a tolerance: "0.08 kg*m^2 ± 10 %".

The tolerance is the half-width of the interval that contains the true value with 95 % probability. While a rig's tables are
decoded, a number carries its tolerance along (`UncertainNumber`); `collect` then separates the two, so that the structures
contain plain numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from vsalog.core.errors import UnitError
from vsalog.core.printable import LONGEST_TEXT
from vsalog.core.significance import INTERVAL
from vsalog.core.units import shown, si_factor, split_number, split_quantity

Path = tuple[str, ...]

TOLERANCE_SIGN = r"±|\+/?[-−]"
_SIGN = re.compile(TOLERANCE_SIGN)
_EXAMPLE = 'write the value, ± and the tolerance, such as "0.08 kg*m^2 ± 10 %" or "0 rad ± 0.5 deg"'


class Tolerance(NamedTuple):
    """The tolerance of a quantity.

    Attributes
    ----------
    half_width : of its 95 % interval, in SI
    unit : the SI unit that both have; empty where there is none
    """

    half_width: float
    unit: str

    @property
    def deviation(self) -> float:
        """One standard deviation, in SI."""
        return self.half_width / INTERVAL


class UncertainNumber(float):
    """A number and its tolerance; any arithmetic with it gives a plain number."""

    tolerance: Tolerance

    def __new__(cls, value: float, tolerance: Tolerance) -> UncertainNumber:
        """Return `value` with its tolerance."""
        number = super().__new__(cls, value)
        number.tolerance = tolerance
        return number


class Quantity(NamedTuple):
    """A quantity parsed from a text.

    Attributes
    ----------
    number : in `unit`
    unit : as written; empty where the text has none
    half_width : of the tolerance, in `half_unit`; None where the text states none
    half_unit : as written; ``%`` for a share of the number
    """

    number: float
    unit: str
    half_width: float | None = None
    half_unit: str = ""

    def to(self, like: str) -> float:
        """Return the number in the unit `like`, empty for none; an `UncertainNumber` where a tolerance is stated.

        Raises
        ------
        UnitError
            A unit does not fit, or the tolerance is not possible.
        """
        value = self.number * (si_factor(self.unit, like) if like else 1.0)
        # A value that is not finite is refused separately.
        if self.half_width is None or not math.isfinite(value):
            return value
        return uncertain(value, self._half_width(self.half_width, value, like), like)

    def _half_width(self, half_width: float, value: float, like: str) -> float:
        if half_width < 0.0:
            raise UnitError(f"the tolerance, {half_width:g}, is negative; write the largest error in either direction")
        if self.half_unit == "%":
            if value == 0.0 and half_width > 0.0:
                raise UnitError("a tolerance in per cent of 0 has no meaning; write it in the quantity's unit")
            return abs(value) * half_width / 100.0
        if not like or (half_width == 0.0 and not self.half_unit):
            return half_width
        if not self.half_unit:
            raise UnitError(f"the tolerance, {half_width:g}, has no unit; write it with one, or in per cent")
        return half_width * _tolerance_factor(self.half_unit, like)


def uncertain(value: float, half_width: float, unit: str) -> UncertainNumber:
    """Return a number with its tolerance, both in the SI unit `unit`.

    Raises
    ------
    UnitError
        The tolerance is too large to compute with.
    """
    # A variance is a finite double.
    if not math.isfinite(half_width * half_width):
        raise UnitError("the tolerance is too large to compute with; leave it out if it is not known")
    return UncertainNumber(value, Tolerance(half_width, unit))


def states_tolerance(text: str) -> bool:
    """Return whether a text has the sign of a tolerance: ±, +- or +/-."""
    return _SIGN.search(text) is not None


def parse_stated(text: str) -> Quantity:
    """Parse "0.08 kg*m^2 ± 10 %", "0.08 ± 0.008 kg*m^2" or "0.08 kg*m^2".

    Raises
    ------
    UnitError
        There is no plain number before or after the sign, or more than that, or no unit.
    """
    if not states_tolerance(text):
        return Quantity(*split_quantity(text))
    quantity = _split(text)
    if not quantity.unit:
        raise UnitError(f"'{shown(text)}' has no unit; {_EXAMPLE}")
    return quantity


def parse_stated_number(text: str) -> Quantity:
    """Parse "1 ± 0.1 %" or "1 ± 0.001", a number without unit.

    Raises
    ------
    UnitError
        As for `parse_stated`, or there is a unit.
    """
    quantity = _split(text)
    if quantity.unit:
        raise UnitError(
            f'\'{shown(text)}\' has a unit, but a plain number is needed, such as "1 ± 0.1 %" or "1 ± 0.001"'
        )
    return quantity


def _split(text: str) -> Quantity:
    sign = _SIGN.search(text)
    assert sign is not None
    if len(text) > LONGEST_TEXT:
        raise UnitError(f"'{shown(text)}' is too long for a quantity (more than {LONGEST_TEXT} characters)")
    stated, tolerance = text[: sign.start()], text[sign.end() :]
    if states_tolerance(tolerance):
        raise UnitError(f"'{shown(text)}' states more than one tolerance; {_EXAMPLE}")
    number, unit = split_number(stated)
    try:
        half_width, half_unit = split_number(tolerance)
    except UnitError:
        raise UnitError(f"'{shown(tolerance.strip())}' is no tolerance; {_EXAMPLE}") from None
    if not unit and half_unit != "%":
        unit = half_unit
    return Quantity(number, unit, half_width, half_unit)


def collect(tables: Any, found: dict[Path, Tolerance], path: Path = ()) -> Any:
    """Return the tables with plain numbers, and put the tolerances they carried into `found`, by their keys' paths."""
    if isinstance(tables, UncertainNumber):
        found[path] = tables.tolerance
        return float(tables)
    if isinstance(tables, dict):
        return {key: collect(item, found, (*path, key)) for key, item in tables.items()}
    if isinstance(tables, list):
        return [collect(item, found, (*path, f"[{i}]")) for i, item in enumerate(tables)]
    return tables


def stated(value: float, tolerance: Tolerance) -> str:
    """Write a quantity and its tolerance in SI; `parse_stated` reads the very same numbers back."""
    unit = f" {tolerance.unit}" if tolerance.unit else ""
    return f"{value!r}{unit} ± {tolerance.half_width!r}{unit}"


def value_at(structures: Any, path: Path) -> Any:
    """Return the value at a key's path in a rig's structures; None where there is none."""
    for part in path:
        if isinstance(structures, tuple):
            index = int(part.strip("[]"))
            structures = structures[index] if index < len(structures) else None
        elif isinstance(structures, Mapping):
            structures = structures.get(part)
        else:
            structures = getattr(structures, part, None)
    return structures


def put_stated(tables: dict[str, Any], structures: Any, tolerances: Mapping[Path, Tolerance]) -> None:
    """Replace the numbers in a rig's tables that have a tolerance by texts that state it.

    `structures` are what the tables were made from; the tables leave out what is at its default.
    """
    for path, tolerance in tolerances.items():
        table: Any = tables
        for i, part in enumerate(path[:-1]):
            table = _entered(table, part, value_at(structures, path[: i + 1]))
        value = value_at(structures, path)
        table[int(path[-1][1:-1]) if isinstance(table, list) else path[-1]] = stated(value, tolerance)
        if path[-1] == "constant":
            table.pop("unit", None)  # the text has its own


def _entered(table: Any, part: str, structure: Any) -> Any:
    """Return the table or list at `part`, made where it is absent because everything in it is at its default."""
    if isinstance(table, list):
        return table[int(part[1:-1])]
    if part not in table:
        table[part] = list(structure) if isinstance(structure, tuple) else {}
    return table[part]


def _tolerance_factor(unit: str, like: str) -> float:
    try:
        return si_factor(unit, like)
    except UnitError as error:
        raise UnitError(f"the tolerance does not fit: {error}") from None
