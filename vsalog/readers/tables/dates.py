"""Dates and times of day in the formats of common programs, as nanoseconds.

A log has many times but few dates, so that each date is read once, and times of day as whole columns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.readers.reach import Nanoseconds

FORMATS = (
    "%m/%d/%Y", "%d/%m/%Y", "%Y/%m/%d", "%m/%d/%y", "%d/%m/%y",
    "%d-%m-%Y", "%m-%d-%Y", "%d-%m-%y", "%m-%d-%y", "%y-%m-%d",
    "%d.%m.%Y", "%d.%m.%y", "%Y.%m.%d", "%Y%m%d",
    "%d-%b-%Y", "%d %b %Y", "%d-%b-%y", "%b %d %Y", "%b %d, %Y",
)  # fmt: skip
"""Formats of dates in addition to ISO 8601, as for `strptime`; of two orders of day and month, the usual one first."""
_ORDERS = {"d": "day", "m": "month", "y": "year"}

_ISO = r"^\d{4}-\d\d-\d\d([T ]\d\d(:?\d\d(:?\d\d([.]\d{1,9})?)?)?)?([+-]\d\d:?\d\d)?$"
_ZONED = r":?\d\d(\.\d+)?[+-]\d\d:?\d\d$"
_TIME = (
    r"^\s*(?:(?P<days>\d{1,5}) days?,? )?(?P<sign>[+-]?)(?P<hour>\d{1,4}):(?P<minute>[0-5]\d)"
    r"(?::(?P<second>[0-5]\d)(?:[.,](?P<fraction>\d{1,9})\d*)?)?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?\s*$"
)
_MOMENT = (
    r"^\s*(?P<date>.+?)(?:(?:[Tt]|[\s,;]+)(?P<clock>\d{1,2}:\d[\d:.,]*(?:\s*[AaPp]\.?[Mm]\.?)?)"
    r"(?:\s*(?P<zone>[zZ]|UTC|GMT|[+-]\d{1,2}(?::?\d\d)?))?)?\s*$"
)
_COMPACT = r"^(\d{8})T(\d\d)(\d\d)(\d\d)"
_NO_TIME_OF_DAY = r"[\sT]+(?:0{1,2}:00(?::00(?:[.,]0+)?)?|12:00(?::00)? ?[Aa][Mm])$"
"""The time of day that spreadsheets add to a date in a column of its own."""
_OFFSET = re.compile(r"^([+-])(\d{1,2}):?(\d\d)?$")
_FACTORS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Nanoseconds of the units of Arrow's types."""


def dates(array: pa.Array, form: str = "") -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates [ns since the epoch], and which of them are dates; those without a time zone count as UTC.

    Parameters
    ----------
    array : pyarrow array
        Timestamps, dates, or texts.
    form : str
        Format of dates in addition to ISO 8601, one of `FORMATS`; "" for none.
    """
    if pa.types.is_timestamp(array.type) or pa.types.is_date(array.type):
        return in_nanoseconds(array)
    text = trimmed(array)
    found = _iso(text)
    stamps, good = integers(found)
    if found.null_count > text.null_count:
        other, also = _moments(pc.if_else(pc.is_null(found), text, pa.scalar(None, pa.string())), form or "%Y-%m-%d")
        stamps, good = np.where(good, stamps, other), good | also
    return stamps, good


def of_day(text: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return times of day [ns since midnight], and which texts are such; they may exceed a day, or begin with the days."""
    found = pc.extract_regex(text, _TIME)
    good = np.array(pc.is_valid(found).to_numpy(zero_copy_only=False), bool)
    days, hour, minute, second = (_digits(found, name) for name in ("days", "hour", "minute", "second"))
    half = pc.ascii_lower(pc.fill_null(pc.struct_field(found, "half"), ""))
    afternoon, morning = _is(half, "p"), _is(half, "a")
    good &= ~(afternoon | morning) | ((hour >= 1) & (hour <= 12))
    hour = np.where(afternoon | morning, hour % 12, hour) + 12 * afternoon
    size = (((days * 24 + hour) * 60 + minute) * 60 + second) * 10**9 + _digits(found, "fraction", 9)
    sign = np.where(_is(pc.struct_field(found, "sign"), "-"), -1, 1)
    return np.where(good, sign * size, 0), good


def without_midnight(text: pa.Array) -> pa.Array:
    """Return dates without a time of day of midnight."""
    return pc.replace_substring_regex(text, _NO_TIME_OF_DAY, "")


