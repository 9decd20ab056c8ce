"""Unit text → factor to SI.

A small grammar (products, quotients, powers, parentheses) over a table of built-in unit names. pint is imported only
for a name that is not in the table, and only ever sees that one name: an expression from a hostile file is never
evaluated by anyone but the few lines below.

The radian counts as 1, so that N·m is a fitting unit for a stiffness in N·m/rad; it is still carried along as an exponent
of its own, because a message that calls N·m/rad a stiffness and N·m a torque is easier to understand.
"""

from __future__ import annotations

import math
import re
from functools import cache, lru_cache
from typing import Any, NamedTuple

from vsalog.core.errors import UnitError
from vsalog.core.printable import LONGEST_TEXT, printable
from vsalog.core.unit_tables import ATOMS, COUNTS, KINDS, OFFSET_UNITS, ONE, QUANTITIES, Dimension

LINE_LENGTH = 80
"""Characters of a text from a file in a message: a line of a terminal; no unit (all base units with powers) is longer."""

_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_PRODUCT_SIGNS = str.maketrans("·⋅•∙×", "*****")
_SAME_LOOK = str.maketrans({"µ": "u", "μ": "u", "Ω": "Ω", "−": "-", "º": "°", "˚": "°"})
_SUPERSCRIPT_RUN = re.compile(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+")
_TOKEN = re.compile(
    r"\s*(?:(?P<power>\^[ ]*\(?[+-]?\d+(?:\.\d+)?\)?)|(?P<name>[A-Za-z_°Ω%]+)|(?P<number>\d+(?:\.\d+)?)|(?P<sign>[*/().-]))\s*"
)
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_EXAMPLE = 'write a plain number and a unit, such as "7.3 kg*m*mm" or "500 N·mm/rad"'


class Unit(NamedTuple):
    """A unit's size in SI base units and the exponents of its dimensions."""

    factor: float
    dimension: Dimension


def si_factor(unit: str, like: str) -> float:
    """Return the factor from a number in `unit` to one in `like`.

    Parameters
    ----------
    unit : as people write it: ``deg``, ``N·mm/rad``, ``kg*m^2``, ``kgf cm``, ``1/s`` …
    like : the unit that is wanted, e.g. ``N*m/rad``

    Raises
    ------
    UnitError
        The unit is not known, measures something else, or has a zero of its own (°C).
    """
    return _conversion(unit, like)


@lru_cache(maxsize=512)
def _conversion(unit: str, like: str) -> float:
    wanted = parse_unit(like)
    # A bare "g" is a gram, except where an acceleration is wanted: sensors state accelerations in g.
    given = parse_unit("g_n" if unit.strip() == "g" and wanted.dimension == _ACCELERATION else unit)
    if not _same(given.dimension, wanted.dimension):
        raise UnitError(f"'{shown(unit)}' is {kind_of(given.dimension)}, but {quantity(like)} is wanted")
    return given.factor / wanted.factor


def matching(unit: str, likes: tuple[str, ...]) -> str:
    """Return which of the units in `likes` has the dimension of `unit`.

    Raises
    ------
    UnitError
        None of them does, or the unit is not known.
    """
    given = parse_unit(unit)
    for like in likes:
        if _same(given.dimension, parse_unit(like).dimension):
            return like
    wanted = " or ".join(quantity(like) for like in likes)
    raise UnitError(f"'{shown(unit)}' is {kind_of(given.dimension)}, but {wanted} is wanted")


def split_quantity(text: str) -> tuple[float, str]:
    """Split "500 N·mm/rad" into the number and its unit.

    Raises
    ------
    UnitError
        There is no plain number in front, or no unit after it.
    """
    number, unit = split_number(text)
    if not unit:
        raise UnitError(f"'{shown(text)}' has no unit; {_EXAMPLE}, or a number without quotes for SI")
    return number, unit


def split_number(text: str) -> tuple[float, str]:
    """Split "500 N·mm/rad" as `split_quantity` does; the unit is empty where there is none.

    Raises
    ------
    UnitError
        There is no plain number in front.
    """
    stripped = text.strip().replace("−", "-")
    number = _NUMBER.match(stripped)
    if number is None:
        raise UnitError(f"'{shown(text)}' does not begin with a number; {_EXAMPLE}")
    unit = stripped[number.end() :].strip()
    if unit and (unit[0] in ",/*^+-" or unit[0].isdigit()):
        raise UnitError(f"'{shown(text)}' is not one plain number and a unit; {_EXAMPLE}")
    return float(number[0]), unit


def parse_quantity(text: str, like: str) -> float:
    """Return the quantity in `text`, e.g. "500 N·mm/rad", in the unit `like`.

    Raises
    ------
    UnitError
        The text is no number with a unit, or the unit does not fit.
    """
    value, unit = split_quantity(text)
    return value * si_factor(unit, like)


def positive_quantity(value: float | str, like: str, kind: str) -> float:
    """Return a number, or the quantity in a text, with a unit or in the unit `like`.

    Parameters
    ----------
    value : the given number or text
    like : SI unit of a bare number
    kind : what it has to be, such as "a time longer than zero"

    Raises
    ------
    UnitError
        It is no such quantity, or not above zero.
    """
    try:
        number = float(value)
    except ValueError:
        number = parse_quantity(str(value), like)
    if not 0.0 < number < float("inf"):
        raise UnitError(f"'{value}' is not {kind}")
    return number


def split_header(text: str) -> tuple[str, str | None]:
    """Split a table's header into name and unit: "theta [deg]" → ("theta", "deg"), "x (filtered)" → (itself, None).

    A bracket without a built-in unit stays in the name: "q (min)" is likelier a minimum than minutes, and pint
    knows a unit for nearly every short word.
    """
    if len(text) > LONGEST_TEXT:
        return text.strip(), None
    match = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]()]*)\]|\(([^()\[\]]*(?:\([^()]*\)[^()\[\]]*)?)\))\s*", text, re.DOTALL)
    if match is None or _is_label(text, match[1]):
        return text.strip(), None
    unit = (match[2] if match[2] is not None else match[3]).strip()
    if unit in _NOT_IN_HEADERS or not (is_known_by_heart(unit) or is_counts(unit)):
        return text.strip(), None
    return match[1].strip(), unit


