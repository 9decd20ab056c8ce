"""`vsalog inspect`: samples of large logs, first samples, and what is reported of both."""

from __future__ import annotations

import gzip
import json
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec import structs

from vsalog.cli import cli
from vsalog.core.errors import WriteError
from vsalog.core.finding import Finding
from vsalog.core.progress import Advanced, watched
from vsalog.inspection.run import Options
from vsalog.inspection.run import inspect as run
from vsalog.readers import sampling
from vsalog.readers.tables.reader import TableReader
from vsalog.report.document import Verdict
from vsalog.report.inspect import inspection_document, seconds
from vsalog.report.verbosity import Verbosity, ask

ROWS = 12_000


@pytest.fixture
def large(tmp_path, monkeypatch):
    """A table with one gap, large for the limits that are set here."""
    monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * 40_000)
    path = tmp_path / "log.csv"
    values = np.random.default_rng(1).standard_normal(ROWS)
    # The gap of 0.1 s is within the first stretch.
    rows = [f"{i / 1000 + (0.1 if i > 50 else 0):.3f},{v!r},{i % 7}\n" for i, v in enumerate(values.tolist())]
    path.write_text("time [s],link position [rad],motor position [rad]\n" + "".join(rows))
    return path


def inspect(*arguments):
    done = CliRunner().invoke(cli, ["inspect", *map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_page_has_a_figure_of_each_guessed_joint(large):
    page = large.with_name("page.html")
    for _ in range(2):  # a page of the same log is replaced
        inspect(large, "--report", page)
    text = page.read_text()
    assert text.count('class="plot"') == 1
    assert "link_position: link position" in text
    page.write_text("mine")
    for kept in (large, page):
        refused = CliRunner().invoke(cli, ["inspect", str(large), "--report", str(kept)])
        assert isinstance(refused.exception, WriteError)
    assert page.read_text() == "mine"


def test_of_a_large_log_a_sample_is_read_and_that_is_reported(large):
    text = inspect(large)
    assert re.search(r"a sample was read, 0.0\d+ MB of 0.3\d+ MB: 8 stretches", text)
    assert "--full" in text
    sampled, whole = (json.loads(inspect(large, "--json", *more))["logs"][0] for more in ((), ("--full",)))
    assert whole["sample"] is None
    assert sampled["sample"]["of"] == large.stat().st_size
    assert sampled["sample"]["size"] == pytest.approx(40_000, rel=0.05)
    assert sampled["duration"] == pytest.approx(whole["duration"]) == pytest.approx(ROWS / 1000 + 0.1 - 0.001)
    ours, all_of_it = sampled["streams"][0], whole["streams"][0]
    assert (all_of_it["count"], all_of_it["total"]) == (ROWS, ROWS)
    assert ours["count"] < ROWS / 4
    assert ours["total"] is None
    assert ours["rate"] == all_of_it["rate"] == 1000.0
    for stream in (ours, all_of_it):  # where stretches meet is no gap
        assert (stream["gaps"], stream["longest_gap"]) == (1, pytest.approx(0.101))
    noise = [stream["channels"][0]["noise"] for stream in (ours, all_of_it)]
    assert noise[0] == pytest.approx(noise[1], rel=0.1)
    assert "a sample" not in inspect(large, "--full")


def test_first_samples_are_exact(large):
    document = json.loads(inspect(large, "--json", "--head", 3))
    (head,) = document["logs"][0]["head"]
    lines = [line.split(",") for line in large.read_text().splitlines()[1:4]]
    assert head["stamps"] == [0, 1_000_000, 2_000_000]
    assert head["channels"] == ["link position", "motor position"]
    assert head["rows"] == [[float(cell) for cell in line[1:]] for line in lines]
    text = inspect(large, "--head", 3)
    for line in lines:
        assert f"{float(line[1])!r}" in text
        assert f"{float(line[0]):.6f}" in text
    assert json.loads(inspect(large, "--json"))["logs"][0]["head"] == []


def test_first_samples_on_a_narrow_terminal_and_without_a_time(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("a_rather_long_name,another_rather_long_name\n" + "1.5,nan\n2.5,7\n" * 3)
    head = json.loads(inspect(path, "--json", "--head", 2))["logs"][0]["head"][0]
    assert head["rows"] == [[1.5, None], [2.5, 7.0]]
    from rich.console import Console

    from vsalog.inspection.document import Inspection
    from vsalog.inspection.run import inspect_recording
    from vsalog.readers import read
    from vsalog.report.inspect import inspection_document
    from vsalog.report.terminal import print_document
    from vsalog.rig.guess import guess_roles

    recording = read(path)
    console = Console(width=40, force_terminal=True, color_system=None)
    with console.capture() as capture:
        print_document(
            inspection_document(Inspection((inspect_recording(recording, guess_roles(recording), head=2),))), console
        )
    assert all(len(line) <= 40 for line in capture.get().splitlines())
    said = [line.split() for line in capture.get().splitlines()]
    assert ["row", "0", "1"] in said
    assert ["another_rather_long_name", "–", "7.0"] in said


def test_roles_have_reasons(large):
    assert "link_position (85 %): a joint's or link's position by its name" in inspect(large)


def test_what_is_not_at_an_address_is_reported():
    done = CliRunner().invoke(cli, ["inspect", "memory://bucket/log.mcap"])
    assert "there is no such file" in str(done.exception or done.output)


def test_without_a_time_samples_are_counted(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("a,b\n" + "".join(f"{i},{i * i % 7}\n" for i in range(500)))
    text = inspect(path)
    assert text.splitlines()[0].endswith("csv, 500 samples, 1 stream, 2 channels")
    assert text.count("has no time column") == 1
    report = json.loads(inspect(path, "--json"))["logs"][0]
    assert report["duration"] is None
    assert [one["code"] for one in report["findings"]] == ["clock.missing"]
    assert report["notes"] == report["warnings"]


@pytest.mark.parametrize(
    ("duration", "words"),
    [
        (0.25, "250 ms"),
        (0.9997, "1000 ms"),
        (90.5, "90.5 s"),
        (5400, "90 min"),
        (86_400, "24 h"),
        (131_400, "36.5 h"),
        (864_000, "10 d"),
        (200_000_000, "2315 d"),
    ],
)
def test_durations_have_the_unit_that_reads_best(duration, words):
    assert seconds(duration) == words


@pytest.mark.parametrize(("late", "words"), [(1, "1 sample came out of order."), (2, "2 samples came out of order.")])
def test_one_sample_is_singular(tmp_path, late, words):
    times = [*range(60)]
    for i in range(late):
        times[5 * i + 2], times[5 * i + 3] = times[5 * i + 3], times[5 * i + 2]
    path = tmp_path / "log.csv"
    path.write_text("time [s],x\n" + "".join(f"{t},{t}\n" for t in times))
    assert words in inspect(path)


def test_of_changed_bytes_it_is_reported_before_the_values(tmp_path):
    """One byte in a stored block of gzip: everything is read, one number is another, and only the checksum knows."""
    rows = "time [s],x\n" + "".join(f"{i / 100:.2f},{i % 7}\n" for i in range(300))
    raw = bytearray(gzip.compress(rows.encode(), compresslevel=0))
    path = tmp_path / "log.csv.gz"
    path.write_bytes(raw)
    assert "wrong" not in inspect(path)
    raw[raw.index(b"0.50,1") + 5] ^= 8  # 1 becomes 9
    path.write_bytes(raw)
    lines = inspect(path).splitlines()
    assert "0 … 9" in "".join(lines)
    said = [i for i, line in enumerate(lines) if "checksum" in line]
    assert said == [1]
    assert lines[1].startswith("warning: ")
    assert any(line.startswith("log.csv") and line.endswith(", values may be wrong") for line in lines[2:])


def test_an_empty_compressed_file_is_empty(tmp_path):
    path = tmp_path / "log.csv.gz"
    for raw, words in (
        (gzip.compress(b""), "is empty"),
        (gzip.compress(b"")[:-3], "damaged"),
        (b"\x1f\x8b\x08", "damaged"),
    ):
        path.write_bytes(raw)
        done = CliRunner().invoke(cli, ["inspect", str(path)])
        assert done.exit_code != 0
        assert words in str(done.exception or done.output)


def test_dates_of_a_large_log_are_computed_from_the_sample(tmp_path, monkeypatch):
    """Its first rows are of 4 March or 3 April; a stretch from the end tells, and the large log itself is not read for it."""
    monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * 40_000)
    begin = datetime(2024, 4, 3, 23, 50)
    rows = [begin + i * timedelta(minutes=2) for i in range(ROWS)]
    path = tmp_path / "log.csv"
    path.write_text("time,x\n" + "".join(f"{m.day}/{m.month}/{m:%Y %H:%M},{i}\n" for i, m in enumerate(rows)))
    read = []
    monkeypatch.setattr(TableReader, "_whole", lambda self, columns: read.append(self.path) or ())
    (log,) = json.loads(inspect(path, "--json"))["logs"]
    assert path not in read
    assert log["sample"]["stretches"] == 8
    assert log["duration"] == pytest.approx(120 * (ROWS - 1))
    assert log["streams"][0]["start"] == int(begin.replace(tzinfo=UTC).timestamp()) * 10**9


def test_reading_tells_how_far_it_is():
    """What a bar shows."""
    path = Path(__file__).parents[2] / "sample_logs" / "vsa2_exp2.mcap"
    heard = []
    with watched(heard.append):
        inspect(path)
    shares = [event.share for event in heard if isinstance(event, Advanced) and event.step == "reading"]
    assert len(shares) > 1
    assert shares[-1] == 1.0


def test_what_several_joints_have_alike_is_reported_once(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],x\n0,1\n1,2\n2,3\n")
    found = tuple(
        Finding(code="signal.sign", joint=joint, part="torque_sensor", evidence={"left": left})
        for joint, left in (("hip", 0.01), ("knee", 0.02))
    )
    look = run([path], Options())
    look = structs.replace(look, logs=(structs.replace(look.logs[0], findings=found),))

    def verdicts():
        (section,) = inspection_document(look).items
        return [item for item in section.items if isinstance(item, Verdict)]

    (folded,) = verdicts()
    assert all(f"'{finding.joint}'" in folded.word for finding in found)
    ask(Verbosity.VERBOSE)
    try:
        assert len(verdicts()) == 2
    finally:
        ask(Verbosity.NORMAL)
