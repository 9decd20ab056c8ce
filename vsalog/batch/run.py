"""A whole batch: the plan, the place, the work, and the final data set."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass

import msgspec

from vsalog._version import __version__
from vsalog.batch.cluster import Cluster
from vsalog.batch.lock import locked
from vsalog.batch.memory import free
from vsalog.batch.outcome import Outcome
from vsalog.batch.plan import Plan, make_plan
from vsalog.batch.pool import Pool
from vsalog.batch.records import (
    MANIFEST,
    RECORDS,
    VERSION,
    Do,
    Record,
    Settings,
    Task,
    read_record,
    record_name,
    write_record,
)
from vsalog.batch.storage import Store, StoreError
from vsalog.batch.summary import page_columns, rows_of, write_summary
from vsalog.core.errors import BatchError
from vsalog.core.memory import cores
from vsalog.core.printable import plural
from vsalog.report.batch import batch_page
from vsalog.report.progress import BatchProgress

# Files of a batch that may be removed when no record names them; other files never are.
_WRITTEN = re.compile(
    r"traces/device=[^/]*/date=[^/]*/log=[^/]*/part\.parquet|models/[^/]*\.model\.toml"
    r"|reports/[^/]*/(estimate\.html|report\.html|report\.json|diagnosis\.html|diagnosis\.json|extended\.rig\.toml)"
)


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The description of a batch: the version of its layout, the command, and a hash of the settings, not of the machines."""

    version: int
    do: Do
    asked: str


@dataclass(frozen=True, slots=True)
class Asked:
    """The request to `batch`.

    Attributes
    ----------
    logs : paths, patterns, folders, addresses, lists
    out : folder or address
    settings : the work on each log
    resume : continue the existing batch
    shard : (i, n): the i-th of n shares only
    jobs, memory, timeout : of the pool; None for the machine's cores, the free memory, no bound
    scheduler : address of a Dask scheduler, instead of the pool
    """

    logs: tuple[str, ...]
    out: str
    settings: Settings
    resume: bool = False
    shard: tuple[int, int] | None = None
    jobs: int | None = None
    memory: int | None = None
    timeout: float | None = None
    scheduler: str | None = None


def run_batch(asked: Asked, shown: BatchProgress) -> Outcome:
    """Do a batch.

    Parameters
    ----------
    asked : what
    shown : called with the progress

    Raises
    ------
    BatchError
        It cannot begin or continue: finished work is kept, and `resume` continues.
    """
    start = time.perf_counter()
    whole_plan = make_plan(asked.logs, asked.out)
    plan = whole_plan if asked.shard is None else whole_plan.shard(*asked.shard)
    for note in plan.notes:
        shown.say(note)
    store = Store(asked.out)
    _check_place(store, asked)
    with _executor(asked, shown, len(plan.logs)) as executor:
        executor.check(asked.settings)
        with locked(store, asked.shard):
            # Once more: another run may have been faster.
            before = _check_place(store, asked)
            if asked.shard is None:
                store.clear_scratch()
            _begin(store, asked, before, shown)
            outcome = Outcome(store.shown, asked.settings.do, len(plan.logs))
            _work(executor, store, plan, asked, outcome, shown)
            _finish(store, {log.name for log in whole_plan.logs}, asked, outcome, shown)
    outcome.seconds = time.perf_counter() - start
    return outcome


def _executor(asked: Asked, shown: BatchProgress, logs: int) -> Pool:
    if asked.scheduler is not None:
        return Cluster(asked.scheduler, shown.say)
    bound = free() if asked.memory is None else asked.memory
    return Pool(min(asked.jobs or cores(), max(logs, 1)), bound, asked.timeout, shown.say)


def _check_place(store: Store, asked: Asked) -> Manifest | None:
    """Refuse a place with other files, or an existing batch without `resume`."""
    data, where = store.read(MANIFEST), store.shown
    if data is None:
        if not store.empty():
            raise BatchError(f"{where}: is not empty, and contains no batch; name a new folder with -o")
        return None
    try:
        manifest = msgspec.json.decode(data, type=Manifest)
    except msgspec.DecodeError:
        raise BatchError(f"{where}/{MANIFEST}: is not of vsalog; name a new folder with -o") from None
    if manifest.version != VERSION:
        versions = f"(layout {manifest.version}, here {VERSION})"
        raise BatchError(f"{where}: is of another version of vsalog {versions}; name a new folder with -o")
    if manifest.do != asked.settings.do:
        raise BatchError(
            f"{where}: contains a batch of '{manifest.do}', not of '{asked.settings.do}'; name another folder with -o"
        )
    same = manifest.asked == asked.settings.digest()
    if not asked.resume and not (asked.shard is not None and same):
        raise BatchError(f"{where}: contains a batch already; continue it with --resume, or name a new folder with -o")
    return manifest


