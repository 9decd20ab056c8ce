"""Figures as files for papers, drawn by matplotlib."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from vsalog.core.errors import VsalogError, WriteError
from vsalog.core.printable import printable
from vsalog.figures.chart import Axes, Chart, Charts, Curve, Surface
from vsalog.figures.decimation import FIGURE_COLUMNS, decimated, scattered
from vsalog.reproduce.drawing import Figure as Reproduced
from vsalog.reproduce.drawing import Panel
from vsalog.writers.atomic import atomic_path, write_text

FORMATS = ("svg", "png", "pdf")

# Okabe and Ito's colours; dashes distinguish the curves in print.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#000000")
COLOURS = {"model": "#0072B2", "measured": "#D55E00", "truth": "#009E73", "error": "#5F5F5F"}
DASHES = ("-", "--", ":", "-.")
STYLES = ("solid", "dashed", "dotted", "dashdot")
MARKERS = {"circle": "o", "diamond-open": "D"}
# Journals want text as text, equal results make equal files, and a name's dollar signs are no formulas.
BASE: Any = {
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "pdf.fonttype": 42,
    "svg.hashsalt": "vsalog",
    "text.parse_math": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 1.5,
    "legend.handletextpad": 0.5,
    "legend.columnspacing": 1.0,
}
STYLE: Any = BASE | {"font.size": 8.0}


@dataclass(frozen=True, slots=True)
class Style:
    """The size of a figure.

    Attributes
    ----------
    width, row : of a figure, and the height of its first pair of axes [in]
    font : size [pt]
    """

    width: float
    row: float
    font: float

    @property
    def settings(self) -> Any:
        """The settings of matplotlib."""
        ticks = {f"{axis}tick.major.{what}": value for axis in "xy" for what, value in (("width", 0.6), ("size", 2.5))}
        return BASE | ticks | {"font.size": self.font, "legend.fontsize": self.font, "axes.xmargin": 0.02}

    @property
    def lines(self) -> float:
        """How many lines fit above one another into the first pair of axes; a narrower band cannot be seen."""
        return 72.0 * self.row / float(BASE["lines.linewidth"])


# A column and a page of IEEE's transactions are 3.5 in and 7.16 in wide, with text of 8 to 10 pt in figures (IEEE,
# "Preparation of Papers for IEEE Transactions and Journals").
SIZES: Mapping[str, Style] = {
    "column": Style(3.5, 1.9, 8.0),
    "page": Style(7.16, 2.3, 9.0),
    "screen": Style(10.0, 4.2, 11.0),
}
METADATA: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}


class FigureError(VsalogError):
    """Figures are requested, but cannot be drawn."""


def check_matplotlib(option: str = "--figures") -> None:
    """Refuse to draw without matplotlib, before anything is computed.

    Parameters
    ----------
    option : that requests figures

    Raises
    ------
    FigureError
        matplotlib is not installed; the message says what to install.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise FigureError(f"{option} needs matplotlib, which is not installed: pip install matplotlib") from None


def write_figures(
    folder: Path,
    drawn: Sequence[Mapping[str, Charts]],
    logs: Sequence[str] = (),
    formats: Sequence[str] = FORMATS,
) -> list[Path]:
    """Write every figure of a report into a folder, which is made, and `figures.txt`, which describes each.

    Files are named after their charts and numbered, ``log1_joint1_part1_torque.svg``; no name from a log is part of one.

    Parameters
    ----------
    folder : of the files
    drawn : per log, its joints' figures
    logs : their names, for `figures.txt`
    formats : out of svg, png, pdf

    Returns
    -------
    The figures' files

    Raises
    ------
    FigureError
        matplotlib is not installed.
    WriteError
        The folder or a file cannot be written.
    """
    check_matplotlib()
    from matplotlib import rc_context

    written: list[Path] = []
    lines: list[str] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with rc_context(STYLE):
            for name, heading, chart in _named(drawn, logs):
                canvas = _drawn(chart)
                for kind in formats:
                    path = folder / f"{name}.{kind}"
                    canvas.savefig(path, dpi=200, metadata=METADATA[kind])
                    written.append(path)
                lines += [f"{name}: {heading}", f"    {chart.title}. {chart.words}", ""]
    except OSError as error:
        raise WriteError(f"{folder}: figures cannot be written: {error.strerror}") from error
    write_text(folder / "figures.txt", "\n".join(lines))
    return written


def prepare_folder(folder: Path, option: str) -> None:
    """Check, before anything is computed, that figures can be drawn and written; makes the folder.

    Parameters
    ----------
    folder : where to
    option : that requests figures

    Raises
    ------
    FigureError
        matplotlib is not installed.
    WriteError
        The folder cannot be made or written to.
    """
    check_matplotlib(option)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be made: {error.strerror}; name another folder with {option}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise WriteError(f"{folder}: cannot be written to; name another folder with {option}")


