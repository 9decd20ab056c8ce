"""The figure of a comparison: the stiffness by every estimator over time, in one pair of axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.comparison.references import References
from vsalog.comparison.run import Run
from vsalog.core.trace import Trace
from vsalog.report.page_charts import Axes, Chart, Curve
from vsalog.report.page_decimate import decimated, gaps_of, one_after_the_other
from vsalog.report.page_figures import STIFFNESS, TIME, span_words

Array = NDArray[np.float64]


def comparison_charts(
    joint: str, runs: Sequence[Run], references: References, columns: int
) -> Iterator[tuple[str, Chart]]:
    """Yield the transmissions of a joint and their figure: each estimator where it is excited, and the truth.

    Parameters
    ----------
    joint : name
    runs : of the estimators
    references : what they are held against
    columns : pixel columns of a figure
    """
    traces = {run.contender.label: e.trace for run in runs for e in run.estimates if e.joint == joint and e.trace}
    names = list(dict.fromkeys(name for trace in traces.values() for name in trace.transmissions))
    for name in [n for n in names if n != "total"] if len(names) == 2 else names:
        curves, said = [], []
        for i, (label, trace) in enumerate(traces.items()):
            if name in trace.transmissions:
                shown = _excited(trace, name)
                curves.append(_curve(label, trace, shown, columns, str(i)))
                said.append(f"{label} {span_words(shown, 'N·m/rad')}")
        first = next(iter(traces.values()))
        true = references.stiffness(joint, name, first)
        if true is not None:
            curves.append(_curve("truth", first, true, columns, "truth", dashed=True))
            said.append(f"the truth {span_words(true, 'N·m/rad')}")
        words = f"The stiffness by every estimator, where it is excited: {'; '.join(said)}."
        yield name, Chart("stiffness", "Stiffness by all estimators", words, (Axes(TIME, STIFFNESS, tuple(curves)),))


def _excited(trace: Trace, name: str) -> Array:
    columns = trace.transmissions[name]
    excited = np.asarray(columns["excited"], dtype=np.float64) > 0.0
    return np.where(excited, np.asarray(columns["stiffness"], dtype=np.float64), np.nan)


def _curve(label: str, trace: Trace, values: Array, columns: int, colour: str, dashed: bool = False) -> Curve:
    time = one_after_the_other(trace.time)
    return Curve(label, *decimated(time, values, columns, gaps_of(time)), colour, dashed=dashed)
