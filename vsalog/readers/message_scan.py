"""The compiled walk along `message_program` through messages that have no shape in common: where their numbers lie.

What is odd (damage, another byte order, names that are not plain, more parts than usual) is left to
`vsalog.readers.layout.learn`, which knows what to say of it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.readers.packets import Bytes, Integers

MOST_FOUND = 4096
"""Numbers of one message that are found, at most."""


_MOST_TAKEN = 8192  # steps; MAX_STEPS of vsalog.readers.layout counts in another way, and much further


class Step(IntEnum):
    """What a step of a program does.

    Each has numbers a, b, c and d, of which b is the place, a count is -1 where the message says it, and d how many
    arrays of texts may name the elements. `NUMBER`: a bytes. `TEXTS`: a count, c rank among the arrays of texts of the
    struct, -1 where they can name nothing. `NUMBERS`: a count, c bytes. `LOOP`: a count, c the step behind its `NEXT`;
    `NEXT`: a its step. `STRUCT`, `END`: a how many arrays of texts may name something; `UNUSED`, for those that did not:
    a the same, c rank.
    """

    STRUCT, END, NUMBER, TIME, STAMP, TEXT, TEXTS, NUMBERS, LOOP, NEXT, UNUSED, DONE = range(12)


class Loop(IntEnum):
    """Columns of the loops a walk is in."""

    COUNT, INDEX, OUTER, SILENT, NAMED = range(5)


class Texts(IntEnum):
    """Columns of the arrays of texts a walk has met."""

    SIZE, AT, USABLE, USED = range(4)


class Counter(IntEnum):
    """How many numbers, labels and characters are known, and how many arrays of texts were looked through."""

    IDS, LABELS, POOL, SERIAL = range(4)


class Usable(IntEnum):
    """Whether an array's texts may name elements."""

    NO, YES, UNKNOWN = range(3)


# These are here, and not where they are made, so that numba's cache sees when they change.
class Found(NamedTuple):
    """What was found in messages, in their order.

    Attributes
    ----------
    number : int64 array, shape (m,)
        What it is, by the numbers of `vsalog.readers.message_memory.Memory`.
    row : int64 array, shape (m,)
        Which message it is in.
    at : int64 array, shape (m,)
        Where it lies in the buffer; of what is no signal, how many values it has.
    """

    number: Integers
    row: Integers
    at: Integers


class Tables(NamedTuple):
    """What was met so far, see `vsalog.readers.message_memory.Memory`.

    `found` and `labels` are hash tables of numbers, `spans` where labels lie in `pool`.
    """

    keys: Integers
    counters: Integers
    found: Integers
    spans: Integers
    labels: Integers
    pool: Bytes


class Limits(NamedTuple):
    """How many texts an array has that name something, how long they are, and how many values an array of signals has."""

    labels: int
    label: int
    array: int


class Work(NamedTuple):
    """What a walk keeps: texts that may be names, the loops and the arrays of texts it is in, and how many texts were held."""

    limits: Limits

    held: Integers
    loops: Integers
    texts: Integers
    tops: Integers


@njit(cache=True, nogil=True)
def scan(
    steps: Integers,
    cdr: bool,
    data: Bytes,
    start: Integers,
    length: Integers,
    good: NDArray[np.bool_],
    stamps: Integers,
    found: Found,
    tables: Tables,
    work: Work,
) -> tuple[int, int]:
    """Walk messages as long as there is room; returns how many, and how much was found."""
    count = 0
    for row in range(start.size):
        if count + MOST_FOUND > found.at.size:
            return row, count
        part = Found(
            found.number[count : count + MOST_FOUND],
            found.row[count : count + MOST_FOUND],
            found.at[count : count + MOST_FOUND],
        )
        more, stamps[row] = _walk(steps, cdr, data, start[row], start[row] + length[row], part, tables, work)
        if more >= 0:
            part.row[:more] = row
            good[row] = True
            count += more
    return start.size, count


