"""Parquet and MATLAB files."""

from __future__ import annotations

import datetime
import re
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes, found, values_of
from scipy.io import savemat

from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read

pytestmark = pytest.mark.share(2)

START = 1_700_000_000_123_456_789


def parquet(tmp_path, columns, units=None, name="log.parquet", **options):
    fields = []
    for column, array in columns.items():
        metadata = {"unit": units[column]} if units and column in units else None
        fields.append(pa.field(column, array.type, metadata=metadata))
    pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), tmp_path / name, **options)
    return tmp_path / name


def test_columns_types_and_units(tmp_path):
    columns = {
        "stamp": pa.array(START + np.arange(4) * 1_000_000),
        "time": pa.array(np.arange(4) * 1e-3),
        "q": pa.array([1.5, None, float("nan"), 4.5]),
        "n [N*m]": pa.array([1, 2, 3, 4], pa.int32()),
        "on": pa.array([True, False, True, True]),
        "mode": pa.array(["a", "b", "c", "d"]),
        "list": pa.array([["a"], ["b"], ["c"], ["d"]]),
    }
    path = parquet(tmp_path, columns, {"stamp": "ns", "q": "rad"})
    recording = read(path)
    assert recording.format == "parquet"
    assert list(recording.channels) == ["time", "n", "on", "q"]
    # Blank cells are no samples.
    np.testing.assert_array_equal(recording.channel("q").values, [1.5, 4.5])
    np.testing.assert_array_equal(recording.channel("q").stamps, START + np.array([0, 3]) * 1_000_000)
    assert recording.channel("q").unit == "rad"
    assert recording.channel("n").unit == "N*m"
    assert recording.unread["mode"] == "text"
    assert recording.unread["list[0]"] == "text"
    assert recording.absolute_time
    assert list(read(path, wanted=["on"]).channels) == ["on"]
    assert sorted(open_reader(path).catalogue().channels) == sorted(recording.channels)


@pytest.mark.parametrize(
    ("kind", "factor"),
    [(pa.timestamp("ms"), 1_000_000), (pa.timestamp("ns", "Europe/Berlin"), 1), (pa.duration("us"), 1000)],
)
def test_time_types(tmp_path, kind, factor):
    times = pa.array(np.arange(1, 5) * 5).cast(kind)
    recording = read(parquet(tmp_path, {"time": times, "x": pa.array([1.0, 2.0, 3.0, 4.0])}))
    assert recording.channel("x").stamps.tolist() == [5 * factor, 10 * factor, 15 * factor, 20 * factor]


def test_a_table_without_rows_is_refused(tmp_path):
    with pytest.raises(ReadError, match="has no rows"):
        read(parquet(tmp_path, {"time": pa.array([], pa.float64()), "x": pa.array([], pa.float64())}))


def test_time_as_dates_with_gaps(tmp_path):
    when = datetime.datetime(2024, 1, 1)
    times = pa.array([when, None, when + datetime.timedelta(seconds=1)])
    recording = read(parquet(tmp_path, {"time": times, "x": pa.array([1.0, 2.0, 3.0])}))
    assert recording.channel("x").values.tolist() == [1, 3]
    assert values_of(recording, "clock.rows_without_time") == [1]


@pytest.mark.filterwarnings("error")
def test_a_time_that_is_a_signalling_nan_is_none(tmp_path):
    times = np.array([0.1, 0.2, 0.3, 0.4])
    times[1:2] = np.frombuffer(b"\1\0\0\0\0\0\xf0\x7f")
    recording = read(parquet(tmp_path, {"time [s]": pa.array(times), "x": pa.array([1.0, 2.0, 3.0, 4.0])}))
    assert recording.channel("x").values.tolist() == [1, 3, 4]


