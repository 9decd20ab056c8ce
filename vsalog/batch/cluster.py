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
            self._dask: Any = import_module("distributed")
        except ImportError:
            raise BatchError("--scheduler needs Dask: pip install 'vsalog[dask]'") from None
        # What Dask logs is tracebacks: what matters comes as exceptions, and is a line.
        for name in logging.root.manager.loggerDict:
            if name.startswith("distributed"):
                logging.getLogger(name).setLevel(logging.CRITICAL)
        self.address, self.say = address, say
        self._lost = f"{address}: the connection to the scheduler was lost"
        try:
            self._client: Any = self._dask.Client(address, set_as_default=False, name="vsalog-batch")
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
            if not self.jobs:
                self.say(f"{self.address} has no worker yet; waiting for one")
                patience = import_module("dask").config.get("distributed.comm.timeouts.connect")
                self._client.wait_for_workers(1, timeout=patience)
            future = self._client.submit(check_settings, msgspec.json.encode(settings), pure=False)
        except TimeoutError:
            raise BatchError(f"{self.address}: the scheduler has no workers; start some with 'dask worker'") from None
        except OSError as error:
            raise BatchError(self._lost) from error
        try:
            said = future.result()
        except Exception as error:
            if future.status != ERRED:
                raise BatchError(self._lost) from error
            raise BatchError(f"{self.address}: the workers cannot run vsalog: {self._words(error)}") from error
        if said:
            raise BatchError(said)

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Answer]]:
        """Do tasks; yield each with its answer as soon as it is there."""
        # Large ones first, so that the last ones end together.
        waiting = sorted(tasks, key=lambda task: (task.log.size, task.log.name))
        known: dict[str, Task] = {}
        done: Any = self._dask.as_completed(loop=self._client.loop)

        def submit() -> None:
            # The scheduler knows twice as many as are worked on: no worker waits for the next one.
            while waiting and len(known) < 2 * self.jobs:
                task = waiting.pop()
                future = self._client.submit(do_task, msgspec.json.encode(task), pure=False)
                known[future.key] = task
                done.add(future)

        submit()
        for future in done:
            task = known.pop(future.key)
            yield task, self._answer(future, task)
            with suppress(OSError):  # where the scheduler is gone the answers say so
                submit()

    def _answer(self, future: Any, task: Task) -> Answer:
        try:
            return msgspec.json.decode(future.result(), type=Answer)
        except Exception as error:
            if future.status != ERRED:
                return Answer(stop=f"{self._lost}, and with it what was being worked on")
            return Answer(record=failed(task.log, task.settings, "killed", self._words(error), __version__))

    def _words(self, error: Exception) -> str:
        if isinstance(error, self._dask.KilledWorker):
            return "the workers that worked on it died, one after the other"
        return f"{type(error).__name__}: {error}"
