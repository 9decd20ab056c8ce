"""What the figures of an estimate draw, read back out of its trace's file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.trace import EXTRA_UNITS
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.readers.opened import for_arrow
from vsalog.report.quantities import unit_text
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence

Array = NDArray[np.float64]

SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
PARAMETERS = ("motor_inertia", "motor_damping")


def evidence_of(trace: Path, estimate: JointEstimate, setpoint_unit: str = "rad") -> JointEvidence:
    """Read what the figures draw back out of a trace's file, column by column: an hour's trace is never held twice.

    Of a longer trace only each n-th row is read (`thinned`).

    Parameters
    ----------
    trace : the Parquet file, complete
    estimate : of the joint wanted
    setpoint_unit : of the joint: rad, or m where it is a lever arm

    Returns
    -------
    The joint's evidence
    """
    columns = TraceColumns(trace, estimate.joint, thinned(estimate))
    names = [t.transmission for t in distinct(estimate.summary.transmissions)]
    time = columns.of(names[0], "time")
    setpoint = columns.of(names[0], "setpoint") if "setpoint" in columns.known else None
    if setpoint is not None and not np.isfinite(setpoint).any():
        setpoint = None
    parts = {n: _part(columns, n, estimate) for n in names}
    excited = parts[names[-1]].inside
    return JointEvidence(
        estimate.joint, time, setpoint, setpoint_unit, parts, estimate.model, Convergence(columns, estimate), excited
    )


def _part(columns: TraceColumns, n: str, estimate: JointEstimate) -> TransmissionEvidence:
    # A residual is compared with the fit behind the residual's own lag.
    lagged = "residual" in columns.known and bool(np.isfinite(columns.of(n, "residual")).any())
    fed = columns.of(n, "residual" if lagged else "flexibility_torque")
    fit = columns.of(n, "residual_fit" if lagged else "flexibility_torque_fit")
    return TransmissionEvidence(
        deflection=columns.of(n, "deflection"),
        predicted=fit,
        predicted_std=np.full(fit.shape, np.nan),
        measured=fed if np.isfinite(fed).any() else None,
        measured_by=estimate.model.modality.lower(),
        stiffness=columns.of(n, "stiffness"),
        stiffness_std=columns.of(n, "stiffness_std"),
        true_stiffness=None,
        inside=columns.of(n, "excited") > 0.0,
    )


def thinned(estimate: JointEstimate) -> int:
    """Return n where figures show each n-th row of a joint's trace, for its columns to fit in memory; 1 for all rows."""
    row = np.dtype(np.float64).itemsize * len(fields(TransmissionEvidence))
    return max(1, -(-max(t.samples for t in estimate.summary.transmissions) * row // AT_ONCE_BYTES))


class TraceColumns:
    """Columns of one joint in a trace's file, each n-th row, read when asked for."""

    def __init__(self, trace: Path, joint: str, every: int = 1) -> None:
        self.trace, self.joint, self.every = trace, joint, every
        self.known = tuple(pq.read_schema(for_arrow(trace)).names)

    def of(self, transmission: str, column: str) -> Array:
        """Return a column of a transmission, shape (N,), NaN where it is null; a part of the file is read after the other."""
        found, skip = [], 0
        with pq.ParquetFile(for_arrow(self.trace)) as file:
            for batch in file.iter_batches(columns=[column, "joint", "transmission"]):
                own = pc.and_(
                    pc.equal(batch["joint"].cast("string"), self.joint),
                    pc.equal(batch["transmission"].cast("string"), transmission),
                )
                values = pc.cast(batch[column].filter(own), "float64").to_numpy(zero_copy_only=False)
                found.append(values[skip :: self.every].copy())
                skip = (skip - values.size) % self.every
        return np.concatenate(found).astype(np.float64)


class Convergence(Mapping[str, Array]):
    """An estimate's parameters over time by their names with units; each is read when asked for."""

    def __init__(self, columns: TraceColumns, estimate: JointEstimate) -> None:
        self.columns = columns
        names = [t.name for t in estimate.model.transmission]
        terms = estimate.model.basis.terms
        self.where: dict[str, tuple[str, str]] = {}
        for n in names:
            # The names of transmissions are needed where there are two.
            before = f"{n}: " if len(names) > 1 else ""
            for i in range(len(terms)):
                self._add(f"{before}{term_text(terms[i])} [N·m]", n, f"coefficient_{i}")
            for parameter in PARAMETERS:
                self._add(f"{before}{parameter.replace('_', ' ')} [{unit_text(EXTRA_UNITS[parameter])}]", n, parameter)

    def _add(self, label: str, transmission: str, column: str) -> None:
        if column in self.columns.known:
            self.where[label] = (transmission, column)

    def __getitem__(self, key: str) -> Array:
        return self.columns.of(*self.where[key])

    def __iter__(self) -> Iterator[str]:
        return iter(self.where)

    def __len__(self) -> int:
        return len(self.where)


def term_text(term: str) -> str:
    """Return a basis function as people write it: phi^3*c^2 is φ³ c²."""
    raised = re.sub(r"\^(\d+)", lambda m: "" if m[1] == "1" else m[1].translate(SUPERSCRIPTS), term)
    return raised.replace("phi", "φ").replace("*", " ").replace(":", ": ")


def distinct(parts: Sequence[TransmissionSummary]) -> Sequence[TransmissionSummary]:
    """Leave out the device where it has a single transmission, which it would repeat."""
    return [p for p in parts if p.transmission != "total"] if len(parts) == 2 else parts