def test_a_trace_of_several_parts_is_several_streams(tmp_path):
    columns = {
        "stamp": pa.array(np.repeat(np.arange(3) * 1_000_000, 2)),
        "joint": pa.array(["elbow"] * 6).dictionary_encode(),
        "transmission": pa.array(["agonist", "antagonist"] * 3),
        "stiffness": pa.array([1.0, 10.0, 2.0, 20.0, 3.0, 30.0]),
    }
    recording = read(parquet(tmp_path, columns, {"stamp": "ns", "stiffness": "N*m/rad"}))
    assert recording.channel("stiffness[elbow.agonist]").values.tolist() == [1, 2, 3]
    assert recording.channel("stiffness[elbow.antagonist]").values.tolist() == [10, 20, 30]
    assert recording.channel("stiffness[elbow.agonist]").unit == "N*m/rad"
    assert recording.findings == ()


def test_many_row_groups_and_no_time(tmp_path):
    path = parquet(tmp_path, {"x": pa.array(np.arange(1000.0))}, row_group_size=100)
    recording = read(path, rate=1000)
    np.testing.assert_array_equal(recording.channel("x").values, np.arange(1000))
    np.testing.assert_array_equal(recording.channel("x").stamps, np.arange(1000) * 1_000_000)
    assert read(path).streams["log"].time_source == "none"


def test_a_cut_off_parquet_file_is_refused(tmp_path):
    path = parquet(tmp_path, {"x": pa.array(np.arange(1000.0))})
    raw = path.read_bytes()
    path.write_bytes(raw[:-100])
    with pytest.raises(ReadError, match="ends without its footer"):
        read(path)
    path.write_bytes(raw[:-1] + b"E")
    with pytest.raises(ReadError, match="encrypted"):
        read(path)
    path.write_bytes(b"PARE" + raw[4:-4] + b"PARE")
    with pytest.raises(ReadError, match="is an encrypted Parquet file"):
        read(path)
    path.write_bytes(raw[:-20] + bytes([255]) * 12 + raw[-8:])
    with pytest.raises(ReadError, match="cannot be read") as told:
        read(path)
    assert str(told.value).isprintable()


def test_structures_with_their_clocks(tmp_path):
    t = np.arange(50) / 1000
    content = {
        "DEVICE": {
            "x00": {"timeJIM": t[:, None], "angle": np.sin(t)[None, :], "torque": t * 2, "label": "soft"},
            "x10": {"time": t * 2, "torque": t * 3, "setting": 10.0},
        },
        "curve": np.arange(7.0),
        "table": np.arange(40.0).reshape(2, 20),
        "image": np.zeros((100, 200)),
        "spectrum": np.array([1j, 2j]),
    }
    path = tmp_path / "log.mat"
    savemat(path, content)
    recording = read(path)
    assert recording.format == "matlab"
    torque = recording.channel("DEVICE.x00.torque")
    np.testing.assert_array_equal(torque.values, t * 2)
    np.testing.assert_array_equal(torque.stamps, np.arange(50) * 1_000_000)
    assert torque.stream == "DEVICE.x00"
    assert recording.streams["DEVICE.x00"].time_source == "column"
    np.testing.assert_array_equal(recording.channel("DEVICE.x10.torque").stamps, np.arange(50) * 2_000_000)
    assert recording.unread["DEVICE.x00.label"] == "text"
    assert recording.unread["DEVICE.x10.setting"] == "a single value"
    assert recording.unread["image"] == "array of 100 values"
    assert recording.unread["spectrum"] == "complex numbers"
    np.testing.assert_array_equal(recording.channel("table[1]").values, np.arange(20, 40))
    assert recording.streams["log (7 values)"].time_source == "none"
    assert read(path, rate=10.0).streams["log (7 values)"].time_source == "rate"
    assert list(read(path, wanted=["curve"]).channels) == ["curve"]
    assert sorted(open_reader(path).catalogue().channels) == sorted(recording.channels)