def dates_of(text: pa.Array) -> list[str]:
    """Return the dates in cells that hold dates, with or without a time of day: each once, in the order they come."""
    return [date for date in pc.unique(_taken_apart(text)["date"]).to_pylist() if date is not None]


def possible_formats(written: Sequence[str]) -> list[str]:
    """Return the formats in which most of the texts are dates, the usual order of day and month first.

    >>> possible_formats(["3/4/2024"]), possible_formats(["3/4/2024", "13/4/2024"]), possible_formats(["4-Mar-2024"])
    (['%m/%d/%Y', '%d/%m/%Y'], ['%d/%m/%Y'], ['%d-%b-%Y'])
    """
    texts = pa.array(written, pa.string())
    wrong = {form: int(np.count_nonzero(~_days(texts, form)[1])) for form in FORMATS}
    least = min(wrong.values())
    return [form for form, count in wrong.items() if count == least < len(written)]


def format_of(name: str, written: Sequence[str]) -> tuple[str, list[Finding]]:
    """Return the format of dates, "" where they are none, and the findings about it.

    The possible dates decide; else that the log's time increases, over the shortest range.

    Parameters
    ----------
    name : str
        The column's name.
    written : sequence of str
        Its dates, each once, in the order of the log.
    """
    possible = possible_formats(written)
    if len(possible) < 2:
        return (possible[0] if possible else ""), []
    cost = {form: _cost(written, form) for form in possible}
    best = min(possible, key=cost.__getitem__)
    if best != "%y-%m-%d" and len(set(possible) - {"%y-%m-%d"}) == 1:
        return best, []  # a year of two digits before the month is so rare that it needs no finding
    unknown = sum(cost[form] == cost[best] for form in possible) > 1
    evidence = {"example": written[0], "order": ", ".join(_ORDERS[letter] for letter in _order(best))}
    code = "clock.date_order_unknown" if unknown else "clock.date_order_by_time"
    return best, [Finding(code=code, part=name, value=len(written), evidence=evidence)]


