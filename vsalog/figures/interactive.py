"""Charts as figures of plotly in Python, as notebooks show them; a report's page draws the same by its own script."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from vsalog.figures.chart import Axes, Chart, Curve, Surface, label
from vsalog.figures.paper import COLOURS, PALETTE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

DASHES = ("solid", "dash", "dot", "dashdot")
SHADE = "rgba(110, 120, 130, .18)"


def interactive(chart: Chart) -> Figure:
    """Return a chart as a figure of plotly; labels are escaped, which plotly reads as HTML of a few tags.

    Parameters
    ----------
    chart : with axes, or a surface
    """
    from plotly.graph_objects import Figure
    from plotly.subplots import make_subplots

    title = {"text": label(chart.title)}
    if chart.surface is not None:
        figure = Figure(list(_solid(chart.surface)))
        names = (chart.surface.x_label, chart.surface.y_label, chart.surface.z_label)
        scene = {f"{axis}axis": {"title": {"text": label(name)}} for axis, name in zip("xyz", names, strict=True)}
        return figure.update_layout(title=title, scene=scene)
    n = max(len(chart.axes), 1)
    rows, columns = (1, n) if chart.side_by_side else (n, 1)
    figure = make_subplots(rows=rows, cols=columns, shared_xaxes=chart.linked)
    for i, axes in enumerate(chart.axes, 1):
        place = {"row": 1, "col": i} if chart.side_by_side else {"row": i, "col": 1}
        for trace in _traces(axes):
            figure.add_trace(trace, **place)
        for begin, end in axes.spans:
            figure.add_vrect(x0=begin, x1=end, fillcolor=SHADE, line_width=0, layer="below", **place)
        last = not chart.linked or i == n
        figure.update_xaxes(
            title_text=label(axes.x_label) if last else None, type="log" if axes.x_log else None, **place
        )
        figure.update_yaxes(title_text=label(axes.y_label), type="log" if axes.y_log else None, **place)
        if axes.x_ticks:
            figure.update_xaxes(
                tickvals=[at for at, _ in axes.x_ticks], ticktext=[label(t) for _, t in axes.x_ticks], **place
            )
        if axes.rows:
            named = {"tickvals": [-k for k in range(len(axes.rows))], "ticktext": [label(row) for row in axes.rows]}
            figure.update_yaxes(range=[0.6 - len(axes.rows), 0.6], zeroline=False, **named, **place)
    # A legend at the right would cover the colour scale.
    legend = {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"}
    return figure.update_layout(title=title, template="simple_white", barmode="overlay", legend=legend)


def _traces(axes: Axes) -> Iterator[Any]:
    from plotly import graph_objects

    if axes.spans and axes.span_label:
        marker = {"symbol": "square", "size": 13, "color": SHADE}
        yield graph_objects.Scatter(x=[None], y=[None], mode="markers", name=label(axes.span_label), marker=marker)
    for curve in axes.curves:
        own: dict[str, Any] = {"x": curve.x, "y": curve.y, "name": label(curve.label), "showlegend": bool(curve.label)}
        colour = _colour(curve)
        if curve.kind == "bars":
            yield graph_objects.Bar(**own, width=curve.width, marker={"color": colour, "opacity": 0.75})
        elif curve.kind == "area":
            yield graph_objects.Scatter(
                **own, mode="lines", line={"width": 0, "color": colour}, fill="toself", opacity=0.3, hoverinfo="skip"
            )
        elif curve.kind == "points":
            yield graph_objects.Scatter(**own | _marked(curve, colour, axes))
        else:
            dash = "dash" if curve.dashed else DASHES[_number(curve) // len(PALETTE) % len(DASHES)]
            mode = "lines+markers" if curve.kind == "marked" else "lines"
            yield graph_objects.Scatter(**own, mode=mode, line={"color": colour, "width": 1.6, "dash": dash})


def _marked(curve: Curve, colour: str, axes: Axes) -> dict[str, Any]:
    marker: dict[str, Any] = {"size": 3, "color": colour, "opacity": 0.6}
    if curve.symbol:
        marker = {"size": 12, "color": colour, "symbol": curve.symbol}
    if curve.shade is None:
        return {"mode": "markers", "marker": marker}
    bar = {"title": {"text": label(axes.shade_label), "side": "right"}}
    shaded = {"color": curve.shade, "colorscale": "Viridis", "showscale": True, "colorbar": bar}
    return {"mode": "markers", "marker": marker | shaded, "showlegend": False}


def _number(curve: Curve) -> int:
    return int(curve.colour) if curve.colour.isdigit() else 0


def _colour(curve: Curve) -> str:
    return PALETTE[_number(curve) % len(PALETTE)] if curve.colour.isdigit() else COLOURS[curve.colour]


def _solid(surface: Surface) -> Iterator[Any]:
    from plotly import graph_objects

    y = np.repeat(surface.y[:, None], surface.x.shape[1], axis=1)
    bar = {"title": {"text": label(surface.z_label), "side": "right"}}
    yield graph_objects.Surface(x=surface.x, y=y, z=surface.z, colorscale="Viridis", opacity=0.85, colorbar=bar)
    x, c, z = surface.data.T
    marker = {"size": 2, "color": COLOURS["measured"]}
    yield graph_objects.Scatter3d(x=x, y=c, z=z, mode="markers", name="data", marker=marker)
