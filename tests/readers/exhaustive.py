"""Compare every number of every message of logs: read fast, message by message, and by the library.

    PYTHONPATH=tests/readers python tests/readers/exhaustive.py LOG...

MCAP files and ROS bags; of folders, all that are in them. Exits with 1 where a number differs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from random_messages import STORES, numbers, same_number, stamp_of
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from vsalog.core.errors import ReadError
from vsalog.readers import open_container
from vsalog.readers.compressed_messages import plain
from vsalog.readers.message_definitions import DefinitionError, normal_type, parse_definition
from vsalog.readers.messages import RosDecoder
from vsalog.readers.sniff import sniff

BAGS = ("mcap", "rosbag1", "rosbag2", "rosbag2-folder")


def compare(path, every=1):
    """Return how many numbers of a log were compared, and where they differ; of each topic every so many-th message."""
    container = open_container(path, sniff(path))
    topics = {one.id: _Topic(one) for one in container.connections() if one.encoding in ("cdr", "ros1")}
    for packet in map(plain, container.packets(list(topics))):
        for number in np.unique(packet.connection).tolist():
            rows = np.flatnonzero(packet.connection == number)
            topics[number].compare(packet.messages.some(topics[number].chosen(rows, every)))
    return sum(topic.count for topic in topics.values()), [words for topic in topics.values() for words in topic.wrong]


class _Topic:
    def __init__(self, connection):
        self.count, self.wrong, self._seen = 0, [], 0
        self._name, self._ros1 = normal_type(connection.type), connection.encoding == "ros1"
        self._topic = connection.topic
        text, language = connection.definition, connection.language
        if language and not text.strip():  # a message without fields
            self._decoders = None
            return
        try:
            root = parse_definition(connection.type, text, language, self._ros1)
        except DefinitionError:
            self._decoders = None
            return
        self._decoders = [RosDecoder(root, not self._ros1, "t", None, remember) for remember in (True, False)]
        types = dict(STORES[self._ros1].fielddefs)
        if text.strip():
            for part in [get_types_from_msg(text, self._name)] if language == "msg" else _idl(text):
                types.update(part)
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types)

    def chosen(self, rows, every):
        first, self._seen = -self._seen % every, self._seen + rows.size
        return rows[first::every]

    def compare(self, messages):
        if self._decoders is None or not len(messages):
            return
        fast, *others = every = [decoder.decode(messages) for decoder in self._decoders]
        for slow in others:
            if fast.good.tolist() != slow.good.tolist() or set(fast.columns) != set(slow.columns):
                self.wrong.append(f"{self._topic}: fast and slow differ in what they can read")
                return
            if (fast.stamps is None) != (slow.stamps is None) or not np.array_equal(fast.stamps, slow.stamps):
                self.wrong.append(f"{self._topic}: stamps differ")
        if any(decoder.unread != self._decoders[-1].unread for decoder in self._decoders):
            self.wrong.append(f"{self._topic}: fast and slow differ in what is no signal")
        for i, raw in enumerate(messages):
            read = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
            try:
                message = read(raw, self._name)
            except SerdeError:
                if fast.good[i]:
                    self.wrong.append(f"{self._topic}: message {i} is none for the library")
                continue
            if not fast.good[i]:
                self.wrong.append(f"{self._topic}: message {i} is one for the library")
                continue
            expected = {f"t.{path}": value for path, value in numbers(self._store, message, self._name).items()}
            for name in fast.columns.keys() | expected.keys():
                values = [one.columns[name][i] if name in one.columns else np.nan for one in every]
                self.count += name in expected
                if not all(same_number(value, expected.get(name, np.nan)) for value in values):
                    self.wrong.append(f"{self._topic}: {name} of message {i}: {values}, not {expected.get(name)}")
            if fast.stamps is not None:
                stamp = message.header.stamp if hasattr(message, "header") else message.stamp
                self.count += 1
                if fast.stamps[i] != stamp_of(self._store, stamp):
                    self.wrong.append(f"{self._topic}: stamp of message {i}")


def _idl(text):
    return [get_types_from_idl(part.partition("\n")[2]) for part in text.split("=" * 80 + "\nIDL: ") if part.strip()]


def main():
    bad = 0
    for root in map(Path, sys.argv[1:]):
        for path in sorted(p for p in root.rglob("*") if p.is_file()) if root.is_dir() else [root]:
            try:
                if path.suffix in (".yaml", ".md", ".txt") or sniff(path) not in BAGS:
                    continue
                count, wrong = compare(path)
            except ReadError as error:
                print(f"{path}: {error}")
                continue
            bad += len(wrong)
            print(f"{path}: {count} numbers, {len(wrong)} differ", *wrong[:5], sep="\n  ")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
