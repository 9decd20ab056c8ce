"""Ctrl-C at any moment of a run, two runs into one place: what lies there is whole, of one run, and nothing is left over.

Only some moments are tried; ``VSALOG_MOMENTS=1000`` tries so many of the lines that are executed while results are written.
"""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from knee import lay

from vsalog.core.model import ModelFile

MOMENTS = int(os.environ.get("VSALOG_MOMENTS", "4"))
COMMAND = [sys.executable, "-c", "from vsalog.cli import main; main()"]


@pytest.fixture(autouse=True)
def interruptible():
    """A shell that runs tests in the background has Ctrl-C ignored, and all they start inherits that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Interrupted:
    """Sends this process a Ctrl-C when so many lines of the writers were executed; counts them otherwise."""

    def __init__(self, at=None):
        self.at, self.count = at, 0

    def __enter__(self):
        self.before = sys.gettrace()
        sys.settrace(self._call)
        return self

    def __exit__(self, *_):
        sys.settrace(self.before)

    def _call(self, frame, event, _):
        # Where the group puts signals off a line is as good as another.
        return self._line if "/vsalog/writers/" in frame.f_code.co_filename else None

    def _line(self, frame, event, _):
        if event == "line":
            self.count += 1
            if self.count == self.at:
                signal.raise_signal(signal.SIGINT)
        return self._line


RUNS = {
    "estimate": (["estimate", "log.csv", "-e", "direct", "-o", "out/", "--report", "out/page.html"], 3),
    "validate": (["validate", "log.model.toml", "log.csv", "--no-modalities", "-o", "out"], 2),
    "repair": (["inspect", "log.csv", "--repair", "out/log.mcap"], 1),
    "simulate": (["simulate", "sea", "--duration", "0.2", "-o", "out/log.csv"], 2),
    "init": (["init", "log.csv", "-o", "out/rig.toml"], 1),
}
MAKE_FOLDERS = ("estimate", "validate")


@pytest.mark.parametrize("name", RUNS)
def test_an_interrupt_while_results_are_written(name, tmp_path, command):
    """All of them are there or none is, whatever the moment."""
    args, files = RUNS[name]
    lay(tmp_path, rows=300)
    if name == "validate":
        assert command("estimate", "log.csv", "-e", "direct", cwd=tmp_path)[0] == 0
    before = set(tmp_path.rglob("*"))
    moments, outcomes = None, set()
    at = None
    while moments is None or at <= moments:
        if name not in MAKE_FOLDERS:
            (tmp_path / "out").mkdir()
        with Interrupted(at) as interrupted:
            code, _, err = command(*args, cwd=tmp_path)
        found = sorted(set(tmp_path.rglob("*")) - before)
        written = [path for path in found if path.is_file()]
        assert len(written) in (0, files), (at, found)
        assert len(found) == len(written) + (1 if name not in MAKE_FOLDERS or written else 0), (at, found)
        assert not [p for p in found if p.name.startswith(".")], (at, found)
        if at is None:
            assert (code, len(written)) == (0, files), err
            moments = interrupted.count
        else:
            reached = interrupted.count >= at  # the first run imports what later ones have
            assert code == (130 if reached else 0), (at, code, err)
            assert not reached or err.splitlines()[-1] == "vsalog: interrupted; no file is half written"
            assert "Traceback" not in err
            outcomes.add((code, len(written)))
        for path in found[::-1]:
            path.rmdir() if path.is_dir() else path.unlink()
        step = max(1, moments // MOMENTS)
        at = 1 if at is None else at + step
    assert (130, 0) in outcomes


@pytest.mark.parametrize("name", ["estimate", "simulate"])
def test_an_interrupt_between_one_file_and_the_next(name, tmp_path, monkeypatch, command):
    """It waits until all are there."""
    args, files = RUNS[name]
    lay(tmp_path, rows=300)
    (tmp_path / "out").mkdir()

    def interrupted(path, target, replace=Path.replace):
        replace(path, target)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Path, "replace", interrupted)
    code, _, err = command(*args, cwd=tmp_path)
    assert code == 130, err
    assert len(list((tmp_path / "out").iterdir())) == files
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_at_any_other_moment(number, tmp_path):
    """As a user presses it: while libraries are imported, the log is read, the joint is estimated."""
    lay(tmp_path, rows=60_000)
    before = set(tmp_path.rglob("*"))
    for moment in (0.2, 1.2) if number == signal.SIGINT else (0.8,):
        process = subprocess.Popen([*COMMAND, "estimate", "log.csv"], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
        time.sleep(moment)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
        assert process.returncode in (0, 130, 143, -signal.SIGINT, -signal.SIGTERM), err
        left = {p.name for p in set(tmp_path.rglob("*")) - before}
        assert left in (set(), {"log.stiffness.parquet", "log.model.toml"}), left
        if process.returncode > 0:
            assert "Traceback" not in err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_where_nothing_can_be_raised(number, code):
    """As in the callbacks of the locks of an import: the command ends nevertheless, without a traceback."""
    program = """
import signal, sys, time, weakref
import vsalog.cli
def command(**_):
    class Lock: pass
    lock = Lock()
    seen = weakref.ref(lock, lambda _: signal.raise_signal(int(sys.argv[1])))
    del lock
    time.sleep(20)
vsalog.cli.cli = command
vsalog.cli.main()
"""
    done = subprocess.run([sys.executable, "-c", program, str(int(number))], capture_output=True, text=True, timeout=15)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_two_runs_into_one_place(tmp_path):
    """Each replaces the other's files as a whole: what is there in the end is one run's trace, and one run's model."""
    folders = []
    for i, stiffness in enumerate((20.0, 90.0)):
        folders.append(tmp_path / f"in{i}")
        folders[i].mkdir()
        lay(folders[i], stiffness=stiffness)
    out = tmp_path / "out"
    out.mkdir()
    args = ("estimate", "log.csv", "-e", "direct", "-o", out)
    with ThreadPoolExecutor(2) as pool:
        for run in pool.map(lambda folder: vsalog_run(*args, cwd=folder), folders):
            assert run.returncode == 0, run.stderr
    assert sorted(p.name for p in out.iterdir()) == ["log.model.toml", "log.stiffness.parquet"]
    told = pq.read_table(out / "log.stiffness.parquet")["stiffness"].to_numpy()
    assert min(abs(np.nanmedian(told) - k) for k in (20.0, 90.0)) < 1.0
    ModelFile.load(out / "log.model.toml")