def integers(array: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return whole numbers, 0 where there is none, and where there are some."""
    if pa.types.is_uint64(array.type):
        array = pc.if_else(pc.less(array, pa.scalar(2**63, pa.uint64())), array, pa.scalar(None, pa.uint64()))
    good = np.asarray(pc.is_valid(array).to_numpy(zero_copy_only=False), bool)
    filled = pc.fill_null(pc.cast(array, pa.int64()), 0)
    return np.asarray(filled.to_numpy(zero_copy_only=False), np.int64), good


def in_nanoseconds(array: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates, times of day and durations as `integers` does, and those that do not fit into 64 bits as none.

    Arrow's own conversion would either refuse all because of one, or let it wrap around.
    """
    kind = array.type
    if pa.types.is_date32(kind):
        numbers, factor = pc.cast(array, pa.int32()), int(Nanoseconds.DAY)
    elif pa.types.is_date64(kind):
        numbers, factor = pc.cast(array, pa.int64()), 10**6
    else:
        numbers, factor = pc.cast(array, pa.int32() if pa.types.is_time32(kind) else pa.int64()), _FACTORS[kind.unit]
    return scaled(*integers(numbers), factor)


def scaled(values: Stamps, good: NDArray[np.bool_], factor: int) -> tuple[Stamps, NDArray[np.bool_]]:
    """Multiply whole numbers; those whose product does not fit into 64 bits are none."""
    most = (2**63 - 1) // factor
    fits = good & (values >= -most) & (values <= most)
    return np.where(fits, values, 0) * np.int64(factor), fits


def trimmed(array: pa.Array) -> pa.Array:
    """Return cells as texts without blanks around them, null where bytes are no text."""
    text = pc.cast(array, pa.string())
    try:
        return pc.utf8_trim_whitespace(text)
    except pa.ArrowInvalid:
        return pc.utf8_trim_whitespace(pa.array(map(_decoded, pc.cast(text, pa.binary()).to_pylist()), pa.string()))


def _decoded(cell: bytes | None) -> str | None:
    try:
        return None if cell is None else cell.decode()
    except UnicodeDecodeError:
        return None


def _iso(text: pa.Array) -> pa.Array:
    """Return dates of ISO 8601 as int64 nanoseconds, null where a text is none."""
    nothing = pa.scalar(None, pa.string())
    text = pc.if_else(pc.fill_null(pc.match_substring_regex(text, _ISO), False), text, nothing)
    zoned = pc.fill_null(pc.match_substring_regex(text, _ZONED), False)
    plain = _cast(pc.if_else(zoned, nothing, text), pa.timestamp("ns"))
    return pc.coalesce(plain, _cast(pc.if_else(zoned, text, nothing), pa.timestamp("ns", "UTC")))


def _cast(text: pa.Array, kind: Any) -> pa.Array:
    """Cast dates to int64 nanoseconds, null where a text is none."""
    try:
        return pc.cast(pc.cast(text, kind), pa.int64())
    except pa.ArrowInvalid:
        if len(text) == 1:
            return pa.nulls(1, pa.int64())
    half = len(text) // 2
    return pa.concat_arrays([_cast(text[:half], kind), _cast(text[half:], kind)])


def _moments(text: pa.Array, form: str) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates, with or without a time of day, [ns since the epoch], and which texts are dates."""
    parts = _taken_apart(text)
    days, good = _days(parts["date"], form)
    zones = pc.dictionary_encode(parts["zone"], null_encoding="encode")
    offsets = np.array([_offset(zone or "") for zone in zones.dictionary.to_pylist()], np.int64)
    clock, told = of_day(parts["clock"])
    without = np.asarray(pc.fill_null(pc.equal(parts["clock"], ""), True).to_numpy(zero_copy_only=False), bool)
    good &= without | (told & (clock >= 0) & (clock < Nanoseconds.DAY))
    moments = days + np.where(without, 0, clock) - offsets[zones.indices.to_numpy(zero_copy_only=False)]
    return np.where(good, moments, 0), good


def _taken_apart(text: pa.Array) -> dict[str, pa.Array]:
    found = pc.extract_regex(pc.replace_substring_regex(text, _COMPACT, r"\1T\2:\3:\4"), _MOMENT)
    return {name: pc.struct_field(found, name) for name in ("date", "clock", "zone")}


def _days(written: pa.Array, form: str) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates in a format as the nanoseconds of their midnights, and which texts are such; each date is read once."""
    coded = pc.dictionary_encode(written, null_encoding="encode")
    texts = coded.dictionary
    if "%b" in form:
        texts = pc.replace_substring_regex(texts, r"([A-Za-z]{3})[a-z]*", r"\1")
    moments = pc.strptime(texts, format=form, unit="s", error_is_null=True)
    same = pc.equal(_unpadded(pc.strftime(moments, format=form)), _unpadded(texts))  # 31 February is read as 3 March
    found, good = integers(pc.if_else(same, pc.cast(moments, pa.int64()), None))
    # Any time of day and zone still fits into 64 bits.
    good &= np.abs(found) < (np.iinfo(np.int64).max - 7 * Nanoseconds.DAY) // Nanoseconds.SECOND
    which = coded.indices.to_numpy(zero_copy_only=False)
    return np.where(good, found, 0)[which] * Nanoseconds.SECOND, good[which]


def _unpadded(written: pa.Array) -> pa.Array:
    return pc.utf8_lower(pc.replace_substring_regex(written, r"(^|[^0-9])0", r"\1"))


def _offset(zone: str) -> int:
    """Return how far a time zone is ahead of UTC [ns]."""
    match = _OFFSET.match(zone)
    if match is None:
        return 0
    size = int(match[2]) * Nanoseconds.HOUR + int(match[3] or 0) * Nanoseconds.MINUTE
    return -size if match[1] == "-" else size


def _order(form: str) -> str:
    """Return the letters of day, month and year in a format's order."""
    return "".join(re.findall("%(.)", form)).lower().replace("b", "m")


def _cost(written: Sequence[str], form: str) -> tuple[int, int]:
    """Return how often dates decrease, and the range they cover."""
    days, good = _days(pa.array(written, pa.string()), form)
    known = days[good].tolist()
    return sum(later < earlier for earlier, later in pairwise(known)), max(known) - min(known)


def _digits(found: Any, name: str, places: int = 0) -> Stamps:
    """Return a part as whole numbers, 0 where there is none; as digits behind the point where `places` is given."""
    text = pc.fill_null(pc.struct_field(found, name), "")
    text = pc.utf8_rpad(text, places, "0") if places else text
    return np.asarray(pc.cast(pc.if_else(pc.equal(text, ""), "0", text), pa.int64()), np.int64)


def _is(text: pa.Array, letter: str) -> NDArray[np.bool_]:
    return np.asarray(pc.fill_null(pc.equal(text, letter), False).to_numpy(zero_copy_only=False), bool)
