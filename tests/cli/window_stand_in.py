"""A backend of matplotlib whose windows are files: `MPLBACKEND=module://window_stand_in`."""

from pathlib import Path

from matplotlib import pyplot
from matplotlib.backends.backend_agg import FigureCanvasAgg, FigureManagerBase


class FigureManager(FigureManagerBase):
    def set_window_title(self, title):
        with Path("titles").open("a", encoding="utf-8") as file:
            file.write(f"{title}\n")

    @classmethod
    def pyplot_show(cls, *, block=None):
        for number in pyplot.get_fignums():
            pyplot.figure(number).savefig(f"{number}.png")


class FigureCanvas(FigureCanvasAgg):
    required_interactive_framework = "headless"
    manager_class = FigureManager
