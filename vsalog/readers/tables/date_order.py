"""Whether ``3/4/2024`` is a day in March or in April: a column's dates tell together what none of them tells alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from vsalog.core.finding import Finding
from vsalog.readers.tables.time_written import day_of, parts_of

_STATED = re.compile(r"\b(d+|m+)[./-](d+|m+)[./-](y+)\b|\b(y+)[./-](m+)[./-](d+)\b")
_SAID = {"dmy": "day, month, year", "mdy": "month, day, year", "ymd": "year, month, day"}


def possible_orders(dates: Sequence[str]) -> list[str]:
    """Return the orders of day, month and year in which most dates are some, the usual one of their mark first.

    Parameters
    ----------
    dates : sequence of str
        Each once, in the order of the log.

    Returns
    -------
    list of str
        ``dmy``, ``mdy``, ``ymd``; none where dates say by themselves in what order they are written.
    """
    open_ones = _open_ones(dates)
    if not open_ones:
        return []
    mark = _mark(open_ones[0])
    usual = ["mdy", "dmy", "ymd"] if mark == "/" else ["dmy", "mdy", "ymd"]
    wrong = {order: sum(day_of(date, order) is None for date in open_ones) for order in usual}
    least = min(wrong.values())
    possible = [order for order in usual if wrong[order] == least < len(open_ones)]
    return possible[:1] if mark == "." else possible  # with points the day comes first, wherever people write so


def order_of(name: str, dates: Sequence[str]) -> tuple[str, list[Finding]]:
    """Return in which order dates are written, "" where they say it by themselves, and what is worth telling of it.

    What is possible as a date decides, then what the column's name says, as in "Date (DD/MM/YYYY)"; else that the log's
    time runs forward, and ends early.
    """
    possible = possible_orders(dates)
    stated = _STATED.search(name.lower())
    if stated and (order := "".join(word[0] for word in stated.groups() if word)) in possible:
        return order, []
    if len(possible) < 2:
        return (possible[0] if possible else ""), []
    written = _open_ones(dates)
    cost = {order: _cost(written, order) for order in possible}
    best = min(possible, key=cost.__getitem__)
    if best != "ymd" and len(set(possible) - {"ymd"}) == 1:
        return best, []  # a year of two digits ahead of the month is so rare that it is no doubt
    unknown = sum(cost[order] == cost[best] for order in possible) > 1
    evidence = {"example": written[0], "order": _SAID[best]}
    found = Finding(
        code="clock.date_order_unknown" if unknown else "clock.date_order_by_time",
        part=name,
        value=len(written),
        evidence=evidence,
    )
    return best, [found]


def _open_ones(dates: Sequence[str]) -> list[str]:
    """Return the dates of three numbers of which the first is no year."""
    return [date for date in dates if (parts := parts_of(date)) is not None and len(parts[0][0]) < 3]


def _mark(date: str) -> str:
    parts = parts_of(date)
    return parts[1] if parts else ""


def _cost(dates: Sequence[str], order: str) -> tuple[int, int]:
    """Return how often dates run backwards, and over how many days they go."""
    days = [day for date in dates if (day := day_of(date, order)) is not None]
    return sum(later < earlier for earlier, later in pairwise(days)), max(days) - min(days)
