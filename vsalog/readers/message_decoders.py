"""The decoder of a connection's messages."""

from __future__ import annotations

from vsalog.core.printable import printable
from vsalog.readers.container import Connection
from vsalog.readers.json_messages import JsonDecoder
from vsalog.readers.message_definitions import DefinitionError, parse_definition
from vsalog.readers.messages import Decoder, RosDecoder
from vsalog.readers.protobuf_messages import ProtobufDecoder


def decoder_of(connection: Connection, stream: str, wanted: frozenset[str] | None) -> Decoder:
    """Return the decoder of a connection's messages.

    Raises
    ------
    DefinitionError
        There is none; the message has the reason.
    """
    if connection.encoding == "json":
        return JsonDecoder(stream, wanted)
    if connection.encoding == connection.language == "protobuf":
        return ProtobufDecoder(connection.type, connection.definition.encode("latin-1"), stream, wanted)
    if not connection.encoding:
        raise DefinitionError("the log does not state the encoding of its messages")
    if connection.encoding not in ("cdr", "ros1"):
        raise DefinitionError(f"messages encoded as '{printable(connection.encoding)}' are not supported")
    if connection.definition.strip() and connection.language not in ("msg", "idl"):
        raise DefinitionError("its definition is in a language that is not supported")
    ros1 = connection.encoding == "ros1"
    root = parse_definition(connection.type, connection.definition, connection.language, ros1)
    return RosDecoder(root, not ros1, stream, wanted)