def write_reproduced(folder: Path, figures: Sequence[Reproduced]) -> list[Path]:
    """Write figures like the papers' as NAME.svg into an existing folder, each whole or not at all; return the files.

    The caption, under each figure and in `figures.txt`, describes the simulation and what was chosen.

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    from matplotlib import rc_context

    written = []
    lines: list[str] = []
    with rc_context(STYLE):
        for figure in figures:
            canvas = _drawn(_chart(figure))
            # Without the space between the title and the panels' legends the two would meet.
            canvas.suptitle(fill(printable(figure.title), int(13.0 * canvas.get_figwidth())) + "\n")
            _captioned(canvas, printable(figure.caption))
            path = folder / f"{figure.name}.svg"
            with atomic_path(path) as temporary:
                canvas.savefig(temporary, format="svg", metadata=METADATA["svg"])
            written.append(path)
            lines += [f"{figure.name}: {figure.title}", f"    {figure.caption}", ""]
    if lines:
        write_text(folder / "figures.txt", "\n".join(lines))
    return written


def _chart(figure: Reproduced) -> Chart:
    surface = None
    if (given := figure.surface) is not None:
        x = np.broadcast_to(given.x, given.z.shape)
        surface = Surface(x, given.y, given.z, given.data, *given.labels)
    axes = tuple(map(_axes, figure.panels))
    return Chart(figure.name, figure.title, figure.caption, axes, side_by_side=figure.side_by_side, surface=surface)


def _captioned(canvas: Any, caption: str) -> None:
    """Put a caption under a figure, which grows by it."""
    if not caption:
        return
    # About 18 letters of the small font fit into an inch.
    text = fill(caption, int(18.0 * canvas.get_figwidth()))
    height = canvas.get_figheight()
    more = 0.125 * (text.count("\n") + 2)
    canvas.set_figheight(height + more)
    if (engine := canvas.get_layout_engine()) is None:
        canvas.subplots_adjust(bottom=(more + 0.08 * height) / (height + more))
    else:
        engine.set(rect=(0.0, more / (height + more), 1.0, height / (height + more)))
    canvas.text(0.01, 0.04 / (height + more), text, fontsize="small", va="bottom", ha="left")


def _axes(panel: Panel) -> Axes:
    curves = []
    for i, curve in enumerate(panel.curves):
        kind = "points" if curve.style == "points" else "line" if curve.x.size >= 20 else "marked"
        x, y = curve.x, curve.y
        if kind == "points":
            x, y = (values[scattered(x, y)] for values in (x, y))
        elif bool(np.all(np.diff(x) >= 0.0)):
            x, y = decimated(x, y, FIGURE_COLUMNS)
        # Curves differ by their dashes too, not by colour alone.
        dash = STYLES.index(curve.style) if curve.style in STYLES else 0
        curves.append(Curve(curve.label, x, y, str(i % len(PALETTE) + dash * len(PALETTE)), kind))
    return Axes(
        panel.x_label, panel.y_label, tuple(curves), x_log=panel.log_x, y_log=panel.log_y, title=panel.title,
        y_range=panel.y_range,
    )  # fmt: skip


def _named(drawn: Sequence[Mapping[str, Charts]], logs: Sequence[str]) -> Iterator[tuple[str, str, Chart]]:
    """Give each chart its file's name and a heading in words."""
    for i, joints in enumerate(drawn):
        log = f", log {logs[i]}" if logs else ""
        for j, (joint, parts) in enumerate(joints.items()):
            for k, (part, charts) in enumerate(parts.items()):
                heading = printable(f"joint {joint}, transmission {part}{log}")
                for chart in charts:
                    yield f"log{i + 1}_joint{j + 1}_part{k + 1}_{chart.name}", heading, chart


def _drawn(chart: Chart) -> Any:
    from matplotlib.figure import Figure

    n = len(chart.axes)
    if chart.surface is not None:
        if n == 0:
            return _surface(Figure(figsize=(4.6, 3.8)), chart.surface)
        canvas = Figure(figsize=(7.0, 1.5 * n), layout="constrained")
        left, right = canvas.subfigures(1, 2, squeeze=False)[0]
        _surface(left, chart.surface)
        for axes, panel in zip(right.subplots(n, 1), chart.axes, strict=True):
            _panel(right, axes, panel, last=True)
            axes.locator_params(axis="x", nbins=5)
        return canvas
    canvas = Figure(figsize=(7.0, 2.5 if chart.side_by_side else 0.9 + 1.3 * sum(_ratios(chart))), layout="constrained")
    _fill(canvas, chart, chart.side_by_side)
    return canvas


