"""Containers of serialised messages → blocks: the common part of MCAP, ROS 1 bags and ROS 2 bags."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.finding import Evidence, Finding
from vsalog.core.look import LOOK_BYTES
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block, Catalogue, ChannelInfo
from vsalog.readers.compressed_messages import plain, plain_packets
from vsalog.readers.container import Connection, Container, Part
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.header_delays import Delays
from vsalog.readers.header_frames import Frames
from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS, MOST_STEPS, PACKED_BYTES, SAMPLE_ROWS
from vsalog.readers.message_decoders import decoder_of
from vsalog.readers.message_definitions import DefinitionError, normal_type
from vsalog.readers.messages import Decoder
from vsalog.readers.packets import Integers, Packet
from vsalog.readers.publishers import publisher_stream
from vsalog.readers.topic_streams import Named, Streams

_COUNTS = ("expected", "total", "damaged")


@dataclass(slots=True)
class _Batch:
    """A stream's messages of one definition; those `waiting` are decoded when they are enough, `rows` of them at once.

    `count` messages wait, of `size` bytes.
    `expected` is their number in all, where the log states it; `total` were decoded, of which `damaged` could not be.
    Messages of the first of `frames` are those of other batches, `apart`.
    """

    stream: str
    type: str
    decoder: Decoder
    connection: Connection
    waiting: list[Packet] = field(default_factory=list)
    count: int = 0
    size: int = 0
    rows: int = PACKED_BYTES // (8 * MAX_FIELDS)  # the first block shows the stream's width
    expected: int = 0
    total: int = 0
    damaged: int = 0
    apart: Sequence[_Batch] = ()
    frames: Frames = field(default_factory=Frames)

    def by_frame(self, packet: Packet) -> Iterator[tuple[_Batch, Packet]]:
        """Yield each batch with those messages that belong to it."""
        if not self.apart:
            yield self, packet
            return
        numbers = self.frames.numbers(self.decoder.frames(packet.messages))
        numbers[numbers >= len(self.apart)] = -1  # other frames are this batch's, as are messages without one
        for k, batch in enumerate((self, *self.apart), -1):
            if (own := numbers == k).any():
                yield batch, packet.some(np.flatnonzero(own))

    def parts(self, packet: Packet) -> Iterator[Packet]:
        """Yield messages to be decoded at once: many in place, and few together with those before and after them."""
        many = len(packet.messages) >= SAMPLE_ROWS
        if many:
            yield from self.rest()
        rows = np.arange(len(packet.messages))
        while rows.size:
            fit = self.rows if many else self._fitting(packet.messages.length[rows])
            now, rows = rows[:fit], rows[fit:]
            if many:
                yield packet.some(now)
                continue
            self.waiting.append(packet.take(now))
            self.count, self.size = self.count + now.size, self.size + self.waiting[-1].messages.data.size
            if self.count >= self.rows or self.size >= PACKED_BYTES:
                yield from self.rest()

    def rest(self) -> Iterator[Packet]:
        """Yield the messages that wait, if any."""
        if self.waiting:
            waiting, self.waiting, self.count, self.size = self.waiting, [], 0, 0
            yield Packet.joined(waiting)

    def _fitting(self, length: Integers) -> int:
        """Return how many of the next messages go in before this is full; at least one."""
        by_size = int(np.searchsorted(np.cumsum(length), PACKED_BYTES - self.size)) + 1
        return max(1, min(self.rows - self.count, by_size))


class BagReader:
    """Reads a container of messages; see `vsalog.readers.base.Reader`."""

    def __init__(self, container: Container) -> None:
        self._container = container
        self.format = container.format
        self.findings = container.findings
        self.unread: dict[str, str] = {}
        self.unfit: list[Finding] = []  # of streams with messages that do not fit their definition
        self._channels: set[str] = set()
        self._streams = Streams(container, self._first_of, self.unread)
        self._sampled: Delays | None = None  # of messages from all over the log, where only a part of it is read
        self._read = Delays()
        self._rare: set[str] = set()  # streams that are read throughout
        self._narrowed = False

    @property
    def rig_text(self) -> str | None:
        """The rig the log carries, as TOML."""
        return self._container.rig_text

    def catalogue(self) -> Catalogue:
        """Return the channels of the first messages of each topic, and fields that are no signal."""
        channels: dict[str, ChannelInfo] = {}
        for block in self.heads():
            for name in block.columns:
                channels.setdefault(name, ChannelInfo(block.stream, block.type, block.units.get(name)))
        return Catalogue(channels, dict(self.unread))

    def heads(self) -> Iterator[Block]:
        """Yield the first messages of each topic."""
        return self._blocks(None, first_only=True)

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield blocks with the wanted channels, stream by stream as they fill up.

        Raises
        ------
        ReadError
            The file cannot be read.
        """
        return self._blocks(None if wanted is None else frozenset(wanted), first_only=False)

    def narrow(self, low: int, high: int, time: str, wanted: Collection[str] | None) -> bool:
        """Skip messages outside of a window [ns]; return whether any will be.

        Where streams have header stamps, samples from all over the log show their difference from the log's times. `blocks`
        then raises ReadError where it turns out to be larger: all has to be read.
        """
        if time == "publish":
            return False
        batches = self._batches(None if wanted is None else frozenset(wanted))
        stamped = {number: batch for number, batch in batches.items() if batch.decoder.stamped}
        if time == "log" or not stamped:
            self._narrowed = self._container.narrow(Part(low, high))
            return self._narrowed
        delays = self._delays(stamped) if self._container.size() >= LOOK_BYTES else None
        if delays is None or not delays.locate_messages():
            return False
        self._sampled, self._rare = delays, delays.rare({batch.stream for batch in stamped.values()})
        throughout = frozenset(number for number, batch in stamped.items() if batch.stream in self._rare)
        self._narrowed = self._container.narrow(Part(*delays.widened(low, high), throughout))
        return self._narrowed

    def _delays(self, batches: Mapping[int, _Batch]) -> Delays:
        """Return the difference of header stamps from the log's times in samples."""
        delays = Delays()
        for packet in map(plain, self._container.glimpses(batches.keys())):
            for batch, own in _shared_out(packet, batches):
                decoded = batch.decoder.decode(own.messages)
                stamps = np.zeros(len(own.messages), np.int64) if decoded.stamps is None else decoded.stamps
                delays.add(batch.stream, stamps[decoded.good], own.log[decoded.good])
        return delays

    def _blocks(self, wanted: frozenset[str] | None, first_only: bool) -> Iterator[Block]:
        batches = self._batches(wanted)
        packets = self._first_of(batches.keys()) if first_only else self._container.packets(batches.keys())
        for packet in plain_packets(packets):
            for batch, own in _shared_out(packet, batches):
                for part in batch.parts(own):
                    yield self._block(batch, part)
        for batch in _all(batches):
            for part in batch.rest():
                yield self._block(batch, part)
        if self._sampled is not None and (standing := self._read.standing()):
            raise ReadError(f"{standing.pop()}: its header stamps are all the same in this part of the log")
        self._report(batches)

    def _first_of(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield first messages of each connection, only of those whose beginning an index has, or else of any."""
        counts = self._container.counts()
        missing = {number: count for number in ids if (count := min(FIRST_ROWS, counts.get(number, FIRST_ROWS)))}
        for find in self._container.beginnings, self._container.packets:
            begun: set[int] = set()
            for packet in find(list(ids)) if missing else ():
                taken = [np.flatnonzero(packet.connection == number)[:most] for number, most in missing.items()]
                begun.update(number for number, rows in zip(missing, taken, strict=True) if rows.size)
                left = {number: most - rows.size for (number, most), rows in zip(missing.items(), taken, strict=True)}
                missing = {number: most for number, most in left.items() if most}
                rows = np.sort(np.concatenate(taken))
                if rows.size:
                    yield packet.take(rows)
                if not missing:
                    return
            missing = {number: most for number, most in missing.items() if number not in begun}

    def _batches(self, wanted: frozenset[str] | None) -> dict[int, _Batch]:
        """Return a batch per connection that may hold wanted channels; publishers of one stream share it."""
        batches: dict[int, _Batch] = {}
        shared: dict[tuple[str, str, str], _Batch] = {}
        counts = self._container.counts()
        for named in self._streams.named(wanted):
            connection, key = named.connection, (named.stream, named.connection.encoding, named.connection.definition)
            if key not in shared:
                try:
                    shared[key] = self._new_batch(named, wanted)
                except DefinitionError as error:
                    self.unread.setdefault(named.stream, str(error))
                    continue
            batches[connection.id] = shared[key]
            shared[key].expected += counts.get(connection.id, 0)
        return batches

    def _new_batch(self, named: Named, wanted: frozenset[str] | None) -> _Batch:
        """Return a batch for a connection's stream, with others for its frames that are streams of their own."""
        one = named.connection
        kind = normal_type(printable(one.type)) or one.encoding
        batch, *others = (
            _Batch(stream, kind, decoder_of(one, stream, wanted), one)
            for stream in (named.stream, *(publisher_stream(named.stream, frame) for frame in named.frames))
        )
        batch.apart, batch.frames = others, Frames(named.frames)
        return batch

    def _block(self, batch: _Batch, packet: Packet) -> Block:
        """Decode messages of a batch's stream."""
        log, decoded = packet.log, batch.decoder.decode(packet.messages)
        batch.rows = min(BLOCK_ROWS, PACKED_BYTES // (8 * max(1, len(decoded.columns))))
        batch.total += log.size
        batch.damaged += int(np.count_nonzero(~decoded.good))
        clocks: dict[str, Stamps] = {"log": log}
        if self._container.has_publish:
            clocks["publish"] = packet.publish
        if decoded.stamps is not None:
            clocks["header"] = decoded.stamps
            if self._sampled is not None and batch.stream not in self._rare:
                self._read.add(batch.stream, decoded.stamps[decoded.good], log[decoded.good])
                if not self._sampled.promised(self._read):
                    raise ReadError(f"{batch.stream}: its header stamps are far from the log's times")
        columns: dict[str, Values] = decoded.columns
        if not decoded.good.all():
            clocks = {kind: stamps[decoded.good] for kind, stamps in clocks.items()}
            columns = {name: values[decoded.good] for name, values in columns.items()}
        for name, reason in batch.decoder.unread.items():
            self.unread.setdefault(name, reason)
        self._channels.update(columns)
        if max(len(self._channels), len(self.unread)) > MOST_STEPS:
            raise ReadError(
                f"the log has more than {MOST_STEPS} channels, as no recording has; only some channels of it can be read, by"
                " their names"
            )
        units = {**decoded.units, **_stated_units(batch, columns)}
        return Block(batch.stream, batch.type, clocks, columns, units, expected=batch.expected, whole=decoded.whole)

    def _report(self, batches: Mapping[int, _Batch]) -> None:
        """Report streams without messages, and with messages that do not fit."""
        streams: dict[str, list[_Batch]] = {}
        for batch in _all(batches):
            if not batch.apart or batch.total:
                streams.setdefault(batch.stream, []).append(batch)
        for stream, own in streams.items():
            expected, total, damaged = (sum(getattr(one, what) for one in own) for what in _COUNTS)
            if not total:
                if not self._narrowed or (not expected and self._container.counts()):
                    self.unread.setdefault(stream, "no messages")
            elif damaged:
                misfits, fit = own[-1].decoder.misfit
                evidence: Evidence = {"messages": total, "misfit": misfits, "done": "left out"}
                self.unfit.append(
                    Finding(code="recording.messages_damaged", part=stream, value=damaged, evidence=evidence)
                )
                if damaged == total:
                    self.unread.setdefault(stream, f"no message {fit}")
                else:
                    self.findings.add(self.unfit[-1])


def _all(batches: Mapping[int, _Batch]) -> list[_Batch]:
    """Return all batches, once each, with those of frames."""
    once = {id(batch): batch for batch in batches.values()}
    return [one for batch in once.values() for one in (batch, *batch.apart)]


def _shared_out(packet: Packet, batches: Mapping[int, _Batch]) -> Iterator[tuple[_Batch, Packet]]:
    """Yield each batch with the messages of a packet that belong to it."""
    shared: dict[int, list[int]] = {}
    for number in np.unique(packet.connection).tolist():
        shared.setdefault(id(batches[number]), []).append(number)
    for group in shared.values():
        own = packet.connection == group[0] if len(group) == 1 else np.isin(packet.connection, group)
        yield from batches[group[0]].by_frame(packet.some(np.flatnonzero(own)))


def _stated_units(batch: _Batch, columns: Collection[str]) -> dict[str, str]:
    """Return the units that a channel's metadata states, for its whole stream or for a field and what is in it."""
    metadata = batch.connection.metadata
    if not any(key.startswith("unit") for key in metadata):
        return {}
    units: dict[str, str] = {}
    for column in columns:
        path = column.removeprefix(f"{batch.stream}.")
        ends = [len(path), *(i for i in range(len(path) - 1, 0, -1) if path[i] in "[.")]
        stated = (metadata.get(f"unit:{path[:end]}") for end in ends)
        unit = next((unit for unit in stated if unit is not None), metadata.get("unit"))
        if unit is not None:
            units[column] = printable(unit)
    return units
