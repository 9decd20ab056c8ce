"""One run at a time in a batch: a lock that no kill leaves behind."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from vsalog.batch.storage import LocalStore, RemoteStore, Store, StoreError
from vsalog.core.errors import BatchError

NAME = ".lock"
BEAT = 20.0
"""Seconds between two renewals of a lock in an object store; an owner that misses four, within two minutes, counts as dead."""


@contextmanager
def locked(store: Store, shard: tuple[int, int] | None) -> Iterator[None]:
    """Keep other runs out of a batch while the context lasts; different shards of one array get along.

    Raises
    ------
    BatchError
        Another run is at it.
    """
    with ExitStack() as stack:
        if isinstance(store, LocalStore):
            stack.enter_context(_flock(store, NAME, shared=shard is not None))
            if shard is not None:
                stack.enter_context(_flock(store, f"{NAME}-{shard[0]}-of-{shard[1]}", shared=False))
        elif isinstance(store, RemoteStore):
            part = "" if shard is None else f"-{shard[0]}-of-{shard[1]}"
            stack.enter_context(_beating(store, f"{NAME}{part}"))
        yield


@contextmanager
def one_after_the_other(store: Store) -> Iterator[None]:
    """Wait for others that are finishing; in an object store there is nothing to wait with."""
    with ExitStack() as stack:
        if isinstance(store, LocalStore):
            stack.enter_context(_flock(store, f"{NAME}-summary", shared=False, patient=True))
        yield


@contextmanager
def _flock(store: LocalStore, name: str, shared: bool, patient: bool = False) -> Iterator[None]:
    """Lock a file as the kernel does: it is free again when the process is gone, however it went."""
    try:
        import fcntl
    except ImportError:  # no such locks on this system
        yield
        return
    path = store.root / name
    try:
        file = path.open("a+")
    except OSError as error:
        raise StoreError(f"{store.shown}: cannot be written: {error.strerror}") from error
    with file:
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(file, kind if patient else kind | fcntl.LOCK_NB)
        except BlockingIOError:
            raise _taken(store, _said(file)) from None
        except OSError:  # a file system without locks
            yield
            return
        if not shared and not patient:
            file.seek(0)
            file.truncate()
            file.write(json.dumps(_me()))
            file.flush()
        try:
            yield
        finally:
            if not shared and not patient:
                with suppress(OSError):
                    file.truncate(0)


def _said(file: IO[str]) -> dict[str, object]:
    file.seek(0)
    with suppress(ValueError, OSError):
        owner = json.loads(file.read(1000))
        if isinstance(owner, dict):
            return owner
    return {}


def _me() -> dict[str, object]:
    return {"host": socket.gethostname(), "process": os.getpid()}


def _taken(store: Store, owner: dict[str, object]) -> BatchError:
    who = f" (process {owner['process']} on {owner['host']})" if {"process", "host"} <= set(owner) else ""
    return BatchError(f"{store.shown}: another run is writing there{who}; wait for it, or name another folder with -o")


@contextmanager
def _beating(store: RemoteStore, name: str) -> Iterator[None]:
    """Hold an object that is written again and again."""
    held = store.read(name)
    if held is not None and (owner := _alive(held)):
        raise _taken(store, owner)
    ended = threading.Event()

    def sign() -> None:
        store.write(name, json.dumps(_me() | {"at": time.time()}).encode())

    def beat() -> None:
        while not ended.wait(BEAT):
            with suppress(StoreError):
                sign()

    sign()
    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        with suppress(StoreError):
            store.remove(name)


def _alive(held: bytes) -> dict[str, object]:
    """Return whose lock it is; nothing where its owner is gone."""
    try:
        owner = json.loads(held)
        age = time.time() - float(owner["at"])
        mine = owner["host"] == socket.gethostname()
        process = int(owner["process"])
    except (ValueError, TypeError, KeyError):
        return {}
    if age > 4.0 * BEAT or (mine and not Path(f"/proc/{process}").exists() and Path("/proc").is_dir()):
        return {}
    return dict(owner)
