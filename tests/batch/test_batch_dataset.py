"""The data set: the same columns whatever wrote it, the same numbers as `estimate`, and one line to read it with."""

import json
import re
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from batch_bench import Here, do_batch

from vsalog.batch import run as whole_run
from vsalog.batch.records import Record, Settings
from vsalog.batch.summary import page_columns, rows_of
from vsalog.core.model import ModelFile
from vsalog.core.trace import Trace
from vsalog.estimation.job import Options, prepare
from vsalog.report.batch import batch_page
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs
from vsalog.writers.dataset import day, in_dataset
from vsalog.writers.trace import TraceWriter

pytestmark = pytest.mark.share(2)

PAGE = Path(__file__).parent.parent.parent / "docs" / "how-to" / "batch.md"


@pytest.fixture(scope="module")
def data(tmp_path_factory, samples):
    """The sample logs of three machines, as one batch, done in this process."""
    out = tmp_path_factory.mktemp("data") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(whole_run, "_executor", lambda *_: Here())
        logs = [samples / name for name in ("vsa2_exp2.mcap", "awas_exp2.mcap", "sea_exp1.csv")]
        outcome, _ = do_batch(*logs, out=out)
    assert outcome.code == 0
    return out


def test_all_files_have_the_same_columns(data):
    schemas = [pq.read_schema(path) for path in data.rglob("part.parquet")]
    assert len(schemas) == 3
    assert all(schema.equals(schemas[0]) for schema in schemas)  # metadata aside


def test_findings_stand_in_the_traces_and_their_codes_in_the_summary(data):
    codes = {row["log"]: row["codes"] for row in pq.read_table(data / "summary.parquet").to_pylist()}
    for path in data.rglob("part.parquet"):
        found = json.loads(pq.read_metadata(path).metadata[b"vsalog.findings"])
        assert codes[path.parent.name.removeprefix("log=")] == [finding["code"] for finding in found]


def test_the_numbers_are_those_of_estimate(data, samples, tmp_path):
    for name in ("awas_exp2.mcap", "sea_exp1.csv"):
        outputs = Outputs.named([samples / name], str(tmp_path), None)
        write_estimate(prepare([samples / name], Options()), outputs)
        alone = pq.read_table(outputs.trace)
        (path,) = data.rglob(f"log={name}/part.parquet")
        ours = pq.ParquetFile(path).read()
        assert ours.num_rows == alone.num_rows
        coefficients = [c for c in alone.column_names if c.startswith("coefficient_")]
        for column in set(alone.column_names) - set(coefficients):
            np.testing.assert_array_equal(ours[column].to_numpy(), alone[column].to_numpy(), err_msg=column)
        stacked = np.stack([alone[c].to_numpy() for c in coefficients], axis=1)
        rows = ours["coefficients"].to_pylist()
        for i in np.flatnonzero(np.isfinite(stacked).all(axis=1))[::997]:
            np.testing.assert_array_equal(rows[i], stacked[i])
        assert ours.schema.metadata[b"vsalog.rig"] == alone.schema.metadata[b"vsalog.rig"]
        assert ours.schema.field("stiffness").metadata == {b"unit": b"N*m/rad"}
        model = ModelFile.load(data / "models" / f"{name}.model.toml")
        assert model == ModelFile.load(outputs.model)


def test_every_reader_finds_every_row(data):
    rows = {path: pq.ParquetFile(path).metadata.num_rows for path in data.rglob("part.parquet")}
    count = sum(rows.values())
    read = f"read_parquet('{data}/traces/**/*.parquet', hive_partitioning = true)"
    assert duckdb.sql(f"select count(*) from {read}").fetchall() == [(count,)]
    found = duckdb.sql(f"select device, date, log, max(stiffness) from {read} group by all order by device").fetchall()
    assert [(device, str(date), log) for device, date, log, _ in found] == [
        ("AwAS", "2026-01-01", "awas_exp2.mcap"),
        ("VSA-II", "2026-01-01", "vsa2_exp2.mcap"),
        ("series elastic joint", "1970-01-01", "sea_exp1.csv"),
    ]
    assert pl.scan_parquet(data / "traces", hive_partitioning=True).select(pl.len()).collect().item() == count
    frame = pd.read_parquet(data / "traces", columns=["stiffness", "device", "joint"])
    assert len(frame) == count
    assert set(frame.device) == {"AwAS", "VSA-II", "series elastic joint"}