def test_a_clock_serves_the_structures_below(tmp_path):
    t = np.arange(20) / 100
    signals = np.array([{"values": t + 1}, {"values": t + 2}], dtype=object)
    savemat(tmp_path / "log", {"out": {"time": t, "signals": signals}}, appendmat=False)
    recording = read(tmp_path / "log")
    channel = recording.channel("out.signals[1].values")
    np.testing.assert_array_equal(channel.values, t + 2)
    np.testing.assert_array_equal(channel.stamps, np.arange(20) * 10_000_000)


@pytest.mark.parametrize(
    ("labels", "blocks", "called"),
    [
        (["q", "torque"], ["joint/Scope", "joint/Scope"], ["q", "torque[0]", "torque[1]"]),
        (["", ""], ["joint/q", "joint/drive/torque"], ["q", "torque[0]", "torque[1]"]),
        (["q", "q"], ["", ""], ["q", "q#2[0]", "q#2[1]"]),
        (["time", ""], ["", ""], ["time#2", "signals[1][0]", "signals[1][1]"]),
        (["", ""], ["", ""], None),
    ],
)
def test_signals_of_simulink_are_called_by_their_labels(tmp_path, labels, blocks, called):
    """Structure With Time, as the Scope and To Workspace blocks log it (Simulink: Scope, Log data to workspace)."""
    t = np.arange(20) / 100
    kinds = ["values", "dimensions", "label", "title", "plotStyle", "blockName"]
    signals = np.empty((1, 2), [(name, object) for name in kinds])
    for i, values in enumerate((t[:, None] + 1, np.stack([t, 2 * t], axis=1))):
        parts = (values, float(values.shape[1]), labels[i], "", 0.0, blocks[i])
        signals[0, i] = parts
    savemat(
        tmp_path / "log",
        {"ScopeData": {"time": t[:, None], "signals": signals, "blockName": "joint/Scope"}},
        appendmat=False,
    )
    recording = read(tmp_path / "log")
    if called is None:
        assert "ScopeData.signals[0].values" in recording.channels
        return
    assert list(recording.channels) == [f"ScopeData.{name}" for name in called]
    for name, values in zip(called, (t + 1, t, 2 * t), strict=True):
        np.testing.assert_array_equal(recording.channel(f"ScopeData.{name}").values, values)
        np.testing.assert_array_equal(recording.channel(f"ScopeData.{name}").stamps, np.arange(20) * 10_000_000)
    assert set(recording.streams) == {"ScopeData"}
    assert recording.unread == {"ScopeData.blockName": "text"}


def test_a_cell_array_is_a_stream_of_its_own(tmp_path):
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = np.arange(30.0), np.arange(30.0) * 2
    savemat(tmp_path / "log", {"x": np.arange(7.0), "cells": cells}, appendmat=False)
    recording = read(tmp_path / "log")
    found = {name: (c.values.tolist(), c.stream) for name, c in recording.channels.items()}
    assert found == {
        "x": (list(range(7)), "log"),
        "cells[0]": (list(range(30)), "cells"),
        "cells[1]": (list(range(0, 60, 2)), "cells"),
    }


def test_time_that_does_not_rise_is_a_channel(tmp_path):
    savemat(tmp_path / "log", {"time": np.zeros(5), "x": np.arange(5.0)}, appendmat=False)
    recording = read(tmp_path / "log")
    assert list(recording.channels) == ["time", "x"]
    assert "clock.missing" in codes(recording)


SECONDS = np.arange(50) / 100
NOON = datetime.datetime(2024, 2, 29, 12, tzinfo=datetime.UTC)


