"""The outcome of a batch: records of its logs, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vsalog.batch.records import Do, Record
from vsalog.core.printable import printable


@dataclass(slots=True)
class Outcome:
    """The outcome.

    Attributes
    ----------
    where, do : of the batch, and the command that is run
    planned : logs of this run (of this share, where there are shares)
    records : of these logs, by their names
    kept : of these, were finished before
    everything, finished : logs of all shares, and of these those that have a record
    others : logs of earlier runs that are no longer requested, but whose results still exist
    seconds : how long it took
    """

    where: str
    do: Do
    planned: int
    records: dict[str, Record] = field(default_factory=dict)
    kept: int = 0
    everything: int = 0
    finished: int = 0
    others: int = 0
    seconds: float = 0.0

    @property
    def failures(self) -> list[Record]:
        """Records of the logs that failed, sorted by name."""
        return sorted((r for r in self.records.values() if r.status == "failed"), key=lambda record: record.log)

    @property
    def missed(self) -> list[str]:
        """Names of the logs that missed a threshold."""
        return sorted(r.log for r in self.records.values() if r.status == "done" and not r.met)

    @property
    def code(self) -> int:
        """The exit code: 1 where a failure is a bug in vsalog, 2 where a log failed, 3 where a threshold was missed."""
        if any(r.kind == "bug" for r in self.failures):
            return 1
        return 2 if self.failures else 3 if self.missed else 0

    def document(self) -> dict[str, Any]:
        """Return it as one JSON document."""
        where = printable(self.where)
        outputs = {"traces": f"{where}/traces", "summary": f"{where}/summary.parquet", "page": f"{where}/index.html"}
        return {
            "do": self.do,
            "logs": self.planned,
            "done": self.planned - len(self.failures),
            "kept": self.kept,
            "failed": [{"log": printable(r.log), "kind": r.kind, "reason": printable(r.reason)} for r in self.failures],
            "missed": [printable(name) for name in self.missed],
            "shares": {"finished": self.finished, "logs": self.everything},
            "seconds": self.seconds,
            "outputs": outputs,
        }
