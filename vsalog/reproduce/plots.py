"""Figures like the papers', drawn by matplotlib, which is an optional extra."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vsalog.core.errors import VsalogError, WriteError
from vsalog.reproduce.rows import Figure, Panel
from vsalog.writers.atomic import atomic_path

# Lines differ by their style too, not by colour alone.
STYLES = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


class PlotError(VsalogError):
    """Figures are asked for, but cannot be drawn."""


def prepare_folder(folder: Path) -> None:
    """See, before anything is computed, that figures can be drawn and written; makes the folder.

    Raises
    ------
    PlotError
        matplotlib is not installed; the message says what to install.
    WriteError
        The folder cannot be made or written to.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise PlotError(
            "--plots needs matplotlib, which is not installed: pip install 'vsalog[plots]' (or pip install matplotlib)"
        ) from None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be made: {error.strerror}; name another folder with --plots") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise WriteError(f"{folder}: cannot be written to; name another folder with --plots")


def write_figures(figures: Sequence[Figure], folder: Path) -> list[Path]:
    """Write each figure as NAME.svg into a folder that is there, whole or not at all; return the files.

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    from matplotlib import rc_context

    written = []
    # Equal results make equal files.
    with rc_context({"svg.hashsalt": "vsalog"}):
        for figure in figures:
            path = folder / f"{figure.name}.svg"
            with atomic_path(path) as temporary:
                _drawn(figure).savefig(temporary, format="svg", metadata={"Date": None})
            written.append(path)
    return written


def _drawn(figure: Figure) -> Any:
    from matplotlib.figure import Figure as Canvas

    count = len(figure.panels)
    canvas = Canvas(figsize=(7.0, 1.0 + 2.3 * count), layout="constrained")
    canvas.suptitle(figure.title)
    grid = canvas.subplots(count, 1, squeeze=False)
    for (axes,), panel in zip(grid, figure.panels, strict=True):
        _draw(axes, panel)
    return canvas


def _draw(axes: Any, panel: Panel) -> None:
    for curve in panel.curves:
        if curve.style == "points":
            axes.plot(curve.x, curve.y, "x", markersize=3.0, label=curve.label)
        else:
            marker = "o" if curve.x.size < 20 else ""
            axes.plot(curve.x, curve.y, STYLES[curve.style] + marker, linewidth=1.2, label=curve.label)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.log_y:
        axes.set_yscale("log")
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    if panel.title:
        axes.set_title(panel.title, fontsize="medium")
    axes.grid(alpha=0.3)
    if len(panel.curves) > 1:
        axes.legend(fontsize="small")
