"""The messages between the parts of a batch, as JSON: a log, the settings, a task, and the record of its outcome."""

from __future__ import annotations

import hashlib
from typing import Any, Literal

import msgspec

from vsalog._version import __version__
from vsalog.batch.names import encoded
from vsalog.batch.storage import Store

# The description of a batch, in its folder; it exists before the first log is begun.
MANIFEST = "batch.json"
RECORDS = "records"
VERSION = 1
"""Of the layout of a batch's folder and records."""

Do = Literal["estimate", "validate", "diagnose"]
# The origin of a failure; all but "input" may disappear on the next run.
Kind = Literal["", "input", "memory", "killed", "time", "bug"]


class Log(msgspec.Struct, frozen=True, kw_only=True):
    """A log of the plan.

    Attributes
    ----------
    name : relative to what all logs have in common, as text; the value of the data set's partition ``log``
    where : path or address, as bytes because a path need not be text
    size : bytes; of a folder, of its files
    """

    name: str
    where: bytes
    size: int


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """The settings, the same for every log. Rigs and models are here as text: other machines need not have the files.

    Attributes
    ----------
    do : the command that is run
    rig : the rig that was given, TOML; None where each log's own is searched for
    rig_name : its name in messages
    model, model_name : the model to validate, TOML
    options : others of the command's `Options`, by name
    report : write a page per log also for commands without one
    fail_on_cause : of `diagnose`
    """

    do: Do = "estimate"
    rig: str | None = None
    rig_name: str = ""
    model: str | None = None
    model_name: str = ""
    options: dict[str, Any] = {}
    report: bool = False
    fail_on_cause: bool = False

    def digest(self) -> str:
        """Return a hash of all of it."""
        return hashlib.sha256(msgspec.json.encode(self, order="sorted")).hexdigest()


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """One log to be done.

    Attributes
    ----------
    log, settings : what, and how
    out : folder or address of the batch, as bytes
    vsalog : required version: a worker with another one must not do it
    keep : skip the log if its record marks it as finished
    """

    log: Log
    settings: Settings
    out: bytes
    vsalog: str
    keep: bool


class Output(msgspec.Struct, frozen=True, kw_only=True):
    """A file that was written: its name in the batch, and its size [bytes]."""

    name: str
    size: int


class Joint(msgspec.Struct, frozen=True, kw_only=True):
    """A joint of a log: its name, and figures by the names of the summary's columns."""

    joint: str
    figures: dict[str, Any]


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a log.

    Attributes
    ----------
    version : of this structure
    log : its name
    do : what was run
    status : done or failed
    kind, reason : of a failure
    key : hash of everything that the result depends on
    vsalog : version
    input_sha256, input_bytes : of the log
    rig_sha256 : of the rig as resolved, settings worked in, as TOML in SI units
    device, date : partitions of the trace
    outputs : what was written, by what it is: trace, model, report, document, rig
    joints : figures, joint by joint
    findings, warnings : of the log as a whole
    met : whether the requested thresholds were met
    run_seconds : how long it took
    """

    version: int = VERSION
    log: str
    do: Do
    status: Literal["done", "failed"] = "done"
    kind: Kind = ""
    reason: str = ""
    key: str = ""
    vsalog: str
    input_sha256: str = ""
    input_bytes: int = 0
    rig_sha256: str = ""
    device: str = ""
    date: str = ""
    outputs: dict[str, Output] = {}
    joints: tuple[Joint, ...] = ()
    findings: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    met: bool = True
    run_seconds: float = 0.0


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """A worker's answer: a record, whether it existed before, and whether it was written; or why none can be written.

    Attributes
    ----------
    resident : memory that the worker's process holds [bytes]
    """

    record: Record | None = None
    kept: bool = False
    written: bool = False
    stop: str = ""
    resident: int = 0


def record_of(task: Task, **fields: Any) -> Record:
    """Return the record of a task's log: its entry in the plan, and fields by name as they come from outside."""
    known = {"log": task.log.name, "do": task.settings.do, "vsalog": __version__, "input_bytes": task.log.size}
    return msgspec.convert(known | fields, Record)


def failed(task: Task, kind: Kind, reason: str, seconds: float = 0.0) -> Record:
    """Return the record of a log without a result, or that failed after some seconds."""
    return record_of(task, status="failed", kind=kind, reason=reason, run_seconds=seconds)


def record_name(log: str) -> str:
    """Return the path of a log's record in the batch."""
    return f"{RECORDS}/{encoded(log)}.json"


def write_record(store: Store, record: Record) -> None:
    """Write a record, in a file of its own: from now on its log is finished."""
    store.write(record_name(record.log), msgspec.json.format(msgspec.json.encode(record)) + b"\n")


def read_record(store: Store, name: str) -> Record | None:
    """Return the record in a file; None where there is none, or none that can be read."""
    try:
        return msgspec.json.decode(store.read(name) or b"", type=Record)
    except msgspec.DecodeError:
        return None


def whole(record: Record, store: Store) -> bool:
    """Return whether a log is finished, and its files are as they were written."""
    return record.status == "done" and all(store.size(o.name) == o.size for o in record.outputs.values())
