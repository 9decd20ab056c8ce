"""The figures of causes: the residual of an equation against the variable that reveals it, and the residual in the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.document import Bin, Unexplained
from vsalog.diagnosis.evidence import CauseEvidence, JointEvidence
from vsalog.report.chart import Axes, Chart, Curve
from vsalog.report.decimation import FIGURE_COLUMNS, decimated, gaps_of, one_after_the_other, rms, scattered
from vsalog.report.diagnosis_quantities import share_text, signal_name, unit_of
from vsalog.report.quantities import number
from vsalog.report.time_series import span_words

Array = NDArray[np.float64]

FOLLOWS = 0.95
"""A shape is drawn as lines where at least this part of its square follows from the variable, or from it and its direction."""
# Causes with a memory make loops, large ones and small ones, over a variable: of those the path of some rows is drawn.
LOOPS = {"transmission.hysteresis": "deflection"}
SHAPE, WITHOUT = "what this cause makes", "residual without this cause"


@dataclass(frozen=True, slots=True)
class Means:
    """Means over intervals of a variable that hold equally many rows; and how much of the square they leave."""

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
    equation = joint.equations[cause.equation]
    unit, left = unit_of(equation.unit), cause.without - cause.shape
    x_label = _axis(signal_name(variable), x_unit)
    y_label = _axis("residual", equation.unit)
    if variable == "time":
        x = one_after_the_other(x) if np.isfinite(x).all() else x
        lower = [Curve("residual with it", *decimated(x, left, FIGURE_COLUMNS, gaps_of(joint.rows)), "error")]
        upper, drawn = _lines(x, cause), "both over time"
    else:
        upper, drawn = _points(x, cause)
        at = scattered(x, left)
        lower = [Curve("residual with it", x[at], left[at], "error", "points")]
    ends = np.array([np.nanmin(x), np.nanmax(x)])
    high = 2.0 * equation.noise
    if high > 0.0:
        band = (np.r_[ends, ends[::-1]], np.array([high, high, -high, -high]))
        lower.insert(0, Curve("± 2 standard deviations of noise", *band, "truth", "area"))
    name = signal_name(cause.equation)
    words = (
        f"The residual of the equation of the {name}, over {signal_name(variable)}"
        f" ({span_words(x, unit_of(x_unit).strip())}): above without this cause, {span_words(cause.without, unit.strip())},"
        f" and what this cause makes of it, {span_words(cause.shape, unit.strip())}, {drawn}; below with it. Its root mean"
        f" square goes from {number(rms(cause.without))} to {number(rms(left))}{unit}; noise alone makes"
        f" {number(equation.noise)}{unit}."
    )
    title = f"{name[:1].upper()}{name[1:]} equation over {signal_name(variable)}"
    panels = (Axes(x_label, y_label, tuple(upper)), Axes(x_label, y_label, tuple(lower)))
    return Chart("cause", title, words, panels, linked=True)


def _variable(joint: JointEvidence, cause: CauseEvidence) -> str:
    """Return the variable that a cause is drawn over."""
    loop = LOOPS.get(cause.cause)
    if loop is None:
        return cause.variable
    suffix = cause.part[-2:] if cause.part.endswith(("_1", "_2")) else ""
    return next((v for v in (loop + suffix, loop) if v in joint.variables), cause.variable)


def _lines(time: Array, cause: CauseEvidence) -> list[Curve]:
    gaps = gaps_of(time[np.isfinite(time)]) if np.isfinite(time).all() else None
    return [
        Curve(WITHOUT, *decimated(time, cause.without, FIGURE_COLUMNS, gaps), "measured"),
        Curve(SHAPE, *decimated(time, cause.shape, FIGURE_COLUMNS, gaps), "model", dashed=True),
    ]


def _points(x: Array, cause: CauseEvidence) -> tuple[list[Curve], str]:
    """The residual as points, and the shape as a line where it is one, else as a loop, else as points; and which in words."""
    at = scattered(x, cause.without)
    points = Curve(WITHOUT, x[at], cause.without[at], "measured", "points")
    one = means_over(x, cause.shape)
    if one.left <= 1.0 - FOLLOWS:
        return [points, Curve(SHAPE, one.x, one.y, "model")], "a line"
    branches = _branches(x, cause.shape, one)
    if branches is not None:
        up, down = branches
        lines = [Curve(f"{SHAPE}, rising", up.x, up.y, "model"), Curve("falling", down.x, down.y, "model", dashed=True)]
        return [points, *lines], "a loop: one line while the variable rises, one while it falls (means)"
    if cause.cause in LOOPS:
        path = _widest(x)
        words = f"loops, of which the line follows {path.stop - path.start} averages that are in one piece and wide"
        return [points, Curve(f"{SHAPE}, for a while", x[path], cause.shape[path], "model")], words
    at = scattered(x, cause.shape)
    words = f"points, for only {share_text(1.0 - one.left)} of it follows from this variable alone"
    return [points, Curve(SHAPE, x[at], cause.shape[at], "model", "points")], words


def _branches(x: Array, shape: Array, one: Means) -> tuple[Means, Means] | None:
    """Return a shape's means while a variable rises and while it falls, where the shape follows from these; else None."""
    rising = np.gradient(x) > 0.0
    known = np.isfinite(x) & np.isfinite(shape)
    ways = [known & rising, known & ~rising]
    up, down = (means_over(np.where(way, x, np.nan), shape) for way in ways)
    squares = [float(np.sum(shape[way] ** 2)) for way in ways]
    left = (up.left * squares[0] + down.left * squares[1]) / max(sum(squares), 1e-300)
    return (up, down) if left <= 1.0 - FOLLOWS else None


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
    """Return how many intervals show a distribution of so many values (Rice's rule)."""
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
    edges = np.unique(np.quantile(v, np.linspace(0.0, 1.0, bins_for(v.size) + 1)))
    if edges.size < 2:
        return Means(np.array([v.mean()]), np.array([e.mean()]), 1.0)
    index = np.clip(np.searchsorted(edges, v, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(index, minlength=edges.size - 1)
    held = count > 0
    middle = np.bincount(index, v, minlength=edges.size - 1)[held] / count[held]
    mean = np.bincount(index, e, minlength=edges.size - 1) / np.maximum(count, 1)
    square = float(np.sum(e**2))
    left = float(np.sum((e - mean[index]) ** 2)) / square if square > 0.0 else 0.0
    return Means(middle, mean[held], left)


def remainder_chart(left: Unexplained, equation_unit: str) -> Chart | None:
    """Return the curve of what no cause explains, over the variable that it depends on most.

    Parameters
    ----------
    left : with its curve
    equation_unit : of the equation it was looked at in
    """
    if not left.curve or not left.depends_on:
        return None
    # Each interval is a step as wide as it is: nothing is claimed between means.
    unit = unit_of(equation_unit)
    on = signal_name(left.depends_on[0])
    top, low = max(left.curve, key=lambda b: b.mean), min(left.curve, key=lambda b: b.mean)
    words = (
        f"The residual of the equation of the {signal_name(left.equation or left.where or 'joint')}, mean over intervals of"
        f" {on}: most, {number(top.mean)} ± {number(2.0 * top.std, 2)}{unit}, between {number(top.low)} and {number(top.high)}"
        f"{unit_of(left.unit)}; least, {number(low.mean)} ± {number(2.0 * low.std, 2)}{unit}, between {number(low.low)} and"
        f" {number(low.high)}{unit_of(left.unit)}."
    )
    curves = _steps(left.curve, "mean of the residual" + (f", {on} rising" if left.curve_back else ""))
    if left.curve_back:
        curves += _steps(left.curve_back, f"{on} falling", dashed=True)
    axes = Axes(_axis(on, left.unit), _axis("residual", equation_unit), tuple(curves))
    return Chart("unexplained", f"What is left, over {on}", words, (axes,))


def _steps(bins: Sequence[Bin], label: str, dashed: bool = False) -> list[Curve]:
    """Return means over intervals, with a band of two standard deviations."""
    x = np.array([end for b in bins for end in (b.low, b.high)])
    y = np.array([b.mean for b in bins for _ in range(2)])
    half = 2.0 * np.array([b.std for b in bins for _ in range(2)])
    band = (np.r_[x, x[::-1]], np.r_[y + half, (y - half)[::-1]])
    return [
        Curve(f"± 2 standard deviations of the {label}" if not dashed else "", *band, "error", "area"),
        Curve(label, x, y, "error", dashed=dashed),
    ]


def _axis(name: str, unit: str) -> str:
    text = unit_of(unit).strip()
    return f"{name} [{text}]" if text else name
