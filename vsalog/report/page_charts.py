"""What a report's figures show, apart from how they are drawn: plotly draws the page's, matplotlib those for papers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Names that a chart may have; files are named after them, never after anything in a log.
NAMES = (
    "torque",
    "torque_expanded",
    "torque_over_deflection",
    "surface",
    "slices",
    "stiffness",
    "convergence",
    "error_distribution",
    "error_dependence",
)


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
    shade : shape (N,), what the colour of each point tells, or None
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
    x_log : x is logarithmic
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


@dataclass(frozen=True, slots=True)
class Surface:
    """z (m, n) over a grid whose rows have a y each, (m,), and their own x (m, n); and the data on it, (N, 3)."""

    x: Array
    y: Array
    z: Array
    data: Array
    x_label: str
    y_label: str
    z_label: str


@dataclass(frozen=True, slots=True)
class Chart:
    """One figure.

    Attributes
    ----------
    name : out of `NAMES`
    title : a few words
    words : what is to be seen, in sentences with figures: the alternative text, and the caption
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
