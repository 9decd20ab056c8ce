"""The storage of a batch and its logs: a folder, or whatever fsspec opens. A file exists as a whole, or not at all."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from vsalog.batch.names import shown
from vsalog.core.errors import BatchError

# Files that are being written: next to the data set and not in it, since readers take all files of a data set for data.
SCRATCH = ".scratch"
LOCK = ".lock"
_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)
_OBJECTS = {"s3", "gs", "abfs"}
_NOTHING = (FileNotFoundError, NotADirectoryError, IsADirectoryError)


class StoreError(BatchError):
    """Nothing can be written where the batch is: the run ends."""


def is_address(text: str) -> bool:
    """Return whether it is an address (s3://…) and not a path."""
    return _ADDRESS.match(text) is not None


def file_system(place: str) -> tuple[Any, str]:
    """Return the file system of a path or an address, and the path in it, which is absolute.

    Raises
    ------
    StoreError
        There is no such kind of address, or what it needs is not installed.
    """
    if not is_address(place):
        return fsspec.filesystem("file"), Path(place).absolute().as_posix()
    try:
        system, path = fsspec.core.url_to_fs(place)
    except (ImportError, ValueError) as error:
        raise StoreError(f"{place}: cannot be opened: {error}") from error
    return system, str(path).rstrip("/")


def is_local(system: Any) -> bool:
    """Return whether it is the local file system and no object store."""
    return isinstance(system, LocalFileSystem)


def address(system: Any, path: str) -> str:
    """Return what `file_system` opens as this path."""
    return path if is_local(system) else str(system.unstrip_protocol(path))


@contextmanager
def explained(where: str, what: str = "written") -> Iterator[None]:
    """Turn an exception of a storage, of any kind, into one line."""
    try:
        yield
    except BatchError:
        raise
    except OSError as error:
        raise StoreError(f"{where}: cannot be {what}: {error.strerror or error}") from error
    except Exception as error:
        raise StoreError(f"{where}: cannot be {what}: {type(error).__name__}: {error}") from error


class Store:
    """Files by names relative to the batch, with slashes; all methods raise `StoreError` where the storage fails.

    Parameters
    ----------
    out : a folder, or an address

    Raises
    ------
    StoreError
        There is no such kind of address, or what it needs is not installed.
    """

    def __init__(self, out: str) -> None:
        self.shown = shown(out.rstrip("/") if is_address(out) else str(Path(out)))
        self._system, self._root = file_system(out)

    @property
    def address(self) -> str:
        """The URL of this place, for this machine and others that see it."""
        return address(self._system, self._root)

    def _at(self, name: str) -> str:
        return f"{self._root}/{name}"

    def put(self, source: Path, name: str) -> None:
        """Move a file into the batch, over one that is there."""
        target, draft = self._at(name), str(source)
        with explained(self.shown):
            if not _OBJECTS.isdisjoint(self._system.protocol):
                # Object stores show an object when it is whole.
                self._system.put_file(draft, target)
                return
            self._system.makedirs(target.rsplit("/", 1)[0], exist_ok=True)
            if not is_local(self._system):
                draft = self._at(f"{SCRATCH}-{os.getpid()}-{source.name}")
                self._system.put_file(str(source), draft)
            self._system.mv(draft, target)

    def write(self, name: str, data: bytes) -> None:
        """Write a file, over one that is there."""
        with self.scratch() as folder, explained(self.shown):
            (folder / "file").write_bytes(data)
            self.put(folder / "file", name)

    def read(self, name: str) -> bytes | None:
        """Return a file's content; None where there is none."""
        with explained(f"{self.shown}/{name}", "read"):
            self._system.invalidate_cache()
            with suppress(*_NOTHING):
                return bytes(self._system.cat_file(self._at(name)))
        return None

    def size(self, name: str) -> int | None:
        """Return a file's size [bytes]; None where there is none."""
        with explained(f"{self.shown}/{name}", "read"), suppress(*_NOTHING):
            return int(self._system.info(self._at(name))["size"])
        return None

    def files(self, below: str) -> list[str]:
        """Return the names of all files below a folder, sorted; of none where there is no such folder."""
        with explained(self.shown, "read"), suppress(*_NOTHING):
            self._system.invalidate_cache()
            return sorted(str(path)[len(self._root) + 1 :] for path in self._system.find(self._at(below)))
        return []

    def names(self) -> list[str]:
        """Return the names of the batch's top-level entries."""
        with explained(self.shown, "read"), suppress(*_NOTHING):
            self._system.invalidate_cache()
            if self._system.isfile(self._root):
                raise StoreError(f"{self.shown}: is a file, no folder; name a folder for the batch with -o")
            return [str(path).rstrip("/").rsplit("/", 1)[-1] for path in self._system.ls(self._root, detail=False)]
        return []

    def remove(self, name: str) -> None:
        """Remove a file, and the folders above it that are empty then."""
        with explained(self.shown):
            with suppress(FileNotFoundError):
                self._system.rm_file(self._at(name))
            if is_local(self._system):
                for folder in Path(name).parents[:-1]:
                    with suppress(OSError):  # it is not empty
                        Path(self._root, folder).rmdir()

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Give a folder to write files in before they are put: on the same file system, if possible."""
        above = self._at(SCRATCH) if is_local(self._system) else None
        with explained(self.shown):
            if above is not None:
                self._system.makedirs(above, exist_ok=True)
            folder = Path(tempfile.mkdtemp(prefix="vsalog-", dir=above))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def clear_scratch(self) -> None:
        """Remove the unfinished files of a killed process."""
        if is_local(self._system):
            shutil.rmtree(self._at(SCRATCH), ignore_errors=True)

    def empty(self) -> bool:
        """Return whether it is empty, except for files of a run that was killed before it began."""
        return all(name.startswith((SCRATCH, LOCK)) for name in self.names())
