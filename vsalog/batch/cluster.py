"""Workers on other machines: an existing Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from types import TracebackType
from typing import Any

import msgspec

from vsalog._version import __version__
from vsalog.batch.records import Answer, Settings, Task, failed
from vsalog.batch.worker import check_settings, do_task
from vsalog.core.errors import BatchError

# Dask's setting of how long whoever is asked may take to answer.
TIMEOUT = "distributed.comm.timeouts.connect"
# Dask's word for a task that failed; where fetching a result fails and it is any other, nobody answers.
ERRED = "error"


class Cluster:
    """Do tasks on a Dask cluster; a context manager with the methods of `vsalog.batch.pool.Pool`.

    Workers that die are the scheduler's affair: it gives their logs to others. What they write is renamed into place, so that a
    log that is done twice is the same as one that was done once.

    Parameters
    ----------
    address : of the scheduler
    say : called with what takes time

    Raises
    ------
    BatchError
        distributed is not installed, or nobody answers there.
    """

    def __init__(self, address: str, say: Callable[[str], None] = lambda _: None) -> None:
        try:
            distributed: Any = import_module("distributed")
        except ImportError:
            raise BatchError("--scheduler needs Dask: pip install 'vsalog[dask]'") from None
        _silence()
        self.address, self.say, self._distributed = address, say, distributed
        try:
            self._client: Any = distributed.Client(address, set_as_default=False, name="vsalog-batch")
        except (OSError, ValueError, TypeError) as error:
            raise BatchError(
                f"{address}: no Dask scheduler answers there ({str(error).splitlines()[0][:200]})"
            ) from error

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # What has not begun is forgotten by the scheduler with the last who waited for it.
        self._client.close(timeout=5)

    @property
    def _lost(self) -> str:
        return f"{self.address}: the connection to the scheduler was lost"

    @property
    def jobs(self) -> int:
        """How many logs are worked on at a time."""
        return sum(self._client.nthreads().values())

    def check(self, settings: Settings) -> None:
        """See on a worker whether what is asked for can be at all.

        Raises
        ------
        BatchError
            It cannot, or the scheduler has no worker, or is gone.
        """
        try:
            self._wait_for_worker()
            future = self._client.submit(check_settings, msgspec.json.encode(settings), pure=False)
        except OSError as error:
            raise BatchError(self._lost) from error
        try:
            said = future.result()
        except Exception as error:
            if future.status != ERRED:
                raise BatchError(self._lost) from error
            raise BatchError(f"{self.address}: the workers cannot run vsalog: {_words(error)}") from error
        if said:
            raise BatchError(said)

    def _wait_for_worker(self) -> None:
        if self.jobs:
            return
        self.say(f"{self.address} has no worker yet; waiting for one")
        try:
            self._client.wait_for_workers(1, timeout=import_module("dask").config.get(TIMEOUT))
        except TimeoutError:
            raise BatchError(f"{self.address}: the scheduler has no workers; start some with 'dask worker'") from None

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Answer]]:
        """Do tasks; yield each with its answer as soon as it is there."""
        # Large ones first, so that the last ones end together.
        waiting = sorted(tasks, key=lambda task: (task.log.size, task.log.name))
        known: dict[str, Task] = {}

        def submit() -> Any:
            task = waiting.pop()
            future = self._client.submit(do_task, msgspec.json.encode(task), pure=False)
            known[future.key] = task
            return future

        # The scheduler knows twice as many as are worked on: no worker waits for the next one.
        first = [submit() for _ in range(min(2 * self.jobs, len(waiting)))]
        done: Any = self._distributed.as_completed(first, loop=self._client.loop)
        for future in done:
            task = known.pop(future.key)
            yield task, self._answer(future, task)
            with suppress(OSError):  # where the scheduler is gone the answers say so
                while waiting and len(known) < 2 * self.jobs:
                    done.add(submit())

    def _answer(self, future: Any, task: Task) -> Answer:
        try:
            answer = future.result()
        except Exception as error:
            if future.status != ERRED:
                return Answer(stop=f"{self._lost}, and with it what was being worked on")
            return Answer(record=failed(task.log, task.settings, "killed", _words(error), __version__))
        return msgspec.json.decode(answer, type=Answer)


def _silence() -> None:
    """Keep what Dask logs, which is tracebacks, from the terminal: what matters comes as exceptions, and is a line."""
    for name in logging.root.manager.loggerDict:
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _words(error: Exception) -> str:
    from distributed.scheduler import KilledWorker

    if isinstance(error, KilledWorker):
        return "the workers that worked on it died, one after the other"
    return f"{type(error).__name__}: {error}"
