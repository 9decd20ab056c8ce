"""The figures of the gain: errors before and after, in multiples of the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.diagnosis.document import EquationError, Gain
from vsalog.report.chart import Axes, Chart, Curve
from vsalog.report.diagnosis_quantities import reduction_text, signal_name
from vsalog.report.quantities import number


@dataclass(frozen=True, slots=True)
class Row:
    """One row: a name, errors before and after as multiples of the noise, and the interval of the second."""

    name: str
    before: float
    after: float
    interval: tuple[float, float] | None = None


def gain_chart(gains: Sequence[Gain], where: str) -> Chart | None:
    """Return the simulation errors of a joint's signals, before and after, along with the noise floor.

    Parameters
    ----------
    gains : of one joint
    where : what they were measured on, in words
    """
    known = [g for g in gains if g.noise_floor > 0.0 and np.isfinite([g.rmse_before, g.rmse_after]).all()]
    rows = []
    for g in known:
        high, low = ((1.0 - end) * g.rmse_before / g.noise_floor for end in g.ci95)
        name = signal_name(g.signal)
        rows.append(Row(name, g.rmse_before / g.noise_floor, g.rmse_after / g.noise_floor, (low, high)))
    each = "; ".join(
        f"{r.name} {number(r.before)} → {number(r.after)} times its noise, less by {reduction_text(g)}"
        for r, g in zip(rows, known, strict=True)
    )
    words = f"Error of the simulation (root mean square) on {where}, as a multiple of the noise floor: {each}."
    return _chart("gain", "Error of the simulation, before and after", words, "error / noise floor", rows)


def equations_chart(errors: Sequence[EquationError]) -> Chart | None:
    """Return the RMS residuals of a joint's equations, before and after, along with the noise."""
    rows = [
        Row(signal_name(e.equation), e.rms_before / e.noise, e.rms_after / e.noise)
        for e in errors
        if e.noise > 0.0 and np.isfinite([e.rms_before, e.rms_after]).all()
    ]
    each = "; ".join(f"{r.name} {number(r.before)} → {number(r.after)} times its noise" for r in rows)
    words = f"RMS residual of each equation of the joint, as a multiple of its noise: {each}."
    return _chart("equations", "Equations of the joint, before and after", words, "RMS residual / noise", rows)


def _chart(kind: str, title: str, words: str, label: str, rows: Sequence[Row]) -> Chart | None:
    if not rows:
        return None
    count = len(rows)
    y = -np.arange(count, dtype=np.float64)
    before, after = (_drawable([getattr(r, which) for r in rows]) for which in ("before", "after"))
    hole = np.full(count, np.nan)
    pairs = np.stack([before, after, hole], axis=1).ravel(), np.repeat(y, 3)
    curves = [
        Curve("noise alone", np.ones(2), np.array([0.6, 0.6 - count]), "truth", dashed=True),
        Curve("", *pairs, "error", dashed=True),
        Curve("rig as it stands", before, y, "error", "points", symbol="diamond-open"),
    ]
    if any(r.interval is not None for r in rows):
        ends = np.array([r.interval or (np.nan, np.nan) for r in rows])
        low, high = _drawable(ends).T
        # Bars with caps, a little below, where the mark does not hide them.
        at = y - 0.24
        x = np.stack([low, low, low, high, high, high, hole], axis=1).ravel()
        up = np.stack([at - 0.06, at + 0.06, at, at, at + 0.06, at - 0.06, hole], axis=1).ravel()
        curves.append(Curve("95 % interval of what is left", x, up, "model"))
    curves.append(Curve("extended rig", after, y, "model", "points", symbol="circle"))
    axes = Axes(label, "", tuple(curves), rows=tuple(r.name for r in rows), x_log=True)
    return Chart(kind, title, words, (axes,))


def _drawable(values: ArrayLike) -> NDArray[np.float64]:
    """Return values for a logarithmic axis: what is zero or less, as an interval's end may be, is a thousandth of the noise."""
    return np.maximum(values, 1e-3)
