"""Figures and messages of `plot`: which figures of a trace, and into which files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsalog.core.errors import did_you_mean
from vsalog.core.notation import listed
from vsalog.core.printable import printable
from vsalog.figures.chart import Chart
from vsalog.figures.joint_figures import plot_charts
from vsalog.figures.paper import FORMATS, FigureError, Style, write_chart
from vsalog.figures.trace_file import TraceFile
from vsalog.report.document import Document, Facts
from vsalog.writers.atomic import check_path, together


@dataclass(frozen=True, slots=True)
class Drawn:
    """One figure, and what it is of.

    Attributes
    ----------
    chart : what it shows
    joint, part, log : names, of any text; empty where it is of all. A part is a transmission, a signal or a cause
    place : numbers of the joint and of the transmission in a trace, from 1 on
    """

    chart: Chart
    joint: str = ""
    part: str = ""
    log: str = ""
    place: tuple[int, int] = (1, 1)

    @property
    def title(self) -> str:
        """What it is, in words."""
        return printable(f"{self.chart.title}, joint {self.joint}, transmission {self.part}")


def check_format(output: Path) -> None:
    """Refuse a file whose suffix names no format.

    Raises
    ------
    FigureError
        It is none of the formats.
    """
    if output.suffix.lower().removeprefix(".") not in FORMATS:
        endings = listed([f".{kind}" for kind in FORMATS])
        raise FigureError(f"{output}: the suffix sets the format, and is none of {endings}")


def figures_of(
    trace: TraceFile, kinds: Sequence[str], joints: Sequence[str], transmissions: Sequence[str]
) -> list[Drawn]:
    """Return the requested figures, joint by joint.

    Parameters
    ----------
    trace : that is drawn
    kinds : names of charts
    joints : names; all of the trace's when empty
    transmissions : names; when empty the device's own figure where it has one of a kind, else one of each transmission

    Raises
    ------
    VsalogError
        There is no such joint or transmission, or the trace has nothing of a kind.
    """
    found: list[Drawn] = []
    numbers = {name: i for i, name in enumerate(trace.joints, 1)}
    for name in joints:
        if name not in numbers:
            known = ", ".join(numbers)
            raise FigureError(f"{trace.path}: has no joint '{name}'{did_you_mean(name, numbers)}; it has {known}")
    for joint in joints or numbers:
        charts = plot_charts(trace.evidence(joint))
        for kind in kinds:
            found += _of_kind(joint, numbers[joint], charts, kind, transmissions)
    return found


def _of_kind(
    joint: str, number: int, charts: Mapping[str, Sequence[Chart]], kind: str, transmissions: Sequence[str]
) -> list[Drawn]:
    for name in transmissions:
        if name not in charts:
            known = ", ".join(charts)
            raise FigureError(
                f"joint '{joint}' has no transmission '{name}'{did_you_mean(name, charts)}; it has {known}"
            )
    every = [
        Drawn(chart, joint, name, place=(number, i))
        for i, (name, parts) in enumerate(charts.items(), 1)
        for chart in parts
    ]
    own = [one for one in every if one.chart.name == kind]
    own = [one for one in own if one.part in transmissions] if transmissions else whole_first(own)
    if not own:
        there = listed(list(dict.fromkeys(_option(c.name) for parts in charts.values() for c in parts)))
        of = f", transmission {listed(list(transmissions))}" if transmissions else ""
        raise FigureError(
            f"joint '{joint}'{of} has nothing that a figure of the kind {_option(kind)} shows; it has {there}"
        )
    return own


def whole_first(own: Sequence[Drawn]) -> list[Drawn]:
    """Return the figures of a kind that are of whole devices; all where there are none."""
    whole = [one for one in own if one.part == "total"]
    return whole or list(own)


def _option(kind: str) -> str:
    return kind.replace("_", "-")


def paths_of(output: Path, figures: Sequence[Drawn]) -> list[Path]:
    """Return a file for each figure: the named one, and of several ones with their kinds, joints and parts in the names.

    Joints and transmissions are numbered: file names contain no name from a log.
    """
    if len(figures) == 1:
        return [output]
    varied = [len({of(one) for one in figures}) > 1 for of in (lambda d: d.place[0], lambda d: d.place[1], _kind_of)]
    return [output.with_stem("_".join([output.stem, *_parts(one, varied)])) for one in figures]


def _kind_of(one: Drawn) -> str:
    return one.chart.name


def _parts(one: Drawn, varied: Sequence[bool]) -> Iterator[str]:
    texts = (f"joint{one.place[0]}", f"part{one.place[1]}", one.chart.name)
    yield from (text for text, differs in zip(texts, varied, strict=True) if differs)


def write_plots(paths: Sequence[Path], figures: Sequence[Drawn], style: Style) -> None:
    """Write figures into files, a path for each, all of them or none.

    Raises
    ------
    VsalogError
        matplotlib is not installed, or a file cannot be written.
    """
    for path in paths:
        check_path(path)
    with together():
        for path, one in zip(paths, figures, strict=True):
            write_chart(path, one.chart, style)


def plots_document(figures: Sequence[Drawn], paths: Sequence[Path]) -> Document:
    """Return what was drawn, into which files; none where it was shown on the screen."""
    facts = tuple((str(path), one.title) for path, one in zip(paths, figures, strict=False))
    data = [
        {
            "file": str(paths[i]) if paths else None,
            "kind": one.chart.name,
            "joint": one.joint,
            "transmission": one.part,
            "words": one.chart.words,
        }
        for i, one in enumerate(figures)
    ]
    return Document("Figures", "", (Facts(facts, "terminal"),), {"figures": data})
