"""Figures on a screen, by matplotlib's windows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from vsalog.figures.chart import Chart
from vsalog.figures.paper import FigureError, Style, check_matplotlib, draw


def require_screen() -> None:
    """Refuse to show figures where there are no windows, before anything is computed.

    Raises
    ------
    FigureError
        matplotlib is not installed, or finds no screen; the message says what to do.
    """
    check_matplotlib("a figure on the screen")
    from matplotlib import pyplot

    figure = pyplot.figure()
    windows = type(figure.canvas).required_interactive_framework
    pyplot.close(figure)
    if windows is None:
        raise FigureError(
            "matplotlib finds no screen here, or no toolkit to open a window with (pip install PySide6); -o figure.pdf, .svg or"
            " .png writes the figure into a file"
        )


def window(chart: Chart, style: Style) -> Any:
    """Return a figure of pyplot with a chart in it, which `show` and notebooks display."""
    from matplotlib import pyplot, rc_context

    with rc_context(style.settings):
        figure = pyplot.figure(FigureClass=_figure_class(), style=style)
        draw(figure, chart, style)
    # A notebook displays a cell's result and pyplot's open figures: it would appear twice.
    if "inline" in pyplot.get_backend().lower():
        pyplot.close(figure)
    return figure


@cache
def _figure_class() -> Any:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    class StyledFigure(Figure):
        """A figure that is saved as it was drawn: matplotlib reads the setting of a PDF's fonts when it is written."""

        def __init__(self, *args: Any, style: Style, **named: Any) -> None:
            super().__init__(*args, **named)
            self.style = style

        def savefig(self, *args: Any, **named: Any) -> None:
            with rc_context(self.style.settings):
                super().savefig(*args, **named)

    return StyledFigure


def show(charts: Sequence[tuple[str, Chart]], style: Style) -> None:
    """Open a window per chart, each with its title, and wait until all are closed."""
    from matplotlib import pyplot

    for title, chart in charts:
        figure = window(chart, style)
        if figure.canvas.manager is not None:
            figure.canvas.manager.set_window_title(title)
    pyplot.show()