def _is_label(text: str, name: str) -> bool:
    """Return whether the bracket names an element: "/joint_states.position[m]" has no space before it, as ROS names have."""
    return name.startswith("/") and text[len(name)] == "["


def is_counts(unit: str) -> bool:
    """Return whether a unit is that of raw encoder counts, whose number per turn is unknown."""
    return unit.strip().lower() in COUNTS


_NOT_IN_HEADERS = frozenset({"", "1", "min", "in", "h", "T", "C", "F", "K"})


def is_known_by_heart(unit: str) -> bool:
    """Return whether a text is a unit of this table, without using pint."""
    try:
        _parse(unit, ask_pint=False)
    except UnitError:
        return False
    return True


@lru_cache(maxsize=512)
def parse_unit(unit: str) -> Unit:
    """Return the size and dimension of a unit.

    Raises
    ------
    UnitError
        The text is no unit, or one with a zero of its own.
    """
    return _parse(unit, ask_pint=True)


def kind_of(dimension: Dimension) -> str:
    """Name what a dimension measures: "a torque"."""
    exact = KINDS.get(dimension)
    if exact is not None:
        return exact
    without_angle = next((name for known, name in KINDS.items() if _same(known, dimension)), None)
    return without_angle or "something else"


def quantity(like: str) -> str:
    """Name what a unit measures with examples: "an angle (rad, deg, …)"."""
    return QUANTITIES.get(like) or f"{kind_of(parse_unit(like).dimension)} ({like}, …)"


def shown(text: str) -> str:
    """Return text from a file fit for a message: no control characters, limited length."""
    safe = printable(text)
    return safe if len(safe) <= LINE_LENGTH else safe[: LINE_LENGTH - 1] + "…"


def _same(a: Dimension, b: Dimension) -> bool:
    """Compare dimensions; the angle, the last one, counts as 1."""
    return a[:-1] == b[:-1]


def _normalised(unit: str) -> str:
    text = _SUPERSCRIPT_RUN.sub(lambda run: "^" + run[0].translate(_SUPERSCRIPTS), unit.strip())
    return text.translate(_PRODUCT_SIGNS).translate(_SAME_LOOK).replace("**", "^")


def _parse(unit: str, ask_pint: bool) -> Unit:
    if len(unit) > LINE_LENGTH:
        raise UnitError(f"'{shown(unit)}' is too long for a unit (more than {LINE_LENGTH} characters)")
    text = _normalised(unit)
    if not text:
        raise UnitError("the unit is empty")
    direct = ATOMS.get(text)
    if direct is not None:
        return Unit(*direct)
    parser = _Parser(unit, text, ask_pint)
    result = parser.product()
    if parser.rest():
        raise parser.error()
    if not (math.isfinite(result.factor) and result.factor > 0.0):
        raise UnitError(f"'{shown(unit)}' is too large or too small to compute with")
    return result


