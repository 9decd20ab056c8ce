"""Records in the folder of a batch: one file per log, which is finished once it is there."""

from __future__ import annotations

import msgspec

from vsalog.batch.names import encoded
from vsalog.batch.records import Record
from vsalog.batch.storage import Store

# What a batch is, in its folder; it is there before the first log is begun.
MANIFEST = "batch.json"
RECORDS = "records"


def record_name(log: str) -> str:
    """Return where a log's record lies in the batch."""
    return f"{RECORDS}/{encoded(log)}.json"


def write_record(store: Store, record: Record) -> None:
    """Write a record: from now on its log is finished."""
    store.write(record_name(record.log), msgspec.json.format(msgspec.json.encode(record)) + b"\n")


def read_record(store: Store, log: str) -> Record | None:
    """Return a log's record; None where there is none, or none that can be read."""
    return parsed(store.read(record_name(log)))


def parsed(data: bytes | None) -> Record | None:
    """Return a record from its file's bytes; None where they are none."""
    if data is None:
        return None
    try:
        return msgspec.json.decode(data, type=Record)
    except msgspec.DecodeError:
        return None


def whole(record: Record, store: Store) -> bool:
    """Tell whether a log is finished, and its files are as they were written."""
    return record.status == "done" and all(store.size(o.name) == o.size for o in record.outputs.values())
