"""The data of figures in a trace's file: its joints, and the fitted model next to it if it is of the same run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from vsalog.core.errors import ReadError, VsalogError
from vsalog.core.model import ModelFile
from vsalog.core.printable import printable
from vsalog.estimation.evidence import JointEvidence, setpoint_unit
from vsalog.estimation.trace_evidence import TraceColumns, every_nth, joint_evidence
from vsalog.readers.opened import for_arrow
from vsalog.readers.own_files import is_trace, model_beside
from vsalog.readers.parquet_rows import ParquetRows
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
            if large := ParquetRows(path).too_large:
                column = printable(large[0])
                raise ReadError(f"column '{column}' takes more memory than its footer states, as of no trace", path)
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
            coded = [_coded(batch[name]) for name in ("joint", "transmission")]
            places = np.stack([pc.fill_null(one.indices.cast("int64"), -1).to_numpy() for one in coded])
            pairs, first = np.unique(places, axis=1, return_index=True)
            texts = [[*one.dictionary.cast("string").to_pylist(), ""] for one in coded]  # the last one of a null
            for i, j in pairs[:, np.argsort(first)].T:
                found.setdefault((texts[0][i] or "", texts[1][j] or ""))
    yield from found


def _coded(column: pa.Array) -> pa.DictionaryArray:
    """Return a column of texts as a dictionary, none of whose texts is written out for each row."""
    return column if pa.types.is_dictionary(column.type) else column.dictionary_encode()


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
