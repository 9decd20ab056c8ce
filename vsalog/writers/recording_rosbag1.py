"""Recordings as ROS 1 bags."""

from __future__ import annotations

from pathlib import Path

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from vsalog.core.recording import Recording
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_messages import merged_messages
from vsalog.writers.recording_topics import topics_of


def write_rosbag1(recording: Recording, path: Path | str) -> None:
    """Write a recording as a ROS 1 bag (version 2.0, bz2 chunks).

    A bag has no place for a rig: write it next to the bag, as ``NAME.rig.toml``.

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
    types = get_typestore(Stores.ROS1_NOETIC)
    with atomic_path(Path(path)) as temporary:
        # The library insists on a file that is not there yet.
        temporary.unlink()
        writer = Writer(temporary)
        writer.set_compression(Writer.CompressionFormat.BZ2)
        with writer:
            connections = [writer.add_connection(topic.name, topic.type, typestore=types) for topic in topics]
            for stamp, index, _, message in merged_messages(topics, cdr=False):
                writer.write(connections[index], stamp, message)