def _begin(store: Store, asked: Asked, before: Manifest | None, shown: BatchProgress) -> None:
    manifest = Manifest(version=VERSION, do=asked.settings.do, asked=asked.settings.digest())
    if before == manifest:
        return
    if before is not None:
        shown.say("other options than before: all logs are processed again")
    store.write(MANIFEST, msgspec.json.format(msgspec.json.encode(manifest)) + b"\n")


def _work(executor: Pool, store: Store, plan: Plan, asked: Asked, outcome: Outcome, shown: BatchProgress) -> None:
    out = os.fsencode(store.address)
    tasks = [Task(log=log, settings=asked.settings, out=out, vsalog=__version__, keep=True) for log in plan.logs]
    shown.begin([log.size for log in plan.logs])
    for task, answer in executor.run(tasks):
        if answer.stop or answer.record is None:
            done = f"{len(outcome.records)} of {plural(len(tasks), 'log')} finished; continue with --resume"
            raise StoreError(f"{answer.stop} ({done})")
        if not answer.written:
            write_record(store, answer.record)
        outcome.records[answer.record.log] = answer.record
        outcome.kept += answer.kept
        # Most reasons begin with the name.
        reason = answer.record.reason.removeprefix(f"{task.log.name}: ")
        shown.add(task.log.size, answer.kept, reason and f"{task.log.name}: {reason}")


def _finish(store: Store, planned: set[str], asked: Asked, outcome: Outcome, shown: BatchProgress) -> None:
    """Make the table and the page of all records that are there, and remove what none of them names."""
    everything, do = dict(outcome.records), asked.settings.do
    _gather(store, everything)
    if asked.shard is None:
        known = {r.input_sha256 for r in outcome.records.values() if r.status == "done"}
        for record in [r for name, r in everything.items() if name not in planned]:
            # A renamed log has its results under the new name; a failed one left none.
            if record.status == "failed" or record.input_sha256 in known:
                del everything[record.log]
                store.remove(record_name(record.log))
        _sweep(store, everything)
    outcome.everything, outcome.finished = len(planned), len(planned & set(everything))
    outcome.others = len(set(everything) - planned)
    if outcome.others:
        shown.say(f"the data set also keeps the results of {plural(outcome.others, 'log')} of an earlier run")
    _write_overview(store, everything, do)
    if asked.shard is None:
        # A killed worker could not do this itself.
        store.clear_scratch()
    else:
        # Of shares that end at the same time the last to write need not be the last to read.
        while _gather(store, everything):
            _write_overview(store, everything, do)


def _gather(store: Store, records: dict[str, Record]) -> bool:
    """Add the existing records of others; return whether there were any."""
    names = set(store.files(RECORDS)) - {record_name(log) for log in records}
    found = {r.log: r for name in sorted(names) if (r := read_record(store, name)) is not None}
    records |= found
    return bool(found)


def _write_overview(store: Store, records: dict[str, Record], do: Do) -> None:
    ordered = [records[name] for name in sorted(records)]
    failed, missed = sum(r.status == "failed" for r in ordered), sum(not r.met for r in ordered)
    counts = {"done": len(ordered) - failed, "failed": failed, "missed": missed}
    store.write("index.html", batch_page(do, counts, rows_of(ordered), page_columns(do)).encode())
    store.write("summary.parquet", write_summary(ordered, do))


def _sweep(store: Store, records: dict[str, Record]) -> None:
    """Remove files of logs that have disappeared, changed their device or their day, or failed since."""
    named = {output.name for record in records.values() for output in record.outputs.values()}
    for top in ("traces", "models", "reports"):
        for name in store.files(top):
            if name not in named and _WRITTEN.fullmatch(name):
                store.remove(name)
