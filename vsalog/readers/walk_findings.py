"""What a walk over the records of a file tells of stretches that are no records."""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.core.finding import Finding
from vsalog.readers.limits import SHOWN


def walk_findings(skipped: Sequence[tuple[int, int]], cut: tuple[int, int] | None) -> list[Finding]:
    """Return what was damaged between records.

    Parameters
    ----------
    skipped : stretches of bytes that are no records
    cut : where reading ended and the size of the file, where no record follows up to its end
    """
    found = []
    if skipped:
        where = ", ".join(str(start) for start, _ in skipped[:SHOWN]) + (", …" if len(skipped) > SHOWN else "")
        count = sum(end - start for start, end in skipped)
        found.append(Finding(code="recording.bytes_skipped", value=count, unit="B", evidence={"where": where}))
    if cut:
        found.append(Finding(code="recording.truncated", value=cut[0], limit=cut[1], unit="B"))
    return found
