"""Findings about the binding of a joint's signals: gaps, lost samples, samples left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from vsalog.binding.grid import SILENCE, Bound, lacks_samples
from vsalog.core.finding import Finding


@dataclass(slots=True)
class Tally:
    """Counts of a role's samples, gathered part by part.

    Attributes
    ----------
    samples : their number
    lost : steps in which a sample or more is missing, gaps included
    bad : those that are no finite number, those that are left out included
    alone, first_alone : the outliers, and the stamp of the first of them [ns]
    held, first_held : those that were held, and the stamp of the first of them [ns]
    low, high : the least and the greatest number
    last : the last stamp so far [ns]
    """

    samples: int = 0
    lost: int = 0
    bad: int = 0
    alone: int = 0
    first_alone: int = 0
    held: int = 0
    first_held: int = 0
    low: float = np.inf
    high: float = -np.inf
    last: int | None = None

    def add(self, b: Bound) -> None:
        """Take the next part of a role into account; there is at least one sample in it."""
        self.samples += b.stamps.size
        self.lost += int(np.count_nonzero(lacks_samples(np.diff(b.stamps), b.period)))
        self.lost += self.last is not None and bool(lacks_samples(b.stamps[0] - self.last, b.period))
        self.last = int(b.stamps[-1])
        finite = b.values[np.isfinite(b.values)]
        self.bad += b.values.size - finite.size
        if finite.size:
            self.low, self.high = min(self.low, float(finite.min())), max(self.high, float(finite.max()))
        if b.alone is not None and b.alone.size:
            self.first_alone = self.first_alone if self.alone else int(b.alone[0])
            self.alone += b.alone.size
        if b.held is not None and b.held.size:
            self.first_held = self.first_held if self.held else int(b.held[0])
            self.held += b.held.size


def binding_findings(
    joint: str, segments: list[tuple[int, int]], tallies: Mapping[str, Tally], origin: int
) -> list[Finding]:
    """Return the findings about a joint's roles; `origin` is the log's first stamp [ns]."""
    found = []
    gaps = len(segments) - 1
    if gaps > 0:
        lost = (segments[-1][1] - segments[0][0] - sum(b - a for a, b in segments)) * 1e-9
        of_log = partial(Finding, joint=joint, severity="info")
        found.append(
            of_log(code="recording.gaps", value=float(gaps), evidence={"seconds": lost, "bridged": SILENCE.longest})
        )
    for role, t in tallies.items():
        of_role = partial(Finding, joint=joint, part=role)
        if (places := t.lost - gaps) > 0:
            found.append(of_role(code="recording.samples_lost", severity="info", value=float(places)))
        if t.alone:
            first = (t.first_alone - origin) * 1e-9
            evidence = {"samples": t.samples, "first": first}
            found.append(of_role(code="recording.outliers", value=float(t.alone), evidence=evidence))
        if t.held:
            first = (t.first_held - origin) * 1e-9
            evidence = {"samples": t.samples, "first": first}
            found.append(of_role(code="sensor.stuck", value=float(t.held), evidence=evidence))
        if (lacking := t.bad - t.alone - t.held) > 0:
            evidence = {"samples": t.samples}
            found.append(of_role(code="recording.not_finite", value=float(lacking), evidence=evidence))
        if t.low == t.high and role != "setpoint":
            found.append(of_role(code="sensor.constant", value=t.low))
    return found