def _ratios(chart: Chart) -> list[float]:
    """Return the heights of axes below one another: of linked ones the first is the figure's subject."""
    n = len(chart.axes)
    return [1.6] + [1.0] * (n - 1) if chart.linked else [1.0] * n


def _fill(canvas: Any, chart: Chart, side_by_side: bool) -> None:
    n = len(chart.axes)
    if side_by_side:
        grid = canvas.subplots(1, max(n, 1), squeeze=False)[0]
    else:
        grid = canvas.subplots(n, 1, squeeze=False, sharex=chart.linked, height_ratios=_ratios(chart))[:, 0]
    for i, (axes, panel) in enumerate(zip(grid, chart.axes, strict=False)):
        _panel(canvas, axes, panel, last=not chart.linked or i == n - 1)


def draw(canvas: Any, chart: Chart, style: Style) -> None:
    """Draw a chart into a figure of matplotlib that is empty, whose size becomes the style's.

    Parameters
    ----------
    canvas : `matplotlib.figure.Figure`; of what is made of it later, its caller sets ``style.settings``
    chart, style : what is drawn, and how large
    """
    if chart.surface is not None:
        flat = chart.surface.flat
        canvas.set_size_inches(style.width, (0.75 if flat else 0.85) * min(style.width, 7.0))
        if flat:
            canvas.set_layout_engine("constrained")
        (_map if flat else _surface)(canvas, chart.surface)
        if flat:
            _few_ticks(canvas.axes[0], style.width, style.font)
        return
    # Axes side by side need a page's width.
    in_row = chart.side_by_side and style.width > SIZES["column"].width
    ratios = [1.0] if in_row else _ratios(chart)
    named = max((len(panel.rows) for panel in chart.axes), default=0)
    height = style.row * sum(ratios) / ratios[0] + 2.5 * style.font / 72.0 * named
    canvas.set_size_inches(style.width, height)
    canvas.set_layout_engine("constrained")
    _fill(canvas, chart, in_row)
    for axes, panel in zip(canvas.axes, chart.axes, strict=False):
        if not panel.x_log and not panel.x_ticks:
            _few_ticks(axes, style.width / (len(chart.axes) if in_row else 1), style.font)
    legends = [axes.get_legend() for axes in canvas.axes if axes.get_legend() is not None]
    tall = [legend.get_window_extent().height / canvas.dpi for legend in legends] or [0.0]
    # Three lines below the axes: their numbers, their label, and some room.
    canvas.set_size_inches(style.width, height + (max(tall) if in_row else sum(tall)) + 3.0 * style.font / 72.0)
    canvas.draw_without_rendering()  # the tick labels depend on the size of the axes, and it on them


def _few_ticks(axes: Any, width: float, font: float) -> None:
    """Mark as few places of x as leave room between their numbers; width in inches, font in points."""
    from matplotlib.ticker import MaxNLocator

    # A number such as −0.005 is six letters wide, of 0.6 of the font's size each, with room for four between two.
    most = max(2, int(72.0 * width / (0.6 * font * 10.0)))
    axes.xaxis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))


def write_chart(path: Path, chart: Chart, style: Style) -> None:
    """Write a chart into a file of the format of its suffix, which appears whole or not at all.

    Raises
    ------
    FigureError
        matplotlib is not installed.
    WriteError
        The file cannot be written.
    """
    check_matplotlib("a figure")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    kind = path.suffix.lower().removeprefix(".")
    with rc_context(style.settings), atomic_path(path) as temporary:
        canvas = Figure()
        draw(canvas, chart, style)
        canvas.savefig(temporary, format=kind, dpi=300, metadata=METADATA[kind])


def _panel(canvas: Any, axes: Any, panel: Axes, last: bool) -> None:
    for i, (begin, end) in enumerate(panel.spans):
        axes.axvspan(begin, end, color="0.5", alpha=0.18, linewidth=0, label=panel.span_label if i == 0 else None)
    for curve in panel.curves:
        drawn = _curve(axes, curve)
        if curve.shade is not None:
            canvas.colorbar(drawn, ax=axes, label=printable(panel.shade_label), pad=0.01)
    for name, is_log in (("x", panel.x_log), ("y", panel.y_log)):
        if is_log:
            axes.set(**{f"{name}scale": "log"})
            # matplotlib's own are formulas, which are not read.
            getattr(axes, f"{name}axis").set_major_formatter("{x:g}")
            getattr(axes, f"{name}axis").set_minor_formatter("")
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    if panel.title:
        axes.set_title(printable(panel.title), loc="right", fontsize="medium")
    if last:
        axes.set_xlabel(printable(panel.x_label))
    axes.set_ylabel(printable(panel.y_label))
    if panel.rows:
        axes.set_yticks([-i for i in range(len(panel.rows))], [printable(name) for name in panel.rows])
        axes.set_ylim(0.6 - len(panel.rows), 0.6)
    if panel.x_ticks:
        axes.set_xticks([at for at, _ in panel.x_ticks], [printable(name) for _, name in panel.x_ticks])
    _legend(canvas, axes)


