"""Dates and times of day in the ways people and programs write them.

A log has many times but few dates, so that dates are read one by one, each once, and times of day as whole columns.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.recording import Stamps
from vsalog.readers.reach import Nanoseconds

_TIME = (
    r"(?P<sign>[+-]?)(?P<hour>\d{1,4}):(?P<minute>[0-5]\d)"
    r"(?::(?P<second>[0-5]\d)(?:[.,](?P<fraction>\d{1,9})\d*|:(?P<milli>\d{3}))?)?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_OF_DAY = rf"^\s*(?:(?P<days>\d{{1,5}}) days?,? )?{_TIME}\s*$"
_MOMENT = (
    r"^\s*(?P<date>.+?)(?:(?:[Tt]|[\s,;]+)(?P<clock>\d{1,2}:\d[\d:.,]*(?:\s*[AaPp]\.?[Mm]\.?)?)"
    r"(?:\s*(?P<zone>[zZ]|[+-]\d{1,2}(?::?\d\d)?|[A-Za-z]{3,4}))?(?:\s+(?P<year>\d{4}))?)?\s*$"
)
_COMPACT = r"^(\d{8})T(\d\d)(\d\d)(\d\d)"
_NO_TIME_OF_DAY = r"[\sT]+(?:0{1,2}:00(?::00(?:[.,]0+)?)?|12:00(?::00)? ?[Aa][Mm])$"
"""What spreadsheets add to a date that has a column of its own."""

_NUMERIC = re.compile(r"^(\d{1,4})\s?([./-])\s?(\d{1,2})\s?\2\s?(\d{4}|\d{2})$")
_EIGHT_DIGITS = re.compile(r"^(\d{4})(\d\d)(\d\d)$")
_WEEKDAY = re.compile(r"^(?:mo|tu|we|th|fr|sa|su|di|mi|do|so)[a-z]*[.,]?\s+", re.IGNORECASE)
_WORDS = re.compile(r"[A-Za-zÀ-ÿ]+|\d+")
_OFFSET = re.compile(r"^([+-])(\d{1,2}):?(\d\d)?$")
_MONTH_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTHS = {name: number for number, name in enumerate(_MONTH_NAMES, start=1)}
_MONTHS |= {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_ZONES = {
    "z": 0, "utc": 0, "gmt": 0, "cet": 1, "cest": 2, "mez": 1, "mesz": 2,
    "est": -5, "edt": -4, "cst": -6, "cdt": -5, "mst": -7, "mdt": -6, "pst": -8, "pdt": -7, "jst": 9,
}  # fmt: skip
"""Hours ahead of UTC of the zones that go by a name: those of e-mail's standard, and of Central Europe and Japan."""


def moments(text: pa.Array, order: str) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates, with or without a time of day, [ns since the epoch], and which texts are dates.

    Parameters
    ----------
    text : pyarrow array of strings
        As they are written; those without a time zone count as UTC.
    order : str
        Of day, month and year in ``3/4/2024``: ``dmy``, ``mdy`` or ``ymd``; "" where nothing is known of it, and only dates
        that leave no doubt are read.
    """
    parts = _taken_apart(text)
    years = pc.if_else(pc.equal(parts["year"], ""), "", pc.binary_join_element_wise(" ", parts["year"], ""))
    days, good = _each(pc.binary_join_element_wise(parts["date"], years, ""), lambda written: day_of(written, order))
    zones, known = _each(parts["zone"], _zone)
    of_day, told = times_of_day(parts["clock"])
    without = np.asarray(pc.fill_null(pc.equal(parts["clock"], ""), True).to_numpy(zero_copy_only=False), bool)
    good &= known & (without | (told & (of_day >= 0) & (of_day < Nanoseconds.DAY)))
    return np.where(good, days * Nanoseconds.DAY + np.where(without, 0, of_day) - zones, 0), good


def dates_of(text: pa.Array) -> list[str]:
    """Return the dates in cells that hold dates, with or without a time of day: each once, in the order they come."""
    return [date for date in pc.unique(_taken_apart(text)["date"]).to_pylist() if date is not None]


def times_of_day(text: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return times of day [ns since midnight], and which texts are such; they may be of several days, or say how many ahead."""
    found = pc.extract_regex(text, _OF_DAY)
    good = np.array(pc.is_valid(found).to_numpy(zero_copy_only=False), bool)
    part = {name: pc.fill_null(pc.struct_field(found, name), "") for name in ("sign", "half")}
    days, hour, minute, second, milli = (
        _integers(found, name) for name in ("days", "hour", "minute", "second", "milli")
    )
    fraction = _integers(found, "fraction", 9)
    half = pc.ascii_lower(part["half"])
    afternoon, morning = (_is(half, letter) for letter in "pa")
    good &= ~(afternoon | morning) | ((hour >= 1) & (hour <= 12))
    hour = np.where(afternoon | morning, hour % 12, hour) + 12 * afternoon
    size = (((days * 24 + hour) * 60 + minute) * 60 + second) * 10**9 + milli * 10**6 + fraction
    return np.where(good, np.where(_is(part["sign"], "-"), -size, size), 0), good


