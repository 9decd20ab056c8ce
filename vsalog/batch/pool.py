"""Workers on this machine: a process each, one log at a time, replaced when they die."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType

import msgspec

import vsalog
from vsalog._version import __version__
from vsalog.batch.memory import BASE, expected, resident, size_text
from vsalog.batch.records import Answer, Kind, Settings, Task, failed
from vsalog.batch.worker import BEGUN, CHECK, COMPILING, PREPARE, TASK, THREADS, serve
from vsalog.core.errors import BatchError

TICK = 0.5
"""Seconds after which a late log, or an interrupt that another thread got, is noticed."""
Say = Callable[[str], None]


@dataclass(slots=True)
class _Worker:
    process: multiprocessing.process.BaseProcess
    pipe: Connection
    job: _Job | None = None
    begun: float = math.inf


@dataclass(slots=True)
class _Job:
    task: Task
    need: int
    deaths: list[str] = field(default_factory=list)


class Pool:
    """Do tasks on this machine.

    Use as a context manager; leaving it ends all workers at once.

    Parameters
    ----------
    jobs : workers at most
    memory : bytes that all of them together may be expected to need
    timeout : seconds that a log may take; None for no bound
    say : called with what takes time
    """

    def __init__(self, jobs: int, memory: int, timeout: float | None = None, say: Say = lambda _: None) -> None:
        self.jobs = max(1, min(jobs, memory // BASE))
        self.memory, self.timeout, self.say = memory, timeout, say
        self._context = multiprocessing.get_context("spawn")
        self._workers: list[_Worker] = []

    def __enter__(self) -> Pool:
        # All of them, so that they load side by side, and while others prepare.
        for _ in range(self.jobs):
            self._start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.pipe.close()
        self._workers.clear()

    def check(self, settings: Settings) -> None:
        """See in a worker, which has to load all that anyway, whether what is asked for can be at all.

        Raises
        ------
        BatchError
            It cannot.
        """
        worker = self._workers[0]
        try:
            worker.pipe.send_bytes(CHECK + msgspec.json.encode(settings))
            while (message := worker.pipe.recv_bytes())[:1] == COMPILING:
                pass
        except (EOFError, OSError):
            raise BatchError(f"no worker could be started: it {_ended(worker.process)}") from None
        if said := message[1:].decode():
            raise BatchError(said)

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Answer]]:
        """Do tasks, those of large logs first; yield each with its answer as soon as it is there.

        Where nothing is compiled yet, one after the other is done alone until loops are compiled, or each worker had one.
        """
        # From the large ones down, so that the last ones end together.
        waiting = sorted(
            (_Job(t, expected(t.log, t.settings)) for t in tasks), key=lambda j: (-j.need, j.task.log.name)
        )
        warm, compiling, tries = len(waiting) < 2 or self.jobs < 2 or compiled(), False, 0
        if not warm:
            waiting.insert(0, waiting.pop(_lukewarm(waiting)))
        while waiting or any(w.job for w in self._workers):
            yield from self._refused(waiting)
            self._grow(waiting)
            if warm or not any(w.job for w in self._workers):
                self._hand_out(waiting, 1 if not warm else self.jobs)
            for worker in self._ready():
                message = self._message(worker)
                if message == BEGUN:
                    worker.begun = time.monotonic()
                    continue
                if message == COMPILING:
                    if not compiling:
                        self.say("first run: compiling the numerical loops takes a few seconds …")
                    compiling = True
                    continue
                job, worker.job = worker.job, None
                assert job is not None
                if message is not None:
                    answer = msgspec.json.decode(message[1:], type=Answer)
                    tries += 1
                    warm = warm or tries >= self.jobs or (answer.record is not None and answer.record.status == "done")
                    yield job.task, answer
                    self._rest(worker, job)
                    continue
                again = self._mourn(worker, job)
                if again is None:
                    yield job.task, _lost(job)
                else:
                    waiting.append(again)

    def _refused(self, waiting: list[_Job]) -> Iterator[tuple[Task, Answer]]:
        """Give back what would not fit if it were alone."""
        for job in [job for job in waiting if job.need > self.memory]:
            waiting.remove(job)
            what = f"a log of {size_text(job.task.log.size)} is expected to need {size_text(job.need)} of memory"
            advice = "give more with --memory, or do a part with --start and --end"
            yield job.task, _failure(job, "memory", f"{what}, and {size_text(self.memory)} are allowed: {advice}")

    def _hand_out(self, waiting: list[_Job], most: int) -> None:
        """Give logs to workers as long as their expected needs fit; a log that somebody died of gets all to itself."""
        busy = [w for w in self._workers if w.job]
        if any(w.job is not None and w.job.deaths for w in busy):
            return
        left = self.memory - sum(w.job.need for w in busy if w.job)
        free = [w for w in self._workers if not w.job]
        count = len(busy)
        for job in list(waiting):
            if not free or count >= most:
                return
            if (job.deaths and count) or job.need > left:
                continue
            while len(free) > 1 and job.need + (len(free) - 1) * BASE > left:
                self._dismiss(free.pop(0))
            worker = free.pop()
            waiting.remove(job)
            # It may have to be loaded first, which is no part of a log's time.
            worker.job, worker.begun = job, math.inf
            with suppress(OSError):  # one that died is noticed by its pipe
                worker.pipe.send_bytes(TASK + msgspec.json.encode(job.task))
            left, count = left - job.need, count + 1
            if job.deaths:
                return

    def _grow(self, waiting: list[_Job]) -> None:
        """Start workers in the place of those that died or were let go, as far as there is work and memory for them."""
        busy = sum(1 for w in self._workers if w.job)
        least = min((job.need for job in waiting), default=0)
        while len(self._workers) < min(self.jobs, len(waiting) + busy):
            used = sum(w.job.need if w.job else BASE for w in self._workers)
            if used + least > self.memory:
                return
            self._start()

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=serve, args=(theirs,), daemon=True)
        with _environment(THREADS), _without_interrupts():
            process.start()
        theirs.close()
        worker = _Worker(process, ours)
        self._workers.append(worker)
        with suppress(OSError):
            ours.send_bytes(PREPARE)
        return worker

    def _ready(self) -> list[_Worker]:
        """Wait until somebody has something to say, or is late."""
        busy = {w.pipe: w for w in self._workers if w.job}
        if not busy:
            return []
        found = [busy[pipe] for pipe in wait(list(busy), TICK) if isinstance(pipe, Connection)]
        for worker in busy.values():
            if worker not in found and self._late(worker):
                worker.process.kill()
        return found

    def _late(self, worker: _Worker) -> bool:
        return self.timeout is not None and time.monotonic() - worker.begun > self.timeout

    def _message(self, worker: _Worker) -> bytes | None:
        """Return what a worker says; nothing when it died."""
        try:
            return worker.pipe.recv_bytes()
        except (EOFError, OSError):
            return None

    def _rest(self, worker: _Worker, job: _Job) -> None:
        """Let a worker go that holds more than one that waits is counted with, twice over: what leaks, leaks for a while only."""
        held = resident(worker.process.pid or 0)
        if (job.need if held is None else held) > 2 * BASE:
            self._dismiss(worker)

    def _mourn(self, worker: _Worker, job: _Job) -> _Job | None:
        """Replace a worker that died; return the job to try it once more, or nothing when it was the second time."""
        late = self._late(worker)
        self._dismiss(worker)
        job.deaths.append("took too long" if late else _ended(worker.process))
        return None if late or len(job.deaths) > 1 else job

    def _dismiss(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join(1.0)
        worker.process.kill()
        worker.process.join()


def compiled() -> bool:
    """Tell whether numba has loops of ours in its cache, next to the sources or where its cache was put."""
    places = [Path(vsalog.__path__[0])]
    if "NUMBA_CACHE_DIR" in os.environ:
        places = [Path(os.environ["NUMBA_CACHE_DIR"])]
    return any(True for place in places for _ in place.rglob("*.nbi"))


def _lukewarm(waiting: Sequence[_Job]) -> int:
    """Return the index of the log to begin with: of ordinary size, for the smallest ones may be stumps."""
    return min(len(waiting) - 1, (3 * len(waiting)) // 4)


def _failure(job: _Job, kind: Kind, reason: str) -> Answer:
    return Answer(record=failed(job.task.log, job.task.settings, kind, reason, __version__))


def _lost(job: _Job) -> Answer:
    if job.deaths[-1] == "took too long":
        return _failure(
            job, "time", "took longer than --timeout allows; give more, or do a part with --start and --end"
        )
    return _failure(job, "killed", f"the process that worked on it {job.deaths[-1]}, twice")


def _ended(process: multiprocessing.process.BaseProcess) -> str:
    """Say how a process ended."""
    process.join(5.0)
    code = process.exitcode
    if code is None or code >= 0:
        return f"ended with code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was ended by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start a process that a terminal's Ctrl-C does not reach; one that comes meanwhile is ours as soon as it has started."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # It would let signals through again while it is started itself.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set variables that a process reads when it starts."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
