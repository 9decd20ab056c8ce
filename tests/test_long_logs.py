"""Logs that are too long for memory: the same numbers as in memory, and memory that does not grow with them."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import lagrange

from vsalog.binding import run
from vsalog.binding.grid import after_long_silence
from vsalog.binding.joint import bind
from vsalog.checks import signals as signal_checks
from vsalog.core import column as core_column
from vsalog.core import look
from vsalog.core.column import Column
from vsalog.core.errors import ReadError, WriteError
from vsalog.core.finding import Findings
from vsalog.core.resolution import STRETCHES
from vsalog.core.signals import JointSignals
from vsalog.estimation import job
from vsalog.estimation.job import Options, prepare
from vsalog.estimators.device import device_of
from vsalog.readers import read
from vsalog.readers import sample_order as ordering
from vsalog.readers.base import Block
from vsalog.readers.recording_from_blocks import collect
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs
from vsalog.rig import Rig

pytestmark = pytest.mark.share(3)

START, MS = 1_700_000_000_000_000_000, 1_000_000
RIG = """
[joint.j]
kind = "elastic"
[joint.j.motor]
inertia = 0.08
damping = 0.4
torque_gain = 1.1
torque_delay = "2 ms"
[joint.j.signals]
motor_position = { channel = "motor.position", unit = "deg", delay = "0.3 ms" }
link_position = { channel = "link.position", unit = "deg", offset = 0.2, drift = 1e-6 }
motor_torque = "motor.torque"
"""


@pytest.fixture
def small(monkeypatch):
    """Small pieces, so that short logs have many edges."""
    monkeypatch.setattr(core_column, "PART", 97)
    monkeypatch.setattr(run, "PART", 101)
    monkeypatch.setattr(job, "AT_ONCE_BYTES", 0)


def reader_of(blocks):
    """Return a reader of blocks: (stream, clocks, columns)."""

    def read_blocks(wanted):
        for stream, clocks, columns in blocks:
            yield Block(stream, "T", {k: np.asarray(v, np.int64) for k, v in clocks.items()}, columns)

    return SimpleNamespace(format="mcap", findings=Findings(), unread={}, rig_text=None, blocks=read_blocks)


def assert_same_recording(blocks, time="auto"):
    whole = collect(Path("x"), reader_of(blocks), None, time)
    long = collect(Path("x"), reader_of(blocks), None, time, 0)
    assert long.in_file
    assert not whole.in_file
    assert list(whole.channels) == list(long.channels)
    for found in (long, look.of_recording(long)):
        for name, channel in whole.channels.items():
            np.testing.assert_array_equal(found.channels[name].stamps, channel.stamps)
            np.testing.assert_array_equal(found.channels[name].values, channel.values)
    assert repr(long.streams) == repr(whole.streams)
    assert long.findings == whole.findings
    assert long.absolute_time == whole.absolute_time
    return long


@st.composite
def streams(draw):
    """Blocks of two streams with stamps out of order, copies, conflicts and clocks and columns that not all blocks have."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    late, coarse = draw(st.sampled_from([0, 3, 40])), draw(st.sampled_from([1, 4]))
    header, publish = draw(st.sampled_from(["good", "zero at the end", "none"])), draw(st.booleans())
    blocks = []
    for stream in ("a", "b"):
        at = 0
        for k in range(draw(st.integers(1, 6))):
            count = int(rng.integers(1, 120))
            at += count
            log = START + MS * (np.arange(at - count, at) // coarse)
            stamps = log - MS * rng.integers(0, late + 1, count)
            clocks = {"log": log}
            if header != "none":
                clocks["header"] = np.where((k > 2) & (header != "good"), 0, stamps)
            if publish:
                clocks["publish"] = log if k < 2 else log + 5
            columns = {f"{stream}.x": rng.integers(0, 2, count).astype(float)}
            if k:
                columns[f"{stream}.y"] = np.where(rng.random(count) < 0.3, np.nan, 1.0)
            blocks.append((stream, clocks, columns))
    return blocks


@given(streams(), st.sampled_from(["auto", "log", "publish", "header"]))
@settings(max_examples=80)
def test_columns_clocks_and_order_are_those_in_memory(blocks, time):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(core_column, "PART", 97)
        assert_same_recording(blocks, time)


def test_header_stamps_are_judged_over_all_of_a_stream(small):
    at = START + MS * np.arange(600)
    header = np.where(np.arange(600) % 10 == 5, 0, at)
    blocks = [
        ("a", {"log": at[i : i + 60], "header": header[i : i + 60]}, {"a.x": np.ones(60)}) for i in range(0, 600, 60)
    ]
    long = assert_same_recording(blocks)
    reason = long.streams["a"].time_finding
    assert (reason.code, reason.value, reason.evidence["stamps"]) == ("clock.stamps_zero", 60, 600)


@example([True] * 26 + [False] * 3, [3, 26])
@example([True] * 25 + [False] * 3, [25])
@given(
    st.lists(st.tuples(st.booleans(), st.integers(1, 30)), min_size=1, max_size=6).map(
        lambda pieces: [lacks for lacks, count in pieces for _ in range(count)]
    ),
    st.lists(st.integers(0, 60), max_size=6),
)
def test_a_silence_ends_where_it_ends_however_it_is_cut(missing, cuts):
    x = np.where(missing, np.nan, 1.0)
    expected = np.zeros(x.size, dtype=bool)
    for i in range(1, x.size):  # by the definition, one sample after the other
        before = next((k for k in range(i, 0, -1) if not np.isnan(x[k - 1])), 0)
        expected[i] = not np.isnan(x[i]) and i - before > 25
    found, silence = [], 0
    for part in np.split(x, sorted(cuts)):
        if part.size:
            starts, silence = after_long_silence({"x": part}, silence)
            found.append(starts)
    np.testing.assert_array_equal(np.concatenate(found), expected)


def test_samples_that_stand_alone_are_found_at_every_edge(small):
    rng = np.random.default_rng(1)
    t = np.arange(3000) * 1e-3
    x = np.sin(3.0 * t) + 1e-3 * rng.normal(size=t.size)
    wild = [0, 97, 193, 194, 485, 970, 971, 2999]
    x[wild] = 50.0
    x[289:293] = 30.0  # a push: four samples, two on either side of an edge
    blocks = [("motor", {"log": START + MS * np.arange(t.size)}, {"motor.position": x})]
    long = assert_same_recording(blocks)
    signals = Rig.from_toml('[joint.j]\nkind = "elastic"\n[joint.j.signals]\nmotor_position = "motor.position"')
    found = bind([long], "j", signals.joints["j"], ("motor_position",)).roles["motor_position"]
    assert np.flatnonzero(np.isnan(found)).tolist() == [0, 193, 194, 970, 971, 2999]
    for k in (97, 485):
        around = np.array([-2, -1, 1, 2])
        assert found[k] == pytest.approx(lagrange(around.astype(float), x[k + around])(0.0))


def test_samples_that_are_much_too_late_are_held_in_memory_and_reported(small, monkeypatch):
    monkeypatch.setattr(ordering, "MOST_WAITING", 100)
    x = np.arange(400.0)
    late = np.r_[np.arange(200, 400), np.arange(200)] * MS + START
    blocks = [("a", {"log": late[i : i + 100]}, {"a.x": x[i : i + 100]}) for i in range(0, 400, 100)]
    recording = collect(Path("x"), reader_of(blocks), None, "auto", 0)
    np.testing.assert_array_equal(recording.channels["a.x"].values, np.r_[x[200:], x[:200]])
    late = recording.findings[-1]
    assert (late.code, late.value) == ("recording.held_in_memory", pytest.approx(0.399))


@pytest.mark.parametrize("name", ["sea_exp2.bag", "sea_exp1.csv"])
def test_a_part_of_a_log_is_that_in_memory(samples, name):
    whole = read(samples / name, start="1", end="2.5")
    long = read(samples / name, start="1", end="2.5", room=0)
    assert long.in_file
    assert repr(long.streams) == repr(whole.streams)
    assert long.unread == whole.unread
    for channel, found in whole.channels.items():
        np.testing.assert_array_equal(long.channels[channel].stamps, found.stamps)
        np.testing.assert_array_equal(long.channels[channel].values, found.values)
    for limits in (("100", None), ("1.00001", "1.00002")):
        messages = []
        for room in (None, 0):
            with pytest.raises(ReadError) as refused:
                read(samples / name, None, "auto", None, *limits, room)
            messages.append(str(refused.value))
        assert messages[0] == messages[1]


def hard_log():
    """Return blocks of a log in which two encoders of different rate turn on and on, with a gap, a silence and wild samples."""
    rng = np.random.default_rng(3)
    t = np.delete(np.arange(6000) * 1e-3, np.s_[2500:2620])
    slow = np.delete(np.arange(1500) * 4e-3 + 5e-4, np.s_[900:910])
    deflection = 0.05 * np.sin(9.0 * t)
    motor = np.mod(np.rad2deg(6.0 * t + 0.3), 360.0)
    link = np.mod(np.rad2deg(6.0 * slow + 0.05 * np.sin(9.0 * slow)) - 40.0, 360.0)
    motor[[7, 1212, 4000]] = 0.0
    motor[3000:3040] = np.nan
    motor[4999] = np.nan
    torque = 20.0 * deflection + 0.02 * rng.normal(size=t.size)
    blocks = []
    for i in range(0, 6000, 300):
        stamps = START + np.round(t[i : i + 300] * 1e9).astype(np.int64)
        order = np.arange(stamps.size)
        order[5:9] = order[5:9][::-1]
        values = {"motor.position": motor[i : i + 300][order], "motor.torque": torque[i : i + 300][order]}
        if stamps.size:
            blocks.append(("motor", {"log": stamps[order]}, values))
        mine = (slow * 1000 >= i) & (slow * 1000 < i + 300)
        stamps = START + np.round(slow[mine] * 1e9).astype(np.int64)
        blocks.append(("link", {"log": stamps}, {"link.position": link[mine]}))
    return blocks


def assert_same_signals(whole, long):
    assert long.in_file
    assert not whole.in_file
    for name in ("period", "resolution", "findings", "run_names", "longest_run"):
        assert getattr(long, name) == getattr(whole, name), name
    for name in ("stamps", "time", "starts", "run"):
        np.testing.assert_array_equal(getattr(long, name), getattr(whole, name), err_msg=name)
    assert list(long.roles) == list(whole.roles)
    for role, values in whole.roles.items():
        np.testing.assert_array_equal(long.roles[role], values, err_msg=role)


@pytest.mark.parametrize("blocks", ["hard", "shifted"])
def test_bound_rows_are_those_of_the_whole_bit_for_bit(small, monkeypatch, blocks):
    rig = Rig.from_toml(RIG)
    made = hard_log()
    if blocks == "shifted":  # no grid of its own, and a motor that begins on another turn
        made = [(s, {"log": c["log"] + 7 * (np.arange(len(c["log"])) % 2) * 10_000}, v) for s, c, v in made]
    whole = collect(Path("x"), reader_of(made), None, "auto")
    long = assert_same_recording(made)
    roles = ("motor_position", "link_position", "motor_torque")
    bound = bind([long, whole], "j", rig.joints["j"], roles)
    monkeypatch.undo()  # all of the log is one part now
    expected = bind([whole, whole], "j", rig.joints["j"], roles)
    assert_same_signals(expected, bound)
    # What makes this log a hard one is there.
    link = expected.roles["link_position"]
    assert np.nanmax(link) - np.nanmin(link) > 4.0 * np.pi
    assert np.count_nonzero(expected.starts) >= 6
    codes = {finding.code for finding in expected.findings}
    assert codes >= {"recording.gaps", "recording.outliers", "recording.not_finite", "encoder.other_turn"}
    pieces = list(bound.blocks(83))
    np.testing.assert_array_equal(
        np.concatenate([p.roles["link_position"] for p in pieces]), bound.roles["link_position"]
    )


@pytest.mark.parametrize(
    ("names", "options"),
    [
        (["vsa2_exp1.mcap"], {}),
        (["sea_exp2.bag"], {"estimator": "batch-ls"}),
        (["awas_exp1.mcap", "awas_exp2.mcap"], {"start": "1", "end": "5"}),
    ],
)
def test_estimates_are_those_in_memory(monkeypatch, samples, names, options):
    logs = [samples / name for name in names]
    (expected,) = prepare(logs, Options(**options)).run()
    for module, name, value in ((core_column, "PART", 997), (run, "PART", 1013)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(job, "AT_ONCE_BYTES", 0)
    prepared = prepare(logs, Options(**options))
    assert prepared.is_long
    long = [one.log for one in prepared.findings if one.code == "recording.too_long_for_memory"]
    assert long == list(names)
    (found,) = prepared.run()
    assert repr(found.model) == repr(expected.model)
    assert repr(found.summary) == repr(expected.summary)
    assert found.findings == expected.findings
    assert found.settings == expected.settings
    np.testing.assert_array_equal(found.trace.time, expected.trace.time)
    for name, one in expected.trace.transmissions.items():
        for column, values in one.items():
            np.testing.assert_array_equal(found.trace[name][column], values)


def test_a_later_log_is_long_when_the_first_fills_the_memory(monkeypatch, samples):
    monkeypatch.setattr(job, "AT_ONCE_BYTES", 10**6)
    prepared = prepare([samples / "awas_exp2.mcap"] * 2, Options())
    assert [r.in_file for r in prepared.recordings] == [False, True]


def in_file(values):
    column = Column(values.dtype.type, in_file=True)
    column.append(values)
    return column.whole(values.size)


def in_files(starts, **roles):
    """Return signals of a joint at 1 kHz that lie in files."""
    rows = np.arange(starts.size)
    stamps, run = in_file(rows * MS), in_file(np.zeros(rows.size, np.int32))
    found = {role: in_file(values) for role, values in roles.items()}
    return JointSignals("j", 1e-3, stamps, in_file(rows * 1e-3), found, in_file(starts), run)


def test_a_look_has_the_whole_range_and_is_bounded(monkeypatch):
    monkeypatch.setattr(look, "STRETCH", 100)
    monkeypatch.setattr(look, "LONGEST_RUN", 200)
    rng = np.random.default_rng(0)
    q = 0.01 * rng.normal(size=100_000)
    theta = q + 0.01 * rng.normal(size=q.size)
    q[33_333], q[77_777], theta[51_234], theta[9_999] = 5.0, -5.0, -4.0, np.nan
    starts = np.zeros(q.size, dtype=bool)
    starts[[0, 10, 40_000, 41_000]] = True
    signals = in_files(starts, link_position=q, motor_position=theta)
    some = look.of_signals(signals)
    assert len(some) <= 100 * (STRETCHES + 3 + 6)
    for role, values in (("link_position", q), ("motor_position", theta)):
        assert np.nanmin(some.roles[role]) == np.nanmin(values)
        assert np.nanmax(some.roles[role]) == np.nanmax(values)
    phi = some.roles["link_position"] - some.roles["motor_position"]
    assert (np.nanmin(phi), np.nanmax(phi)) == (np.nanmin(q - theta), np.nanmax(q - theta))
    # Rows are those of the log, and a run begins wherever rows were left out.
    rows = some.stamps // MS
    np.testing.assert_array_equal(some.roles["link_position"], q[rows])
    np.testing.assert_array_equal(some.starts, starts[rows] | np.append(True, np.diff(rows) != 1))
    assert 41_000 in rows
    assert 41_199 in rows


def test_an_encoder_that_was_stuck_once_is_reported_wherever_that_was(monkeypatch):
    monkeypatch.setattr(signal_checks, "ENOUGH", 10_000)
    t = np.arange(100_000) * 1e-3
    q = np.round((np.sin(3.0 * t) + 0.05 * np.sin(7.0 * t)) / 1e-4) * 1e-4
    theta = np.round(np.sin(3.0 * t) / 1e-4) * 1e-4
    for begin in (62_000, 84_000):
        q[begin : begin + 900] = q[begin]
    signals = replace(
        in_files(t == 0.0, link_position=q, motor_position=theta),
        resolution={"link_position": 1e-4, "motor_position": 1e-4},
    )
    device = device_of("j", Rig.from_toml(RIG).joints["j"])
    (found,) = signal_checks.first_of_each(signal_checks.passing_findings(device, signals))
    assert (found.code, found.part) == ("encoder.stuck", "link_position")
    assert (found.evidence["begin"], found.evidence["end"]) == pytest.approx((62.0, 62.9), abs=2e-3)


def test_what_needs_the_whole_trace_in_memory_is_refused_at_once(monkeypatch, samples, tmp_path):
    monkeypatch.setattr(job, "AT_ONCE_BYTES", 0)
    prepared = prepare([samples / "sea_exp1.csv"], Options())
    outputs = Outputs(tmp_path / "a.parquet", tmp_path / "a.toml", mcap=tmp_path / "a.mcap")
    with pytest.raises(WriteError, match="--start and --end"):
        write_estimate(prepared, outputs)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_reported_with_what_to_do(monkeypatch, samples):
    monkeypatch.setattr(job, "AT_ONCE_BYTES", 0)

    class Full:
        def close(self):
            pass

        def write(self, data):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(core_column.tempfile, "TemporaryFile", lambda **_: Full())
    with pytest.raises(ReadError, match=r"No space left on device; set TMPDIR"):
        prepare([samples / "vsa2_exp1.mcap"], Options())


def test_figures_of_a_long_trace_are_drawn_of_a_part_of_its_rows(monkeypatch, samples, tmp_path):
    from vsalog.estimation import trace_evidence

    outputs = Outputs(tmp_path / "a.parquet", tmp_path / "a.toml", page=tmp_path / "a.html")
    prepared = prepare([samples / "vsa2_exp1.mcap"], Options())
    monkeypatch.setattr(trace_evidence, "AT_ONCE_BYTES", 3000 * 8 * 9)  # nine columns of eight bytes
    (estimate,) = write_estimate(prepared, outputs)
    every = trace_evidence.thinned(estimate)
    assert every == 7
    for transmission in ("1", "2"):
        whole = trace_evidence.TraceColumns(outputs.trace, estimate.joint).of(transmission, "stiffness")
        some = trace_evidence.TraceColumns(outputs.trace, estimate.joint, every).of(transmission, "stiffness")
        np.testing.assert_array_equal(some, whole[::every])
    assert "one sample in 7" in outputs.page.read_text(encoding="utf-8")


MEMORY = """
import json, resource, sys
from pathlib import Path
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
from vsalog.core import look
from vsalog.estimation import job
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs

job.AT_ONCE_BYTES = int(sys.argv[1])
# In proportion to logs of minutes instead of hours.
look.LOOK_BYTES, look.STRETCH = 2**20, 8192
rig = 'preset = "sea"\\n[joint.sea.signals]\\nmotor_position = "m"\\nlink_position = "l"\\nmotor_torque = "t"\\n'
peaks = []
for count in (300_000, 1_200_000):
    log = Path("log.parquet")
    with pq.ParquetWriter(log, pa.schema([("time", pa.float64()), *((c, pa.float64()) for c in "mlt")])) as writer:
        for first in range(0, count, 50_000):
            t = np.arange(first, first + 50_000) * 1e-3
            phi, q = 0.06 * np.sin(1.3 * t) + 0.02 * np.sin(8.0 * t), 0.5 * np.sin(1.3 * t)
            writer.write_table(pa.table({"time": t, "m": q - phi, "l": q, "t": -20.0 * phi - 2000.0 * phi**3}))
    prepared = job.prepare([log], job.Options(rig=job.Rig.from_toml(rig), estimator="residual-rls"))
    write_estimate(prepared, Outputs(Path("t.parquet"), Path("m.toml")))
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
print(json.dumps([prepared.is_long, peaks]))
"""


def grown(room, folder):
    """Return by how many bytes the peak of memory grows from a log to one four times as long, by 29 MB of columns."""
    pytest.importorskip("resource")
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(room)], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    is_long, (short, long) = json.loads(done.stdout)
    assert is_long == (room == 2**20)
    return long - short


def test_memory_does_not_grow_with_the_log(tmp_path):
    assert grown(2**20, tmp_path) < 35e6
