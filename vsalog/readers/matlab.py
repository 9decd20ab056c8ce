"""MATLAB files: every structure that contains vectors of equal length is a stream."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.printable import MAX_DEPTH, printable
from vsalog.core.recording import Stamps, Values
from vsalog.readers import matlab_v73, matlab_variables
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.limits import GLANCE_BYTES, MAX_ARRAY
from vsalog.readers.matlab_clock import find_clock, is_called_time, stamps_of
from vsalog.readers.tables.row_times import row_clock
from vsalog.readers.tables.text import unique_names

V73 = b"MATLAB 7.3 MAT-file"
"""The first bytes of files that are HDF5 inside."""

_WHAT = {"nested": "nested too deeply", "other": "MATLAB object that is no array of numbers"}


class Clock(NamedTuple):
    """Stamps [ns], and which values of a vector as long as the clock they belong to: where it is no number there is no time."""

    stamps: Stamps
    rows: NDArray[np.bool_]


Clocks = Mapping[int, Clock]
"""Clocks of the structures around, by their length."""


class MatlabReader:
    """Reads a MATLAB file, v4, v5 or v7.3; see `vsalog.readers.base.Reader`.

    A vector that is named as a time and increases strictly is the clock of the vectors of the same length
    next to it and in structures below.

    Parameters
    ----------
    path : Path
        The file.
    rate : float or None
        Samples per second [Hz], for vectors without a clock.

    Raises
    ------
    ReadError
        The file cannot be opened or is damaged.
    """

    format = "matlab"
    rig_text: str | None = None

    def __init__(self, path: Path, rate: float | None) -> None:
        self.path = path
        self.rate = rate
        self.findings = Findings()
        self.unread: dict[str, str] = {}
        self._room = 0
        self._loaded: dict[str, Any] | None = None
        self._whole: dict[str, Stamps] = {}  # of what may be a clock of whole numbers

    def catalogue(self) -> Catalogue:
        """Return the vectors; the file has to be read for it."""
        channels = {
            name: ChannelInfo(block.stream, block.type) for block in self.blocks(None) for name in block.columns
        }
        return Catalogue(channels, dict(self.unread))

    def heads(self) -> Iterator[Block]:
        """Yield the first rows."""
        return first_of_each(self.blocks(None))

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield one block per stream.

        Raises
        ------
        ReadError
            The file is damaged.
        """
        self._whole.clear()
        yield from self._structure("", self._load(), {}, None if wanted is None else frozenset(wanted), 0)

    def _load(self) -> dict[str, Any]:
        """Return the variables, which are read once."""
        if self._loaded is not None:
            return self._loaded
        try:
            with self.path.open("rb") as file:
                head = file.read(GLANCE_BYTES)
                # All of it is in memory at once, as it is stored too.
                self._room = max(AT_ONCE_BYTES, FILE_RATIO * file.seek(0, 2))
            load = matlab_v73.load if head.startswith(V73) else matlab_variables.load
            found, damage = load(self.path, self._room)
        except OSError as error:
            raise ReadError(f"cannot be read: {error.strerror or error}", self.path) from error
        if damage and not found:
            raise ReadError(f"the MATLAB file is damaged: {damage[0]}", self.path)
        if not found:
            self.findings.add(Finding(code="recording.no_variables"))
        elif damage:
            evidence = {"reason": damage[0]}
            self.findings.add(Finding(code="recording.variables_damaged", value=len(damage), evidence=evidence))
        self._loaded = found
        return found

    def _structure(
        self, path: str, members: Mapping[str, Any], outer: Clocks, wanted: frozenset[str] | None, depth: int
    ) -> Iterator[Block]:
        """Yield the stream of a structure's own vectors, then those of the structures in it."""
        vectors: dict[str, Values] = {}
        inner: list[tuple[str, Any]] = []
        for name, value in _by_label(members).items():
            full = path + printable(name) if not path or name.startswith("[") else f"{path}.{printable(name)}"
            kind = _kind(value)
            if kind == "numbers":
                vectors.update(self._vectors(full, value))
            elif kind == "nested" and depth < MAX_DEPTH:
                inner.append((full, value))
            else:
                self.unread[full] = "text" if kind == "text" else _WHAT[kind]
        clock, why = find_clock(vectors)
        clocks = dict(outer)
        if why:
            self.findings.add(why)
        if clock is not None:
            times = vectors.pop(clock)
            clocks[len(times)] = self._clock(clock, times)
            if vectors and not inner and all(len(values) != len(times) for values in vectors.values()):
                self.unread[clock] = f"a clock of {len(times)} values; no vector next to it has as many"
        yield from self._streams(path, vectors, clocks, wanted)
        for full, value in inner:
            for element, content in _elements(full, value):
                yield from self._structure(element, content, clocks, wanted, depth + 1)

    def _clock(self, name: str, times: Values) -> Clock:
        """Return a vector as a clock."""
        rows = np.isfinite(times)
        whole = self._whole.get(name)
        stamps, findings = stamps_of(name, times[rows], None if whole is None else whole[rows])
        self.findings.add(*findings)
        if not rows.all():
            dropped = int(np.count_nonzero(~rows))
            self.findings.add(Finding(code="clock.rows_without_time", part=name, value=dropped))
        return Clock(stamps, rows)

    def _vectors(self, full: str, value: NDArray[Any]) -> dict[str, Values]:
        """Return the columns of a numeric array; what is no signal is listed as unread."""
        if np.iscomplexobj(value):
            self.unread[full] = "complex numbers"
            return {}
        if value.ndim > 2 or value.size == 0:
            self.unread[full] = f"array of shape {value.shape}"
            return {}
        if value.size == 1:
            self.unread[full] = "a single value"
            return {}
        if 8 * value.size > self._room:  # bytes take eight times as much as numbers
            self.unread[full] = f"{value.size} values, more than any recording of this size has"
            self.findings.add(Finding(code="recording.variable_too_large", part=full, value=value.size))
            return {}
        if value.ndim < 2 or 1 in value.shape:
            if value.dtype.kind in "iu" and value.dtype.itemsize == 8 and is_called_time(full):
                self._whole[full] = value.reshape(-1).astype(np.int64)
            return {full: np.asarray(value.reshape(-1), dtype=np.float64)}
        table = value.T if value.shape[0] < value.shape[1] else value
        if table.shape[1] > MAX_ARRAY:
            self.unread[full] = f"array of {table.shape[1]} values"
            return {}
        return {f"{full}[{i}]": np.array(table[:, i], dtype=np.float64) for i in range(table.shape[1])}

    def _streams(
        self, path: str, vectors: dict[str, Values], clocks: Clocks, wanted: frozenset[str] | None
    ) -> Iterator[Block]:
        """Yield a block per length of vectors: only those of equal length can share a clock."""
        name = path or self.path.stem
        lengths = list(dict.fromkeys(len(values) for values in vectors.values()))
        for length in lengths:
            columns = {
                column: values
                for column, values in vectors.items()
                if len(values) == length and (wanted is None or column in wanted)
            }
            if wanted is not None and not columns:
                continue
            if length in clocks:
                clock = clocks[length]
                stamps = {"column": clock.stamps}
                columns = {column: values[clock.rows] for column, values in columns.items()}
            else:
                stamps = row_clock(0, length, self.rate)
                if self.rate is None:
                    self.findings.add(Finding(code="clock.missing", part=name))
            stream = name if len(lengths) == 1 else f"{name} ({length} values)"
            yield Block(stream, "matlab", stamps, columns)


