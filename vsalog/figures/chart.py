"""The content of a figure, apart from its drawing: plotly draws those of pages, matplotlib those for papers."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.core.notation import number
from vsalog.core.printable import printable
from vsalog.figures.decimation import band, decimated, extent, gaps_of, scattered

Array = NDArray[np.float64]

TWO_STD = "± 2 standard deviations"


@dataclass(frozen=True, slots=True)
class Curve:
    """One thing drawn in a pair of axes.

    Attributes
    ----------
    label : for the legend; empty for none
    x, y : shape (N,); NaN breaks a line
    colour : a name out of the palette: model, measured, truth, error, or 0, 1, 2 … for one of several
    kind : line, marked (a line with its points), points, area (the outline of an area) or bars
    dashed : line style
    shade : shape (N,), the value for the colour of each point, or None
    width : of each bar, shape (N,), or None
    symbol : of large points: circle, diamond, …; small dots when empty
    """

    label: str
    x: Array
    y: Array
    colour: str
    kind: str = "line"
    dashed: bool = False
    shade: Array | None = None
    width: Array | None = None
    symbol: str = ""


class OverTime:
    """Curves over one time, thinned to the pixel columns of a figure; none crosses a gap.

    Parameters
    ----------
    time : shape (N,), not decreasing [s]
    columns : of pixels
    """

    def __init__(self, time: Array, columns: int) -> None:
        self.time, self.columns, self.gaps = time, columns, gaps_of(time)

    def line(self, label: str, values: Array, colour: str = "model", dashed: bool = False) -> Curve:
        """Return a line through values, shape (N,)."""
        return Curve(label, *decimated(self.time, values, self.columns, self.gaps), colour, dashed=dashed)

    def band(self, label: str, low: Array, high: Array, colour: str = "model") -> Curve:
        """Return what lies between two lines, each of shape (N,)."""
        return Curve(label, *band(self.time, low, high, self.columns, self.gaps), colour, "area")


def outline(label: str, x: Array, low: ArrayLike, high: ArrayLike, colour: str = "model") -> Curve:
    """Return the area between two lines over `x`, shape (N,), as it is; each line may be one number."""
    upper, lower = np.broadcast_to(high, x.shape), np.broadcast_to(low, x.shape)
    return Curve(label, np.r_[x, x[::-1]], np.r_[upper, lower[::-1]], colour, "area")


def points(label: str, x: Array, y: Array, colour: str = "measured", shade: Array | None = None) -> Curve:
    """Return points that cover the same area as all of them, shape (N,)."""
    at = scattered(x, y)
    return Curve(label, x[at], y[at], colour, "points", shade=None if shade is None else shade[at])


def strokes(*ends: ArrayLike) -> Array:
    """Return a line through the points of each stroke, with NaN between strokes.

    Parameters
    ----------
    ends : first, second … points of all strokes, each of shape (N,)
    """
    return np.stack([*ends, np.full(np.shape(ends[0]), np.nan)], axis=1).ravel()


@dataclass(frozen=True, slots=True)
class Axes:
    """A pair of axes.

    Attributes
    ----------
    x_label, y_label : with units
    curves : drawn in them
    spans, span_label : stretches of x that are shaded, and what that means
    shade_label : what the colour of points means
    x_ticks : places that are marked, and with what; plotly's own when empty
    rows : names of the rows of a chart that has no y: row i is at y = −i
    x_log, y_log : logarithmic
    title, y_range : above them, and the shown range of y, in files for papers
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    spans: tuple[tuple[float, float], ...] = ()
    span_label: str = ""
    shade_label: str = ""
    x_ticks: tuple[tuple[float, str], ...] = ()
    rows: tuple[str, ...] = ()
    x_log: bool = False
    y_log: bool = False
    title: str = ""
    y_range: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Surface:
    """z (m, n) over a grid whose rows have a y each, (m,), and their own x (m, n); and the data on it, (N, 3).

    Flat: drawn as a map with contours in files for papers.
    """

    x: Array
    y: Array
    z: Array
    data: Array
    x_label: str
    y_label: str
    z_label: str
    flat: bool = False


@dataclass(frozen=True, slots=True)
class Chart:
    """One figure.

    Attributes
    ----------
    name : of its kind; files are named after it, never after anything in a log
    title : a few words
    words : a description in sentences with figures: the alternative text, and the caption
    axes : one below the other, or side by side
    side_by_side : side by side
    linked : the axes share x: zooming one zooms all
    surface : instead of axes
    """

    name: str
    title: str
    words: str
    axes: tuple[Axes, ...] = ()
    side_by_side: bool = False
    linked: bool = False
    surface: Surface | None = None


Charts = Mapping[str, Sequence[Chart]]
"""Transmission → figures."""


def span_words(values: NDArray[np.float64], unit: str) -> str:
    """Return the range of values, shape (N,), in words; where there is none, that."""
    low, high, _ = extent(values)
    if low > high:
        return "no known value"
    return f"{number(low)} to {number(high)} {unit}".rstrip()


def chart_data(part: Any) -> Any:
    """Return a chart, or a part of one, as JSON that the page's script hands to plotly: labels escaped, arrays as bytes."""
    if isinstance(part, Surface):
        y, labels = np.repeat(part.y[:, None], part.x.shape[1], axis=1), (part.x_label, part.y_label, part.z_label)
        grid = {name: array(values) for name, values in (("x", part.x), ("y", y), ("z", part.z))}
        return grid | {"data": chart_data(tuple(part.data.T)), "labels": chart_data(labels)}
    if is_dataclass(part):
        found = {f.name: getattr(part, f.name) for f in fields(part) if f.name not in ("title", "words")}
        return {name: chart_data(value) for name, value in found.items() if value is not None}
    if isinstance(part, np.ndarray):
        return array(part)
    if isinstance(part, float):
        return float(f"{part:.9g}")
    if isinstance(part, tuple):
        return [chart_data(each) for each in part]
    return label(part) if isinstance(part, str) else part


def array(values: Array) -> dict[str, str]:
    """Return an array as plotly reads it: single precision, or double where single would merge neighbours.

    Parameters
    ----------
    values : shape (N,) or (M, N); NaN is kept, infinities become NaN
    """
    values = np.where(np.isfinite(values), values, np.nan)
    known = values[np.isfinite(values)]
    kind = "f4"
    if known.size:
        steps = np.abs(np.diff(known))
        steps = steps[steps > 0.0]
        # A twentieth of a usual step is finer than any screen shows.
        coarse = steps.size > 0 and float(np.finfo(np.float32).eps) / 2.0 * float(np.abs(known).max()) > 0.05 * float(
            np.median(steps)
        )
        if coarse or float(np.abs(known).max()) > float(np.finfo(np.float32).max):
            kind = "f8"
    data = {"dtype": kind, "bdata": base64.b64encode(values.astype(f"<{kind}").tobytes()).decode("ascii")}
    return data if values.ndim == 1 else {**data, "shape": ",".join(map(str, values.shape))}


def label(text: str) -> str:
    """Return a text for plotly, whose labels know some tags of their own; it turns entities back into characters."""
    return html.escape(printable(text), quote=False)
