"""Workers on this machine: a process each, one log at a time, replaced when they die."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec
from pebble import CONSTS, ProcessExpired, ProcessPool

from vsalog.batch.memory import BASE, expected
from vsalog.batch.records import Answer, Kind, Settings, Task, failed
from vsalog.batch.worker import check_settings, do_task, prepare
from vsalog.core.errors import BatchError
from vsalog.core.printable import size_text
from vsalog.report.compiling import ANNOUNCED

Say = Callable[[str], None]
Worker = ProcessPool
"""One process: in a pool of several, a death at the wrong moment is attributed to another (decision 14)."""


@dataclass(slots=True)
class Job:
    """A task, the memory [bytes] that it is expected to need, and how many workers died of it."""

    task: Task
    need: int
    deaths: int = 0

    def failed(self, kind: Kind, reason: str) -> Answer:
        """Return the answer of a task that failed without a result."""
        return Answer(record=failed(self.task, kind, reason))


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
        self._jobs = max(1, min(jobs, memory // BASE))
        self.memory, self.timeout, self.say = memory, timeout, say
        self._idle: list[Worker] = []
        self._busy: dict[Future[bytes], tuple[Job, Worker]] = {}

    def __enter__(self) -> Self:
        # All of them, so that they load in parallel, and while others prepare.
        self._idle = [self._started() for _ in range(self.jobs)]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _end([*self._idle, *(worker for _, worker in self._busy.values())])

    @property
    def jobs(self) -> int:
        """How many logs may be given to workers at a time."""
        return self._jobs

    def _is_compiled(self) -> bool:
        """Return whether numba has loops of vsalog in its cache, next to the sources or in its cache folder."""
        place = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1])
        return any(True for _ in place.rglob("*.nbi"))

    def _started(self) -> Worker:
        return _process()

    def check(self, settings: Settings) -> None:
        """Check the options in a worker, which has to load the libraries anyway.

        Raises
        ------
        BatchError
            An option is impossible.
        """
        error = self._asked(settings)
        if error is None:  # it is tried once more, as a log is
            _end([self._idle.pop(0)])
            self._idle.append(self._started())
            error = self._asked(settings)
        if error is None:
            raise BatchError("no worker could be started: it ended before it was ready")
        if error:
            raise BatchError(error)

    def _asked(self, settings: Settings) -> str | None:
        """Return a worker's answer; None where it died."""
        worker = self._idle[0]
        try:
            future = worker.schedule(check_settings, (msgspec.json.encode(settings),))
            while not wait([future], CONSTS.sleep_unit).done and worker.active:
                pass
            return future.result(0.0)
        except (OSError, RuntimeError):  # it expired, its pool broke, or it will never answer
            return None

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Answer]]:
        """Do tasks, those of large logs first; yield each with its answer as soon as it arrives.

        Where nothing is compiled yet, one after the other is done alone until loops are compiled, or each worker had one.
        """
        jobs = [Job(task, expected(task.log, task.settings)) for task in tasks]
        for job in jobs:
            if job.need > self.memory:
                what = f"a log of {size_text(job.task.log.size)} is expected to need {size_text(job.need)} of memory"
                advice = "allow more with --memory, or process a part with --start and --end"
                reason = f"{what}, but {size_text(self.memory)} are allowed: {advice}"
                yield job.task, job.failed("memory", reason)
        # From the large ones down, so that the last ones end together.
        waiting = [job for job in jobs if job.need <= self.memory]
        waiting.sort(key=lambda job: (-job.need, job.task.log.name))
        alone = 0
        if waiting and not self._is_compiled():
            self.say(ANNOUNCED)
            alone = min(self.jobs, len(waiting))
            # Of ordinary size, since the smallest ones may be incomplete.
            waiting.insert(0, waiting.pop(3 * len(waiting) // 4))
        while waiting or self._busy:
            self._hand_out(waiting, 1 if alone else self.jobs)
            for future in self._done():
                job, worker = self._busy.pop(future)
                answer = self._answer(future, job)
                self._keep(worker, answer)
                if answer is None:
                    waiting.append(job)
                    continue
                done = answer.record is not None and answer.record.status == "done"
                alone = 0 if done else max(alone - 1, 0)
                yield job.task, answer

    def _hand_out(self, waiting: list[Job], most: int) -> None:
        """Give logs to workers as long as their expected needs fit."""
        while (job := self._next(waiting, most)) is not None:
            waiting.remove(job)
            left = self.memory - job.need - sum(other.need for other, _ in self._busy.values())
            spare = 1 + max(left, 0) // BASE
            _end(self._idle[spare:])
            del self._idle[spare:]
            worker = self._idle.pop() if self._idle else self._started()
            if not worker.active:  # it died while it waited
                _end([worker])
                worker = self._started()
            future = worker.schedule(do_task, (msgspec.json.encode(job.task),), timeout=self.timeout)
            self._busy[future] = job, worker

    def _next(self, waiting: list[Job], most: int) -> Job | None:
        """Return the first log that may begin; one at which a worker died runs alone."""
        busy = [job for job, _ in self._busy.values()]
        if len(busy) >= most or any(job.deaths for job in busy):
            return None
        left = self.memory - sum(job.need for job in busy)
        return next((job for job in waiting if job.need <= left and not (job.deaths and busy)), None)

    def _done(self) -> list[Future[bytes]]:
        """Wait until a worker is done, or died; no longer than pebble does, since an interrupt may reach another thread."""
        done = wait(self._busy, CONSTS.sleep_unit, FIRST_COMPLETED).done
        # A task given to a worker that dies at this moment is never answered.
        return [f for f, (_, worker) in self._busy.items() if f in done or not worker.active]

    def _answer(self, future: Future[bytes], job: Job) -> Answer | None:
        """Return a worker's answer; None where the log is tried once more, because the worker died the first time."""
        error = future.exception() if future.done() else None
        if future.done() and error is None:
            return msgspec.json.decode(future.result(), type=Answer)
        if isinstance(error, TimeoutError):
            advice = "allow more, or process a part with --start and --end"
            return job.failed("time", f"took longer than --timeout allows; {advice}")
        job.deaths += 1
        end = _ended(error.exitcode) if isinstance(error, ProcessExpired) else "ended before it began"
        return None if job.deaths < 2 else job.failed("killed", f"the process that worked on it {end}, twice")

    def _keep(self, worker: Worker, answer: Answer | None) -> None:
        """Keep a worker for the next log, unless it died, or holds twice the memory of an idle one because of a leak."""
        if worker.active and answer is not None and answer.resident <= 2 * BASE:
            self._idle.append(worker)
        else:
            _end([worker])


def _process() -> Worker:
    """Start a worker that a terminal's Ctrl-C does not reach, nor its threads here: the waiting process ends it."""
    worker = ProcessPool(1, initializer=prepare, context=multiprocessing.get_context("spawn"))
    # It would unblock signals while it is started itself.
    resource_tracker.ensure_running()
    masked = hasattr(signal, "pthread_sigmask")
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masked else set()
    try:
        assert worker.active
    finally:
        if masked:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return worker


def _end(workers: Sequence[Worker]) -> None:
    for worker in workers:
        worker.stop()  # type: ignore[no-untyped-call]
    for worker in workers:
        worker.join()


def _ended(code: int) -> str:
    """Return how a process ended."""
    if code >= 0:
        return f"ended with code {code}"
    name = "SIGKILL (out of memory?)" if code == -signal.SIGKILL else signal.strsignal(-code)
    return f"was ended by {name}"
