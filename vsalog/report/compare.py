"""Document of `compare`: the stiffness by all estimators in one figure, and a table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.comparison.references import References
from vsalog.comparison.run import Comparison, Row, Run
from vsalog.core.finding_texts import sentences_of
from vsalog.core.notation import between, number, percent, transmission_title
from vsalog.core.trace import Trace
from vsalog.estimation.job import Job
from vsalog.figures.chart import Chart
from vsalog.figures.decimation import one_after_the_other
from vsalog.figures.joint_figures import columns_for
from vsalog.figures.time_series import stiffnesses_chart
from vsalog.report.document import Block, Document, Figures, Notes, Section, Table, Words, provenance

Array = NDArray[np.float64]

HEADS = ("transmission", "estimator", "stiffness [N·m/rad]", "± (1 std)", "RMS residual [N·m]", "off sensor [N·m]", "excited",
         "agrees", "differs", "MSREP to truth [%]")  # fmt: skip
MEANING = (
    "RMS residual: of the fit; off sensor: RMS difference of the fitted torque from the torque sensor; agrees: share of the"
    " time within the 95 % interval of the difference from the first; differs: RMS difference relative to the first."
)


def worded(found: Comparison) -> Comparison:
    """Return a comparison with its findings in sentences."""
    return replace(found, warnings=sentences_of(found.findings))


def comparison_document(found: Comparison, runs: Sequence[Run] = (), references: References | None = None) -> Document:
    """Return a comparison.

    Parameters
    ----------
    found : the comparison, in words
    runs, references : for the figures; none without them
    """
    items: list[Block] = []
    joints = list(dict.fromkeys(row.joint for row in found.rows))
    for joint in joints:
        charts = () if references is None else comparison_charts(joint, runs, references)
        figures = [Figures((chart,), name) for name, chart in charts]
        own = [row for row in found.rows if row.joint == joint]
        items.append(Section(f"Joint {joint}" if len(joints) > 1 else "", (*figures, _table(joint, own))))
    items += [Words(MEANING), Notes(found.findings)]
    for what, reasons in (("left out", found.left_out), ("failed", found.failed)):
        items += [Words(f"{what}: {name}: {reason.removeprefix(f'{name}: ')}") for name, reason in reasons.items()]
    if runs:
        items.append(_provenance(runs[0].job))
    return Document(f"Estimators on {', '.join(found.logs)}", "Comparison", tuple(items), found)


def _provenance(job: Job) -> Section:
    origin = job.provenance()
    inputs: dict[str, str] = json.loads(origin["vsalog.input"])
    pairs = [(f"log {name}", f"SHA-256 {digest}") for name, digest in inputs.items()]
    return provenance([*pairs, ("vsalog", origin["vsalog.version"])], origin["vsalog.rig"])


def _table(joint: str, rows: Sequence[Row]) -> Table:
    names = _distinct(row.transmission for row in rows)
    shown = [
        (
            row.transmission,
            row.estimator,
            between(row.stiffness_low, row.stiffness_high),
            percent(row.relative_std),
            number(row.torque_left),
            number(row.off_sensor),
            percent(row.excited_share),
            percent(row.agrees_share),
            percent(row.difference),
            number(None if row.against_truth is None else row.against_truth.msrep.value),
        )
        for name in names
        for row in rows
        if row.transmission == name
    ]
    table = Table(f"Joint {joint} by every estimator", HEADS, tuple(shown), keys=2, texts=2)
    return table.without_first() if len(names) == 1 else table


def _distinct(transmissions: Iterator[str]) -> list[str]:
    """Return the transmissions; leave the device out where it has a single one and would repeat it."""
    names = list(dict.fromkeys(transmissions))
    return [n for n in names if n != "total"] if len(names) == 2 else names


def comparison_charts(joint: str, runs: Sequence[Run], references: References) -> Iterator[tuple[str, Chart]]:
    """Yield the transmissions of a joint and their figure: each estimator where it is excited, and the truth.

    Parameters
    ----------
    joint : name
    runs : of the estimators
    references : what they are compared with
    """
    traces = {run.contender.label: e.trace for run in runs for e in run.estimates if e.joint == joint}
    for name in _distinct(name for trace in traces.values() for name in trace.transmissions):
        lines = [
            (label, str(i), one_after_the_other(trace.time), _excited(trace, name))
            for i, (label, trace) in enumerate(traces.items())
            if name in trace.transmissions
        ]
        first = next(iter(traces.values()))
        true = references.stiffness(joint, name, first)
        if true is not None:
            lines.append(("truth", "truth", one_after_the_other(first.time), true))
        yield name, stiffnesses_chart(transmission_title(name), lines, columns_for(len(traces)))


def _excited(trace: Trace, name: str) -> Array:
    columns = trace.transmissions[name]
    excited = np.asarray(columns["excited"], dtype=np.float64) > 0.0
    return np.where(excited, np.asarray(columns["stiffness"], dtype=np.float64), np.nan)