@pytest.mark.parametrize(
    ("name", "time", "begin", "read_as"),
    [
        ("time", SECONDS, 0.0, ""),
        (
            "time",
            SECONDS * 1000,
            0.0,
            "milliseconds",
        ),
        # Microseconds and nanoseconds since the machine was switched on, whose size is that of dates in larger units.
        ("time", 1.2e9 + SECONDS * 1e6, 1200.0, "microseconds"),
        ("time", 1.2e12 + SECONDS * 1e9, 1200.0, "nanoseconds"),
        ("time", 5e14 + SECONDS * 1e9, 5e5, "nanoseconds"),
        ("t_ms", SECONDS * 1000, 0.0, ""),
        ("time_s", SECONDS, 0.0, ""),
        ("time", NOON.timestamp() + SECONDS, NOON.timestamp(), ""),
        ("timestamp", (NOON.timestamp() + SECONDS) * 1e3, NOON.timestamp(), ""),
        # MATLAB's datenum counts from a day that it calls 0, a year and a day before Python's first.
        ("t", NOON.toordinal() + 366.5 + SECONDS / 86400, NOON.timestamp(), "days"),
    ],
)
def test_units_of_matlab_clocks(tmp_path, name, time, begin, read_as):
    savemat(tmp_path / "log", {name: time, "x": SECONDS}, appendmat=False)
    recording = read(tmp_path / "log")
    stamps = recording.channel("x").stamps
    assert stamps[0] == pytest.approx(begin * 1e9, abs=1e4)
    np.testing.assert_allclose(stamps - stamps[0], SECONDS * 1e9, atol=2e4)  # datenum resolves 10 µs
    assert codes(recording) == [
        "clock.counts_days" if read_as == "days" else "clock.unit_by_steps" for _ in [read_as] if read_as
    ]
    assert [one.evidence["read_as"] for one in found(recording, "clock.unit_by_steps")] == [read_as] * (
        read_as not in ("", "days")
    )


def test_whole_nanoseconds_are_exact(tmp_path):
    """Floating point would round those of today to 256."""
    time = int(NOON.timestamp()) * 10**9 + np.arange(50) * 1_000_003
    savemat(tmp_path / "log", {"time": time, "s": {"t": time, "x": SECONDS}, "x": SECONDS}, appendmat=False)
    recording = read(tmp_path / "log")
    assert recording.channel("x").stamps.tolist() == time.tolist()
    assert recording.channel("s.x").stamps.tolist() == time.tolist()


def test_seconds_at_steps_of_seconds_can_be_told(tmp_path):
    savemat(tmp_path / "log", {"time_s": SECONDS * 1000, "x": SECONDS}, appendmat=False)
    assert read(tmp_path / "log").channel("x").stamps[1] == 10_000_000_000


@pytest.mark.parametrize(
    ("place", "value", "code", "at"),
    [(slice(None), np.nan, "clock.no_times", None), (6, 0.0, "clock.not_rising", 7)],
)
def test_why_a_time_is_not_taken_for_it(tmp_path, place, value, code, at):
    time = SECONDS.copy()
    time[place] = value
    savemat(tmp_path / "log", {"time": time, "x": SECONDS}, appendmat=False)
    recording = read(tmp_path / "log")
    assert recording.channel("x").stamps.tolist() == list(range(50))
    assert [(one.part, one.value) for one in found(recording, code)] == [("time", at)]


@pytest.mark.parametrize("missing", [[0], [7], [49], [3, 4, 30], list(range(20, 50))])
def test_rows_without_a_time_are_left_out(tmp_path, missing):
    """As where a vector was made room for that was not filled to its end."""
    time = SECONDS.copy()
    time[missing] = np.nan
    savemat(tmp_path / "log", {"s": {"time": time, "x": SECONDS, "inner": {"y": 2 * SECONDS}}}, appendmat=False)
    recording = read(tmp_path / "log")
    for name, factor in (("s.x", 1), ("s.inner.y", 2)):
        channel = recording.channel(name)
        np.testing.assert_array_equal(channel.values, factor * np.delete(SECONDS, missing))
        np.testing.assert_array_equal(channel.stamps, np.delete(np.arange(50), missing) * 10**7)
    (left_out,) = recording.findings
    assert (left_out.code, left_out.part, left_out.value) == ("clock.rows_without_time", "s.time", len(missing))


