"""Figures like the papers', as data: curves, panels, a surface, and a caption with the paper's and the chosen conditions.

A figure is described by its content: `over` makes a panel of named lines, whose names decide how they are drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STYLES: Mapping[str, str] = {
    "actual": "dashed",
    "nominal": "dashdot",
    "reference": "dashed",
    "MODEL": "dotted",
    "SENSOR": "dashdot",
    "residual": "dotted",
    "sensor": "dashdot",
}
"""How lines of these names are drawn in every figure; all others are solid."""


class Curve(NamedTuple):
    """A line or points of a figure; `style` is solid, dashed, dotted, dashdot or points."""

    label: str
    x: Array
    y: Array
    style: str = "solid"


class Surface(NamedTuple):
    """z (m, n) over a grid of x (n,) and y (m,), points of data (N, 3) on it, and the axes' labels with units."""

    x: Array
    y: Array
    z: Array
    data: Array
    labels: tuple[str, str, str]


class Panel(msgspec.Struct, frozen=True, kw_only=True):
    """One pair of axes; `y_range` is shown where given, all else.

    Attributes
    ----------
    title, x_label, y_label : with units
    curves : to draw
    log_x, log_y : logarithmic axes
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None


class Figure(msgspec.Struct, frozen=True):
    """A figure like one of the paper's; `name` becomes the file's.

    Attributes
    ----------
    name, title : for the file, and above the panels
    panels : one below the other, or side by side
    caption : the paper's and the chosen conditions
    side_by_side : the panels' place
    surface : left of the panels, where there is one
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    caption: str = ""
    side_by_side: bool = False
    surface: Surface | None = None


def over(
    x: Array, lines: Mapping[str, Array], y_label: str, *, x_label: str = "time [s]", scale: float = 1.0, title: str = "",
    by: str = "", margin: float = 0.3, log_y: bool = False,
) -> Panel:  # fmt: skip
    """Return a panel of lines over one x.

    Parameters
    ----------
    x : shape (N,)
    lines : label → shape (N,), drawn in the style of the label's last word that has one
    y_label, x_label : with units
    scale : of all lines, to the unit of `y_label`
    title : of the panel
    by : label of the line whose range is shown, and as much of it as `margin` on both sides; all is shown where empty
    log_y : logarithmic
    """
    curves = tuple(Curve(name, x, scale * np.asarray(y, dtype=np.float64), style_of(name)) for name, y in lines.items())
    shown = next((c.y for c in curves if by and c.label == by), None)
    limits = None
    if shown is not None:
        low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
        room = margin * ((high - low) or abs(high))
        limits = low - room, high + room
    return Panel(x_label=x_label, y_label=y_label, curves=curves, title=title, y_range=limits, log_y=log_y)


def style_of(label: str) -> str:
    """Return the style of a line of that name."""
    return next((STYLES[word] for word in reversed(label.split()) if word in STYLES), "solid")


def figure(
    paper: str, number: str | int, title: str, panels: tuple[Panel, ...], conditions: str, chosen: str, *,
    side_by_side: bool = False, surface: Surface | None = None,
) -> Figure:  # fmt: skip
    """Return a figure named after the paper's, with a caption.

    Parameters
    ----------
    paper, number : "Flacco 2012", 6
    title : of the figure
    panels, side_by_side, surface : as for `Figure`
    conditions : of the simulation
    chosen : those that the paper does not print
    """
    name = f"{paper.lower().replace(' ', '')}-fig{number}"
    caption = f"Simulated: {conditions}. Chosen, not printed: {chosen}."
    return Figure(name, f"{title} ({paper}, Fig. {number})", panels, caption, side_by_side, surface)
