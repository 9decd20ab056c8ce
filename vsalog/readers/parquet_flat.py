"""The rows of a Parquet file with a plain column for every value in structures and lists."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vsalog.core.finding import Finding
from vsalog.readers.limits import MAX_ARRAY
from vsalog.readers.parquet_cells import is_number, plain_cells, plain_type
from vsalog.readers.parquet_rows import ParquetRows
from vsalog.readers.tables.text import printable_cell


class FlatRows:
    """Batches of a `ParquetRows`: ``js.pos`` for a member of a structure, ``pos[0]`` for an element of a list.

    Types are those of `parquet_cells.plain_type`; dates and times of day are read as those of text tables are. Lists have as
    many columns as the longest of the first rows has elements.

    Parameters
    ----------
    rows : ParquetRows
        The file.

    Attributes
    ----------
    schema : pyarrow Schema
        Of the plain columns.
    """

    def __init__(self, rows: ParquetRows) -> None:
        self._rows = rows
        self._sizes: dict[str, int] = {}
        self._longer: dict[str, int] = {}
        nested = any(pa.types.is_nested(field.type) for field in rows.schema)
        if nested:
            for field, cells in zip(rows.schema, rows.sample(), strict=False):
                self._measure(field.name, field.type, cells)
        columns = [list(self._flat(field, None)) for field in rows.schema]
        names = [one.name for column in columns for one, _ in column]
        self._plain = nested and len(set(names)) < len(names)  # names that would be those of others
        if self._plain:
            columns = [[_as_plain(field, None)] for field in rows.schema]
        self.schema = pa.schema([one for column in columns for one, _ in column], rows.schema.metadata)
        self._owners = [i for i, column in enumerate(columns) for _ in column]

    @property
    def findings(self) -> list[Finding]:
        """Findings about unreadable cells, and about elements left out of lists."""
        return self._rows.findings + [
            Finding(
                code="recording.elements_left_out",
                part=printable_cell(name),
                value=self._sizes[name],
                limit=longest,
            )
            for name, longest in self._longer.items()
        ]

    def sample(self) -> list[pa.Array | None]:
        """Return the first rows of each column that can be read, None for one of which none can."""
        found: list[pa.Array | None] = []
        for field, cells in zip(self._rows.schema, self._rows.sample(), strict=False):
            empty = cells is None
            flat = self._columns(field, pa.nulls(0, field.type) if empty else cells)
            found += [None if empty else column for _, column in flat]
        return found

    def batches(
        self, columns: Sequence[int], required: Collection[int]
    ) -> Iterator[tuple[int, int, dict[int, pa.Array]]]:
        """Yield the number of the first row, how many there are, and the cells by column, see `ParquetRows.batches`.

        Raises
        ------
        ReadError
            One of the required columns, or all others, cannot be read at all.
        """
        schema = self._rows.schema
        names = schema.names
        first = {owner: i for i, owner in reversed([*enumerate(self._owners)])}
        read = list(dict.fromkeys(names[self._owners[i]] for i in columns))
        # All of one name come together.
        fields = [i for name in read for i in schema.get_all_field_indices(name)]
        for row, batch in self._rows.batches(read, {names[self._owners[i]] for i in required}):
            cells = {}
            for i, stored in zip(fields, batch.columns, strict=True):
                for k, (_, plain) in enumerate(self._columns(schema.field(i), stored), first[i]):
                    cells[k] = plain
            yield row, batch.num_rows, cells

    def _columns(self, field: pa.Field, cells: pa.Array) -> list[tuple[pa.Field, pa.Array]]:
        return [_as_plain(field, cells)] if self._plain else list(self._flat(field, cells))

    def _measure(self, name: str, kind: pa.DataType, cells: pa.Array | None) -> None:
        """Find out how long the lists are."""
        if cells is None:
            return
        if pa.types.is_struct(kind):
            for member, part in zip(kind, cells.flatten(), strict=True):
                self._measure(f"{name}.{member.name}", member.type, part)
        elif _is_list(kind):
            self._sizes[name] = pc.max(pc.list_value_length(cells)).as_py() or 0

    def _flat(self, field: pa.Field, cells: pa.Array | None) -> Iterator[tuple[pa.Field, pa.Array]]:
        """Yield the plain columns of one of the file's, without cells where there are none."""
        name, kind = field.name, field.type
        if pa.types.is_struct(kind) and kind.num_fields:
            members = cells.flatten() if cells is not None else [None] * kind.num_fields
            for member, part in zip(kind, members, strict=True):
                yield from self._flat(member.with_name(f"{name}.{member.name}"), part)
        elif (size := self._elements(name, kind)) and _is_plain(kind.value_type):
            if cells is not None and name in self._sizes:
                longest = pc.max(pc.list_value_length(cells)).as_py() or 0
                if longest > max(size, self._longer.get(name, 0)):
                    self._longer[name] = longest
            for k in range(size):
                plain = pa.field(f"{name}[{k}]", kind.value_type, metadata=field.metadata)
                yield plain, None if cells is None else plain_cells(_element(cells, k))
        else:
            yield _as_plain(field, cells)

    def _elements(self, name: str, kind: pa.DataType) -> int:
        """Return how many elements of a list have a column, 0 for what is no list or no signal."""
        measured = self._sizes.get(name, 0) if _is_list(kind) else 0  # a column that is none may have the name of one
        size = kind.list_size if pa.types.is_fixed_size_list(kind) else measured
        return size if size <= MAX_ARRAY else 0


def _is_list(kind: pa.DataType) -> bool:
    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind))


def _is_plain(kind: pa.DataType) -> bool:
    """Return whether elements of a list have columns: numbers, and the names of what they are numbers of."""
    return is_number(kind) or bool(pa.types.is_string(kind))


def _as_plain(field: pa.Field, cells: pa.Array | None) -> tuple[pa.Field, pa.Array | None]:
    return field.with_type(plain_type(field.type)), None if cells is None else plain_cells(cells)


def _element(lists: pa.Array, k: int) -> pa.Array:
    """Return an element of each list, null where there is none."""
    if pa.types.is_fixed_size_list(lists.type):
        return pc.list_element(lists, k)
    there = np.asarray(
        pc.fill_null(pc.greater(pc.list_value_length(lists), k), False).to_numpy(zero_copy_only=False), bool
    )
    begins = lists.offsets.to_numpy()[:-1].astype(np.int64)
    return lists.values.take(pa.array(np.where(there, begins + k, 0), mask=~there))