def test_samples_that_share_a_time_are_reported(tmp_path):
    time = SECONDS.copy()
    time[7] = time[6]
    savemat(tmp_path / "log", {"time": time, "x": SECONDS}, appendmat=False)
    recording = read(tmp_path / "log")
    np.testing.assert_array_equal(recording.channel("x").values, np.delete(SECONDS, 7))
    assert recording.streams["log"].conflicts == 1


def test_a_clock_of_another_length_is_reported(tmp_path):
    savemat(tmp_path / "log", {"time": SECONDS[:40], "x": SECONDS}, appendmat=False)
    assert "40 values" in read(tmp_path / "log").unread["time"]


def test_a_cut_off_matlab_file_is_refused(tmp_path):
    path = tmp_path / "log"
    savemat(path, {"x": np.random.default_rng(1).random(1000)}, appendmat=False)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(ReadError, match="damaged"):
        read(path)


def damaged(raw, rng, k):
    """Return a file with a byte changed, or cut off."""
    bad = bytearray(raw)
    if k % 4 == 0:
        return bad[: int(rng.integers(len(bad)))]
    bad[int(rng.integers(len(bad)))] ^= int(rng.integers(1, 256))
    return bad


def numbers(path):
    """Return the values of each channel by their stamps, without those that are lost."""
    found = {}
    for name, channel in read(path).channels.items():
        there = np.isfinite(channel.values)
        found[name] = dict(zip(channel.stamps[there].tolist(), channel.values[there].tolist(), strict=True))
    return found


def write_parquet(path, t, x):
    table = pa.table({"time": t, "x": x, "y": np.round(x, 3)})
    pq.write_table(table, path, row_group_size=100, write_page_checksum=True)


def write_matlab(path, t, x):
    content = {"one": {"time": t, "x": x, "in": {"time": t, "y": -x}}, "two": {"time": t, "z": x + 1}}
    savemat(path, content, do_compression=True, appendmat=False)


@pytest.mark.parametrize("write", [write_parquet, write_matlab])
def test_damage_is_no_crash_and_no_wrong_value(tmp_path, write):
    """Both have checksums: what does not match is left out, and the rest is read."""
    rng = np.random.default_rng(1)
    path = tmp_path / "log"
    write(path, np.arange(1000) / 1000, rng.standard_normal(1000))
    raw, sound = path.read_bytes(), numbers(path)
    most = 0
    for k in range(150):
        path.write_bytes(damaged(raw, rng, k))
        try:
            found = numbers(path)
        except ReadError:
            continue
        for name in found.keys() & sound.keys():
            assert found[name].items() <= sound[name].items()
        kept = sum(len(found[name]) for name in found.keys() & sound.keys())
        most += 0.3 < kept / sum(map(len, sound.values())) < 1
    assert most > 30  # of which a part was damaged, and the rest read


def test_a_name_that_is_no_text_is_refused(tmp_path):
    path = parquet(tmp_path, {"time [s]": pa.array([0.0, 1.0]), "xyz": pa.array([1.0, 2.0])}, store_schema=False)
    path.write_bytes(path.read_bytes().replace(b"xyz", b"\xd6\xd6\xd6"))
    with pytest.raises(ReadError, match="cannot be read"):
        read(path)