def _legend(canvas: Any, axes: Any) -> None:
    """Put a legend above the axes, in as many columns as the figure is wide."""
    handles, labels = axes.get_legend_handles_labels()
    if not handles:
        return
    place = axes.get_subplotspec().get_position(canvas)
    for columns in range(min(4, len(handles)), 0, -1):
        legend = axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns)
        for handle in legend.legend_handles:
            if hasattr(handle, "set_sizes"):  # points of the figure's size would hardly show
                handle.set_sizes([20])
        # It ends with the axes, and may begin above their labels.
        if legend.get_window_extent().width <= 0.97 * canvas.bbox.width * place.x1:
            return


def _curve(axes: Any, curve: Curve) -> Any:
    label = printable(curve.label) or None
    one_of_many = curve.colour.isdigit()
    colour = PALETTE[int(curve.colour) % len(PALETTE)] if one_of_many else COLOURS[curve.colour]
    if curve.kind == "bars":
        return axes.bar(curve.x, curve.y, width=curve.width, color=colour, alpha=0.6, label=label)
    if curve.kind == "area":
        areas = axes.fill(*_polygons(curve), color=colour, alpha=0.22, linewidth=0)
        for area in areas[:1]:  # a band with gaps is one thing in a legend
            area.set_label(label)
        return areas
    if curve.kind == "points":
        c = colour if curve.shade is None else curve.shade
        size, edge, marker = (20, 0.8, MARKERS.get(curve.symbol, "o")) if curve.symbol else (3, 0.0, ".")
        shaded = {"label": label} if curve.shade is None else {"cmap": "viridis"}
        return axes.scatter(curve.x, curve.y, s=size, c=c, marker=marker, linewidths=edge, **shaded)
    dash = DASHES[int(curve.colour) // len(PALETTE) % len(DASHES)] if one_of_many else "--" if curve.dashed else "-"
    marker = "o" if curve.kind == "marked" else ""
    return axes.plot(curve.x, curve.y, dash, color=colour, marker=marker, markersize=3, label=label)


def _polygons(curve: Curve) -> list[Any]:
    """Return an outline's polygons, between its NaN, as arguments x, y, x, y …"""
    holes = np.flatnonzero(~np.isfinite(curve.x))
    out: list[Any] = []
    for stretch in np.split(np.arange(curve.x.size), holes):
        inside = stretch[np.isfinite(curve.x[stretch])]
        if inside.size > 2:
            out += [curve.x[inside], curve.y[inside]]
    return out


def _map(canvas: Any, surface: Surface) -> None:
    """Draw a surface as a map: z as colour with its contours, and the positions of the data."""
    axes = canvas.subplots()
    y = np.repeat(surface.y[:, None], surface.x.shape[1], axis=1)
    z = np.ma.masked_invalid(surface.z)
    if z.count() and np.ptp(z) > 0.0:
        # The lightest colours are left out, on which white lines would not show.
        filled = axes.contourf(surface.x, y, z, levels=24, cmap="viridis", vmax=z.max() + 0.2 * np.ptp(z))
        filled.set_edgecolor("face")  # else viewers show the paper between two levels
        canvas.colorbar(filled, ax=axes, label=printable(surface.z_label), pad=0.02)
        lines = axes.contour(surface.x, y, z, levels=6, colors="white", linewidths=0.7)
        axes.clabel(lines, fmt="%g", fontsize="small")
    axes.plot(surface.data[:, 0], surface.data[:, 1], ".", color="black", markersize=1, label="samples")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), markerscale=4)
    axes.set_xlabel(printable(surface.x_label))
    axes.set_ylabel(printable(surface.y_label))
    axes.grid(visible=False)


def _surface(canvas: Any, surface: Surface) -> Any:
    axes = canvas.add_subplot(projection="3d")
    y = np.repeat(surface.y[:, None], surface.x.shape[1], axis=1)
    axes.plot_surface(surface.x, y, surface.z, cmap="viridis", alpha=0.75, linewidth=0, rstride=1, cstride=1)
    axes.scatter(*surface.data.T, s=3, marker="x", linewidths=0.5, color=COLOURS["measured"], rasterized=True)
    axes.locator_params(nbins=5)
    axes.set_box_aspect(None, zoom=0.75)
    axes.set_xlabel(printable(surface.x_label))
    axes.set_ylabel(printable(surface.y_label))
    axes.set_zlabel(printable(surface.z_label))
    axes.view_init(elev=24, azim=-125)
    return canvas