@njit(cache=True, nogil=True)
def _walk(
    steps: Integers, cdr: bool, data: Bytes, begin: int, end: int, found: Found, tables: Tables, work: Work
) -> tuple[int, int]:
    """Walk one message; returns how much was found, -1 where it is odd, and where its time stamp lies."""
    stamp, at, count = -1, begin, 0
    if cdr:
        if end - begin < 4 or data[at] != 0 or data[at + 1] != 1:
            return -1, -1
        at += 4
    origin = at  # alignment counts from here
    step, outer, depth, n_texts, n_held, n_tops = 0, 0, 0, 0, 0, 0
    silent = False
    for _ in range(_MOST_TAKEN):
        op, a, place, c = steps[step, 0], steps[step, 1], steps[step, 2], steps[step, 3]
        noted, unheard = -1, silent  # where something lies that was found; it is not to be told
        step += 1
        if op == Step.DONE:
            return (count if 0 <= end - at <= (3 if cdr else 0) else -1), stamp
        if op in (Step.NUMBER, Step.TIME, Step.STAMP):
            at = _aligned(at, origin, a if op == Step.NUMBER else 4, cdr)
            if op == Step.STAMP:
                stamp = at
            else:
                noted = at
            at += a if op == Step.NUMBER else 8
        elif op == Step.TEXT:
            at, _ = _text(data, at, origin, end, cdr)
            noted = 0 if place >= 0 else -1
        elif op == Step.STRUCT and not silent:
            if n_texts + a > work.texts.shape[0]:
                return -1, -1
            work.tops[n_tops] = n_held
            n_texts, n_tops = n_texts + a, n_tops + 1
        elif op == Step.UNUSED and not silent:
            text = work.texts[n_texts - a + c]
            noted = 0 if text[Texts.SIZE] and not text[Texts.USED] else -1
        elif op == Step.END and not silent:
            n_texts, n_tops = n_texts - a, n_tops - 1
            n_held = work.tops[n_tops]
        elif op == Step.NEXT:
            loop = work.loops[depth - 1]
            loop[Loop.INDEX] += 1
            if loop[Loop.INDEX] < loop[Loop.COUNT]:
                step = a + 1
                if not silent:
                    name = _name(work, loop[Loop.NAMED], loop[Loop.INDEX])
                    outer = _number_of(tables, loop[Loop.OUTER], place, name)
            else:
                depth -= 1
                outer, silent = loop[Loop.OUTER], loop[Loop.SILENT] != 0
        elif op in (Step.TEXTS, Step.NUMBERS, Step.LOOP):
            n = a
            if n < 0:
                at = _aligned(at, origin, 4, cdr)
                n = _word(data, at, end)
                at += 4
            if n < 0 or n > end - begin:
                return -1, -1
            base = n_texts - steps[step - 1, 4]
            if op == Step.TEXTS:
                named = c >= 0 and not silent  # they may name elements of other arrays
                at, n_held = _hold(data, at, origin, end, cdr, n, work, n_held, named)
                if named and at >= 0:
                    text = work.texts[base + c]
                    text[Texts.SIZE], text[Texts.AT], text[Texts.USED] = n, n_held - n, 0
                    text[Texts.USABLE] = Usable.UNKNOWN if n <= work.limits.labels else Usable.NO
                elif n and c < 0:
                    noted = 0
            else:
                by, quiet = -1, silent
                if not silent:
                    by = _named(data, n, base, n_texts, tables, work)
                    if by < -1:
                        return -1, -1
                    if by < 0 and n > work.limits.array:
                        quiet, noted = True, n
                if op == Step.NUMBERS and n:
                    at = _aligned(at, origin, c, cdr)
                    if at + n * c > end:
                        return -1, -1
                    if not quiet:
                        names = work.held[:0]
                        if by >= 0:
                            names = work.held[work.texts[by, Texts.AT] : work.texts[by, Texts.AT] + n]
                        count = _add_all(found, count, tables, outer, place, names, n, at, c)
                    at += n * c
                elif op == Step.LOOP and n:
                    loop = work.loops[depth]
                    loop[Loop.COUNT], loop[Loop.INDEX], loop[Loop.NAMED], loop[Loop.OUTER], loop[Loop.SILENT] = (
                        n,
                        -1,
                        by,
                        outer,
                        silent,
                    )
                    depth += 1
                    step = c - 1
                elif op == Step.LOOP:
                    step = c
                silent = quiet if op == Step.LOOP and n else silent
        if noted >= 0 and not unheard:
            count = _add(found, count, tables, outer, place, noted)
        if at < 0 or at > end or count < 0 or outer < 0:
            return -1, -1
    return -1, -1


