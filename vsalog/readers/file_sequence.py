"""Several files of messages as one log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from types import MappingProxyType

import numpy as np

from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.readers.container import Connection, Container, Part
from vsalog.readers.packets import Packet
from vsalog.readers.sampling_pieces import Sample


class SeveralContainer:
    """Files, which are `parts`, one after the other; see `vsalog.readers.container.Container`.

    Parameters
    ----------
    parts : sequence of Container
        Opened.
    format : str
        Of all together.
    findings : Findings
        The findings so far.
    stated : mapping of str to int, optional
        Messages of each topic, where metadata next to the files count them.
    """

    def __init__(
        self,
        parts: Sequence[Container],
        format: str,
        findings: Findings,
        stated: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self.parts, self.format, self.findings = parts, format, findings
        self.has_publish = all(part.has_publish for part in parts)
        self._stated, self._narrowed = stated, False

    @property
    def rig_text(self) -> str | None:
        """The rig in the first file that has one."""
        return next((part.rig_text for part in self.parts if part.rig_text is not None), None)

    def connections(self) -> list[Connection]:
        """Return the connections of all files."""
        return [
            replace(one, id=numbers.start + one.id)
            for numbers, container in self._numbered()
            for one in container.connections()
        ]

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, where their file says so."""
        return {
            numbers.start + number: count
            for numbers, container in self._numbered()
            for number, count in container.counts().items()
        }

    def _numbered(self) -> Iterator[tuple[range, Container]]:
        """Yield each file with the numbers of its connections here, which begin where its own begin with 0."""
        first = 0
        for container in self.parts:
            most = max((one.id for one in container.connections()), default=0)  # a file may be several itself
            last = first + (most | np.iinfo(np.uint32).max) + 1  # formats count connections by 32 bits
            yield range(first, last), container
            first = last

    def size(self) -> int:
        """Return how many bytes all files have."""
        return sum(container.size() for container in self.parts)

    def narrow(self, part: Part) -> bool:
        """Skip messages outside of a part of the log, in all files that can."""
        able = [
            container.narrow(replace(part, throughout=frozenset(_own(numbers, part.throughout))))
            for numbers, container in self._numbered()
        ]
        self._narrowed = any(able)
        return self._narrowed

    def sample(self, budget: int) -> Sample | None:
        """From now on read stretches of each file; a file that cannot be cut is only read if it is small."""
        whole, cuts = self.size(), []
        for part in self.parts:
            size = part.size()
            cut = part.sample(max(budget * size // whole, 1))
            if cut is not None:
                cuts.append(cut)
            elif size > budget or isinstance(part, SeveralContainer):
                return None
        if not cuts:
            return None
        totals: Counter[str] = Counter()
        for cut in cuts:
            totals.update(cut.totals)
        findings = Findings()
        findings.add(*(one for cut in cuts for one in cut.findings))
        self._narrowed = True
        # Between stretches of two files there is a seam, too.
        return Sample(sum(cut.size for cut in cuts), sum(cut.stretches for cut in cuts), totals, tuple(findings))

    def glimpses(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield messages from all over each file."""
        for numbers, container in self._numbered():
            yield from _renumbered(container.glimpses(_own(numbers, ids)), numbers.start)

    def beginnings(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield messages with which connections of each file begin."""
        for numbers, container in self._numbered():
            yield from _renumbered(container.beginnings(_own(numbers, ids)), numbers.start)

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections, file by file."""
        found: Counter[int] = Counter()
        for numbers, container in self._numbered():
            for packet in _renumbered(container.packets(_own(numbers, ids)), numbers.start):
                if self._stated:
                    here, counts = np.unique(packet.connection, return_counts=True)
                    found.update(dict(zip(here.tolist(), counts.tolist(), strict=True)))
                yield packet
            self.findings.add(*container.findings)
        if self._stated and not self._narrowed:
            self.findings.add(*self._missing(set(ids), found))

    def _missing(self, ids: set[int], found: Mapping[int, int]) -> list[Finding]:
        """Return the read topics with missing messages; nothing where none are missing."""
        topics: dict[str, set[int]] = {topic: set() for topic in self._stated}
        for one in self.connections():
            topics.setdefault(one.topic, set()).add(one.id)
        there = {topic: sum(found.get(n, 0) for n in numbers) for topic, numbers in topics.items() if numbers <= ids}
        lacking = {topic: count for topic, count in there.items() if count < self._stated.get(topic, 0)}
        shown = [f"{printable(topic)} {n} of {self._stated[topic]}" for topic, n in islice(lacking.items(), 3)]
        more = f" and {len(lacking) - 3} more topics" if len(lacking) > 3 else ""
        evidence = {"topics": ", ".join(shown) + more}
        return [Finding(code="recording.topics_incomplete", value=len(lacking), evidence=evidence)] if lacking else []


def _own(numbers: range, ids: Collection[int]) -> list[int]:
    """Return a file's own numbers of those connections that are in it."""
    return [number - numbers.start for number in ids if number in numbers]


def _renumbered(packets: Iterator[Packet], first: int) -> Iterator[Packet]:
    """Yield packets with numbers of connections that begin with one."""
    return (replace(packet, connection=packet.connection + first) for packet in packets)
