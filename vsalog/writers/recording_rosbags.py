"""Recordings as bags: of ROS 1, a file; of ROS 2, a folder of one SQLite file and its metadata.

A bag has no place for a rig: write it next to the bag, as ``NAME.rig.toml``.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.rosbag2.errors import WriterError

from vsalog.core.errors import WriteError
from vsalog.core.recording import Recording
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_messages import merged_messages, typestore
from vsalog.writers.recording_topics import Topic, topics_of


def write_rosbag1(recording: Recording, path: Path | str) -> None:
    """Write a recording as a ROS 1 bag (version 2.0, bz2 chunks).

    Parameters
    ----------
    recording : its channels are sorted into topics as `topics_of` says
    path : appears when all is written; replaced when it is there

    Raises
    ------
    WriteError
        The file cannot be written, or the channels do not make topics.
    """
    topics = topics_of(recording)
    with atomic_path(Path(path)) as temporary:
        # The library requires a file that does not exist yet.
        temporary.unlink()
        writer = rosbag1.Writer(temporary)
        writer.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
        _write(writer, topics, cdr=False)


def write_rosbag2(recording: Recording, path: Path | str) -> None:
    """Write a recording as the folder of a ROS 2 bag: ``NAME.db3`` (sqlite3) and ``metadata.yaml``.

    Parameters
    ----------
    recording : its channels are sorted into topics as `topics_of` says
    path : the folder, which must not exist yet; it appears when all is written

    Raises
    ------
    WriteError
        The folder exists already or cannot be written, or the channels do not make topics.
    """
    folder = Path(path)
    check_folder(folder)
    topics = topics_of(recording)
    temporary: str | None = None
    try:
        temporary = tempfile.mkdtemp(prefix=".vsalog-", suffix=".part", dir=folder.parent)
        # The library names the files after the folder it is given.
        made = Path(temporary) / folder.name
        # Version 8 is read by ROS 2 Iron and all later ones.
        _write(rosbag2.Writer(made, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3), topics, cdr=True)
        made.rename(folder)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except (sqlite3.Error, WriterError) as error:
        raise WriteError(f"{folder}: cannot be written: {error}") from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _write(writer: Any, topics: Sequence[Topic], cdr: bool) -> None:
    with writer:
        connections = [writer.add_connection(topic.name, topic.type, typestore=typestore(cdr)) for topic in topics]
        for stamp, index, _, message in merged_messages(topics, cdr):
            writer.write(connections[index], stamp, message)


def check_folder(folder: Path) -> None:
    """Refuse a folder that a bag cannot be written to.

    Raises
    ------
    WriteError
        It exists already, its parent does not, or SQLite cannot name it.
    """
    if folder.exists() or folder.is_symlink():
        raise WriteError(f"{folder}: exists already; remove it or name another folder")
    if not folder.parent.is_dir():
        raise WriteError(f"{folder}: the folder {folder.parent} does not exist")
    # The library makes a URI of the path, in which these have another meaning.
    if any(c in os.fspath(folder) for c in "?#%"):
        raise WriteError(f"{folder}: the path of a ROS 2 bag must not contain any of ? # %")
    try:
        os.fspath(folder).encode()
    except UnicodeEncodeError:
        raise WriteError(f"{folder}: the path of a ROS 2 bag must be UTF-8") from None
