"""Where a batch's files lie: a folder, or whatever fsspec opens. A file is there as a whole, or not at all."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from vsalog.batch.names import shown
from vsalog.core.errors import BatchError

# Files that are being written: next to the data set and not in it, since readers take all files of a data set for data.
SCRATCH = ".scratch"
# What a run that was killed at once may leave of a batch that has not begun.
OURS = (SCRATCH, ".lock")
_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)


class StoreError(BatchError):
    """Nothing can be written where the batch is: the run ends."""


class Store(Protocol):
    """Files by names relative to the batch, with slashes; all methods raise `StoreError` where the storage fails."""

    shown: str

    def put(self, source: Path, name: str) -> None:
        """Move a file into the batch, over one that is there."""

    def write(self, name: str, data: bytes) -> None:
        """Write a file, over one that is there."""

    def read(self, name: str) -> bytes | None:
        """Return what a file holds; None where there is none."""

    def size(self, name: str) -> int | None:
        """Return a file's size [bytes]; None where there is none."""

    def files(self, below: str) -> list[str]:
        """Return the names of all files below a folder, sorted; of none where there is no such folder."""

    def remove(self, name: str) -> None:
        """Remove a file, and the folders above it that hold nothing any more."""

    def scratch(self) -> Any:
        """Return a context with a folder to write files in before they are put."""

    def clear_scratch(self) -> None:
        """Make the place to write in, and clear away what a killed process was writing there."""

    def empty(self) -> bool:
        """Tell whether nothing is there."""


def is_address(text: str) -> bool:
    """Tell an address (s3://…) from a path."""
    return _ADDRESS.match(text) is not None


def open_store(out: str) -> Store:
    """Open the place of a batch.

    Parameters
    ----------
    out : a folder, or an address

    Raises
    ------
    StoreError
        There is no such kind of address, or what it needs is not installed.
    """
    if out.startswith("file://"):
        out = out.removeprefix("file://")
    return RemoteStore(out) if is_address(out) else LocalStore(Path(out))


@contextmanager
def _explained(where: str) -> Iterator[None]:
    """Turn what a storage raises, which may be of any kind, into one line."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{where}: cannot be written: {error.strerror or error}") from error
    except Exception as error:
        raise StoreError(f"{where}: {type(error).__name__}: {error}") from error


class LocalStore:
    """A folder."""

    def __init__(self, root: Path) -> None:
        self.root, self.shown = root, shown(str(root))

    def put(self, source: Path, name: str) -> None:
        """See `Store`."""
        with _explained(self.shown):
            target = self.root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            source.replace(target)

    def write(self, name: str, data: bytes) -> None:
        """See `Store`."""
        with self.scratch() as folder, _explained(self.shown):
            (folder / "file").write_bytes(data)
            self.put(folder / "file", name)

    def read(self, name: str) -> bytes | None:
        """See `Store`."""
        try:
            return (self.root / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            return None
        except OSError as error:
            raise StoreError(f"{self.root / name}: cannot be read: {error.strerror}") from error

    def size(self, name: str) -> int | None:
        """See `Store`."""
        try:
            return (self.root / name).stat().st_size
        except OSError:
            return None

    def files(self, below: str) -> list[str]:
        """See `Store`."""
        top = self.root / below
        found = (Path(folder, file) for folder, _, files in os.walk(top) for file in files)
        return sorted(path.relative_to(self.root).as_posix() for path in found)

    def remove(self, name: str) -> None:
        """See `Store`."""
        path = self.root / name
        with _explained(self.shown):
            path.unlink(missing_ok=True)
            for folder in path.parents:
                if folder == self.root or any(folder.iterdir()):
                    break
                folder.rmdir()

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """See `Store`."""
        with _explained(self.shown):
            above = self.root / SCRATCH
            above.mkdir(parents=True, exist_ok=True)
            folder = Path(tempfile.mkdtemp(dir=above))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def clear_scratch(self) -> None:
        """See `Store`."""
        with _explained(self.shown):
            shutil.rmtree(self.root / SCRATCH, ignore_errors=True)
            (self.root / SCRATCH).mkdir(parents=True, exist_ok=True)

    def empty(self) -> bool:
        """See `Store`."""
        if self.root.exists() and not self.root.is_dir():
            raise StoreError(f"{self.root}: is a file, no folder; name a folder for the batch with -o")
        return not self.root.exists() or all(path.name.startswith(OURS) for path in self.root.iterdir())


class RemoteStore:
    """An address that fsspec opens; object stores show an object when it is whole."""

    def __init__(self, address: str) -> None:
        self.shown = shown(address.rstrip("/"))
        self.system, self.root = file_system(address.rstrip("/"))

    def _at(self, name: str) -> str:
        return f"{self.root}/{name}"

    def put(self, source: Path, name: str) -> None:
        """See `Store`."""
        with _explained(self.shown):
            if "s3" in self.system.protocol or "gs" in self.system.protocol or "abfs" in self.system.protocol:
                self.system.put_file(str(source), self._at(name))
                return
            # A server of files shows them while they grow.
            self.system.makedirs(self._at(name).rsplit("/", 1)[0], exist_ok=True)
            scratch = self._at(f"{SCRATCH}-{os.getpid()}-{source.name}")
            self.system.put_file(str(source), scratch)
            self.system.mv(scratch, self._at(name))

    def write(self, name: str, data: bytes) -> None:
        """See `Store`."""
        with self.scratch() as folder:
            (folder / "file").write_bytes(data)
            self.put(folder / "file", name)

    def read(self, name: str) -> bytes | None:
        """See `Store`."""
        with _explained(self.shown):
            try:
                self.system.invalidate_cache()
                data = self.system.cat_file(self._at(name))
            except FileNotFoundError:
                return None
            return bytes(data)

    def size(self, name: str) -> int | None:
        """See `Store`."""
        with _explained(self.shown):
            try:
                return int(self.system.info(self._at(name))["size"])
            except FileNotFoundError:
                return None

    def files(self, below: str) -> list[str]:
        """See `Store`."""
        with _explained(self.shown):
            self.system.invalidate_cache()
            try:
                found = self.system.find(self._at(below))
            except FileNotFoundError:
                return []
            cut = len(self.root.rstrip("/")) + 1
            return sorted(str(path)[cut:] for path in found)

    def remove(self, name: str) -> None:
        """See `Store`."""
        with _explained(self.shown):
            self.system.rm_file(self._at(name))

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """See `Store`."""
        with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
            yield Path(folder)

    def clear_scratch(self) -> None:
        """See `Store`."""

    def empty(self) -> bool:
        """See `Store`."""
        with _explained(self.shown):
            try:
                found = self.system.ls(self.root, detail=False, refresh=True)
                return all(str(path).rsplit("/", 1)[-1].startswith(OURS) for path in found)
            except FileNotFoundError:
                return True


def file_system(address: str) -> tuple[Any, str]:
    """Return what opens an address, and the path in it.

    Raises
    ------
    StoreError
        There is no such kind of address, or what it needs is not installed.
    """
    try:
        import fsspec
    except ImportError:
        raise StoreError(f"{address}: addresses need fsspec: pip install 'vsalog[s3]' for s3://") from None
    try:
        system, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise StoreError(f"{address}: cannot be opened: {error}") from error
    return system, str(path).rstrip("/")
