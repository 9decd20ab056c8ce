"""Files and folders whose names have line ends, quotes, what means something in addresses, and bytes that are no text."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from rosbags import rosbag2
from scipy.io import savemat
from test_damage import write_mcap, write_rosbag1, write_rosbag2
from test_matlab_v73 import Matlab

from vsalog.readers import read
from vsalog.readers.sampling import cut_parquet, read_sample
from vsalog.writers.repair import repair

NAME = os.fsdecode(b"line\nend\xff\xfe %41?mode=rw#'\"&;$(touch x)\x1b[31m")
T = np.arange(400) * 1e-3


def table(path):
    path.write_text("time,x\n" + "".join(f"{t:.3f},{t:.3f}\n" for t in T))


def parquet(path):
    with path.open("wb") as file:
        pq.write_table(pa.table({"time": T, "x": T}), file, row_group_size=5)


def matlab(path):
    with path.open("wb") as file:
        savemat(file, {"time": T, "x": T})


def hdf5(path):
    moved(lambda plain: Matlab(plain).save({"time": T[None, :], "x": T[None, :]}), path)


def moved(write, path):
    """Write where the format's own library can, and give it the name then."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder, "log"))
        shutil.move(Path(folder, "log"), path)


def bag2(path):
    moved(lambda plain: write_rosbag2(plain, rosbag2.StoragePlugin.SQLITE3), path)


def bag1(path):
    moved(write_rosbag1, path)


def folder(path):
    path.mkdir()
    bag2(path / (NAME + "0.db3"))


FORMATS = {
    "csv": table, "parquet": parquet, "matlab": matlab, "matlab v7.3": hdf5, "mcap": write_mcap, "rosbag1": bag1,
    "rosbag2": bag2, "folder": folder,
}  # fmt: skip


@pytest.mark.parametrize("kind", FORMATS)
def test_a_log_of_any_name_in_a_folder_of_any_name(tmp_path, kind):
    path = tmp_path / NAME / NAME
    path.parent.mkdir()
    FORMATS[kind](path)
    recording = read(path)
    assert recording.channels
    assert not [one for one in recording.findings if one.part != "metadata.yaml"]
    assert read(path, start=0.0, end=0.02).channels
    repair(path, path.with_name(NAME + "new"))
    assert {p.name for p in path.parent.iterdir()} == {NAME, NAME + "new"}


def test_samples_of_logs_of_any_name(tmp_path, monkeypatch):
    source, target = tmp_path / "in" / NAME, tmp_path / (NAME + "part")
    source.parent.mkdir()
    parquet(source)
    assert cut_parquet(source, target, 1) is not None
    with target.open("rb") as file:
        assert 0 < pq.read_table(file).num_rows < T.size
    target.unlink()
    source.unlink()
    bag2(source)
    monkeypatch.setattr("vsalog.readers.sampling.LOOK_BYTES", 8000)
    recording, sample = read_sample(source)
    assert sample is not None
    assert recording.channels


def test_results_in_a_folder_of_any_name(tmp_path, samples):
    """The report is drawn of the trace that was written there, and the run is repeated from it."""
    out = tmp_path / NAME
    out.mkdir()
    log = samples / "sea_exp1.csv"
    done = vsalog_run("estimate", log, "-e", "direct", "-o", f"{out}/", "--report", out / NAME, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (trace,) = out.glob("*.parquet")
    done = vsalog_run("estimate", log, "--from", trace, "-o", "again.parquet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again.parquet").is_file()
