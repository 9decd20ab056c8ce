"""A task, done on any machine."""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from vsalog._version import __version__
from vsalog.batch.names import shown
from vsalog.batch.one_log import COMMANDS
from vsalog.batch.records import (
    MANIFEST,
    Answer,
    Kind,
    Log,
    Output,
    Record,
    Task,
    failed,
    read_record,
    record_name,
    record_of,
    whole,
    write_record,
)
from vsalog.batch.storage import Store, StoreError, file_system, is_address
from vsalog.core.errors import ReadError, VsalogError, WriteError, words_of
from vsalog.core.memory import resident
from vsalog.estimation.job import sha256
from vsalog.readers.remote import download
from vsalog.report.rigs import rig_in_errors, rig_words
from vsalog.rig.find import RigFound, rig_beside


def do(task: Task) -> Answer:
    """Do a task: all files of a log, then its record.

    Returns
    -------
    The record, also of a log that failed; or why nothing can be written at all
    """
    try:
        if task.vsalog != __version__:
            raise StoreError(f"this worker has vsalog {__version__}, but the batch needs {task.vsalog}")
        store = Store(os.fsdecode(task.out))
        if store.size(MANIFEST) is None:
            raise StoreError(f"{store.shown}: is not seen by this worker; name a place that all machines share")
        record, kept = _done(task, store)
        if not kept:
            write_record(store, record)
    except StoreError as error:
        return Answer(stop=str(error))
    return Answer(record=record, kept=kept, written=True, resident=resident())


def _done(task: Task, store: Store) -> tuple[Record, bool]:
    """Return a log's record, and whether it existed before."""
    log, start = task.log, time.perf_counter()

    def gone(kind: Kind, reason: str) -> tuple[Record, bool]:
        return failed(task, kind, shown(reason), time.perf_counter() - start), False

    try:
        with _here(log) as path:
            before = read_record(store, record_name(log.name)) if task.keep else None
            if before is not None and whole(before, store) and before.key == _key(task, path, sha256(path)):
                return before, True
            return _fresh(task, store, path, start), False
    except StoreError:
        raise
    except WriteError as error:
        raise StoreError(str(error)) from error
    except VsalogError as error:
        return gone("input", str(error))
    except MemoryError:
        return gone("memory", f"{log.name}: ran out of memory")
    except OSError as error:
        return gone("input", f"{log.name}: {error.strerror or error}")
    except Exception as error:
        # A hostile log may reach any bug in vsalog or a library; the others must not be affected.
        return gone("bug", f"this is a bug in vsalog, not in your log: {type(error).__name__}: {error}")


@contextmanager
def _here(log: Log) -> Iterator[Path]:
    """Give a log as a local path: its own, or that of a copy, with the rigs next to it, while the context lasts."""
    where = os.fsdecode(log.where)
    if not is_address(where):
        yield Path(where)
        return
    with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
        path = download(where, log.name, Path(folder))
        system, origin = file_system(where)
        for rig in (f"{path.stem}.rig.toml", "rig.toml"):
            source = f"{origin.rpartition('/')[0]}/{rig}"
            if system.isfile(source):
                system.get_file(source, str(path.with_name(rig)))
        yield path


def _fresh(task: Task, store: Store, path: Path, start: float) -> Record:
    """Process a log, check that it did not change, and put the files into the batch."""
    log = task.log
    with store.scratch() as scratch:
        try:
            before = _state(path)
            with rig_in_errors(_rig_words):
                files, fields = COMMANDS[task.settings.do](log, path, task.settings, scratch)
            if _state(path) != before:
                raise ReadError(
                    f"{log.name}: changed while it was processed; run again with --resume when it is complete"
                )
        except VsalogError as error:
            kind = WriteError if isinstance(error, WriteError) else VsalogError
            raise kind(_named(words_of(error), path, log)) from error
        fields = _named(msgspec.to_builtins(fields), path, log)
        outputs = {what: Output(name=name, size=file.stat().st_size) for what, (file, name) in files.items()}
        for file, name in files.values():
            store.put(file, name)
    key = _key(task, path, fields["input_sha256"])
    return record_of(task, outputs=outputs, key=key, run_seconds=time.perf_counter() - start, **fields)


def _state(path: Path) -> list[tuple[str, int, int, int]]:
    """Return a value that changes when a log does; its hash is taken only once and cannot show a later change."""
    if not path.exists():
        raise ReadError(f"{path}: there is no such file")
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [(str(p), s.st_size, s.st_mtime_ns, s.st_ino) for p in files for s in (p.stat(),)]


def _rig_words(found: RigFound) -> str:
    """Name a rig without its folder, which is private as the log's is."""
    return rig_words(replace(found, path=None))


def _named(value: Any, path: Path, log: Log) -> Any:
    """Name the log in messages as the batch does: its location is private, and differs by machine."""
    if isinstance(value, str):
        return shown(value.replace(str(path), log.name))
    if isinstance(value, dict):
        return {_named(key, path, log): _named(item, path, log) for key, item in value.items()}
    return [_named(item, path, log) for item in value] if isinstance(value, list | tuple) else value


def _key(task: Task, path: Path, digest: str) -> str:
    """Return a hash of all that a log's result depends on; `digest` is that of the log."""
    found = rig_beside(path) if task.settings.rig is None else None
    rig = "" if found is None else sha256(found)
    parts = (__version__, task.log.name, digest, rig, task.settings.digest())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
