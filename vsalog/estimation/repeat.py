"""Repeating a run from the provenance in its result: `vsalog estimate --from OUT.parquet`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.errors import ReadError
from vsalog.estimation.job import Options, sha256
from vsalog.readers.opened import for_arrow
from vsalog.rig import Rig


def repeated(result: Path, logs: Sequence[Path] = ()) -> tuple[tuple[Path, ...], Options]:
    """Return the logs and options of the run that wrote a trace.

    Parameters
    ----------
    result : a Parquet trace that `estimate` wrote
    logs : where its logs are now; else they are searched in the current folder and next to the result

    Raises
    ------
    ReadError
        The file is no trace, lacks provenance, or a log is missing or has changed.
    RigError
        The rig in it does not load.
    """
    try:
        metadata = pq.read_schema(for_arrow(result)).metadata or {}
    except OSError as error:
        raise ReadError(f"{result}: cannot be read: {error.strerror or error}") from error
    except pa.ArrowInvalid as error:
        raise ReadError(f"{result}: is no Parquet file: {error}") from error
    provenance = {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in metadata.items()}
    missing = [key for key in ("vsalog.rig", "vsalog.options", "vsalog.input") if key not in provenance]
    if missing:
        raise ReadError(f"{result}: lacks its provenance ({missing[0]} is missing): no trace of 'vsalog estimate'")
    try:
        inputs, asked = json.loads(provenance["vsalog.input"]), json.loads(provenance["vsalog.options"])
        options = Options(
            Rig.from_toml(provenance["vsalog.rig"], f"the rig in {result.name}"),
            tuple(asked["joints"]),
            asked["estimator"],
            asked["tune"],
            asked["set"],
            asked["rate"],
            asked["time"],
            asked.get("start"),  # older traces are of whole logs
            asked.get("end"),
        )
        names = dict(inputs)
    except (KeyError, TypeError, ValueError) as error:
        raise ReadError(f"{result}: its provenance cannot be read: {error}") from error
    return _found(result, names, logs), options


def _found(result: Path, inputs: dict[str, str], logs: Sequence[Path]) -> tuple[Path, ...]:
    """Find each log and check that it has not changed."""
    if logs and len(logs) != len(inputs):
        raise ReadError(f"{result}: was made from {len(inputs)} logs, but {len(logs)} are given")
    found = []
    for i, (name, digest) in enumerate(inputs.items()):
        # Only the name is searched, in these two folders, never a path.
        plain = Path(name).name
        places = [logs[i]] if logs else [Path(plain), result.parent / plain]
        log = next((place for place in places if place.exists()), None)
        if log is None:
            raise ReadError(f"{result}: its log '{plain}' is neither here nor next to it; give its path too")
        if sha256(log) != digest:
            raise ReadError(f"{log}: is not the log that {result.name} was made from: its content differs")
        found.append(log)
    return tuple(found)
