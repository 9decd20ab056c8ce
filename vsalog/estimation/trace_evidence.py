"""What the figures of an estimate draw, read back out of its trace's file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.trace import EXTRA_UNITS
from vsalog.estimation.evidence import JointEvidence, Parameter, TransmissionEvidence
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.readers.opened import for_arrow

Array = NDArray[np.float64]

MOTOR = ("motor_inertia", "motor_damping")


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


class Convergence(Mapping[Parameter, Array]):
    """An estimate's parameters over time; each is read when asked for."""

    def __init__(self, columns: TraceColumns, estimate: JointEstimate) -> None:
        self.columns = columns
        terms = estimate.model.basis.terms
        found: dict[Parameter, str] = {}
        for transmission in estimate.model.transmission:
            n = transmission.name
            found |= {Parameter(n, term, "N*m"): f"coefficient_{i}" for i, term in enumerate(terms)}
            found |= {Parameter(n, name, EXTRA_UNITS[name]): name for name in MOTOR}
        self.where = {parameter: column for parameter, column in found.items() if column in columns.known}

    def __getitem__(self, key: Parameter) -> Array:
        return self.columns.of(key.transmission, self.where[key])

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.where)

    def __len__(self) -> int:
        return len(self.where)


def distinct(parts: Sequence[TransmissionSummary]) -> Sequence[TransmissionSummary]:
    """Leave out the device where it has a single transmission, which it would repeat."""
    return [p for p in parts if p.transmission != "total"] if len(parts) == 2 else parts
