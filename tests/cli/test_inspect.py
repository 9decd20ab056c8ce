"""`vsalog inspect`: samples of large logs, first samples, and what is said of both."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from vsalog.cli import cli
from vsalog.readers import sampling

ROWS = 12_000


@pytest.fixture
def large(tmp_path, monkeypatch):
    """A table with one gap, large for the limits that are set here."""
    monkeypatch.setattr(sampling, "SAMPLE_BYTES", 40_000)
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


def test_of_a_large_log_a_sample_is_read_and_that_is_said(large):
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

    from vsalog.readers import read
    from vsalog.reports.inspect import print_report
    from vsalog.reports.inspect_data import inspect_recording
    from vsalog.rig.guess import guess_roles

    recording = read(path)
    console = Console(width=40, force_terminal=True, color_system=None)
    with console.capture() as capture:
        print_report(inspect_recording(recording, guess_roles(recording), head=2), console)
    assert all(len(line) <= 40 for line in capture.get().splitlines())
    assert "row 0" in capture.get()
    assert "another_rather_long_name  7.0" in capture.get()


def test_roles_have_reasons(large):
    assert "link_position (85 %): its name says" in inspect(large)


def test_what_is_not_at_an_address_is_said():
    done = CliRunner().invoke(cli, ["inspect", "memory://bucket/log.mcap"])
    assert "there is no such file" in str(done.exception or done.output)
