"""A folder of tables that were recorded together, as one log: a stream per table, and joints' names in a file of their own."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.base import Block, Catalogue, ChannelInfo
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.reach import Stamp
from vsalog.readers.tables.columnar import ColumnarReader

ENDINGS = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".parquet")
"""The suffixes of tables in a folder."""
_ELEMENT = re.compile(r"(.*)\[(\d+)\]", re.DOTALL)
_NAME = re.compile(r"[^\W\d_][\w .-]{0,63}")
_NUMBER = re.compile(r"\d+")


class OpenTable(Protocol):
    """Opens a table; `units` are those of columns whose headers state none."""

    def __call__(self, path: Path, units: Mapping[str, str]) -> ColumnarReader: ...  # noqa: D102


def tables_in(folder: Path) -> list[Path]:
    """Return the files of a folder that are tables by their names."""
    files = (path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    return sorted(path for path in files if path.name.lower().endswith(ENDINGS))


def recorded_together(one: Stamps, other: Stamps) -> bool:
    """Return whether two clocks show that they ran at the same time: by dates, or by the same irregular steps.

    Even steps, rounded to some digits, have two sizes at most (a Sturmian sequence), and every run of a program may begin with
    them. Where there are more sizes, a computer was late now and then, and no other recording repeats that.

    Parameters
    ----------
    one, other : int64 arrays, shapes (n,) and (m,)
        The first stamps [ns].
    """
    if not one.size or not other.size:
        return False
    if min(one.min(), other.min()) >= Stamp.YEAR_2000:
        return bool(one.min() <= other.max() and other.min() <= one.max())
    count = min(one.size, other.size)
    irregular = count > REPEATS and np.unique(np.diff(one[:count])).size > 2
    return bool(irregular and np.array_equal(one[:count], other[:count]))


@dataclass(slots=True)
class _Table:
    """A table of the folder: the names of its columns there, and in the log."""

    path: Path
    reader: ColumnarReader
    stem: str
    channels: Mapping[str, ChannelInfo]
    names: dict[str, str] = field(default_factory=dict)

    def full(self, column: str) -> str:
        return self.names.get(column, f"{self.stem}.{column}")

    def stream(self, own: str) -> str:
        """Return the name of a stream of the table in the log."""
        mine = self.path.stem
        return self.stem + own[len(mine) :] if own.startswith(mine) else f"{self.stem}.{own}"


class TableFolderReader:
    """Reads the tables of a folder as one log; see `vsalog.readers.base.Reader`.

    A channel is named by its table and its column, as ``state.position``. Elements of lists have the names that a text file in
    the folder gives, a line each, where it has as many lines as the lists have elements. Clocks of the same name count in the
    same unit.

    Parameters
    ----------
    folder : Path
        It.
    open_table : callable
        Opens one of its files, or raises ReadError where it is no table.

    Raises
    ------
    ReadError
        No file is a table with channels, or two of them seem to be recordings of their own: they have the same columns, or names
        that only a number tells apart, and their clocks do not show that they ran together.
    """

    def __init__(self, folder: Path, open_table: OpenTable) -> None:
        self.path, self.findings, self.unread = folder, Findings(), dict[str, str]()
        self._open = open_table
        lists = self._find_tables(tables_in(folder))
        if not self._tables:
            raise ReadError(
                "is a folder, but no ROS 2 bag, and no file in it is a table with numbers; name one of the files in it",
                folder,
            )
        self._require_one_recording()
        self._agree_on_units()
        self._name(lists)
        self.format = self._tables[0].reader.format

    @property
    def rig_text(self) -> str | None:
        """The rig in the first table that has one."""
        return next((one.reader.rig_text for one in self._tables if one.reader.rig_text is not None), None)

    def _find_tables(self, paths: Collection[Path]) -> list[list[str]]:
        """Open the tables; return the lists of names, which are no tables."""
        self._tables: list[_Table] = []
        lists: list[tuple[Path, list[str]]] = []
        stems = Counter(map(_stem, paths))
        for path in paths:
            names, why = _names_in(path), ""
            try:
                reader = self._open(path, {})
                channels = reader.catalogue().channels
            except ReadError as error:
                channels, why = {}, error.what
            if names is not None and (not channels or not reader.has_clock):
                lists.append((path, names))
            elif channels:
                stem = _stem(path) if stems[_stem(path)] == 1 else printable(path.name)
                self._tables.append(_Table(path, reader, stem, channels))
            elif why and path.suffix != ".txt":
                self.findings.add(Finding(code="recording.file_left_out", part=path.name, evidence={"reason": why}))
            else:
                self.unread[printable(path.name)] = why or "no column of numbers"
        lengths = {length for one in self._tables for length in _lengths(one.channels).values()}
        for path, names in lists:
            if len(names) not in lengths:
                self.unread[printable(path.name)] = "names, but no lists of as many numbers"
        return [names for _, names in lists if len(names) in lengths]

    def _require_one_recording(self) -> None:
        first_of: dict[object, _Table] = {}
        for one in self._tables:
            for alike in (frozenset(one.channels), _NUMBER.sub("", one.stem)):
                first = first_of.setdefault(alike, one)
                if first is not one and not recorded_together(first.reader.first_stamps(), one.reader.first_stamps()):
                    raise ReadError(
                        f"is a folder of tables with the same columns, or similar names ({printable(first.path.name)},"
                        f" {printable(one.path.name)}), and their times do not show that they were recorded together;"
                        " name one of them",
                        self.path,
                    )

    @property
    def surely_one(self) -> bool:
        """Whether all clocks show that the tables, two at least, were recorded together."""
        begins = [one.reader.first_stamps() for one in self._tables if one.reader.has_clock]
        return len(begins) > 1 and all(recorded_together(begins[0], other) for other in begins[1:])

    def _agree_on_units(self) -> None:
        """Read clocks of the same name in the same unit: that of the fastest, since the shortest steps determine the unit."""
        clocks = [(one, clock) for one in self._tables if (clock := one.reader.clock_by_steps()) is not None]
        for one, (name, unit, _) in clocks:
            quickest = min((clock for _, clock in clocks if clock.name == name), key=lambda clock: clock.step)
            if unit != quickest.unit:
                one.reader = self._open(one.path, {name: quickest.unit})

    def _name(self, lists: Collection[list[str]]) -> None:
        """Name the channels."""
        by_length = Counter(map(len, lists))
        given = {len(names): names for names in lists if by_length[len(names)] == 1}
        for one in self._tables:
            lengths = _lengths(one.channels)
            for column in one.channels:
                label = column
                if (found := _ELEMENT.fullmatch(column)) and int(found[2]) < lengths[found[1]] in given:
                    label = f"{found[1]}[{given[lengths[found[1]]][int(found[2])]}]"
                one.names[column] = f"{one.stem}.{label}"

    def catalogue(self) -> Catalogue:
        """Return the contents of the tables."""
        channels: dict[str, ChannelInfo] = {}
        unread = dict(self.unread)
        for one in self._tables:
            channels |= {
                one.full(name): replace(info, stream=one.stream(info.stream)) for name, info in one.channels.items()
            }
            unread |= {one.full(name): reason for name, reason in one.reader.catalogue().unread.items()}
        return Catalogue(channels, unread)

    def heads(self) -> Iterator[Block]:
        """Yield the first samples of each table."""
        for one in self._tables:
            yield from (_renamed(one, block) for block in one.reader.heads())

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the tables' blocks, one table after the other.

        Raises
        ------
        ReadError
            A table cannot be read, or two of them are of different times.
        """
        spans: dict[str, tuple[int, int]] = {}
        for one in self._tables:
            own = None if wanted is None else {name for name in one.channels if one.full(name) in wanted}
            if own is not None and not own:
                continue
            for block in one.reader.blocks(own):
                stamps = block.clocks.get("column")
                if stamps is not None and stamps.size:
                    first, last = spans.get(one.stem, (int(stamps.min()), int(stamps.max())))
                    spans[one.stem] = min(first, int(stamps.min())), max(last, int(stamps.max()))
                yield _renamed(one, block)
            self.findings.add(*one.reader.findings)
            self.unread |= {one.full(name): reason for name, reason in one.reader.unread.items()}
        self._require_one_time({stem: span for stem, span in spans.items() if span[0] < span[1]})

    def _require_one_time(self, spans: Mapping[str, tuple[int, int]]) -> None:
        """Refuse tables of which one ended before the other began."""
        if not spans:
            return
        late = max(spans, key=lambda stem: spans[stem][0])
        early = min(spans, key=lambda stem: spans[stem][1])
        if spans[early][1] < spans[late][0]:
            raise ReadError(
                f"is a folder of tables of different times ({early}, {late}), which are no one recording; name one of them",
                self.path,
            )


def _renamed(one: _Table, block: Block) -> Block:
    columns = {one.full(name): values for name, values in block.columns.items()}
    units = {one.full(name): unit for name, unit in block.units.items()}
    return replace(block, stream=one.stream(block.stream), columns=columns, units=units)


def _lengths(columns: Collection[str]) -> Counter[str]:
    """Return the lists of a table, and how many elements each has."""
    return Counter(found[1] for name in columns if (found := _ELEMENT.fullmatch(name)))


def _stem(path: Path) -> str:
    name = printable(path.name)
    return re.sub(r"(\.\w+?)(\.gz)?$", "", name) or name


def _names_in(path: Path) -> list[str] | None:
    """Return the lines of a small text file where each is a name of its own; None where they are not."""
    try:
        with path.open("rb") as file:
            data = file.read(GLANCE_BYTES + 1)
        lines = [line.strip() for line in data.decode("utf-8-sig").splitlines()]
    except (OSError, UnicodeDecodeError):
        return None
    names = [line for line in lines if line]
    fit = len(data) <= GLANCE_BYTES and all(_NAME.fullmatch(name) for name in names)
    return names if names and fit and len(set(names)) == len(names) else None
