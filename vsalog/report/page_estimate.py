"""An estimate as a page: the evidence that its trace holds, and its key figures."""

from __future__ import annotations

import json
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
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.readers.opened import for_arrow
from vsalog.report.page import Part, Section, assembled, columns_for, joint_charts, provenance
from vsalog.report.page_tables import motor_table, summary_table, warnings_box
from vsalog.report.page_text import escaped, name
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence, setpoint_unit
from vsalog.writers.atomic import write_text

Array = NDArray[np.float64]

SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
PARAMETERS = ("motor_inertia", "motor_damping")


def evidence_of(trace: Path, estimate: JointEstimate, setpoint_unit: str = "rad") -> JointEvidence:
    """Read what the figures draw back out of a trace's file, column by column: an hour's trace is never held twice.

    Of a longer one every so many rows are read (`thinned`).

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
    names = [t.transmission for t in _apart(estimate.summary.transmissions)]
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
    """Return that figures are drawn of every so many rows of a joint's trace, for its columns to fit in memory; 1 for all."""
    row = np.dtype(np.float64).itemsize * len(fields(TransmissionEvidence))
    return max(1, -(-max(t.samples for t in estimate.summary.transmissions) * row // AT_ONCE_BYTES))


class TraceColumns:
    """Columns of one joint in a trace's file, read when asked for: every so many rows."""

    def __init__(self, trace: Path, joint: str, every: int = 1) -> None:
        self.trace, self.joint, self.every = trace, joint, every
        self.known = tuple(pq.read_schema(for_arrow(trace)).names)

    def of(self, transmission: str, column: str) -> Array:
        """Return a column of a transmission, shape (N,), NaN where it is null."""
        if self.every > 1:
            return self._some_of(transmission, column)
        wanted = [("joint", "==", self.joint), ("transmission", "==", transmission)]
        values = pq.read_table(for_arrow(self.trace), columns=[column], filters=wanted)[column]
        return np.asarray(pc.cast(values, "float64").to_numpy(), dtype=np.float64)

    def _some_of(self, transmission: str, column: str) -> Array:
        """Read a part of the file after the other, and keep every so many rows."""
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
                unit = EXTRA_UNITS[parameter].replace("*", "·").replace("^2", "²")
                self._add(f"{before}{parameter.replace('_', ' ')} [{unit}]", n, parameter)

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


def write_estimate_page(
    path: Path, job: Job, trace: Path, estimates: Sequence[JointEstimate], origin: Mapping[str, str]
) -> None:
    """Write an estimate as one page.

    Parameters
    ----------
    path : of the page
    job : that was run
    trace : the Parquet file, complete
    estimates : what was found, joint by joint
    origin : provenance, as `Job.provenance` gives it

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    inputs: dict[str, str] = json.loads(origin["vsalog.input"])
    log = ", ".join(inputs) or job.logs[0].name
    columns = columns_for(sum(len(e.summary.transmissions) for e in estimates))
    sections = []
    for estimate in estimates:
        if not estimate.summary.transmissions:
            sections.append(Section(estimate.joint, log, _about(estimate), []))
            continue
        joint = evidence_of(trace, estimate, setpoint_unit(job.rig.joints[estimate.joint]))
        parts = [Part(n, "", charts) for n, charts in joint_charts(joint, columns).parts.items()]
        sections.append(Section(estimate.joint, log, _about(estimate), parts))
    pairs = [("log", f"{name(n)} <code>SHA-256 {escaped(digest)}</code>") for n, digest in inputs.items()]
    for estimate in estimates:
        settings = ", ".join(f"{key} = {value}" for key, value in estimate.settings.items())
        pairs.append((f"settings of {name(estimate.joint)}", f"<code>{escaped(settings)}</code>"))
    pairs.append(("vsalog", escaped(origin["vsalog.version"])))
    bottom = provenance(pairs, origin["vsalog.rig"])
    page = assembled(f"Stiffness of {log}", "Estimate", warnings_box(job.warnings), sections, bottom)
    write_text(path, page)


def _apart(parts: Sequence[TransmissionSummary]) -> Sequence[TransmissionSummary]:
    """Leave out the device where it has a single transmission, which it would repeat."""
    return [p for p in parts if p.transmission != "total"] if len(parts) == 2 else parts


def _about(estimate: JointEstimate) -> str:
    s = estimate.summary
    words = (
        f"{escaped(estimate.estimator)}: {escaped(estimate.reason)}. {s.duration:.4g} s at {1.0 / s.period:.4g} Hz."
        if s.period > 0.0
        else escaped(estimate.estimator)
    )
    if s.transmissions and thinned(estimate) > 1:
        words += f" The figures are drawn of one sample in {thinned(estimate)}."
    tables = summary_table(_apart(s.transmissions)) + motor_table(estimate.model.motor)
    return f"<p>{words}</p>{tables}{warnings_box(estimate.warnings)}"
