"""Workers on other machines: an existing Dask cluster."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import Any

import msgspec

from vsalog.batch.pool import Job, Pool, Say
from vsalog.batch.records import Answer, Settings
from vsalog.batch.worker import check_settings
from vsalog.core.errors import BatchError


@dataclass(frozen=True, slots=True)
class Place:
    """Passes work to a cluster, with the interface of a local process."""

    executor: Executor
    active = True

    def schedule(self, function: Callable[..., Any], args: tuple[Any, ...], timeout: None = None) -> Future[Any]:
        """Give work to the scheduler."""
        return self.executor.submit(function, *args)

    def stop(self) -> None:
        """Leave: the scheduler drops tasks that have not begun once nobody waits for them."""

    join = stop


class Cluster(Pool):
    """Do tasks on a Dask cluster.

    The scheduler replaces workers that die and gives their logs to others. Results are renamed into place, so that a log that is
    done twice gives the same files as one that is done once.

    Parameters
    ----------
    address : of the scheduler
    say : called with what takes time

    Raises
    ------
    BatchError
        distributed is not installed, or nobody answers there.
    """

    def __init__(self, address: str, say: Say = lambda _: None) -> None:
        super().__init__(1, sys.maxsize, None, say)
        try:
            self._dask: Any = import_module("distributed")
        except ImportError:
            raise BatchError("--scheduler needs Dask: pip install 'vsalog[dask]'") from None
        # Dask logs tracebacks: errors arrive as exceptions, and are printed in one line.
        for name in logging.root.manager.loggerDict:
            if name.startswith(("distributed", "tornado")):
                logging.getLogger(name).setLevel(logging.CRITICAL)
        self.address = address
        self._lost = f"{address}: the connection to the scheduler was lost"
        try:
            self._client: Any = self._dask.Client(address, set_as_default=False, name="vsalog-batch")
        except (OSError, ValueError, TypeError) as error:
            raise BatchError(
                f"{address}: no Dask scheduler answers there ({str(error).splitlines()[0][:200]})"
            ) from error
        self._executor = self._client.get_executor(pure=False)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close(timeout=5)

    @property
    def jobs(self) -> int:
        """How many logs the scheduler knows: twice as many as are in progress, so that no worker waits for the next one."""
        try:
            return max(2 * self._threads(), 1)
        except OSError as error:
            if not self._busy:  # else the answers show it
                raise BatchError(self._lost) from error
            return 0

    def _threads(self) -> int:
        return sum(self._client.nthreads().values())

    def _is_compiled(self) -> bool:
        return True

    def _started(self) -> Any:
        return Place(self._executor)

    def _asked(self, settings: Settings) -> str:
        try:
            if not self._threads():
                self.say(f"{self.address} has no worker yet; waiting for one")
                patience = import_module("dask").config.get("distributed.comm.timeouts.connect")
                self._client.wait_for_workers(1, timeout=patience)
            return str(self._executor.submit(check_settings, msgspec.json.encode(settings)).result())
        except TimeoutError:
            raise BatchError(f"{self.address}: the scheduler has no workers; start some with 'dask worker'") from None
        except (OSError, CancelledError) as error:
            raise BatchError(self._lost) from error
        except Exception as error:
            raise BatchError(f"{self.address}: the workers cannot run vsalog: {self._words(error)}") from error

    def _answer(self, future: Future[bytes], job: Job) -> Answer:
        try:
            return msgspec.json.decode(future.result(), type=Answer)
        except CancelledError:
            return Answer(stop=f"{self._lost}, and with it the work in progress")
        except Exception as error:
            return job.failed("killed", self._words(error))

    def _words(self, error: Exception) -> str:
        if isinstance(error, self._dask.KilledWorker):
            return "the workers that worked on it died, one after the other"
        return f"{type(error).__name__}: {error}"
