"""Fuzz target: Parquet files: tables of any types and names, with changed bytes, with and without checksums of pages."""

from __future__ import annotations

import struct
from contextlib import suppress
from io import BytesIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fuzz_contract import exercise, put
from fuzz_frames import framed, frames

TYPES = (
    pa.float64(), pa.float32(), pa.float16(), pa.int64(), pa.int32(), pa.int8(), pa.uint64(), pa.bool_(), pa.string(),
    pa.timestamp("ns"), pa.timestamp("us", "UTC"), pa.timestamp("s"), pa.date32(), pa.time64("ns"), pa.time32("ms"),
    pa.duration("us"), pa.binary(), pa.decimal128(20, 3), pa.list_(pa.float64()), pa.dictionary(pa.int8(), pa.string()),
    pa.struct([("a", pa.float64())]), pa.null(), pa.large_string(), pa.date64(), pa.duration("s"), pa.uint16(),
)  # fmt: skip
NAME, VALUES, NULLS, PATCH, META = range(5)


def one(data: bytes) -> None:
    """Read what the input makes: how to read it, how to write it, and frames of columns (or bytes as they are)."""
    if len(data) < 2:
        return
    content = data[2:] if data[1] & 1 else assemble(data[1], frames(data[2:]))
    if content:
        exercise(put(content, "log.parquet"), data[0])


def assemble(flags: int, parts) -> bytes:
    """Write a table. Flags: 2 compressed, 4 with checksums, 8 row groups of two rows, 16 no schema of Arrow."""
    names, columns, metadata = [], [], {}
    name, nulls = "x", b""
    for kind, content in parts:
        if kind % 5 == NAME:
            name = content.decode("utf-8", "replace")
        elif kind % 5 == NULLS:
            nulls = content
        elif kind % 5 == META:
            metadata[b"stream" if len(content) % 2 else b"unit"] = content
        elif kind % 5 == VALUES and len(columns) < 12:
            names.append(name)
            columns.append(column(TYPES[kind // 5 % len(TYPES)], content, nulls))
    if not columns:
        return b""
    rows = min(map(len, columns))
    schema = pa.schema([pa.field(n, c.type, metadata=metadata or None) for n, c in zip(names, columns, strict=True)])
    file = BytesIO()
    with suppress(pa.ArrowException, OverflowError, UnicodeError):
        table = pa.Table.from_arrays([c.slice(0, rows) for c in columns], schema=schema)
        pq.write_table(
            table,
            file,
            compression="zstd" if flags & 2 else "none",
            write_page_checksum=bool(flags & 4),
            row_group_size=2 if flags & 8 else None,
            store_schema=not flags & 16,
        )
    raw = bytearray(file.getvalue())
    for kind, content in parts:
        if kind % 5 == PATCH and len(content) > 4 and raw:
            at = struct.unpack_from("<I", content)[0] % len(raw)
            raw[at : at + len(content) - 4] = content[4:]
    return bytes(raw)


def column(kind, content: bytes, nulls: bytes):
    """Make a column of a type from bytes."""
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind):
        cells = content.decode("utf-8", "replace").split("\n")
        return pa.array(cells, kind)
    if pa.types.is_binary(kind):
        return pa.array(content.split(b"\n"), kind)
    count = len(content) // 8
    numbers = np.frombuffer(content[: count * 8], np.int64)
    mask = np.array([i < len(nulls) and nulls[i] & 1 for i in range(count)], bool)
    if pa.types.is_null(kind):
        return pa.nulls(count)
    if pa.types.is_list(kind) or pa.types.is_struct(kind):
        values = numbers.view(np.float64).tolist()
        return pa.array([[v] if pa.types.is_list(kind) else {"a": v} for v in values], kind)
    if pa.types.is_floating(kind):
        with np.errstate(all="ignore"):
            return pa.array(numbers.view(np.float64).astype(kind.to_pandas_dtype()), kind, mask=mask)
    if pa.types.is_decimal(kind):
        return pa.array(numbers, pa.int64()).cast(pa.decimal128(38, 3), safe=False).cast(kind, safe=False)
    if pa.types.is_boolean(kind):
        return pa.array(numbers % 2 == 1, mask=mask)
    width = kind.bit_width
    plain = {8: pa.int8(), 16: pa.int16(), 32: pa.int32(), 64: pa.int64()}[width]
    whole = pa.array(numbers.astype(plain.to_pandas_dtype()), plain, mask=mask)
    try:
        return whole.view(kind)
    except pa.ArrowException:
        return whole


def seeds():
    """Yield tables with clocks of many types."""
    t = np.arange(12, dtype=np.int64)
    x = np.sin(t).tobytes()
    ns = (1_700_000_000_000_000_000 + t * 10**6).tobytes()
    seconds = (t * 1e-3).tobytes()
    for name, kind, stamps in (
        ("time", 0, seconds), ("time", 9, ns), ("stamp", 3, ns), ("t", 11, t.tobytes()), ("time", 13, t.tobytes()),
        ("time [ms]", 3, t.tobytes()), ("time", 15, t.tobytes()), ("time", 12, t.tobytes()), ("nothing", 0, x),
    ):  # fmt: skip
        parts = [
            (NAME, name.encode()),
            (VALUES + 5 * kind, stamps),
            (NAME, b"q [rad]"),
            (VALUES, x),
            (NULLS, b"\0\1\0"),
        ]
        parts += [(NAME, b"tau"), (VALUES + 5, x)]
        yield bytes([0x68, 0]) + framed(parts)
        yield bytes([0x38, 8]) + framed(parts)
    dates = b"2026-01-31T12:00:00\n2026-01-31T12:00:01\nx\n2262-04-11"
    parts = [(NAME, b"date"), (VALUES + 5 * 8, dates), (NAME, b"x"), (VALUES, x)]
    yield bytes([0x28, 4]) + framed(parts)
    parts = [(NAME, b"joint"), (VALUES + 40, b"a\nb\na\nb"), (NAME, b"transmission"), (VALUES + 40, b"t\nt\nu\nu")]
    parts += [(NAME, b"stamp"), (VALUES + 15, ns), (NAME, b"stiffness"), (VALUES, x)]
    yield bytes([0x28, 0]) + framed(parts)
    for flags in (0, 2, 4):
        yield bytes([0x00, 1]) + assemble(flags, parts[4:])