def day_of(written: str, order: str) -> int | None:
    """Return a date's days since the epoch; None where it is none, or nobody knows which by `order` (see `moments`).

    >>> day_of("3/4/1970", "mdy"), day_of("3/4/1970", "dmy"), day_of("3/4/1970", ""), day_of("4 Mar 1970", "")
    (62, 92, None, 62)
    """
    written = _WEEKDAY.sub("", written.strip())
    numeric = parts_of(written)
    if numeric is not None:
        numbers, mark = numeric
        if len(numbers[0]) == 4:
            order = "ymd"
        order = order or ("dmy" if mark == "." else "")
        return _day(**dict(zip(order, numbers, strict=True))) if order else None
    eight = _EIGHT_DIGITS.match(written)
    return _day(*eight.groups()) if eight else _with_a_name(written)


def parts_of(written: str) -> tuple[tuple[str, str, str], str] | None:
    """Return the three numbers of a date and the mark between them, None where it is written in another way."""
    match = _NUMERIC.match(_WEEKDAY.sub("", written.strip()))
    return None if match is None or len(match[1]) == 3 else ((match[1], match[3], match[4]), match[2])


def without_midnight(text: pa.Array) -> pa.Array:
    """Return dates without the time of day that is none."""
    return pc.replace_substring_regex(text, _NO_TIME_OF_DAY, "")


def _with_a_name(written: str) -> int | None:
    """Read a date whose month has a name: ``13 Mar 2024``, ``March 13, 2024``, ``2024-Mar-13``."""
    words = _WORDS.findall(written)
    names = [word for word in words if not word.isdigit()]
    if len(words) != 3 or len(names) != 1 or names[0][:3].lower() not in _MONTHS:
        return None
    first, second = (word for word in words if word.isdigit())
    year, day = (first, second) if len(first) == 4 else (second, first)
    return _day(year, str(_MONTHS[names[0][:3].lower()]), day)


def _day(y: str, m: str, d: str) -> int | None:
    if len(y) not in (2, 4) or len(d) > 2:
        return None
    year = int(y) if len(y) == 4 else (2000 if int(y) < 70 else 1900) + int(y)
    try:
        day = date(year, int(m), int(d)).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None
    in_64_bits = (abs(day) + 7) * Nanoseconds.DAY <= np.iinfo(np.int64).max  # with any time of day and zone
    return day if in_64_bits else None


def _zone(written: str) -> int | None:
    """Return how far a time zone is ahead of UTC [ns]."""
    offset = _OFFSET.match(written)
    if offset is None:
        hours = _ZONES.get(written.lower(), None if written else 0)
        return None if hours is None else hours * Nanoseconds.HOUR
    size = int(offset[2]) * Nanoseconds.HOUR + int(offset[3] or 0) * Nanoseconds.HOUR // 60
    return -size if offset[1] == "-" else size


def _taken_apart(text: pa.Array) -> dict[str, pa.Array]:
    found = pc.extract_regex(pc.replace_substring_regex(text, _COMPACT, r"\1T\2:\3:\4"), _MOMENT)
    return {name: pc.struct_field(found, name) for name in ("date", "clock", "zone", "year")}


def _each(text: pa.Array, read: Callable[[str], int | None]) -> tuple[Stamps, NDArray[np.bool_]]:
    """Read texts of which there are few different ones; return the numbers, 0 where there is none, and where there are some."""
    coded = pc.dictionary_encode(text, null_encoding="mask")
    numbers = [None if one is None else read(one) for one in coded.dictionary.to_pylist()]
    known = np.array([number is not None for number in numbers] + [False])
    values = np.array([number or 0 for number in numbers] + [0], np.int64)
    which = np.asarray(pc.fill_null(coded.indices, len(numbers)).to_numpy(zero_copy_only=False), np.intp)
    return values[which], known[which]


def _integers(found: Any, name: str, digits: int = 0) -> Stamps:
    """Return a part as whole numbers, 0 where there is none; as digits behind the point where `digits` is given."""
    text = pc.fill_null(pc.struct_field(found, name), "")
    text = pc.utf8_rpad(text, digits, "0") if digits else text
    return np.asarray(
        pc.cast(pc.if_else(pc.equal(text, ""), "0", text), pa.int64()).to_numpy(zero_copy_only=False), np.int64
    )


def _is(text: pa.Array, letter: str) -> NDArray[np.bool_]:
    return np.asarray(pc.equal(text, letter).to_numpy(zero_copy_only=False), bool)