def broken(tmp_path, columns, at, groups=100, **options):
    """Write a table of which one number of one column is changed behind its checksum: at is (column, row)."""
    path = tmp_path / "log.parquet"
    options = {"write_page_checksum": True, "compression": "none", "use_dictionary": False} | options
    pq.write_table(pa.table(columns), path, row_group_size=groups, **options)
    name, row = at
    raw, number = bytearray(path.read_bytes()), pa.array(columns[name])[row].as_py()
    column = pq.ParquetFile(path).metadata.row_group(row // groups).column(list(columns).index(name))
    raw[raw.index(np.float64(number).tobytes(), column.data_page_offset)] ^= 1
    path.write_bytes(raw)
    return path


def columns(rows=1000):
    rng = np.random.default_rng(1)
    return {"time": np.arange(rows) / 1000, "x": rng.standard_normal(rows), "y": rng.standard_normal(rows)}


@pytest.mark.parametrize("groups", [1000, 100])
def test_a_damaged_page_takes_along_no_other_column_and_no_other_row_group(tmp_path, groups):
    written = columns()
    recording = read(broken(tmp_path, written, ("x", 350), groups))
    first, last = (0, 1000) if groups == 1000 else (300, 400)
    expected = written["x"].copy()
    expected[first:last] = np.nan
    np.testing.assert_array_equal(recording.channel("x").values, expected)
    np.testing.assert_array_equal(recording.channel("y").values, written["y"])
    np.testing.assert_array_equal(recording.channel("y").stamps, np.arange(1000) * 1_000_000)
    (damage,) = recording.findings
    assert (damage.code, damage.part, damage.value) == ("recording.column_damaged", "x", last - first)
    assert [damage.evidence[name] for name in ("rows", "begin", "end", "more")] == [1000, first + 1, last, 0]


def test_rows_before_a_damaged_page_are_kept(tmp_path):
    written = columns(100_000)
    path = broken(tmp_path, written, ("x", 70_000), 100_000, data_page_size=2**16)
    values = read(path).channel("x").values
    there = np.isfinite(values)
    np.testing.assert_array_equal(values[there], written["x"][there])
    assert there[:60_000].all()
    assert not there[70_000:].any()


def test_rows_whose_time_is_damaged_are_left_out(tmp_path):
    written = columns()
    recording = read(broken(tmp_path, written, ("time", 350)))
    kept = np.r_[0:300, 400:1000]
    np.testing.assert_array_equal(recording.channel("x").values, written["x"][kept])
    np.testing.assert_array_equal(recording.channel("x").stamps, kept * 1_000_000)
    assert values_of(recording, "recording.rows_left_out") == [100]


def test_a_clock_whose_beginning_is_damaged_is_still_the_clock(tmp_path):
    recording = read(broken(tmp_path, columns(), ("time", 50)))
    np.testing.assert_array_equal(recording.channel("x").stamps, np.arange(100, 1000) * 1_000_000)


def test_a_clock_that_is_lost_is_named(tmp_path):
    written = columns()
    path = broken(tmp_path, written, ("time", 350), 1000)
    with pytest.raises(ReadError, match="time column 'time' cannot be read; --rate HZ"):
        read(path)
    recording = read(path, rate=1000.0)
    np.testing.assert_array_equal(recording.channel("y").values, written["y"])
    np.testing.assert_array_equal(recording.channel("y").stamps, np.arange(1000) * 1_000_000)


def test_nothing_but_a_lost_column_is_refused(tmp_path):
    path = broken(tmp_path, columns(), ("x", 350), 1000)
    with pytest.raises(ReadError, match="none of the 1000 rows of column 'x' can be read"):
        read(path, wanted=["x"])


def test_columns_whose_names_begin_alike_stay_apart(tmp_path):
    written = columns()
    tables = {"time": written["time"], "motor.x": written["x"], "motor": written["y"], "z": written["x"] * 2}
    recording = read(broken(tmp_path, tables, ("z", 350)))
    np.testing.assert_array_equal(recording.channel("motor").values, written["y"])
    np.testing.assert_array_equal(recording.channel("motor.x").values, written["x"])
    assert np.isnan(recording.channel("z").values[300:400]).all()


def test_parts_of_a_trace_of_which_the_names_are_lost(tmp_path):
    count = 400
    columns = {
        "stamp": pa.array(np.arange(count)),
        "joint": pa.array(["elbow", "wrist"] * (count // 2)),
        "transmission": pa.array(["total"] * count),
        "stiffness": pa.array(np.arange(count) * 1.0),
    }
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=100, write_page_checksum=True, compression="none")
    raw = bytearray(path.read_bytes())
    group = pq.ParquetFile(path).metadata.row_group(1).column(1)
    raw[raw.index(b"wrist", group.dictionary_page_offset)] ^= 1
    path.write_bytes(raw)
    recording = read(path)
    assert set(recording.channels) == {"stiffness[elbow.total]", "stiffness[wrist.total]"}
    expected = np.r_[1:100:2, 201:400:2]
    np.testing.assert_array_equal(recording.channel("stiffness[wrist.total]").values, expected)
    assert values_of(recording, "recording.rows_left_out") == [100]


def test_a_damaged_row_group_moves_no_row(tmp_path):
    recording = read(broken(tmp_path, {"x": np.arange(1000.0)}, ("x", 350)), rate=1000.0)
    channel = recording.channel("x")
    expected = np.arange(1000.0)
    expected[300:400] = np.nan
    np.testing.assert_array_equal(channel.stamps, np.arange(1000) * 1_000_000)
    np.testing.assert_array_equal(channel.values, expected)


def test_a_page_that_is_passed_by_moves_no_row(tmp_path):
    """Arrow passes by pages of a kind that it does not know, and what follows would come too early."""
    written, path = columns(60_000), tmp_path / "log.parquet"
    options = {"compression": "none", "use_dictionary": False, "data_page_size": 2**14, "write_statistics": False}
    pq.write_table(pa.table(written), path, **options)
    raw = bytearray(path.read_bytes())
    column = pq.ParquetFile(path).metadata.row_group(0).column(1)
    head = bytes(raw[column.data_page_offset : column.data_page_offset + 2])
    assert head == b"\x15\x00"  # an integer, 0: a page of data
    second = raw.index(head, column.data_page_offset + 2**13)
    raw[second + 1] = 2  # an index
    path.write_bytes(raw)
    recording = read(path)
    values = recording.channel("x").values
    there = np.isfinite(values)
    np.testing.assert_array_equal(values[there], written["x"][there])
    np.testing.assert_array_equal(recording.channel("y").values, written["y"])
    assert "recording.column_damaged" in codes(recording)


READS_ALL = """
import sys, pathlib
from vsalog.core.errors import ReadError
from vsalog.readers import read
path = pathlib.Path(sys.argv[1])
raw = path.read_bytes()
for place in range(int(sys.argv[2]), len(raw)):
    for change in (1, 7):
        path.write_bytes(raw[:place] + bytes([raw[place] ^ change]) + raw[place + 1 :])
        try:
            read(path)
        except ReadError:
            pass
"""


def test_a_footer_that_contradicts_itself_ends_no_process(tmp_path):
    table = pa.table({"time": np.arange(8) / 10, "x": np.arange(8.0)})
    pq.write_table(table, tmp_path / "log", store_schema=False, write_page_checksum=True)
    raw = (tmp_path / "log").read_bytes()
    footer = len(raw) - 8 - int.from_bytes(raw[-8:-4], "little")
    command = [sys.executable, "-c", READS_ALL, str(tmp_path / "log"), str(footer)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_rows_of_a_stream_do_not_depend_on_what_else_is_read(tmp_path):
    """A row is there for a stream where any of its columns has a sample, even one that nobody asks for."""
    cells = {"a.x": [1.0, None, 3.0, None], "a.y": [1.0, 2.0, None, None], "b.z": [None, None, None, 4.0]}
    fields = [pa.field(name, pa.float64(), metadata={"stream": name[0]}) for name in cells]
    schema = pa.schema([pa.field("time", pa.int64(), metadata={"unit": "ns"}), *fields])
    path = tmp_path / "log"
    pq.write_table(pa.table([pa.array(range(4)), *map(pa.array, cells.values())], schema=schema), path)
    together = read(path)
    assert together.channel("a.x").stamps.tolist() == together.channel("a.y").stamps.tolist() == [0, 1, 2]
    assert together.channel("b.z").stamps.tolist() == [3]
    for name, channel in together.channels.items():
        alone = read(path, wanted=[name]).channel(name)
        np.testing.assert_array_equal(alone.stamps, channel.stamps)
        np.testing.assert_array_equal(alone.values, channel.values)


def lying(path):
    """Write a column that a page of 300 MiB is in, and a footer in which it has a thousand bytes."""
    table = pa.table({"time": [0.0, 1.0], "x": [1.0, 2.0], "b": pa.array([bytes(300 * 2**20), b""], pa.binary())})
    pq.write_table(table, path, compression="zstd", use_dictionary=False)
    raw = bytearray(path.read_bytes())
    footer = len(raw) - 8 - int.from_bytes(raw[-8:-4], "little")
    group = pq.ParquetFile(path).metadata.row_group(0)
    for said in (group.column(2).total_uncompressed_size, group.total_byte_size):
        for at in [m.start() for m in re.finditer(re.escape(varint(said)), bytes(raw)) if m.start() > footer]:
            raw[at : at + 5] = varint(1000, 5)
    path.write_bytes(raw)


def varint(number, size=0):
    """Return a number as Thrift's compact protocol writes it, in so many bytes at least."""
    number *= 2
    out = bytearray()
    while number > 127 or len(out) < size - 1:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


# In a process of its own, whose memory pool has seen nothing else.
TAKEN = """
import sys
import pyarrow as pa
from pathlib import Path
from vsalog.readers import read
assert read(Path(sys.argv[1])).channel("x").values.tolist() == [1.0, 2.0]
print(pa.default_memory_pool().max_memory())
"""


def test_a_footer_that_lies_about_a_page(tmp_path):
    path = tmp_path / "log"
    lying(path)
    assert pq.ParquetFile(path).metadata.row_group(0).total_byte_size == 1000
    done = subprocess.run([sys.executable, "-c", TAKEN, str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert 0 < int(done.stdout) < 2**24


@pytest.mark.parametrize("rows", [100, 20_000])
def test_a_row_group_that_is_not_held_is_read_as_one_that_is(tmp_path, monkeypatch, rows):
    path = parquet(tmp_path, {name: pa.array(values) for name, values in columns(rows).items()}, row_group_size=15_000)
    whole = read(path)
    monkeypatch.setattr("vsalog.readers.parquet_rows.ParquetRows._table", lambda *_: None)
    apart = read(path)
    assert apart.findings == whole.findings == ()
    for name, channel in whole.channels.items():
        np.testing.assert_array_equal(apart.channel(name).values, channel.values)
        np.testing.assert_array_equal(apart.channel(name).stamps, channel.stamps)


def test_rows_that_nobody_has_are_refused(tmp_path):
    """A footer may count as many as it likes; none is made up."""
    path = parquet(tmp_path, {"time": pa.array([0.0, 1.0]), "x": pa.array([1.0, 2.0])}, store_schema=False)
    raw = path.read_bytes()
    at = len(raw) - 8 - int.from_bytes(raw[-8:-4], "little")
    counts = [k for k in range(at, len(raw) - 8) if raw[k : k + 2] == b"\x16\x04"]  # an integer of 64 bits, 2
    footer = raw[at:-8]
    for k in reversed(counts):
        footer = footer[: k - at + 1] + varint(2**40) + footer[k - at + 2 :]
    path.write_bytes(raw[:at] + footer + len(footer).to_bytes(4, "little") + b"PAR1")
    assert pq.ParquetFile(path).metadata.row_group(0).num_rows == 2**40
    with pytest.raises(ReadError, match="announces"):
        read(path)
