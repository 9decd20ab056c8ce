"""The plan of a batch, and what a log is among the files that it is made from."""

from __future__ import annotations

import glob
from dataclasses import dataclass

from vsalog.batch.records import Log

BAG = "metadata.yaml"
# What a folder is searched for; a pattern may match anything.
ENDINGS = (".mcap", ".bag", ".db3", ".csv", ".tsv", ".parquet", ".mat", ".gz", ".zst", ".bz2", ".lz4")
# What lies next to logs and is none.
BESIDE = (".toml", ".yaml", ".yml", ".md", ".html", ".json")


@dataclass(frozen=True, slots=True)
class Plan:
    """The logs of a batch, sorted by name, and what was left out on the way, in words."""

    logs: tuple[Log, ...]
    notes: tuple[str, ...]

    def shard(self, index: int, count: int) -> Plan:
        """Return every count-th log, beginning with the index-th, counted from 1."""
        return Plan(self.logs[index - 1 :: count], self.notes)


def fixed_part(pattern: str) -> str:
    """Return the folder above the first part of a pattern that has a wildcard: the same whatever it matches."""
    parts = pattern.split("/")
    first = next(i for i, part in enumerate(parts) if glob.has_magic(part))
    return "/".join(parts[:first]) or ("/" if pattern.startswith("/") else ".")