def test_the_table_goes_with_the_traces(data):
    """Joined by log and joint, as people will; the figures are those of the traces."""
    (table,) = duckdb.sql(
        f"select count(*), from (select distinct t.log, t.joint from read_parquet('{data}/traces/**/*.parquet') t"
        f" join '{data}/summary.parquet' s on t.log = s.log and t.joint = s.joint and t.device = s.device and t.date = s.date)"
    ).fetchall()
    assert table == (3,)
    summary = pl.read_parquet(data / "summary.parquet").filter(pl.col("log") == "sea_exp1.csv").to_dicts()[0]
    (path,) = data.rglob("log=sea_exp1.csv/part.parquet")
    trace = pq.ParquetFile(path).read().to_pandas()
    excited = trace[(trace.transmission == "total") & trace.excited]
    assert summary["stiffness_low"] == pytest.approx(excited.stiffness.quantile(0.01), rel=0.02)
    assert summary["samples"] == (trace.transmission == "total").sum()
    assert summary["status"] == "done"
    assert summary["estimator"] == "smoother"


@pytest.mark.parametrize("language", ["sql", "python"])
def test_the_lines_of_the_page(data, language, monkeypatch):
    """What docs/how-to/batch.md shows is run as it is there."""
    monkeypatch.chdir(data.parent)
    blocks = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    for block in blocks:
        if language == "sql":
            for statement in block.split(";"):
                if statement.strip():
                    assert duckdb.sql(statement).fetchall(), statement
        else:
            exec(compile(block, str(PAGE), "exec"), {})


def test_columns_that_come_late_are_not_lost(tmp_path):
    """Estimators of third parties may give one joint columns that another has not."""

    def block(joint, count, **extra):
        base = dict.fromkeys(("deflection", "stiffness"), np.arange(count, dtype=float))
        stamps = np.arange(count, dtype=np.int64) + 1_767_225_600_000_000_000
        return Trace(joint, stamps, stamps * 1e-9, np.zeros(count, np.int32), ("r",), {"1": base | extra})

    with TraceWriter(tmp_path / "part.parquet", {"a": "b"}, in_dataset) as writer:
        writer.write(block("one", 70_000, coefficient_0=np.ones(70_000)))
        writer.write(block("two", 5, odd=np.full(5, 7.0)))
        writer.write(block("three", 3))
    assert day(tmp_path / "part.parquet") == "2026-01-01"
    table = pq.read_table(tmp_path / "part.parquet")
    assert table.num_rows == 70_008
    assert table["odd"].null_count == 70_003
    assert table["odd"].drop_null().to_pylist() == [7.0] * 5
    assert table["coefficients"][0].as_py() == [1.0]
    assert table["coefficients"].null_count == 8
    assert table["joint"].unique().to_pylist() == ["one", "two", "three"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["part.parquet"]


def test_a_trace_of_no_rows_is_a_file_all_the_same(tmp_path):
    with TraceWriter(tmp_path / "part.parquet", {}, in_dataset):
        pass
    assert pq.read_table(tmp_path / "part.parquet").num_rows == 0
    assert day(tmp_path / "part.parquet") == "1970-01-01"
    assert pa.types.is_list(pq.read_schema(tmp_path / "part.parquet").field("coefficients").type)


def test_a_report_is_there_where_it_is_asked_for(tmp_path, logs, here):
    outcome, _ = do_batch(logs / "day0" / "exp0.csv", out=tmp_path / "out", settings=Settings(report=True))
    assert outcome.code == 0
    page = (tmp_path / "out" / "reports" / "exp0.csv" / "estimate.html").read_text(encoding="utf-8")
    assert "Stiffness of exp0.csv" in page
    assert 'href="reports/exp0.csv/estimate.html"' in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert not list((tmp_path / "out").rglob("plain.parquet"))


def test_the_page_of_a_huge_batch_stays_small_enough_to_open():
    """Ten megabytes, and it says where the rest is."""
    made = [
        Record(log=f"day/{k:06d}.mcap", do="estimate", status="failed", vsalog="0", reason="x") for k in range(45_000)
    ]
    counts = {"done": 0, "failed": 45_000, "missed": 0}
    page = batch_page("estimate", counts, rows_of(made), page_columns("estimate"))
    assert 5e6 < len(page) < 15e6
    assert "summary.parquet" in page
