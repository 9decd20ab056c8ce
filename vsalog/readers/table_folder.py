"""A folder of tables that were recorded together, as one log: a stream per table, and joints' names in a file of their own."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.readers.base import Block, Catalogue, ChannelInfo, Reader
from vsalog.readers.limits import GLANCE_BYTES

ENDINGS = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".parquet")
"""What tables in a folder are called."""
_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
_NAME = re.compile(r"\w[\w .-]{0,63}")


def tables_in(folder: Path) -> list[Path]:
    """Return the files of a folder that are called as tables are, by name."""
    files = (path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    return sorted(path for path in files if path.name.lower().endswith(ENDINGS))


class TableFolderReader:
    """Reads the tables of a folder as one log; see `vsalog.readers.base.Reader`.

    A channel is called by its table and its column, as ``state.position``. Elements of lists have the names that a text file in
    the folder gives, a line each, where it has as many lines as the lists have elements.

    Parameters
    ----------
    folder : Path
        It.
    open_table : callable
        Opens one of its files.

    Raises
    ------
    ReadError
        No file is a table with channels, or two have the same columns: these are recordings of their own.
    """

    def __init__(self, folder: Path, open_table: Callable[[Path], Reader]) -> None:
        self.path, self.findings, self.unread = folder, Findings(), dict[str, str]()
        self._parts: dict[str, Reader] = {}
        lists, columns = list[list[str]](), dict[frozenset[str], str]()
        for path in tables_in(folder):
            try:
                reader = open_table(path)
                channels = frozenset(reader.catalogue().channels)
            except ReadError as error:
                if (names := _names_in(path)) is not None:
                    lists.append(names)
                else:
                    self.findings.add(
                        Finding(code="recording.file_left_out", part=path.name, evidence={"reason": error.what})
                    )
                continue
            if not channels:
                self.unread[printable(path.name)] = "no column of numbers"
                continue
            if channels in columns:
                raise ReadError(
                    f"is a folder of tables with the same columns ({columns[channels]}, {printable(path.name)}), which are"
                    " recordings of their own; name one of them",
                    folder,
                )
            columns[channels] = printable(path.name)
            self._parts[_stem(path)] = reader
        if not self._parts:
            raise ReadError("is a folder in which no file is a table with numbers, nor a log", folder)
        self._names = self._renamed(lists)
        self.format = next(iter(self._parts.values())).format

    @property
    def rig_text(self) -> str | None:
        """The rig in the first table that has one."""
        return next((part.rig_text for part in self._parts.values() if part.rig_text is not None), None)

    def catalogue(self) -> Catalogue:
        """Return what the tables hold."""
        channels: dict[str, ChannelInfo] = {}
        unread = dict(self.unread)
        for stem, reader in self._parts.items():
            own = reader.catalogue()
            channels |= {self._names[stem][name]: one for name, one in own.channels.items()}
            unread |= {f"{stem}.{name}": reason for name, reason in own.unread.items()}
        return Catalogue(channels, unread)

    def heads(self) -> Iterator[Block]:
        """Yield the first samples of each table."""
        for stem, reader in self._parts.items():
            yield from (self._of(stem, block) for block in reader.heads())

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the tables' blocks, one table after the other.

        Raises
        ------
        ReadError
            A table cannot be read, or two of them are of different times.
        """
        spans: dict[str, tuple[int, int]] = {}
        for stem, reader in self._parts.items():
            names = self._names[stem]
            own = None if wanted is None else {name for name, full in names.items() if full in wanted}
            if own is not None and not own:
                continue
            for block in reader.blocks(own):
                stamps = block.clocks.get("column")
                if stamps is not None and stamps.size:
                    first, last = spans.get(stem, (int(stamps.min()), int(stamps.max())))
                    spans[stem] = min(first, int(stamps.min())), max(last, int(stamps.max()))
                yield self._of(stem, block)
            self.findings.add(*reader.findings)
            self.unread |= {f"{stem}.{name}": reason for name, reason in reader.unread.items()}
        self._require_one_time(spans)

    def _require_one_time(self, spans: Mapping[str, tuple[int, int]]) -> None:
        for one, (first, last) in spans.items():
            for other, (begin, end) in spans.items():
                if last < begin or end < first:
                    raise ReadError(
                        f"is a folder of tables of different times ({printable(one)}, {printable(other)}), which are no one"
                        " recording; name one of them",
                        self.path,
                    )

    def _of(self, stem: str, block: Block) -> Block:
        names = self._names[stem]
        columns = {names.get(name, f"{stem}.{name}"): values for name, values in block.columns.items()}
        units = {names.get(name, f"{stem}.{name}"): unit for name, unit in block.units.items()}
        return replace(block, columns=columns, units=units)

    def _renamed(self, lists: Collection[list[str]]) -> dict[str, dict[str, str]]:
        """Return table → column → channel."""
        out: dict[str, dict[str, str]] = {}
        for stem, reader in self._parts.items():
            columns = list(reader.catalogue().channels)
            elements = {name: found for name in columns if (found := _ELEMENT.fullmatch(name))}
            lengths: dict[str, int] = {}
            for found in elements.values():
                lengths[found[1]] = lengths.get(found[1], 0) + 1
            out[stem] = {}
            for name in columns:
                label = name
                if name in elements:
                    base, index = elements[name][1], int(elements[name][2])
                    names = next((given for given in lists if len(given) == lengths[base]), None)
                    label = name if names is None or index >= len(names) else f"{base}[{names[index]}]"
                out[stem][name] = f"{stem}.{label}"
        return out


def _stem(path: Path) -> str:
    name = printable(path.name)
    return re.sub(r"(\.\w+?)(\.gz)?$", "", name) or name


def _names_in(path: Path) -> list[str] | None:
    """Return the lines of a small text file where each is a name of its own; None where they are not."""
    try:
        with path.open("rb") as file:
            data = file.read(GLANCE_BYTES + 1)
        lines = [line.strip() for line in data.decode("utf-8").splitlines()]
    except (OSError, UnicodeDecodeError):
        return None
    names = [line for line in lines if line]
    fit = len(data) <= GLANCE_BYTES and all(_NAME.fullmatch(name) for name in names)
    return names if names and fit and len(set(names)) == len(names) else None