@njit(cache=True, nogil=True)
def _aligned(at: int, origin: int, size: int, cdr: bool) -> int:
    return origin + ((at - origin + size - 1) & -size) if cdr else at


@njit(cache=True, nogil=True)
def _word(data: Bytes, at: int, end: int) -> int:
    """Read an unsigned number of four bytes; -1 where it does not end within the message."""
    if at + 4 > end:
        return -1
    value = np.int64(0)
    for i in range(at + 3, at - 1, -1):
        value = (value << 8) | np.int64(data[i])
    return int(value)


@njit(cache=True, nogil=True)
def _text(data: Bytes, at: int, origin: int, end: int, cdr: bool) -> tuple[int, int]:
    """Return where a text ends, -1 where that is not within the message, and how long it is."""
    at = _aligned(at, origin, 4, cdr)
    length = _word(data, at, end)
    return (at + 4 + length if 0 <= length <= end - at - 4 else -1), length


@njit(cache=True, nogil=True)
def _hold(
    data: Bytes, at: int, origin: int, end: int, cdr: bool, n: int, work: Work, held: int, keep: bool
) -> tuple[int, int]:
    """Pass by texts, of which some are kept; returns where they end, -1 where they do not, and how many are held in all."""
    if keep and held + n > work.held.shape[0]:
        return -1, held
    texts = work.held
    for _ in range(n):
        at, length = _text(data, at, origin, end, cdr)
        if at < 0:
            break
        if keep:
            begin = at - length
            while length and data[begin + length - 1] == 0:
                length -= 1
            texts[held, 0], texts[held, 1] = begin, length
            held += 1
    return at, held


@njit(cache=True, nogil=True)
def _named(data: Bytes, n: int, base: int, top: int, tables: Tables, work: Work) -> int:
    """Return which array of texts names the elements of an array; -1 for none, -2 where a text is not plain."""
    found = -1
    for k in range(base, top):
        text = work.texts[k]
        if text[Texts.SIZE] != n or not n:
            continue
        text[Texts.USED] = 1
        if found < 0 and text[Texts.USABLE] == Usable.UNKNOWN:
            usable = _usable(data, text, tables, work)
            if usable < 0:
                return -2
            text[Texts.USABLE] = usable
        if found < 0 and text[Texts.USABLE] == Usable.YES:
            found = k
    return found


@njit(cache=True, nogil=True)
def _usable(data: Bytes, text: Integers, tables: Tables, work: Work) -> int:
    """Tell whether texts can name the elements of an array; -1 where one is not plain, empty or there twice."""
    tables.counters[Counter.SERIAL] += 1
    held = work.held[text[Texts.AT] : text[Texts.AT] + text[Texts.SIZE]]
    # Taken out of the tuple once: that counts references.
    counters, spans, labels, pool = tables.counters, tables.spans, tables.labels, tables.pool
    for i in range(held.shape[0]):
        label = _label_of(data, held[i, 0], held[i, 1], work.limits.label, counters, spans, labels, pool)
        if label < 0 or held[i, 1] == 0 or spans[label, 2] == counters[Counter.SERIAL]:
            return -1
        spans[label, 2] = counters[Counter.SERIAL]
        held[i, 2] = label
    return 1


@njit(cache=True, nogil=True)
def _name(work: Work, named: int, i: int) -> int:
    """Return the name of an array's element: the number of its label, or of its index."""
    return int(work.held[work.texts[named, Texts.AT] + i, 2]) if named >= 0 else -1 - i


