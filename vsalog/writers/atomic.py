"""Files that are whole or not there at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vsalog.errors import WriteError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; it becomes `path` when all went well and vanishes otherwise.

    Raises
    ------
    WriteError
        The folder is not there or cannot be written to, or the disk is full.
    """
    check_path(path)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=".vsalog-", suffix=".part", dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
        temporary = None
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()


def check_path(path: Path) -> None:
    """Refuse a path that no file can be written to.

    Raises
    ------
    WriteError
        The folder is not there, or the path is a folder or a device.
    """
    if not path.parent.is_dir():
        raise WriteError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise WriteError(f"{path}: is a folder; name a file")
    if path.exists() and not path.is_file():
        raise WriteError(f"{path}: is a device, not a file; name a file")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, as UTF-8."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
