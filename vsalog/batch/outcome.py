"""What came of a batch: counts, lines on stdout, one JSON document."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any

from vsalog.batch.progress import duration
from vsalog.batch.records import Do, Record
from vsalog.core.documents import document_text
from vsalog.core.printable import plural
from vsalog.report.page_text import plain


@dataclass(slots=True)
class Outcome:
    """What came of it.

    Attributes
    ----------
    where : of the batch
    planned : logs of this run (of this share, where there are shares)
    records : of these logs, by their names
    kept : of these, were finished before
    everything, finished : logs of all shares, and of these those that have a record
    others : logs of earlier runs that are not asked for any more, and whose results are still there
    seconds : how long it took
    """

    where: str
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
        """The exit code: 1 where a failure is a bug of ours, 2 where a log failed, 3 where a threshold was missed."""
        if any(r.kind == "bug" for r in self.failures):
            return 1
        return 2 if self.failures else 3 if self.missed else 0


def print_outcome(outcome: Outcome, do: Do, as_json: bool) -> None:
    """Print what came of it, for people or as one JSON document; what failed goes to stderr, in one line."""
    where, bad = plain(outcome.where), len(outcome.failures)
    places = {"traces": f"{where}/traces", "summary": f"{where}/summary.parquet", "page": f"{where}/index.html"}
    if as_json:
        sys.stdout.write(document_text(_document(outcome, do, places)))
    else:
        before = f" ({outcome.kept} of them before)" if outcome.kept else ""
        logs = f"{plural(outcome.planned, 'log')} in {duration(outcome.seconds)}"
        print(f"{logs}: {outcome.planned - bad} done{before}, {bad} failed")
        if outcome.everything > outcome.planned:
            print(f"of all shares {outcome.finished} of {plural(outcome.everything, 'log')} finished")
        if outcome.missed:
            print(f"{plural(len(outcome.missed), 'log')} missed the threshold")
        data = f"data set: {places['traces']}   " if do == "estimate" else ""
        print(f"{data}table: {places['summary']}   page: {places['page']}")
    if bad:
        listed = f"{places['page']} and {places['summary']} say which and why"
        print(f"vsalog: {bad} of {plural(outcome.planned, 'log')} failed; {listed}", file=sys.stderr)


def _document(outcome: Outcome, do: Do, places: dict[str, str]) -> dict[str, Any]:
    return {
        "do": do,
        "logs": outcome.planned,
        "done": outcome.planned - len(outcome.failures),
        "kept": outcome.kept,
        "failed": [{"log": plain(r.log), "kind": r.kind, "reason": plain(r.reason)} for r in outcome.failures],
        "missed": [plain(name) for name in outcome.missed],
        "shares": {"finished": outcome.finished, "logs": outcome.everything},
        "seconds": outcome.seconds,
        "outputs": places,
    }
