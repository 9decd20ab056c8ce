"""Read the MCAP project's conformance files, and compare what is found with the JSON next to each.

    python tests/readers/conformance.py FOLDER

The files are those of `tests/conformance/data` in the MCAP project's repository. Messages with both of their times, channels,
attachments and metadata are compared; no note may be made. Exits with 1 where a file differs.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from vsalog.readers.mcap_file import McapContainer
from vsalog.writers.repair import _records_of


def expected(path):
    """Return what the JSON next to a file says is in it."""
    found = {"messages": [], "channels": set(), "attachments": [], "metadata": []}
    for record in json.loads(path.with_suffix(".json").read_text())["records"]:
        fields = dict(record["fields"])
        match record["type"]:
            case "Message":
                numbers = (int(fields[name]) for name in ("channel_id", "log_time", "publish_time"))
                found["messages"].append((*numbers, bytes(map(int, fields["data"]))))
            case "Channel":
                found["channels"].add((int(fields["id"]), fields["topic"], fields["message_encoding"]))
            case "Attachment":
                found["attachments"].append((fields["name"], bytes(map(int, fields["data"]))))
            case "Metadata":
                found["metadata"].append((fields["name"], dict(fields["metadata"])))
    return found


def read(path):
    """Return the same as it is read, and what was noted."""
    container = McapContainer(path)
    connections = container.connections()
    messages = [
        (
            int(packet.connection[i]),
            int(packet.log[i]),
            int(packet.publish[i]),
            bytes(packet.messages.data[first : first + size]),
        )
        for packet in container.packets([one.id for one in connections])
        for i, (first, size) in enumerate(zip(packet.messages.start, packet.messages.length, strict=True))
    ]
    stored = _records_of(container, Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX)
    attachments = [Attachment.read(ReadDataStream(BytesIO(content))) for content in stored]
    metadata = [
        Metadata.read(ReadDataStream(BytesIO(content)))
        for op, content in McapContainer(path).records()
        if op == Opcode.METADATA
    ]
    return {
        "messages": messages,
        "channels": {(one.id, one.topic, one.encoding) for one in connections},
        "attachments": [(one.name, bytes(one.data)) for one in attachments],
        "metadata": [(one.name, dict(one.metadata)) for one in metadata],
    }, container.findings


def main(folder):
    """Compare all files of a folder; returns the exit code."""
    files, count = sorted(Path(folder).rglob("*.mcap")), Counter()
    for path in files:
        found, damage = read(path)
        wrong = [what for what, values in expected(path).items() if found[what] != values]
        count["same"] += not wrong and not damage
        if wrong or damage:
            print(f"{path.name}: {', '.join(wrong)} differ; findings: {damage}")
    print(f"{count['same']} of {len(files)} files as their JSON says")
    return 0 if files and count["same"] == len(files) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
