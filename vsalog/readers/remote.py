"""Remote logs: downloaded once, and read as files."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.printable import LONGEST_NAME

_ADDRESS = re.compile(r"([a-z][a-z0-9+.-]+):(/+)(.+)", re.IGNORECASE)
"""An address as people write it, or with one slash, to which a path reduces two."""

_folders: list[tempfile.TemporaryDirectory[str]] = []
"""The downloaded files; removed at the end of the run."""


def is_address(path: Path) -> bool:
    """Return whether a path is an address and no file."""
    return _ADDRESS.fullmatch(str(path)) is not None and not path.exists()


def local(path: Path) -> Path:
    """Return a log's file or folder: the path itself, or what was downloaded from the address that it is.

    Parameters
    ----------
    path : Path
        Of a file, or an address such as ``s3://bucket/log.mcap``; one of two slashes may have been lost.

    Raises
    ------
    ReadError
        The library for such an address is not installed; the log does not exist; or it cannot be downloaded.
    """
    return _fetched(str(path)) if is_address(path) else path


@cache
def _fetched(text: str) -> Path:
    protocol, slashes, rest = _ADDRESS.fullmatch(text).groups()  # type: ignore[union-attr]
    folder = tempfile.TemporaryDirectory(prefix="vsalog-")
    _folders.append(folder)
    return download(f"{protocol}:{slashes if len(slashes) > 2 else '//'}{rest}", text, Path(folder.name))


def download(address: str, text: str, folder: Path) -> Path:
    """Copy a log, a file or the files of a folder, and return where it is.

    Parameters
    ----------
    address : of the log
    text : its name in messages
    folder : an empty one to copy it into

    Raises
    ------
    ReadError
        The library for such an address is not installed; the log does not exist; or it cannot be downloaded.
    """
    import fsspec

    # The name is only ever one of a file in this folder, whatever the store calls the object.
    bare = re.sub(r"[?#].*", "", address) if address.lower().startswith("http") else address
    name = bare.rstrip("/").rpartition("/")[2]
    plain = name not in ("", ".", "..") and "\0" not in name and len(os.fsencode(name)) <= LONGEST_NAME
    target = folder / (name if plain else "log")
    try:
        system, where = fsspec.core.url_to_fs(address)
        if system.isdir(where):
            target.mkdir()
            files = {Path(one["name"]).name: one for one in system.ls(where, detail=True) if one["type"] == "file"}
        else:
            files = {"": system.info(where)}
        _check_room(text, sum(int(one.get("size") or 0) for one in files.values()), str(folder))
        for own, one in files.items():
            system.get_file(one["name"] if own else where, str(target / own if own else target))
    except FileNotFoundError:
        raise ReadError(f"{text}: there is no such file") from None
    except ReadError:
        raise
    except Exception as error:  # of as many kinds as there are protocols
        words = " ".join(str(error).split())[:300] or type(error).__name__
        raise ReadError(f"{text}: cannot be downloaded: {words}") from error
    return target


def _check_room(text: str, size: int, folder: str) -> None:
    free = shutil.disk_usage(folder).free
    if size > free:
        raise ReadError(
            f"{text}: has {size // 2**20} MiB, and {folder} only {free // 2**20} MiB left to download it to;"
            " TMPDIR names another place"
        )


def downloaded(path: Path) -> Finding:
    """Return that a log was downloaded."""
    files: Any = path.iterdir() if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files) / 2**20
    return Finding(code="recording.downloaded", severity="info", value=size, unit="MiB")
