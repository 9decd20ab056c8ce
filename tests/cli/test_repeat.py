"""`vsalog estimate --from`: a run repeated from its own result."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

pytestmark = pytest.mark.share(2)


@pytest.fixture
def folder(tmp_path, samples):
    shutil.copy(samples / "vsa2_exp1.mcap", tmp_path / "log.mcap")
    return tmp_path


def test_a_run_is_repeated_to_the_last_bit(run, folder):
    settings = ("--tune", "forgetting=0.99", "--set", "joint.vsa2.motor_1.inertia=7.5e-3", "-e", "qr-rls")
    assert run("estimate", "log.mcap", *settings).returncode == 0
    assert run("estimate", "--from", "log.stiffness.parquet", "-o", "again.parquet").returncode == 0
    first, again = (pq.read_table(folder / name) for name in ("log.stiffness.parquet", "again.parquet"))
    assert again.column_names == first.column_names
    for name in first.column_names:
        np.testing.assert_array_equal(again[name].to_numpy(), first[name].to_numpy())  # NaN is like NaN
    assert again.schema.metadata == first.schema.metadata


def test_what_cannot_be_repeated_is_reported(run, folder, samples):
    assert run("estimate", "log.mcap").returncode == 0
    (folder / "log.mcap").unlink()
    done = run("estimate", "--from", "log.stiffness.parquet")
    assert (done.returncode, "its log 'log.mcap' is neither here" in done.stderr) == (2, True)
    shutil.copy(samples / "vsa2_exp2.mcap", folder / "log.mcap")
    done = run("estimate", "--from", "log.stiffness.parquet")
    assert (done.returncode, "is not the log that" in done.stderr) == (2, True)
    done = run("estimate", samples / "vsa2_exp1.mcap", "--from", "log.stiffness.parquet", "-o", "again.parquet")
    assert done.returncode == 0
    done = run("estimate", "--from", "log.stiffness.parquet", "-e", "direct")
    assert (done.returncode, "as it was" in done.stderr) == (2, True)
    assert run("estimate").returncode == 2
    (folder / "no.parquet").write_bytes(b"PAR1")
    done = run("estimate", "--from", "no.parquet")
    assert (done.returncode, "no.parquet" in done.stderr) == (2, True)
