"""The figures of causes: what is left over in an equation against the variable that reveals it, and what is left in the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.document import Unexplained
from vsalog.diagnosis.evidence import CauseEvidence, JointEvidence
from vsalog.reports.diagnosis_words import share_text, signal_name, unit_of
from vsalog.reports.page_charts import Axes, Chart, Curve
from vsalog.reports.page_decimate import decimated, gaps_of, one_after_the_other, scattered
from vsalog.reports.page_figures import number, span_words

Array = NDArray[np.float64]

POINTS, BINS, COLUMNS = 1800, 60, 800
# A shape is drawn as a line where this part of its square follows from the variable, or from it and its direction.
ALONG, BRANCHES = 0.97, 0.9


@dataclass(frozen=True, slots=True)
class Means:
    """Means over intervals of a variable that hold equally many rows; and how much of the square they leave."""

    x: Array
    y: Array
    left: float


def cause_chart(joint: JointEvidence, cause: CauseEvidence) -> Chart | None:
    """Return what is left over without a cause, the cause's shape through it, and what is left with it.

    Parameters
    ----------
    joint : that the cause is in
    cause : a view of it
    """
    values, x_unit = joint.variables[cause.variable]
    x = np.where(np.isfinite(cause.without) & np.isfinite(cause.shape), values, np.nan)
    if np.count_nonzero(np.isfinite(x)) < 2:
        return None
    equation = joint.equations[cause.equation]
    unit, left = unit_of(equation.unit), cause.without - cause.shape
    x_label = _axis(signal_name(cause.variable), x_unit)
    y_label = _axis("left over", equation.unit)
    if cause.variable == "time":
        x = one_after_the_other(x) if np.isfinite(x).all() else x
        upper, lower = _lines(x, cause), [Curve("with it", *decimated(x, left, COLUMNS, gaps_of(joint.rows)), "error")]
        drawn = "both over time"
    else:
        upper, drawn = _points(x, cause)
        at = scattered(x, left, POINTS)
        lower = [Curve("left over with it", x[at], left[at], "error", "points")]
    ends = np.array([np.nanmin(x), np.nanmax(x)])
    high = 2.0 * equation.noise
    if high > 0.0:
        band = (np.r_[ends, ends[::-1]], np.array([high, high, -high, -high]))
        lower.insert(0, Curve("± 2 standard deviations of noise", *band, "truth", "area"))
    name = signal_name(cause.equation)
    words = (
        f"What is left over in the equation of the {name}, over {signal_name(cause.variable)}"
        f" ({span_words(x, unit_of(x_unit).strip())}): above without this cause, {span_words(cause.without, unit.strip())},"
        f" and what this cause makes of it, {span_words(cause.shape, unit.strip())}, {drawn}; below with it. Its root mean"
        f" square goes from {number(_rms(cause.without))} to {number(_rms(left))}{unit}; noise alone makes"
        f" {number(equation.noise)}{unit}."
    )
    title = f"{name[:1].upper()}{name[1:]} equation over {signal_name(cause.variable)}"
    panels = (Axes(x_label, y_label, tuple(upper)), Axes(x_label, y_label, tuple(lower)))
    return Chart("cause", title, words, panels, linked=True)


def _lines(time: Array, cause: CauseEvidence) -> list[Curve]:
    gaps = gaps_of(time[np.isfinite(time)]) if np.isfinite(time).all() else None
    return [
        Curve("left over without this cause", *decimated(time, cause.without, COLUMNS, gaps), "measured"),
        Curve("what this cause makes", *decimated(time, cause.shape, COLUMNS, gaps), "model", dashed=True),
    ]


def _points(x: Array, cause: CauseEvidence) -> tuple[list[Curve], str]:
    """The remainder as points, the shape as a line where it is one, else as two branches, else as points; and which in words."""
    at = scattered(x, cause.without, POINTS)
    curves = [Curve("left over without this cause", x[at], cause.without[at], "measured", "points")]
    one = means_over(x, cause.shape)
    if one.left <= 1.0 - ALONG:
        return [*curves, Curve("what this cause makes", one.x, one.y, "model")], "a line"
    rising = np.gradient(x) > 0.0
    branches = [means_over(np.where(way, x, np.nan), cause.shape) for way in (rising, ~rising)]
    square = max(float(np.nansum(cause.shape[np.isfinite(x)] ** 2)), 1e-300)
    left = sum(
        b.left * float(np.sum(cause.shape[np.isfinite(x) & way] ** 2))
        for b, way in zip(branches, (rising, ~rising), strict=True)
    )
    if left / square <= min(1.0 - BRANCHES, 0.5 * one.left):
        names = (("what this cause makes, rising", False), ("falling", True))
        for (label, dashed), b in zip(names, branches, strict=True):
            curves.append(Curve(label, b.x, b.y, "model", dashed=dashed))
        return curves, "a loop: one line while the variable rises, one while it falls (means)"
    at = scattered(x, cause.shape, POINTS // 2)
    share = share_text(1.0 - one.left)
    return [
        *curves,
        Curve("what this cause makes", x[at], cause.shape[at], "model", "points"),
    ], f"points, for only {share} of it follows from this variable alone"


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
    edges = np.unique(np.quantile(v, np.linspace(0.0, 1.0, min(BINS, max(v.size // 4, 2)) + 1)))
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
    x = np.array([end for b in left.curve for end in (b.low, b.high)])
    y = np.array([b.mean for b in left.curve for _ in range(2)])
    half = 2.0 * np.array([b.std for b in left.curve for _ in range(2)])
    band = (np.r_[x, x[::-1]], np.r_[y + half, (y - half)[::-1]])
    unit = unit_of(equation_unit)
    on = signal_name(left.depends_on[0])
    top, low = max(left.curve, key=lambda b: b.mean), min(left.curve, key=lambda b: b.mean)
    words = (
        f"What is left over in the equation of the {signal_name(left.equation or left.where or 'joint')}, mean over intervals of"
        f" {on}: most, {number(top.mean)} ± {number(2.0 * top.std, 2)}{unit}, between {number(top.low)} and {number(top.high)}"
        f"{unit_of(left.unit)}; least, {number(low.mean)} ± {number(2.0 * low.std, 2)}{unit}, between {number(low.low)} and"
        f" {number(low.high)}{unit_of(left.unit)}."
    )
    curves = (
        Curve("± 2 standard deviations of the mean", *band, "error", "area"),
        Curve("mean of what is left over", x, y, "error"),
    )
    axes = Axes(_axis(on, left.unit), _axis("left over", equation_unit), curves)
    return Chart("unexplained", f"What is left, over {on}", words, (axes,))


def _axis(name: str, unit: str) -> str:
    told = unit_of(unit).strip()
    return f"{name} [{told}]" if told else name


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