class _Parser:
    """Recursive descent over one unit: product = power { ("*" | "/" | " ") power | "/" number }, power = atom [ "^" number ].

    A number divides only ("rev/4096"): in front of a unit it would be a quantity.
    """

    def __init__(self, original: str, text: str, ask_pint: bool) -> None:
        self.original = original
        self.text = text
        self.pos = 0
        self.ask_pint = ask_pint

    def error(self) -> UnitError:
        return UnitError(f"'{shown(self.original)}' is not a unit (examples: deg, N*m/rad, N·mm, kg*m^2, A)")

    def rest(self) -> str:
        return self.text[self.pos :]

    def product(self) -> Unit:
        result = self.power()
        while self.rest() and not self.rest().startswith(")"):
            divide = self._take("/")
            if not divide:
                # "N m" and "N-m" are products too.
                _ = self._take("*") or self._take(".") or self._take("-")
            part = Unit(self._number(), ONE) if divide and self._number_follows() else self.power()
            result = _times(result, part, -1.0 if divide else 1.0)
        return result

    def _number_follows(self) -> bool:
        token = _TOKEN.match(self.text, self.pos)
        return token is not None and token["number"] is not None

    def _number(self) -> float:
        token = _TOKEN.match(self.text, self.pos)
        assert token is not None
        self.pos = token.end()
        return float(token["number"])

    def power(self) -> Unit:
        base = self.atom()
        token = _TOKEN.match(self.text, self.pos)
        if token is None or not token["power"]:
            return base
        self.pos = token.end()
        exponent = float(token["power"].lstrip("^ ").strip("()"))
        return _times(Unit(1.0, ONE), base, exponent)

    def atom(self) -> Unit:
        token = _TOKEN.match(self.text, self.pos)
        if token is None:
            raise self.error()
        self.pos = token.end()
        if token["name"]:
            return self._named(token["name"])
        if token["number"] == "1":
            return Unit(1.0, ONE)
        if token["sign"] == "(":
            inner = self.product()
            if not self._take(")"):
                raise self.error()
            return inner
        raise self.error()

    def _take(self, sign: str) -> bool:
        token = _TOKEN.match(self.text, self.pos)
        if token is None or token["sign"] != sign:
            return False
        self.pos = token.end()
        return True

    def _named(self, name: str) -> Unit:
        for spelling in (name, name.lower()) if len(name) > 2 else (name,):
            if spelling in ATOMS:
                return Unit(*ATOMS[spelling])
            if spelling in COUNTS:
                raise UnitError(
                    f"'{shown(name)}' have no meaning until the counts per turn are known: write counts_per_turn = 4096 next"
                    ' to the channel, or unit = "rev/4096"'
                )
            if spelling in OFFSET_UNITS:
                raise UnitError(f"'{shown(name)}' has a zero of its own and cannot be converted with a factor")
        if not self.ask_pint:
            raise self.error()
        found = _ask_pint(name)
        if found is None:
            raise self.error()
        return found


@cache
def _registry() -> Any:
    import pint  # takes a third of a second, and hardly anybody needs it

    return pint.UnitRegistry()


_PINT_BASES = ("[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")


def _ask_pint(name: str) -> Unit | None:
    """Return the size of a single unit name, or None where pint does not know it or it has a zero of its own."""
    registry = _registry()
    try:
        once = registry.Quantity(1.0, name).to_base_units()
        nothing = registry.Quantity(0.0, name).to_base_units()
    except Exception:  # pint's parser raises many kinds for a text that is no unit
        return None
    exponents = dict(once.dimensionality)
    if nothing.magnitude != 0.0 or not set(exponents) <= set(_PINT_BASES):
        return None
    return Unit(float(once.magnitude), (*(float(exponents.get(base, 0)) for base in _PINT_BASES), 0.0))


def _times(a: Unit, b: Unit, exponent: float) -> Unit:
    """Return a · b^exponent."""
    try:
        # Dividing keeps 1000 N / 0.001 m exact where a multiplication by the power −1 would round twice.
        size = a.factor / b.factor if exponent == -1.0 else a.factor * b.factor**exponent
    except (OverflowError, ZeroDivisionError):
        size = math.inf
    return Unit(size, tuple(x + exponent * y for x, y in zip(a.dimension, b.dimension, strict=True)))


_ACCELERATION = parse_unit("m/s^2").dimension
