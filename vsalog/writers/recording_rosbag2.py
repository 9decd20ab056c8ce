"""Recordings as ROS 2 bags: a folder of one SQLite file and its metadata."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore

from vsalog.core.errors import WriteError
from vsalog.core.recording import Recording
from vsalog.writers.recording_messages import merged_messages
from vsalog.writers.recording_topics import topics_of


def write_rosbag2(recording: Recording, path: Path | str) -> None:
    """Write a recording as the folder of a ROS 2 bag: ``NAME.db3`` (sqlite3) and ``metadata.yaml``.

    A bag has no place for a rig: write it next to the folder, as ``NAME.rig.toml``.

    Parameters
    ----------
    recording : its channels are sorted into topics as `topics_of` says
    path : the folder, which must not be there yet; it appears when all is written

    Raises
    ------
    WriteError
        The folder is there already or cannot be written, or the channels do not make topics.
    """
    folder = Path(path)
    check_folder(folder)
    topics = topics_of(recording)
    types = get_typestore(Stores.ROS2_HUMBLE)
    temporary: str | None = None
    try:
        temporary = tempfile.mkdtemp(prefix=".vsalog-", suffix=".part", dir=folder.parent)
        # The library names the files after the folder it is given.
        made = Path(temporary) / folder.name
        # Version 8 is read by ROS 2 Iron and all later ones.
        with Writer(made, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
            connections = [writer.add_connection(topic.name, topic.type, typestore=types) for topic in topics]
            for stamp, index, _, message in merged_messages(topics, cdr=True):
                writer.write(connections[index], stamp, message)
        made.rename(folder)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except (sqlite3.Error, WriterError) as error:
        raise WriteError(f"{folder}: cannot be written: {error}") from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def check_folder(folder: Path) -> None:
    """Refuse a folder that a bag cannot be written to.

    Raises
    ------
    WriteError
        It is there already, what it lies in is not, or SQLite cannot name it.
    """
    if folder.exists() or folder.is_symlink():
        raise WriteError(f"{folder}: is there already; remove it or name another folder")
    if not folder.parent.is_dir():
        raise WriteError(f"{folder}: the folder {folder.parent} does not exist")
    # The library makes an address of the path, in which these mean something else.
    if any(c in os.fspath(folder) for c in "?#%"):
        raise WriteError(f"{folder}: the path of a ROS 2 bag must not contain any of ? # %")
    try:
        os.fspath(folder).encode()
    except UnicodeEncodeError:
        raise WriteError(f"{folder}: the path of a ROS 2 bag must be UTF-8") from None
