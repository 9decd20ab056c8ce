"""JSON messages → columns of numbers."""

from __future__ import annotations

import json
from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from vsalog.readers.nested import STAMPS, part_at
from vsalog.readers.tree_messages import TreeDecoder, stamp_of

if TYPE_CHECKING:
    import msgspec

_FRAME = b"frame_id"


class JsonDecoder(TreeDecoder):
    """Decodes JSON objects, in text or in Python's extensions of JSON; see `TreeDecoder`.

    A time stamp is an object with the members ``sec`` and ``nanosec`` (or ``nsec``).
    """

    misfit = ("are no JSON objects", "is a JSON object")

    def __init__(self, prefix: str, wanted: Collection[str] | None) -> None:
        import msgspec

        super().__init__(prefix, wanted)
        self._decoder = msgspec.json.Decoder()
        self._errors = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)

    def _loaded(self, raw: bytes) -> dict[str, Any] | None:
        try:
            message = self._decoder.decode(raw)
        except self._errors:
            message = _leniently(raw)
        return message if isinstance(message, dict) else None

    def _stamp(self, message: Any) -> tuple[tuple[str, ...], int | None]:
        for path in STAMPS:
            time = part_at(message, path)
            if isinstance(time, dict):
                seconds = time.get("sec", time.get("secs"))
                fraction = time.get("nanosec", time.get("nsec", time.get("nsecs")))
                if isinstance(seconds, int) and isinstance(fraction, int):
                    return path, stamp_of(seconds, fraction)
        return (), None

    def _frame(self, raw: bytes) -> object:
        if _FRAME not in raw:
            return None
        try:
            found = _frame_decoder().decode(raw)
            return found.frame_id if found.header is None else found.header.frame_id
        except self._errors:
            return super()._frame(raw)  # of other members by these names


@cache
def _frame_decoder() -> msgspec.json.Decoder[Any]:
    """Return a decoder of a message's frame alone, which is several times as fast."""
    import msgspec

    header = msgspec.defstruct("Header", [("frame_id", str | None, None)])
    return msgspec.json.Decoder(
        msgspec.defstruct("Framed", [("header", header | None, None), ("frame_id", str | None, None)])
    )


def _leniently(raw: bytes) -> Any:
    """Return a message's content as Python reads it, with NaN, numbers beyond infinity and halves of characters, or None."""
    try:
        return json.loads(raw)
    except (ValueError, RecursionError):
        return None
