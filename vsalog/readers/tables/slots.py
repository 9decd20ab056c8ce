"""Tables whose rows name the joints of numbered columns, as ``rostopic echo -p`` writes them: ``name0,name1,position0,…``.

A publisher may change the order of its joints from message to message; a joint's values stay in one column here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.readers.tables.cells import numbers_and_words
from vsalog.readers.tables.dates import trimmed
from vsalog.readers.tables.text import printable_cell

_NAME = re.compile(r"^(?P<stem>.*?)names?(?P<number>[\[_.]?\d+\]?)$")


class _Family(NamedTuple):
    """Columns of names, their values in the first row, and columns of values of as many joints each."""

    namers: list[int]
    called: pa.Array
    kinds: list[list[int]]


class Slots:
    """The numbered columns of a table that contain the names of others with the same numbers.

    Parameters
    ----------
    names : sequence of str
        Of all columns.
    sample : sequence of pyarrow arrays
        Their first rows.
    """

    def __init__(self, names: Sequence[str], sample: Sequence[pa.Array]) -> None:
        self._names = names
        self._families: list[_Family] = []
        found: dict[str, dict[str, int]] = {}
        for i, name in enumerate(names[: len(sample)]):
            match = _NAME.match(name)
            if match and pa.types.is_string(sample[i].type) and np.diff(numbers_and_words(sample[i])) > 0:
                found.setdefault(match["stem"], {})[match["number"]] = i
        at = {name: i for i, name in enumerate(names[: len(sample)])}
        for stem, numbered in found.items():
            ends = {name[len(stem) :].removesuffix(n) for n in numbered for name in at if name.startswith(stem)}
            kinds = [[at.get(f"{stem}{end}{number}") for number in numbered] for end in sorted(ends)]
            whole = [[i for i in kind if i is not None] for kind in kinds if None not in kind]
            namers = [*numbered.values()]
            called = _called([sample[i] for i in namers])
            if called and len(called) > 1:
                others = [kind for kind in whole if kind != namers]
                self._families.append(_Family(namers, pa.array(called, pa.string()), others))
        self.begin(())

    def begin(self, columns: Sequence[int]) -> set[int]:
        """Begin to read some columns; return those that have to be read with them."""
        self._moved = [0 for _ in self._families]
        self._strangers, self._stranger = 0, ""
        mine = [one for one in self._families if any(set(kind).intersection(columns) for kind in one.kinds)]
        return {i for one in mine for kind in (one.namers, *one.kinds) for i in kind}

    def without_names(self, sample: Sequence[pa.Array]) -> list[pa.Array]:
        """Return the first rows of all columns with those of names blanked, which do not describe the row as a whole."""
        namers = {i for one in self._families for i in one.namers}
        return [pa.nulls(len(cells), cells.type) if i in namers else cells for i, cells in enumerate(sample)]

    def in_place(self, cells: Mapping[int, pa.Array]) -> Mapping[int, pa.Array]:
        """Return some columns of a block with each joint's cells where the first row has them."""
        moved: dict[int, pa.Array] = {}
        for n, family in enumerate(self._families):
            if family.namers[0] not in cells:
                continue
            names = [trimmed(cells[i]) for i in family.namers]
            who = np.stack([_numbers(pc.index_in(one, family.called)) for one in names])
            usual = np.arange(len(names))[:, None]
            if (who == usual).all():
                continue
            self._moved[n] += int(np.count_nonzero(((who != usual) & (who >= 0)).any(axis=0)))
            for one, theirs in zip(names, who, strict=True):
                strange = np.flatnonzero((theirs < 0) & one.is_valid().to_numpy(zero_copy_only=False))
                self._strangers += strange.size
                self._stranger = self._stranger or (str(one[int(strange[0])]) if strange.size else "")
            for kind in (kind for kind in family.kinds if cells.keys() >= set(kind)):
                for j, column in enumerate(kind):
                    own = [pc.if_else(pa.array(who[k] == j), cells[i], None) for k, i in enumerate(kind)]
                    moved[column] = pc.coalesce(*own)
        return {**cells, **moved}

    def findings(self) -> list[Finding]:
        """Return the findings."""
        found = []
        for count, family in zip(self._moved, self._families, strict=True):
            if count:
                pairs = zip(family.kinds[0] if family.kinds else (), family.called.to_pylist(), strict=False)
                shown = ", ".join(f"'{self._names[i]}' is of '{printable_cell(called)}'" for i, called in [*pairs][:3])
                column, evidence = self._names[family.namers[0]], {"shown": shown}
                found.append(Finding(code="table.names_move", part=column, value=count, evidence=evidence))
        if self._strangers:
            evidence = {"first": printable_cell(self._stranger)}
            found.append(Finding(code="table.names_unknown", value=self._strangers, evidence=evidence))
        return found


def _called(columns: Sequence[pa.Array]) -> list[str]:
    """Return the names in the first row that has all of them, none where two are the same."""
    for row in zip(*(trimmed(cells).to_pylist() for cells in columns), strict=True):
        if all(row):
            return list(row) if len(set(row)) == len(row) else []
    return []


def _numbers(found: pa.Array) -> NDArray[np.int64]:
    return np.asarray(pc.fill_null(found, -1).to_numpy(zero_copy_only=False), np.int64)
