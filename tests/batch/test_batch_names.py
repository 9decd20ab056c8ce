"""Names from outside as names of partitions: never a path, never two for one, and every reader gives them back."""

import os
from urllib.parse import unquote

import duckdb
import polars as pl
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.batch.names import device_name, encoded, readable, told_apart, trace_name
from vsalog.core.printable import LONGEST_NAME

HOSTILE = [
    "../../x", "..", ".", "/etc/passwd", "a=b", "line\nend", "tab\there", "nul\0here", "50%", "%2F", "a b+c", "ü€🦾", "~",
    "*?[x]", "<img src=x onerror=alert(1)>", "\"'`$(rm -rf /)", "C:\\x", "device=other", "\x1b[31m", "\u202eevil", "#",
    "&amp;", "x" * 5000,
]  # fmt: skip


@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=300))
def test_any_text_is_one_harmless_name_that_can_be_read_back(text):
    name = encoded(text)
    assert unquote(name) == text
    assert set(name) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-.%")
    assert not name.startswith(".")


@given(st.lists(st.binary(min_size=1, max_size=400).filter(lambda b: b"\0" not in b), unique=True, max_size=20))
def test_other_paths_have_other_names(paths):
    names = told_apart([readable(path) for path in paths])
    assert len({encoded(name).casefold() for name in names}) == len(paths)
    assert all(len(encoded(name)) <= LONGEST_NAME + 40 for name in names)


def test_names_leave_room_in_those_of_files_for_what_comes_with_them():
    """File systems end at 255 bytes: a prefix and an ending take up to 75."""
    assert len(encoded(readable(b"x" * 300))) == 180
    assert readable(b"x" * 180) == "x" * 180


def test_bytes_that_are_no_text_are_not_taken_for_text_that_looks_like_them():
    assert len({readable(b"\xff.csv"), readable(b"\\xff.csv"), readable(b"\xfe.csv")}) == 3
    assert readable(b"\\xff.csv") == "\\xff.csv"


def test_names_that_capitals_alone_tell_apart_lie_apart_where_capitals_do_not_count():
    names = told_apart(["a/Exp1.mcap", "a/exp1.mcap", "a/EXP1.mcap", "b.mcap"])
    assert len({encoded(name).casefold() for name in names}) == 4
    assert "a/exp1.mcap" in names
    assert "b.mcap" in names


@pytest.mark.parametrize("text", ["", *HOSTILE])
def test_a_device_is_one_folder_below_the_traces(text, tmp_path):
    name = trace_name(device_name(text), "2026-01-01", readable(os.fsencode(text) or b"x"))
    parts = name.split("/")
    assert len(parts) == 5
    assert [part.split("=")[0] for part in parts[1:4]] == ["device", "date", "log"]
    assert all(len(part.encode()) < 256 and part.count("=") <= 1 for part in parts)
    target = tmp_path / name
    target.parent.mkdir(parents=True)
    target.write_text("")
    assert target.resolve().is_relative_to(tmp_path)


def test_readers_give_hostile_names_back(tmp_path):
    devices = sorted({device_name(text) for text in HOSTILE})
    for device in devices:
        path = tmp_path / trace_name(device, "2026-01-01", f"{device_name(device)[:20]}.csv")
        path.parent.mkdir(parents=True)
        pq.write_table(pa.table({"x": [1.0]}), path)
    top = tmp_path / "traces"
    found = duckdb.sql(
        f"select device, date from read_parquet('{top}/**/*.parquet', hive_partitioning = true)"
    ).fetchall()
    assert sorted(device for device, _ in found) == devices
    assert {str(date) for _, date in found} == {"2026-01-01"}
    assert sorted(pl.scan_parquet(top, hive_partitioning=True).collect()["device"]) == devices
    assert sorted(ds.dataset(top, partitioning="hive").to_table()["device"].to_pylist()) == devices
