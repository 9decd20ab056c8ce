"""Figures with a row per name: errors before and after in multiples of the noise floor, and the errors of several logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsalog.core.notation import number, part_name, percent, signal_name
from vsalog.diagnosis.document import EquationError, Gain
from vsalog.diagnosis.plan_document import Cause
from vsalog.figures.chart import Axes, Chart, Curve, strokes
from vsalog.identification.document import IdentifiedNumber
from vsalog.validation.verdict import HOLDING_ERROR, Line


@dataclass(frozen=True, slots=True)
class Row:
    """One row: a name, errors before and after as multiples of the noise, and the interval of the second."""

    name: str
    before: float
    after: float
    interval: tuple[float, float] = (np.nan, np.nan)


def gain_chart(gains: Sequence[Gain], where: str) -> Chart | None:
    """Return the simulation errors of a joint's signals, before and after, along with the noise floor.

    Parameters
    ----------
    gains : of one joint
    where : the log of the measurement, in words
    """
    known = [g for g in gains if g.noise_floor > 0.0 and np.isfinite([g.rmse_before, g.rmse_after]).all()]
    rows, each = [], []
    for g in known:
        high, low = ((1.0 - end) * g.rmse_before / g.noise_floor for end in g.ci95)
        rows.append(
            Row(signal_name(g.signal), g.rmse_before / g.noise_floor, g.rmse_after / g.noise_floor, (low, high))
        )
        each.append(f"{_change(rows[-1])}, reduced by {reduction_text(g)}")
    words = (
        f"Error of the simulation (root mean square) on {where}, as a multiple of the noise floor: {'; '.join(each)}."
    )
    return _before_and_after("gain", "Error of the simulation, before and after", words, "error / noise floor", rows)


def reduction_text(gain: Gain) -> str:
    """Return a reduction with its 95 % interval, to the digits that the interval allows."""
    values = (gain.reduction, *gain.ci95)
    if not all(map(math.isfinite, values)):
        return "–"
    if gain.rmse_after > 10.0 * gain.rmse_before:
        return "worse, more than tenfold"
    digits = 1 if values[2] - values[1] < 0.02 else 0
    middle, low, high = (f"{100.0 * value:.{digits}f}".replace("-", "−") for value in values)
    return f"{middle} % ({low} … {high})"


def equations_chart(errors: Sequence[EquationError]) -> Chart | None:
    """Return the RMS residuals of a joint's equations, before and after, along with the noise."""
    rows = [
        Row(signal_name(e.equation), e.rms_before / e.noise, e.rms_after / e.noise)
        for e in errors
        if e.noise > 0.0 and np.isfinite([e.rms_before, e.rms_after]).all()
    ]
    words = f"RMS residual of each equation of the joint, as a multiple of its noise: {'; '.join(map(_change, rows))}."
    title = "Equations of the joint, before and after"
    return _before_and_after("equations", title, words, "RMS residual / noise", rows)


def logs_chart(lines: Sequence[Line]) -> Chart:
    """Return the error of each log, with its interval."""
    known = [(f"{row.joint} in {row.log}", row.score.nrmse) for row in lines if row.score is not None]
    known = [(name, nrmse) for name, nrmse in known if nrmse.value is not None]
    x, low, high = (np.array([getattr(f, end) for _, f in known], np.float64) for end in ("value", "low", "high"))
    y = _places(len(known))
    curves = (
        _limit("limit of a model that holds", HOLDING_ERROR, len(known)),
        Curve("95 % interval", strokes(low, high), np.repeat(y, 3), "model"),
        Curve("error", x, y, "model", "points", symbol="circle"),
    )
    each = "; ".join(f"{name} {number(nrmse.value)} %" for name, nrmse in known)
    axes = Axes("NRMSE [%]", "", curves, rows=tuple(name for name, _ in known))
    return Chart("errors", "Error by log", f"Error of the torque, as a share of its span: {each}.", (axes,))


def identified_chart(numbers: Sequence[IdentifiedNumber]) -> Chart | None:
    """Return the numbers of a joint that were identified, relative to the rig's; None where all of the rig's are zero."""
    known = [n for n in numbers if n.rig != 0.0]
    if not known:
        return None
    x, low, high = np.array([_relative(n) for n in known]).T
    y = _places(len(known))
    curves = (
        _limit("value in the rig", 1.0, len(known)),
        Curve("95 % interval", strokes(low, high), np.repeat(y, 3), "model"),
        Curve("identified", x, y, "model", "points", symbol="circle"),
    )
    each = "; ".join(f"{n.key} {number(n.value, 4)} ({number(n.low)} to {number(n.high)})" for n in known)
    axes = Axes("identified / rig", "", curves, rows=tuple(n.key for n in known))
    return Chart("numbers", "Numbers identified, relative to the rig's", f"{each}.", (axes,))


def _relative(one: IdentifiedNumber) -> tuple[float, float, float]:
    """Return a number and the ends of its interval, relative to the rig's, which may be negative."""
    low, high = sorted((one.low / one.rig, one.high / one.rig))
    return one.value / one.rig, low, high


def seen_chart(causes: Sequence[Cause]) -> Chart:
    """Return the probability that a diagnosis would name each cause, as large as the rig's tolerance of it."""
    names = [f"{c.cause} ({part_name(c.part)})" if c.part else c.cause for c in causes]
    x, y = np.array([c.seen for c in causes]), _places(len(causes))
    curves = (
        Curve("", strokes(np.zeros_like(x), x), np.repeat(y, 3), "error"),
        Curve("probability", x, y, "model", "points", symbol="circle"),
    )
    each = "; ".join(f"{name} {percent(seen)}" for name, seen in zip(names, x, strict=True))
    axes = Axes("probability that it is found", "", curves, rows=tuple(names))
    return Chart("causes", "Causes that would show", f"{each}.", (axes,))


def _before_and_after(kind: str, title: str, words: str, label: str, rows: Sequence[Row]) -> Chart | None:
    if not rows:
        return None
    y = _places(len(rows))
    # The axis is logarithmic: values of zero or less, as an interval's end may be, are drawn at a thousandth of the noise.
    before, after, low, high = np.maximum([(r.before, r.after, *r.interval) for r in rows], 1e-3).T
    curves = [
        _limit("noise alone", 1.0, len(rows)),
        Curve("", strokes(before, after), np.repeat(y, 3), "error", dashed=True),
        Curve("original rig", before, y, "error", "points", symbol="diamond-open"),
    ]
    if np.isfinite(low).any():
        # Bars with caps, a little below, where the mark does not hide them.
        at, cap = y - 0.24, 0.06
        x = strokes(low, low, low, high, high, high)
        y_bars = strokes(at - cap, at + cap, at, at, at + cap, at - cap)
        curves.append(Curve("95 % interval of the remaining error", x, y_bars, "model"))
    curves.append(Curve("extended rig", after, y, "model", "points", symbol="circle"))
    axes = Axes(label, "", tuple(curves), rows=tuple(r.name for r in rows), x_log=True)
    return Chart(kind, title, words, (axes,))


def _change(row: Row) -> str:
    return f"{row.name} {number(row.before)} → {number(row.after)} times its noise"


def _places(count: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return -np.arange(count, dtype=np.float64)


def _limit(label: str, value: float, count: int) -> Curve:
    """Return an upright line through all rows."""
    return Curve(label, np.full(2, value), np.array([0.6, 0.6 - count]), "truth", dashed=True)
