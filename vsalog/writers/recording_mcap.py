"""Recordings as MCAP files with ROS 2 messages, as rosbag2, Foxglove and PlotJuggler open them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.writer import CompressionType, Writer

from vsalog.core.progress import Advanced, tell
from vsalog.core.recording import Recording
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_messages import merged_messages, typestore
from vsalog.writers.recording_topics import Topic, read_back_name, topics_of

# The metadata record that carries the rig, and its key.
RIG_RECORD, RIG_KEY = "vsalog.rig", "toml"


def write_mcap(recording: Recording, path: Path | str, rig_text: str | None = None, units: bool = False) -> None:
    """Write a recording as MCAP: profile ``ros2``, CDR messages, definitions embedded, zstd chunks.

    Parameters
    ----------
    recording : its channels are sorted into topics as `topics_of` says
    path : appears when all is written; replaced when it is there
    rig_text : the rig as TOML, kept in the metadata record ``vsalog.rig``; the recording's own when absent
    units : keep the units that the recording states as metadata of the MCAP channels, where the reader finds them

    Raises
    ------
    WriteError
        The file cannot be written, or the channels do not make topics.
    """
    stated = _stated_units(recording) if units else {}
    write_topics_mcap(topics_of(recording), path, rig_text or recording.rig_text, stated=stated)


def write_topics_mcap(
    topics: Sequence[Topic],
    path: Path | str,
    rig_text: str | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    stated: Mapping[str, Mapping[str, str]] | None = None,
) -> None:
    """Write topics as MCAP, in the order of time.

    Parameters
    ----------
    topics : each with its own stamps, which are log time, publish time and, where the message has one, header stamp
    path, rig_text : as for `write_mcap`
    metadata : further metadata records, name → key → text
    stated : metadata of the topics' channels, topic → key → text
    """
    records = {name: dict(entries) for name, entries in (metadata or {}).items()}
    if rig_text is not None:
        records[RIG_RECORD] = {RIG_KEY: rig_text}
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="vsalog")
        for name, entries in records.items():
            writer.add_metadata(name, entries)
        kinds = dict.fromkeys(topic.type for topic in topics)
        definitions = {kind: typestore(True).generate_msgdef(kind, ros_version=2)[0].encode() for kind in kinds}
        schemas = {kind: writer.register_schema(kind, "ros2msg", text) for kind, text in definitions.items()}
        channels = [
            writer.register_channel(topic.name, "cdr", schemas[topic.type], dict((stated or {}).get(topic.name, {})))
            for topic in topics
        ]
        total = sum(topic.stamps.size for topic in topics)
        for count, (stamp, index, sequence, message) in enumerate(merged_messages(topics, cdr=True)):
            if not count % BLOCK_ROWS:
                tell(Advanced("writing", count / total))
            # The sequence is a 32-bit number that may wrap around.
            writer.add_message(channels[index], stamp, message, stamp, sequence & 0xFFFFFFFF)
        writer.finish()  # type: ignore[no-untyped-call]


def _stated_units(recording: Recording) -> dict[str, dict[str, str]]:
    """Return the units as `vsalog.readers.message_reader` reads them: topic → ``unit:FIELD`` → unit."""
    found: dict[str, dict[str, str]] = {}
    for channel in recording.channels.values():
        if channel.unit is not None:
            # Neither topics nor the names of fields have dots.
            topic, _, field = read_back_name(channel.name).partition(".")
            found.setdefault(topic, {})[f"unit:{field}"] = channel.unit
    return found
