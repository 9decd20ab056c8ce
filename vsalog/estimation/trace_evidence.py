"""The data of an estimate's figures, read back from its trace's file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.model import JointModel
from vsalog.core.trace import EXTRA_UNITS
from vsalog.estimation.evidence import JointEvidence, Parameter, TransmissionEvidence
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.readers.opened import for_arrow

Array = NDArray[np.float64]

MOTOR = ("motor_inertia", "motor_damping")


def evidence_of(trace: Path | pa.Table, estimate: JointEstimate, setpoint_unit: str = "rad") -> JointEvidence:
    """Read the data of figures back from a trace's file, column by column: an hour's trace is never held twice.

    Of a longer trace only each n-th row is read (`thinned`).

    Parameters
    ----------
    trace : the Parquet file, complete, or the trace as a table
    estimate : of the joint wanted
    setpoint_unit : of the joint: rad, or m where it is a lever arm

    Returns
    -------
    The joint's evidence
    """
    columns = TraceColumns(trace, estimate.joint, thinned(estimate))
    names = [t.transmission for t in distinct(estimate.summary.transmissions)]
    return joint_evidence(columns, names, estimate.model, setpoint_unit)


def joint_evidence(
    columns: TraceColumns, names: Sequence[str], model: JointModel | None, setpoint_unit: str
) -> JointEvidence:
    """Return the data of the figures from a joint's columns.

    Parameters
    ----------
    columns : of the joint
    names : of its transmissions, the device last
    model : that was fitted; None where it is not available
    setpoint_unit : of the joint: rad, or m where it is a lever arm
    """
    time = columns.of(names[0], "time")
    setpoint = columns.of(names[0], "setpoint") if "setpoint" in columns.known else None
    if setpoint is not None and not np.isfinite(setpoint).any():
        setpoint = None
    measured_by = "" if model is None else model.modality.lower()
    parts = {n: _part(columns, n, measured_by) for n in names}
    excited = parts[names[-1]].inside
    found = Convergence(columns, model)
    return JointEvidence(columns.joint, time, setpoint, setpoint_unit, parts, model, found, excited)


def _part(columns: TraceColumns, n: str, measured_by: str) -> TransmissionEvidence:
    # A residual is compared with the fit behind the residual's own lag.
    lagged = "residual" in columns.known and bool(np.isfinite(columns.of(n, "residual")).any())
    fed = columns.of(n, "residual" if lagged else "flexibility_torque")
    fit = columns.of(n, "residual_fit" if lagged else "flexibility_torque_fit")
    return TransmissionEvidence(
        deflection=columns.of(n, "deflection"),
        predicted=fit,
        predicted_std=np.full(fit.shape, np.nan),
        measured=fed if np.isfinite(fed).any() else None,
        measured_by=measured_by,
        stiffness=columns.of(n, "stiffness"),
        stiffness_std=columns.of(n, "stiffness_std"),
        true_stiffness=None,
        inside=columns.of(n, "excited") > 0.0,
    )


def thinned(estimate: JointEstimate) -> int:
    """Return n if figures show each n-th row of a joint's trace, for its columns to fit in memory; 1 for all rows."""
    return every_nth(max(t.samples for t in estimate.summary.transmissions))


def every_nth(samples: int) -> int:
    """Return n where figures show every n-th sample, so that their columns fit in memory; 1 for all."""
    row = np.dtype(np.float64).itemsize * len(fields(TransmissionEvidence))
    return max(1, -(-samples * row // AT_ONCE_BYTES))


class TraceColumns:
    """Columns of one joint in a trace's file or table, each n-th row, read when asked for."""

    def __init__(self, trace: Path | pa.Table, joint: str, every: int = 1) -> None:
        self.trace, self.joint, self.every = trace, joint, every
        schema = trace.schema if isinstance(trace, pa.Table) else pq.read_schema(for_arrow(trace))
        self.known = tuple(schema.names)

    def of(self, transmission: str, column: str) -> Array:
        """Return a column of a transmission, shape (N,), NaN where it is null; a part of the file is read after the other."""
        found, skip = [np.zeros(0)], 0
        for batch in _batches(self.trace, [column, "joint", "transmission"]):
            own = pc.and_(_is(batch["joint"], self.joint), _is(batch["transmission"], transmission))
            values = pc.cast(batch[column].filter(own), "float64").to_numpy(zero_copy_only=False)
            found.append(values[skip :: self.every].copy())
            skip = (skip - values.size) % self.every
        return np.concatenate(found).astype(np.float64)


def _is(column: pa.Array, text: str) -> pa.Array:
    """Return which cells have a text; those of a dictionary are not written out, as that of a hostile file may be long."""
    if pa.types.is_dictionary(column.type):
        return pc.equal(column.dictionary.cast("string"), text).take(column.indices)
    return pc.equal(column.cast("string"), text)


def _batches(trace: Path | pa.Table, columns: list[str]) -> Iterator[pa.RecordBatch]:
    if isinstance(trace, pa.Table):
        yield from trace.select(columns).to_batches()
        return
    with pq.ParquetFile(for_arrow(trace), page_checksum_verification=True) as file:
        yield from file.iter_batches(columns=columns)


class Convergence(Mapping[Parameter, Array]):
    """An estimate's parameters over time; each is read when asked for."""

    def __init__(self, columns: TraceColumns, model: JointModel | None) -> None:
        self.columns = columns
        found: dict[Parameter, str] = {}
        terms = () if model is None else model.basis.terms
        for transmission in () if model is None else model.transmission:
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
    """Leave out a device with a single transmission, which it would repeat."""
    return [p for p in parts if p.transmission != "total"] if len(parts) == 2 else parts
