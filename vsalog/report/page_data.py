"""Charts as JSON that the page's script hands to plotly: labels escaped, arrays as base64 of their bytes."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.report.page_charts import Axes, Chart, Curve, Surface
from vsalog.report.page_text import label

Array = NDArray[np.float64]


def chart_data(chart: Chart) -> dict[str, Any]:
    """Return a chart as plain data."""
    out: dict[str, Any] = {"name": chart.name, "side_by_side": chart.side_by_side, "linked": chart.linked}
    if chart.surface is not None:
        return {**out, "surface": _surface(chart.surface)}
    return {**out, "axes": [_axes(axes) for axes in chart.axes]}


def _axes(axes: Axes) -> dict[str, Any]:
    out: dict[str, Any] = {
        "x": label(axes.x_label),
        "y": label(axes.y_label),
        "spans": [list(map(_rounded, span)) for span in axes.spans],
        "spanLabel": label(axes.span_label),
        "shadeLabel": label(axes.shade_label),
        "curves": [_curve(curve) for curve in axes.curves],
    }
    if axes.x_ticks:
        out["ticks"] = {
            "at": [_rounded(at) for at, _ in axes.x_ticks],
            "text": [label(text) for _, text in axes.x_ticks],
        }
    if axes.rows:
        out["rows"] = [label(text) for text in axes.rows]
    if axes.x_log:
        out["log"] = True
    return out


def _curve(curve: Curve) -> dict[str, Any]:
    out: dict[str, Any] = {
        "label": label(curve.label),
        "colour": curve.colour,
        "kind": curve.kind,
        "dashed": curve.dashed,
        "x": array(curve.x),
        "y": array(curve.y),
    }
    if curve.shade is not None:
        out["shade"] = array(curve.shade)
    if curve.symbol:
        out["symbol"] = curve.symbol
    if curve.width is not None:
        out["width"] = array(curve.width)
    return out


def _surface(surface: Surface) -> dict[str, Any]:
    return {
        "x": _grid(surface.x),
        "y": _grid(np.repeat(surface.y[:, None], surface.x.shape[1], axis=1)),
        "z": _grid(surface.z),
        "data": [array(surface.data[:, i]) for i in range(3)],
        "labels": [label(text) for text in (surface.x_label, surface.y_label, surface.z_label)],
    }


def _grid(values: Array) -> dict[str, str]:
    return {**array(values.ravel()), "shape": ",".join(map(str, values.shape))}


def array(values: Array) -> dict[str, str]:
    """Return an array as plotly reads it: single precision, or double where single would merge neighbours.

    Parameters
    ----------
    values : shape (N,); NaN is kept, infinities become NaN
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
    return {"dtype": kind, "bdata": base64.b64encode(values.astype(f"<{kind}").tobytes()).decode("ascii")}


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")
