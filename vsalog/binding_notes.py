"""What a person should know of how a joint's signals came about: gaps, lost samples, samples left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vsalog.grid import Bound


def binding_notes(
    joint: str, segments: list[tuple[int, int]], moving: Mapping[str, Bound], origin: int
) -> tuple[str, ...]:
    """Return the notes on a joint's bound roles; `origin` is the log's first stamp."""
    notes = []
    if len(segments) > 1:
        lost = (segments[-1][1] - segments[0][0] - sum(b - a for a, b in segments)) * 1e-9
        notes.append(
            f"joint '{joint}': {len(segments) - 1} gaps, {lost:.3g} s in all; nothing is estimated across them"
        )
    for role, b in moving.items():
        lost = int(np.count_nonzero(np.diff(b.stamps) > 1.5 * b.period)) - (len(segments) - 1)
        if lost > 0:
            notes.append(
                f"joint '{joint}': {role} lacks a sample or two at {lost} places; bridged between the neighbours"
            )
        bad = int(np.count_nonzero(~np.isfinite(b.values)))
        if b.alone is not None:
            bad -= b.alone.size
            notes.append(_alone_note(joint, role, b.alone.size, b.values.size, (int(b.alone[0]) - origin) * 1e-9))
        if bad:
            notes.append(f"joint '{joint}': {bad} of {b.values.size} samples of {role} are no finite number; left out")
        if np.ptp(b.values[np.isfinite(b.values)]) == 0.0 and role != "setpoint":
            notes.append(f"joint '{joint}': {role} never changes")
    return tuple(notes)


def _alone_note(joint: str, role: str, alone: int, of: int, first: float) -> str:
    """Say that samples stood alone, the first of them at `first` [s]."""
    stand, when = ("stand", f"the first at {first:.6g} s") if alone > 1 else ("stands", f"at {first:.6g} s")
    return f"joint '{joint}': {alone} of {of} samples of {role} {stand} alone, as no motion does ({when}); left out"
