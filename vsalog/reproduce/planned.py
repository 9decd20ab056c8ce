"""Methods of the papers that may not be there yet: looked up in the table of estimators each time.

A row of such a method says "not there yet" until an estimator of one of its names is registered, and is then computed like any
other from the columns of its trace.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import VsalogError
from vsalog.estimators.registry import methods
from vsalog.reproduce.measure import Setting, Study, estimate
from vsalog.reproduce.rows import Row, Spread
from vsalog.simulation.experiment import Experiment

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Planned:
    """A published method.

    Attributes
    ----------
    title : for the report
    names : of the estimators that would be it, the first one registered is taken
    """

    title: str
    names: tuple[str, ...]

    @property
    def registered(self) -> str | None:
        """Name of the estimator that is there, None where there is none."""
        known = methods()
        return next((name for name in self.names if name in known), None)


@dataclass(frozen=True, slots=True)
class Column:
    """A quantity of a trace and the truth it is held against.

    Attributes
    ----------
    name : of the trace's column, in the device's row or a transmission's
    truth : of an experiment's joint, over time
    error : of estimated and true values, what is compared with the printed number
    """

    name: str
    truth: Callable[[Experiment, str], Array]
    error: Callable[[Array, Array], float]


def row_of(
    row: Row, planned: Planned, column: Column, experiments: Callable[[], list[Experiment]], joint: str, study: Study
) -> Row:
    """Return the row computed where the method is there, else as "not there yet" with what is missing.

    Parameters
    ----------
    row : all but the estimator and its number
    planned, column : method and quantity
    experiments : gives one per seed; asked for only where the method is there
    joint : name in the rig
    study : with whom to call for what is done
    """
    name = planned.registered
    if name is None:
        return row.with_values(
            status="not there yet",
            reason=f"{planned.title} is not among the estimators yet ({' or '.join(planned.names)})",
        )
    study.say(f"{row.item}: {name}, {row.quantity}")
    found: list[float] = []
    try:
        for experiment in experiments():
            trace = estimate(experiment, Setting("vsalog's default", name, {}), joint)
            parts = [part for part in ("total", *trace.transmissions) if column.name in trace[part]]
            if not parts:
                return row.with_values(
                    status="not there yet", reason=f"the estimator {name} gives no column '{column.name}'"
                )
            values = np.asarray(trace[parts[0]][column.name], dtype=np.float64)
            found.append(column.error(values, column.truth(experiment, joint)))
    except VsalogError as error:
        return row.with_values(status="not there yet", reason=f"the estimator {name} cannot be run here: {error}")
    return row.with_values(settings="vsalog's default", estimator=name, ours=Spread.of(found))


def mean_relative(estimated: Array, true: Array) -> float:
    """Return the mean of |x̂ − x| / |x| [%], of the samples that have an estimate."""
    relative = np.abs((estimated - true) / true)
    return 100.0 * float(np.mean(relative[np.isfinite(relative)]))


def root_mean_square(estimated: Array, true: Array) -> float:
    """Return √(mean (x̂ − x)²), of the samples that have an estimate."""
    error = estimated - true
    return float(np.sqrt(np.mean(np.square(error[np.isfinite(error)]))))


def largest(estimated: Array, true: Array) -> float:
    """Return max |x̂ − x|, of the samples that have an estimate."""
    return float(np.nanmax(np.abs(estimated - true)))
