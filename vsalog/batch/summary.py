"""All records as one table: a row per log and joint, `summary.parquet`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.json as pj
import pyarrow.parquet as pq

from vsalog.batch.records import Do, Record

NAME = "summary.parquet"
_TEXT, _NUMBER, _WHOLE = pa.string(), pa.float64(), pa.int64()

_TRANSMISSION = pa.struct(
    [
        ("transmission", _TEXT),
        ("samples", _WHOLE),
        *(
            (name, _NUMBER)
            for name in (
                "excited_share", "stiffness_low", "stiffness_high", "stiffness_last", "negative_share", "relative_std",
                "fit_rms", "fit_mean", "fit_share", "deflection_span",
            )
        ),
    ]
)  # fmt: skip

# What each command finds, in the order of the columns, with the units that go into their metadata.
FIGURES: dict[Do, tuple[tuple[str, pa.DataType, str], ...]] = {
    "estimate": (
        ("estimator", _TEXT, ""),
        ("modality", _TEXT, ""),
        ("rig_guessed", pa.bool_(), ""),
        ("duration", _NUMBER, "s"),
        ("rate", _NUMBER, "Hz"),
        ("samples", _WHOLE, ""),
        ("excited_share", _NUMBER, ""),
        ("stiffness_low", _NUMBER, "N*m/rad"),
        ("stiffness_high", _NUMBER, "N*m/rad"),
        ("stiffness_last", _NUMBER, "N*m/rad"),
        ("relative_std", _NUMBER, ""),
        ("negative_share", _NUMBER, ""),
        ("fit_rms", _NUMBER, "N*m"),
        ("fit_mean", _NUMBER, "N*m"),
        ("fit_share", _NUMBER, ""),
        ("deflection_span", _NUMBER, "rad"),
        ("transmissions", pa.list_(_TRANSMISSION), ""),
        ("motor", pa.list_(pa.struct([("parameter", _TEXT), ("value", _NUMBER)])), ""),
    ),
    "validate": (
        ("verdict", _TEXT, ""),
        ("judged_on", _TEXT, ""),
        ("threshold_met", pa.bool_(), ""),
        ("duration", _NUMBER, "s"),
        ("rate", _NUMBER, "Hz"),
        ("samples", _WHOLE, ""),
        ("inside_share", _NUMBER, ""),
        ("nrmse", _NUMBER, "%"),
        ("nrmse_low", _NUMBER, "%"),
        ("nrmse_high", _NUMBER, "%"),
        ("rmse", _NUMBER, "N*m"),
        ("msrep", _NUMBER, "%"),
        ("r2", _NUMBER, ""),
        ("bias", _NUMBER, "N*m"),
        ("not_independent", _TEXT, ""),
        ("sentences", pa.list_(_TEXT), ""),
    ),
    "diagnose": (
        ("verdict", _TEXT, ""),
        ("threshold_met", pa.bool_(), ""),
        (
            "causes",
            pa.list_(pa.struct([("cause", _TEXT), ("confidence", _NUMBER), ("error_removed", _NUMBER)])),
            "",
        ),
        (
            "errors",
            pa.list_(
                pa.struct(
                    [("signal", _TEXT), ("unit", _TEXT), ("rmse", _NUMBER), ("noise_floor", _NUMBER), ("nrmse", _NUMBER)]
                )
            ),
            "",
        ),
        (
            "gains",
            pa.list_(
                pa.struct([("signal", _TEXT), ("rmse_before", _NUMBER), ("rmse_after", _NUMBER), ("reduction", _NUMBER)])
            ),
            "",
        ),
        ("unexplained", _NUMBER, ""),
        ("sentences", pa.list_(_TEXT), ""),
        ("next_experiment", _TEXT, ""),
    ),
}  # fmt: skip
EPOCH = date(1970, 1, 1)
FILES = ("trace", "model", "report", "document", "rig")


def summary_schema(do: Do) -> pa.Schema:
    """Return the table's schema; run times come last, apart from what is the same however often it is computed."""
    plain = ("log", "joint", "status", "kind", "reason", "device")
    fields = [pa.field(name, _TEXT) for name in plain]
    fields.append(pa.field("date", pa.date32()))
    fields += [pa.field(n, kind, metadata={"unit": unit} if unit else None) for n, kind, unit in FIGURES[do]]
    fields += [pa.field(name, pa.list_(_TEXT)) for name in ("codes", "warnings")]
    fields.append(pa.field("input_sha256", _TEXT))
    fields.append(pa.field("input_bytes", _WHOLE, metadata={"unit": "B"}))
    fields += [pa.field(name, _TEXT) for name in ("rig_sha256", "key", "vsalog")]
    fields += [pa.field(name, _TEXT) for name in FILES]
    fields.append(pa.field("run_seconds", _NUMBER, metadata={"unit": "s"}))
    return pa.schema(fields, metadata={"vsalog.batch": do})


def rows_of(records: Iterable[Record]) -> Iterator[dict[str, Any]]:
    """Yield a row per log and joint, in the order of the records; a log that failed has one without a joint."""
    for record in records:
        log: dict[str, Any] = {
            "log": record.log,
            "status": record.status,
            "kind": record.kind or None,
            "reason": record.reason or None,
            "device": record.device or None,
            "date": date.fromisoformat(record.date) if record.date else None,
            "threshold_met": record.met if record.status == "done" else None,
            "input_sha256": record.input_sha256 or None,
            "input_bytes": record.input_bytes,
            "rig_sha256": record.rig_sha256 or None,
            "key": record.key or None,
            "vsalog": record.vsalog,
            "run_seconds": record.run_seconds,
            "codes": [finding["code"] for finding in record.findings],
            "warnings": list(record.warnings),
        }
        log |= {what: record.outputs[what].name if what in record.outputs else None for what in FILES}
        if not record.joints:
            yield log | {"joint": None}
        for joint in record.joints:
            codes = (finding["code"] for finding in joint.figures.get("findings", ()))
            own = {
                "codes": [*log["codes"], *codes],
                "warnings": [*record.warnings, *joint.figures.get("warnings", ())],
            }
            yield log | joint.figures | own | {"joint": joint.joint}


def write_summary(records: Iterable[Record], do: Do, path: Path) -> None:
    """Write the table.

    Parameters
    ----------
    records : sorted by log
    do : the command that was run
    path : of the file

    Raises
    ------
    OSError
        It cannot be written.
    """
    table = _table(list(rows_of(records)), summary_schema(do))
    # Opened here: Arrow cannot be given a name whose bytes are no text.
    with path.open("wb") as file:
        pq.write_table(table, file, compression="zstd", write_page_checksum=True)


def _table(rows: list[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """Return rows as a table, by way of JSON: `Table.from_pylist` imports pandas, to see whether it was given any; a second."""
    if not rows:
        return schema.empty_table()
    # Arrow's reader takes the days since the epoch for a date.
    days = ({**row, "date": None if row["date"] is None else (row["date"] - EPOCH).days} for row in rows)
    lines = b"\n".join(map(msgspec.json.encode, days))
    table = pj.read_json(
        pa.BufferReader(lines),
        pj.ReadOptions(use_threads=False, block_size=len(lines) + 1),
        pj.ParseOptions(explicit_schema=pa.schema(list(schema)), unexpected_field_behavior="ignore"),
    )
    return table.select(schema.names).cast(schema)
