"""A task done, wherever that is: JSON in, JSON out."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import replace as replaced
from pathlib import Path
from typing import Any

import msgspec

from vsalog._version import __version__
from vsalog.batch.memory import resident
from vsalog.batch.names import shown
from vsalog.batch.one_log import Result, check, run_one
from vsalog.batch.record_files import MANIFEST, read_record, whole, write_record
from vsalog.batch.records import Answer, Joint, Kind, Log, Output, Record, Settings, Task, failed
from vsalog.batch.storage import Store, StoreError, fetched
from vsalog.core.errors import VsalogError, WriteError
from vsalog.estimation.job import sha256
from vsalog.rig.find import rig_beside


def do_json(task: bytes) -> bytes:
    """Do a task; both it and the answer are JSON, so that nothing else goes between processes."""
    return msgspec.json.encode(do(msgspec.json.decode(task, type=Task)))


def check_json(settings: bytes) -> str:
    """Return what is wrong with what is asked for, whatever the log; nothing where nothing is."""
    try:
        check(msgspec.json.decode(settings, type=Settings))
    except VsalogError as error:
        return str(error)
    return ""


def do(task: Task) -> Answer:
    """Do a task: all files of a log, then its record.

    Parameters
    ----------
    task : a log and what is asked for

    Returns
    -------
    The record, also of a log that failed; or why nothing can be written at all.
    """
    start = time.perf_counter()
    if task.vsalog != __version__:
        return Answer(stop=f"this worker has vsalog {__version__}, but {task.vsalog} was asked for")
    try:
        store = Store(os.fsdecode(task.out))
        if store.size(MANIFEST) is None:
            return Answer(stop=f"{store.shown}: is not seen by this worker; name a place that all machines share")
        record, kept = _done(task, store, start)
        if not kept:
            write_record(store, record)
    except StoreError as error:
        return Answer(stop=str(error))
    return Answer(record=record, kept=kept, written=True, resident=resident())


def _done(task: Task, store: Store, start: float) -> tuple[Record, bool]:
    log, settings = task.log, task.settings

    def gone(kind: Kind, reason: str) -> tuple[Record, bool]:
        return failed(log, settings, kind, shown(reason), __version__, time.perf_counter() - start), False

    try:
        with fetched(log) as path:
            before = read_record(store, log.name) if task.keep else None
            if before is not None and whole(before, store) and before.key == _key(task, path, sha256(path)):
                return before, True
            with store.scratch() as scratch:
                result = _explaining(lambda: run_one(log, path, settings, scratch), path, log)
                key = _key(task, path, result.input_sha256)
                outputs = {what: Output(name=n, size=f.stat().st_size) for what, (f, n) in result.files.items()}
                for what, (file, _) in result.files.items():
                    store.put(file, outputs[what].name)
            return _record(task, key, result, outputs, time.perf_counter() - start), False
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
        # A hostile log may reach any bug of ours or of a library; the others must not suffer from that.
        return gone("bug", f"this is a bug in vsalog, not in your log: {type(error).__name__}: {error}")


def _explaining(run: Callable[[], Result], path: Path, log: Log) -> Result:
    """Run, and call the log in messages what the batch calls it: where it lies is no one's business, and differs by machine."""

    def plain(value: Any) -> Any:
        if isinstance(value, str):
            return shown(value.replace(str(path), log.name))
        if isinstance(value, dict):
            return {plain(key): plain(item) for key, item in value.items()}
        return [plain(item) for item in value] if isinstance(value, list | tuple) else value

    try:
        result = run()
    except VsalogError as error:
        raise type(error)(plain(str(error))) from error
    joints = tuple(Joint(joint=plain(j.joint), figures=plain(j.figures)) for j in result.joints)
    findings, warnings = tuple(plain(result.findings)), tuple(plain(result.warnings))
    return replaced(result, findings=findings, warnings=warnings, joints=joints)


def _key(task: Task, path: Path, digest: str) -> str:
    """Return a hash of all that a log's result depends on; `digest` is that of the log."""
    found = rig_beside(path) if task.settings.rig is None else None
    rig = "" if found is None else sha256(found)
    parts = (__version__, task.log.name, digest, rig, task.settings.digest())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _record(task: Task, key: str, result: Result, outputs: dict[str, Output], seconds: float) -> Record:
    return Record(
        log=task.log.name,
        do=task.settings.do,
        status="done",
        key=key,
        vsalog=__version__,
        input_sha256=result.input_sha256,
        input_bytes=task.log.size,
        rig_sha256=result.rig_sha256,
        device=result.device,
        date=result.date,
        outputs=outputs,
        joints=result.joints,
        findings=result.findings,
        warnings=result.warnings,
        met=result.met,
        run_seconds=seconds,
    )
