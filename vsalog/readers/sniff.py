"""The format of a file, detected from its first bytes, never from its name."""

from __future__ import annotations

from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.printable import command, printable
from vsalog.readers.limits import GLANCE_BYTES, MOST_DAMAGED
from vsalog.readers.matlab_variables import is_v4
from vsalog.readers.rosbag2 import is_bag_folder
from vsalog.readers.table_folder import tables_in
from vsalog.readers.tables.source import DAMAGE, open_text, read_beginning, without_holes

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAGIC = (
    (b"\x89MCAP0\r\n", "mcap"),
    (b"#ROSBAG V", "rosbag1"),
    (b"SQLite format 3\0", "rosbag2"),
    (b"\x28\xb5\x2f\xfd", "rosbag2"),
    (b"PAR1", "parquet"),
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
)
_FOREIGN = (
    (_HDF5, "is an HDF5 file"),
    (b"PK\x03\x04", "is a zip archive (a spreadsheet?); unpack it, or export a spreadsheet as CSV"),
    (b"ULog\x01\x12\x35", "is a PX4 ULog file; convert it with 'ulog2csv' first"),
    (b"ARROW1\0\0", "is an Arrow IPC file; save it as Parquet"),
    (b"PARE", "is an encrypted Parquet file; decrypt it first"),
    (b"%PDF-", "is a PDF document"),
    (b"\x7fELF", "is a program"),
    (b"BZh", "is compressed with bzip2; unpack it first"),
    (b"\xfd7zXZ\0", "is compressed with xz; unpack it first"),
    (b"rosbag2_bagfile_information:", "describes a ROS 2 bag, but contains no data; name the folder it is in"),
    (b"<?xml", "is an XML document"),
)
_FIRST_BYTES = max(len(magic) for magic, _ in _MAGIC)
_BOMS = (b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf")


_CONTROL = bytes({*range(32)} - {*b"\t\n\v\f\r\x1b"})


def sniff(path: Path) -> str:
    """Return a file or folder's format: ``mcap``, ``rosbag1``, ``rosbag2``, ``rosbag2-folder``, ``table-folder``, ``parquet``,
    ``matlab`` or ``table``.

    Raises
    ------
    ReadError
        There is no such file, it cannot be opened, is empty or is nothing that can be read.
    """
    try:
        if path.is_dir():
            return _sniff_folder(path)
        if path.exists() and not path.is_file():  # to open a pipe would wait for its writer
            raise ReadError("is a pipe or a device, no file; write its output to a file first", path)
        with path.open("rb") as file:
            head = file.read(GLANCE_BYTES)
    except FileNotFoundError:
        raise ReadError("there is no such file", path) from None
    except PermissionError:
        raise ReadError("may not be read (permission denied)", path) from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        raise ReadError(f"cannot be opened: {getattr(error, 'strerror', None) or error}", path) from error
    return _sniff_head(path, head)


def _sniff_folder(path: Path) -> str:
    if is_bag_folder(path):
        return "rosbag2-folder"
    others = sorted(file for file in path.iterdir() if file.is_file() and _is_log(file))
    if others:
        raise ReadError(f"is a folder with logs; name one of them, such as {printable(str(others[0]))}", path)
    if tables_in(path):
        return "table-folder"
    below = any(file.is_dir() for file in path.iterdir())
    todo = f"; '{command('batch', path, '-o', 'out')}' takes all in folders below it" if below else ""
    raise ReadError(f"is a folder without a log: neither a bag nor tables are in it; name a log{todo}", path)


def _is_log(path: Path) -> bool:
    """Return whether a file is surely a log of its own, and no table."""
    try:
        with path.open("rb") as file:
            head = file.read(_FIRST_BYTES)
    except OSError:
        return False
    return any(head.startswith(magic) for magic, kind in _MAGIC if kind != "parquet")


def _sniff_head(path: Path, head: bytes) -> str:
    if not head:
        raise ReadError("is empty", path)
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            return kind
    if _HDF5 in head[:1024]:
        raise ReadError("is an HDF5 file, but none that MATLAB wrote; export its tables as Parquet or CSV", path)
    for magic, words in _FOREIGN:
        if head.startswith(magic):
            raise ReadError(f"{words}", path)
    if head.startswith(b"\x1f\x8b"):
        head = _gzip_head(path)
        if any(head.startswith(magic) for magic, _ in _MAGIC):
            raise ReadError("is a log compressed with gzip; unpack it first", path)
    if is_v4(head):
        return "matlab"
    if not looks_like_text(head):
        raise ReadError(
            "is of no known format; MCAP, ROS 1 and ROS 2 bags, CSV, Parquet and MATLAB files can be read", path
        )
    return "table"


def _gzip_head(path: Path) -> bytes:
    try:
        with open_text(path) as file:
            head = read_beginning(file, GLANCE_BYTES)
            if not head and not file.read(1):
                raise ReadError("is empty: it is compressed with gzip, and has no content", path)
    except DAMAGE:
        head = b""
    except OSError as error:
        raise ReadError(f"cannot be opened: {error.strerror or error}", path) from error
    if not head:
        raise ReadError("is compressed with gzip, but damaged: nothing can be decompressed", path)
    return head


def looks_like_text(head: bytes) -> bool:
    """Return whether bytes are text in UTF-8, UTF-16 with its mark, or a Latin encoding."""
    if not head.strip():
        return False
    if head.startswith(_BOMS):
        return True
    if head[0] and b"\n" in head:
        head = without_holes(head)
    control = len(head) - len(head.translate(None, _CONTROL))
    return head.count(0) <= MOST_DAMAGED * len(head) and 20 * control < len(head)
