"""One run at a time in a batch: heartbeats, which expire soon after a kill."""

from __future__ import annotations

import os
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from vsalog.batch.storage import LOCK, Store, StoreError
from vsalog.core.errors import BatchError

BEAT = 20.0
"""Seconds between two heartbeats; a run that misses four counts as dead."""


class Owner(msgspec.Struct, frozen=True, kw_only=True):
    """A run that is active in a batch, by its heartbeat.

    Attributes
    ----------
    host, process : whose it is
    share : of a job array, "2-of-7"; nothing where it is the whole batch
    at : time of the last heartbeat [s since 1970]
    """

    host: str
    process: int
    share: str = ""
    at: float

    def alive(self) -> bool:
        """Return whether it is still active."""
        if time.time() - self.at > 4.0 * BEAT:
            return False
        if self.host != socket.gethostname() or not Path("/proc").is_dir():
            return True
        return self.process != os.getpid() and Path(f"/proc/{self.process}").exists()


@contextmanager
def locked(store: Store, shard: tuple[int, int] | None) -> Iterator[None]:
    """Keep other runs out of a batch while the context lasts; different shares of one array may run together.

    Raises
    ------
    BatchError
        Another run is active.
    """
    name = f"{LOCK}-{secrets.token_hex(8)}"
    share = "" if shard is None else f"{shard[0]}-of-{shard[1]}"
    ended = threading.Event()

    def sign() -> None:
        owner = Owner(host=socket.gethostname(), process=os.getpid(), share=share, at=time.time())
        store.write(name, msgspec.json.encode(owner))

    def beat() -> None:
        while not ended.wait(BEAT):
            with suppress(StoreError):
                sign()

    thread = threading.Thread(target=beat, daemon=True)
    try:
        # The second run sees the first: both have written a heartbeat before they check.
        sign()
        _look(store, name, share)
        thread.start()
        yield
    finally:
        ended.set()
        if thread.is_alive():
            thread.join()
        with suppress(StoreError):
            store.remove(name)


def _look(store: Store, mine: str, share: str) -> None:
    """Refuse a batch where another run is active, and remove the files of dead ones."""
    for name in store.names():
        if not name.startswith(LOCK) or name == mine:
            continue
        try:
            owner = msgspec.json.decode(store.read(name) or b"", type=Owner)
        except msgspec.DecodeError:
            owner = None
        if owner is None or not owner.alive():
            store.remove(name)
        elif not (share and owner.share) or share == owner.share:
            raise BatchError(
                f"{store.shown}: another run is writing there (process {owner.process} on {owner.host});"
                " wait for it, or name another folder with -o"
            )
