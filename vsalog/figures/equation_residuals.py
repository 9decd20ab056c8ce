"""Figures of equations' residuals: with and without a cause over the variable that reveals it, and the remaining residual."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.notation import axis_label, number, share_text, signal_name, unit_of
from vsalog.diagnosis.document import Bin, Unexplained
from vsalog.diagnosis.evidence import CauseEvidence, JointEvidence
from vsalog.figures.chart import TWO_STD, Axes, Chart, Curve, OverTime, outline, points, span_words
from vsalog.figures.decimation import FIGURE_COLUMNS, one_after_the_other, rms
from vsalog.validation.scores import binned

Array = NDArray[np.float64]

FOLLOWS = 0.95
"""A shape is drawn as lines where at least this part of its square follows from the variable, or from it and its direction."""
# Causes with a memory make loops, large ones and small ones, over a variable: of those the path of some rows is drawn.
LOOPS = {"transmission.hysteresis": "deflection"}
SHAPE, WITHOUT, WITH = "effect of this cause", "residual without this cause", "residual with it"


@dataclass(frozen=True, slots=True)
class Means:
    """Means over intervals of a variable with equally many rows; and the share of the square that they leave."""

    x: Array
    y: Array
    left: float


def cause_chart(joint: JointEvidence, cause: CauseEvidence) -> Chart | None:
    """Return the residual without a cause, the cause's shape through it, and the residual with it.

    Parameters
    ----------
    joint : that the cause is in
    cause : a view of it
    """
    variable = _variable(joint, cause)
    values, x_unit = joint.variables[variable]
    x = np.where(np.isfinite(cause.without) & np.isfinite(cause.shape), values, np.nan)
    if np.count_nonzero(np.isfinite(x)) < 2:
        return None
    equation, left = joint.equations[cause.equation], cause.without - cause.shape
    if variable == "time":
        over = OverTime(one_after_the_other(joint.rows), FIGURE_COLUMNS)
        x = np.where(np.isfinite(x), over.time, np.nan)
        upper = [over.line(WITHOUT, cause.without, "measured"), over.line(SHAPE, cause.shape, dashed=True)]
        lower, drawn = [over.line(WITH, left, "error")], "both over time"
    else:
        upper, drawn = _points(x, cause)
        lower = [points(WITH, x, left, "error")]
    high = 2.0 * equation.noise
    if high > 0.0:
        ends = np.array([np.nanmin(x), np.nanmax(x)])
        lower.insert(0, outline(f"{TWO_STD} of noise", ends, -high, high, "truth"))
    name, unit = signal_name(cause.equation), unit_of(equation.unit)
    words = (
        f"The residual of the equation of the {name}, over {signal_name(variable)}"
        f" ({span_words(x, unit_of(x_unit).strip())}): above without this cause, {span_words(cause.without, unit.strip())},"
        f" and the effect of this cause, {span_words(cause.shape, unit.strip())}, {drawn}; below with it. Its root mean"
        f" square changes from {number(rms(cause.without))} to {number(rms(left))}{unit}; the noise floor is"
        f" {number(equation.noise)}{unit}."
    )
    title = f"{name[:1].upper()}{name[1:]} equation over {signal_name(variable)}"
    labels = axis_label(signal_name(variable), x_unit), axis_label("residual", equation.unit)
    return Chart("cause", title, words, (Axes(*labels, tuple(upper)), Axes(*labels, tuple(lower))), linked=True)


def _variable(joint: JointEvidence, cause: CauseEvidence) -> str:
    """Return the variable that a cause is drawn over."""
    loop = LOOPS.get(cause.cause)
    if loop is None:
        return cause.variable
    suffix = cause.part[-2:] if cause.part.endswith(("_1", "_2")) else ""
    return next((v for v in (loop + suffix, loop) if v in joint.variables), cause.variable)


def _points(x: Array, cause: CauseEvidence) -> tuple[list[Curve], str]:
    """The residual as points, and the shape as a line where it is one, else as a loop, else as points; and which in words."""
    residual, shape = points(WITHOUT, x, cause.without), cause.shape
    one = means_over(x, shape)
    if one.left <= 1.0 - FOLLOWS:
        return [residual, Curve(SHAPE, one.x, one.y, "model")], "a line"
    rising = np.gradient(x) > 0.0
    up, down = (means_over(np.where(way, x, np.nan), shape) for way in (rising, ~rising))
    known = np.isfinite(x) & np.isfinite(shape)
    squares = [float(np.sum(shape[known & way] ** 2)) for way in (rising, ~rising)]
    if (up.left * squares[0] + down.left * squares[1]) / max(sum(squares), 1e-300) <= 1.0 - FOLLOWS:
        lines = [Curve(f"{SHAPE}, rising", up.x, up.y, "model"), Curve("falling", down.x, down.y, "model", dashed=True)]
        return [residual, *lines], "a loop: one line while the variable rises, one while it falls (means)"
    if cause.cause in LOOPS:
        path = _widest(x)
        words = f"loops, of which the line follows {path.stop - path.start} averages that are in one piece and wide"
        return [residual, Curve(f"{SHAPE}, for a while", x[path], shape[path], "model")], words
    words = f"points, since only {share_text(1.0 - one.left)} of it follows from this variable alone"
    return [residual, points(SHAPE, x, shape, "model")], words


def _widest(x: Array) -> slice:
    """Return rows that follow one another without a gap and in which a variable goes as far as it does."""
    length = min(2 * bins_for(x.size), x.size)
    reach = [
        (float(np.ptp(x[k : k + length])) if np.isfinite(x[k : k + length]).all() else -1.0, -k)
        for k in range(0, x.size - length + 1, max(length // 4, 1))
    ]
    first = -max(reach)[1]
    return slice(first, first + length)


def bins_for(count: int) -> int:
    """Return the number of intervals for a histogram of `count` values (Rice's rule)."""
    return max(2, round(2.0 * math.cbrt(count)))


def means_over(x: Array, y: Array) -> Means:
    """Return means of y over intervals of x.

    Parameters
    ----------
    x, y : shape (N,); NaN are left out
    """
    good = np.isfinite(x) & np.isfinite(y)
    v, e = x[good], y[good]
    if v.size < 2:
        return Means(v, e, 1.0)
    index = binned(v, bins_for(v.size))[1]
    count = np.bincount(index)
    held = count > 0
    mean = np.bincount(index, e) / np.maximum(count, 1)
    square = float(np.sum(e**2))
    # A constant variable explains nothing.
    left = 1.0 if np.ptp(v) == 0.0 else float(np.sum((e - mean[index]) ** 2)) / square if square > 0.0 else 0.0
    return Means(np.bincount(index, v)[held] / count[held], mean[held], left)


def remainder_chart(left: Unexplained, equation_unit: str) -> Chart | None:
    """Return the curve of the unexplained residual, over the variable that it depends on most.

    Parameters
    ----------
    left : with its curve
    equation_unit : of the equation it was looked at in
    """
    if not left.curve or not left.depends_on:
        return None
    on = signal_name(left.depends_on[0])
    most, least = (
        f"{number(b.mean)} ± {number(2.0 * b.std, 2)}{unit_of(equation_unit)}, between {number(b.low)} and"
        f" {number(b.high)}{unit_of(left.unit)}"
        for b in (max(left.curve, key=lambda b: b.mean), min(left.curve, key=lambda b: b.mean))
    )
    words = (
        f"The residual of the equation of the {signal_name(left.equation or left.where or 'joint')}, mean over intervals of"
        f" {on}: most, {most}; least, {least}."
    )
    curves = _steps(left.curve, "mean of the residual" + (f", {on} rising" if left.curve_back else ""))
    if left.curve_back:
        curves += _steps(left.curve_back, f"{on} falling", dashed=True)
    axes = Axes(axis_label(on, left.unit), axis_label("residual", equation_unit), tuple(curves))
    return Chart("unexplained", f"Unexplained residual over {on}", words, (axes,))


def _steps(bins: Sequence[Bin], label: str, dashed: bool = False) -> list[Curve]:
    """Return means over intervals, as steps since the values in between are unknown, with a band of two standard deviations."""
    x = np.array([end for b in bins for end in (b.low, b.high)])
    y, std = (np.repeat([getattr(b, name) for b in bins], 2) for name in ("mean", "std"))
    area = outline("" if dashed else f"{TWO_STD} of the {label}", x, y - 2.0 * std, y + 2.0 * std, "error")
    return [area, Curve(label, x, y, "error", dashed=dashed)]