@njit(cache=True, nogil=True)
def _add(found: Found, count: int, tables: Tables, outer: int, place: int, at: int) -> int:
    """Note something without a name that was found; returns how much was, -1 where there is no room."""
    number = _number_of(tables, outer, place, 0)
    if number < 0 or not 0 <= count < found.at.size:
        return -1
    found.number[count], found.at[count] = number, at
    return count + 1


@njit(cache=True, nogil=True)
def _add_all(
    found: Found, count: int, tables: Tables, outer: int, place: int, names: Integers, n: int, at: int, size: int
) -> int:
    """Note the n numbers of an array, which `names` name, or their indices where there are none."""
    numbers, places, keys, counters, known = found.number, found.at, tables.keys, tables.counters, tables.found
    if not 0 <= count <= places.size - n:
        return -1
    for i in range(n):
        name = names[i, 2] if names.shape[0] else -1 - i
        number = _number_in(keys, counters, known, outer, place, name)
        if number < 0:
            return -1
        numbers[count + i], places[count + i] = number, at + i * size
    return count + n


@njit(cache=True, nogil=True)
def _number_of(tables: Tables, outer: int, place: int, name: int) -> int:
    """Return the number of something, a new one where it was never met; -1 where there is no room."""
    return int(_number_in(tables.keys, tables.counters, tables.found, outer, place, name))


@njit(cache=True, nogil=True)
def _number_in(keys: Integers, counters: Integers, found: Integers, outer: int, place: int, name: int) -> int:
    mask = found.size - 1
    mixed = outer * 0x9E3779B1 + place * 0x85EBCA6B + name * 0x27D4EB2F
    at = (mixed ^ (mixed >> 15) ^ (mixed >> 29)) & mask
    while found[at] >= 0:
        k = found[at]
        if keys[k, 0] == outer and keys[k, 1] == place and keys[k, 2] == name:
            return int(k)
        at = (at + 1) & mask
    k = counters[Counter.IDS]
    if k == keys.shape[0]:
        return -1
    keys[k, 0], keys[k, 1], keys[k, 2] = outer, place, name
    counters[Counter.IDS] = k + 1
    found[at] = k
    return int(k)


@njit(cache=True, nogil=True)
def _label_of(
    data: Bytes,
    begin: int,
    length: int,
    longest: int,
    counters: Integers,
    spans: Integers,
    labels: Integers,
    pool: Bytes,
) -> int:
    """Return the number of a text; -1 where it is not plain, too long or there is no room."""
    if length > longest:
        return -1
    mixed = np.int64(2166136261)
    for i in range(begin, begin + length):
        if data[i] < 32 or data[i] > 126:
            return -1
        mixed = ((mixed ^ np.int64(data[i])) * 16777619) & 0xFFFFFFFF
    mask = labels.size - 1
    slot = (mixed ^ (mixed >> 13)) & mask
    while labels[slot] >= 0:
        k = labels[slot]
        if spans[k, 1] == length and _same(pool, spans[k, 0], data, begin, length):
            return int(k)
        slot = (slot + 1) & mask
    k, at = counters[Counter.LABELS], counters[Counter.POOL]
    if k == spans.shape[0] or at + length > pool.size:
        return -1
    spans[k, 0], spans[k, 1] = at, length
    pool[at : at + length] = data[begin : begin + length]
    counters[Counter.LABELS], counters[Counter.POOL] = k + 1, at + length
    labels[slot] = k
    return int(k)


@njit(cache=True, nogil=True)
def _same(one: Bytes, at: int, other: Bytes, begin: int, length: int) -> bool:
    same = True
    for i in range(length):
        same = same and one[at + i] == other[begin + i]
    return same


@njit(cache=True, nogil=True)
def scatter(values: NDArray[np.float64], line: Integers, row: Integers, out: NDArray[np.float64]) -> None:
    """Put values into the lines and rows of a table that they belong to."""
    for k in range(values.size):
        out[line[k], row[k]] = values[k]