def _by_label(members: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return members of a structure; of one that Simulink logs ("Structure With Time"), signals by their labels.

    A signal without a label gets the name of the block that logs it; where none has a name, they stay numbered.
    """
    signals = members.get("signals")
    listed: list[Any] = signals if isinstance(signals, list) else [signals]
    if "time" not in members or not all(isinstance(one, dict) and "values" in one for one in listed):
        return members
    names = [_text(one.get("label")) or _text(one.get("blockName")).rpartition("/")[2] for one in listed]
    if not any(names):
        return members
    others = {name: value for name, value in members.items() if name != "signals"}
    called = [name or f"signals[{i}]" for i, name in enumerate(names)]
    values = [*others.values(), *(one["values"] for one in listed)]
    return dict(zip(unique_names([*others, *called]), values, strict=True))


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""


def _kind(value: Any) -> str:
    """Return ``numbers``, ``text``, ``nested`` (structures and cells) or ``other``."""
    if isinstance(value, dict | list):
        return "nested"
    if not isinstance(value, np.ndarray):
        return "text" if isinstance(value, str) else "other"
    return "numbers" if value.dtype.kind in "biufc" else "other"


def _elements(full: str, value: dict[str, Any] | list[Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield path and members of each structure in an array of structures, or of a cell array.

    Structures are dictionaries and lists of these, cell arrays lists.
    """
    if isinstance(value, dict):
        yield full, value
    elif value and all(isinstance(element, dict) for element in value):
        for i, element in enumerate(value[:MAX_ARRAY]):
            yield f"{full}[{i}]", element
    else:
        yield full, {f"[{i}]": element for i, element in enumerate(value[:MAX_ARRAY])}
