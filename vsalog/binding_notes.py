"""What a person should know of how a joint's signals came about: gaps, lost samples, samples left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vsalog.grid import Bound

# A step of so many periods lacks a sample.
LACKING = 1.5


@dataclass(slots=True)
class Tally:
    """What there is to say of a role's samples, gathered part by part.

    Attributes
    ----------
    samples : their number
    lost : steps in which a sample or more is lacking, gaps included
    bad : those that are no finite number, those that are left out included
    alone, first_alone : those that stand alone, and the stamp of the first of them [ns]
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
        self.lost += int(np.count_nonzero(np.diff(b.stamps) > LACKING * b.period))
        self.lost += self.last is not None and bool(b.stamps[0] - self.last > LACKING * b.period)
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


def tally_of(b: Bound) -> Tally:
    """Return what there is to say of a role."""
    tally = Tally()
    tally.add(b)
    return tally


def binding_notes(
    joint: str, segments: list[tuple[int, int]], tallies: Mapping[str, Tally], origin: int
) -> tuple[str, ...]:
    """Return the notes on a joint's roles; `origin` is the log's first stamp."""
    notes = []
    if len(segments) > 1:
        lost = (segments[-1][1] - segments[0][0] - sum(b - a for a, b in segments)) * 1e-9
        notes.append(
            f"joint '{joint}': {len(segments) - 1} gaps, {lost:.3g} s in all; nothing is estimated across them"
        )
    for role, t in tallies.items():
        places = t.lost - (len(segments) - 1)
        if places > 0:
            notes.append(
                f"joint '{joint}': {role} lacks a sample or two at {places} places; bridged between the neighbours"
            )
        if t.alone:
            notes.append(_alone_note(joint, role, t.alone, t.samples, (t.first_alone - origin) * 1e-9))
        if t.held:
            first = (t.first_held - origin) * 1e-9
            notes.append(
                f"joint '{joint}': {role} hung at {t.held} of {t.samples} samples (first at {first:.6g} s): it stood still amid a"
                " motion and then jumped to catch up; left out"
            )
        if (lacking := t.bad - t.alone - t.held) > 0:
            notes.append(
                f"joint '{joint}': {lacking} of {t.samples} samples of {role} are no finite number; left out, and bridged between"
                " the neighbours where one is alone"
            )
        if t.low == t.high and role != "setpoint":
            notes.append(f"joint '{joint}': {role} never changes")
    return tuple(notes)


def _alone_note(joint: str, role: str, alone: int, of: int, first: float) -> str:
    """Say that samples stood alone, the first of them at `first` [s]."""
    stand, when = ("stand", f"the first at {first:.6g} s") if alone > 1 else ("stands", f"at {first:.6g} s")
    return f"joint '{joint}': {alone} of {of} samples of {role} {stand} alone, as no motion does ({when}); left out"
