"""All records as one table: a row per log and joint, `summary.parquet`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.json as pj
import pyarrow.parquet as pq

from vsalog.batch.records import Do, Record
from vsalog.report.batch import Column

TEXT, NUMBER, COUNT = pa.string(), pa.float64(), pa.int64()


class Figure(NamedTuple):
    """A column of a command's results for a joint; `head` is its heading on the page, if it is shown there."""

    name: str
    kind: pa.DataType = NUMBER
    unit: str = ""
    head: str = ""


def _each(texts: Sequence[str], numbers: Sequence[str], counts: Sequence[str] = ()) -> pa.DataType:
    """Return the type of a list of structures with these fields."""
    fields = [(n, kind) for names, kind in ((texts, TEXT), (counts, COUNT), (numbers, NUMBER)) for n in names]
    return pa.list_(pa.struct(fields))


_OF_TRANSMISSION = (
    Figure("samples", COUNT),
    Figure("excited_share", head="excited [%]"),
    Figure("stiffness_low", unit="N*m/rad", head="stiffness, 1 % [N·m/rad]"),
    Figure("stiffness_high", unit="N*m/rad", head="99 % [N·m/rad]"),
    Figure("stiffness_last", unit="N*m/rad"),
    Figure("relative_std", head="± (1 std) [%]"),
    Figure("negative_share"),
    Figure("fit_rms", unit="N*m"),
    Figure("fit_mean", unit="N*m"),
    Figure("fit_share", head="RMS residual [%]"),
    Figure("deflection_span", unit="rad"),
    Figure("external_stiffness_low", unit="N*m/rad"),
    Figure("external_stiffness_high", unit="N*m/rad"),
)
# The results of each command, in the order of the columns.
FIGURES: dict[Do, tuple[Figure, ...]] = {
    "estimate": (
        Figure("estimator", TEXT, head="estimator"),
        Figure("modality", TEXT),
        Figure("rig_guessed", pa.bool_()),
        Figure("duration", unit="s", head="duration [s]"),
        Figure("rate", unit="Hz"),
        *_OF_TRANSMISSION,
        Figure("transmissions", _each(["transmission"], [f.name for f in _OF_TRANSMISSION[1:]], ["samples"])),
        Figure("motor", _each(["parameter"], ["value"])),
    ),
    "validate": (
        Figure("verdict", TEXT, head="verdict"),
        Figure("judged_on", TEXT, head="judged by"),
        Figure("threshold_met", pa.bool_()),
        Figure("duration", unit="s"),
        Figure("rate", unit="Hz"),
        Figure("samples", COUNT),
        Figure("inside_share", head="inside the region [%]"),
        Figure("nrmse", unit="%", head="NRMSE [%]"),
        Figure("nrmse_low", unit="%"),
        Figure("nrmse_high", unit="%"),
        Figure("rmse", unit="N*m"),
        Figure("msrep", unit="%", head="MSREP [%]"),
        Figure("r2", head="R²"),
        Figure("bias", unit="N*m"),
        Figure("not_independent", TEXT),
        Figure("sentences", pa.list_(TEXT)),
    ),
    "diagnose": (
        Figure("verdict", TEXT, head="verdict"),
        Figure("threshold_met", pa.bool_()),
        Figure("causes", _each(["cause"], ["confidence", "error_removed"]), head="causes"),
        Figure("errors", _each(["signal", "unit"], ["rmse", "noise_floor", "nrmse"])),
        Figure("gains", _each(["signal"], ["rmse_before", "rmse_after", "reduction"])),
        Figure("unexplained", head="unexplained [%]"),
        Figure("sentences", pa.list_(TEXT)),
        Figure("next_experiment", TEXT),
    ),
}
FILES = ("trace", "model", "report", "document", "rig")


def summary_schema(do: Do) -> pa.Schema:
    """Return the table's schema; run times come last, after the reproducible columns."""
    figures = (
        *(Figure(name, TEXT) for name in ("log", "joint", "status", "kind", "reason", "device")),
        Figure("date", pa.date32()),
        *FIGURES[do],
        *(Figure(name, pa.list_(TEXT)) for name in ("codes", "warnings")),
        Figure("input_sha256", TEXT),
        Figure("input_bytes", COUNT, "B"),
        *(Figure(name, TEXT) for name in ("rig_sha256", "key", "vsalog", *FILES)),
        Figure("run_seconds", unit="s"),
    )
    fields = [pa.field(f.name, f.kind, metadata={"unit": f.unit} if f.unit else None) for f in figures]
    return pa.schema(fields, metadata={"vsalog.batch": do})


def page_columns(do: Do) -> list[Column]:
    """Return the figures on the page of a batch."""
    return [
        Column(f.name, f.head, f.kind == NUMBER, f.head.endswith("[%]") and f.unit != "%")
        for f in FIGURES[do]
        if f.head
    ]


def rows_of(records: Iterable[Record]) -> Iterator[dict[str, Any]]:
    """Yield a row per log and joint, in the order of the records; a log that failed has one without a joint."""
    for record in records:
        # Unknown values are null.
        log = {name: value or None for name, value in msgspec.structs.asdict(record).items()}
        log |= {what: record.outputs[what].name if what in record.outputs else None for what in FILES}
        log |= {"input_bytes": record.input_bytes, "run_seconds": record.run_seconds}
        log["threshold_met"] = record.met if record.status == "done" else None
        for joint in record.joints or (None,):
            figures = {} if joint is None else joint.figures
            codes = [finding["code"] for finding in (*record.findings, *figures.get("findings", ()))]
            warnings = [*record.warnings, *figures.get("warnings", ())]
            name = None if joint is None else joint.joint
            yield log | figures | {"joint": name, "codes": codes, "warnings": warnings}


def write_summary(records: Iterable[Record], do: Do) -> bytes:
    """Return the table as a file.

    Parameters
    ----------
    records : sorted by log
    do : the command that was run
    """
    sink = pa.BufferOutputStream()
    pq.write_table(_table(rows_of(records), summary_schema(do)), sink, compression="zstd", write_page_checksum=True)
    return bytes(sink.getvalue())


def _table(rows: Iterable[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """Return rows as a table, by way of JSON: `Table.from_pylist` imports pandas for a type check, which takes a second."""
    lines = b"\n".join(msgspec.json.encode({name: row.get(name) for name in schema.names}) for row in rows)
    if not lines:
        return schema.empty_table()
    # Dates are read as texts.
    read = pa.schema([field.with_type(TEXT) if pa.types.is_date(field.type) else field for field in schema])
    table = pj.read_json(
        pa.BufferReader(lines),
        pj.ReadOptions(use_threads=False, block_size=len(lines) + 1),
        pj.ParseOptions(explicit_schema=read, unexpected_field_behavior="ignore"),
    )
    return table.select(schema.names).cast(schema)
