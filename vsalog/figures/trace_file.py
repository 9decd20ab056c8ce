"""The data of figures in a trace's file: its joints, and the fitted model next to it if it is of the same run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from vsalog.core.errors import ReadError, VsalogError
from vsalog.core.model import ModelFile
from vsalog.estimation.evidence import JointEvidence, setpoint_unit
from vsalog.estimation.trace_evidence import TraceColumns, every_nth, joint_evidence
from vsalog.readers.opened import for_arrow
from vsalog.readers.own_files import is_trace, model_beside
from vsalog.rig import Rig
from vsalog.validation.frozen import frozen


@dataclass(frozen=True, slots=True)
class TraceFile:
    """A trace's file.

    Attributes
    ----------
    path : of the file
    joints : name → transmissions, the device last
    rig : with which it was estimated; None where the file lacks it
    model : that was fitted along with it; None where it is not next to it
    """

    path: Path
    joints: dict[str, list[str]]
    rig: Rig | None
    model: ModelFile | None

    @classmethod
    def of(cls, path: Path) -> TraceFile:
        """Read the contents of a file.

        Raises
        ------
        ReadError
            It cannot be read, or is no trace.
        """
        if not is_trace(path):
            raise ReadError("is no trace that 'vsalog estimate' wrote", path)
        try:
            metadata = _metadata(path)
            joints: dict[str, list[str]] = {}
            for joint, transmission in _parts(path):
                joints.setdefault(joint, []).append(transmission)
            text = metadata.get("vsalog.rig")
            rig = None if text is None else Rig.from_toml(text, f"the rig in {path.name}")
        except (OSError, UnicodeError, pa.ArrowException) as error:
            raise ReadError(f"cannot be read: {error}", path) from error
        return cls(path, joints, rig, _model(path, metadata))

    def evidence(self, joint: str) -> JointEvidence:
        """Read the data of the figures of a joint; of a long trace each n-th row.

        Raises
        ------
        ReadError
            The file is damaged.
        """
        parts = self.joints[joint]
        # The device repeats its only transmission.
        names = [n for n in parts if n != "total"] if len(parts) == 2 else parts
        of_rig = None if self.rig is None else self.rig.joints.get(joint)
        unit = "" if of_rig is None else setpoint_unit(of_rig)
        model = None if self.model is None else self.model.joint.get(joint)
        try:
            rows = pq.read_metadata(for_arrow(self.path)).num_rows
            columns = TraceColumns(self.path, joint, every_nth(rows // max(sum(map(len, self.joints.values())), 1)))
            return joint_evidence(columns, names, model, unit)
        except (OSError, UnicodeError, pa.ArrowException) as error:
            raise ReadError(f"cannot be read: {error}", self.path) from error


def _metadata(path: Path) -> dict[str, str]:
    found = pq.read_schema(for_arrow(path)).metadata or {}
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in found.items()}


def _parts(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the joints and transmissions that have rows, in the order of the file."""
    found: dict[tuple[str, str], None] = {}
    with pq.ParquetFile(for_arrow(path)) as file:
        for batch in file.iter_batches(columns=["joint", "transmission"]):
            texts: Sequence[pa.Array] = [pc.cast(batch[name], "string") for name in ("joint", "transmission")]
            pairs = pa.table(texts, ["joint", "transmission"]).group_by(["joint", "transmission"], use_threads=False)
            for row in pairs.aggregate([]).to_pylist():
                found.setdefault((row["joint"] or "", row["transmission"] or ""))
    yield from found


def _model(path: Path, metadata: dict[str, str]) -> ModelFile | None:
    """Return the model next to a trace, where it was fitted to the same logs with the same rig."""
    model_path = model_beside(path)
    try:
        model = frozen(model_path) if model_path.is_file() else None
        same = model is not None and (model.rig, model.log) == (
            metadata.get("vsalog.rig"),
            json.loads(metadata["vsalog.input"]),
        )
    except (VsalogError, KeyError, ValueError):
        return None
    return model if same else None
