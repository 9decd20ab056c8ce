"""Values of `--tune` that are far off are refused in words, or told what they cost; what is left open follows the samples."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.signal import freqz

from vsalog.filters.savitzky_golay import savgol_cutoff, savgol_weights


@pytest.mark.parametrize(("window", "degree"), [(51, 5), (101, 5), (201, 4), (1601, 5), (101, 15)])
def test_the_cutoff_is_where_the_filter_has_lost_three_decibels(window, degree):
    value = savgol_weights(window, degree, 0)[0]
    _, response = freqz(value, worN=[savgol_cutoff(window, degree)])
    assert abs(response[0]) == pytest.approx(10 ** (-3 / 20), rel=0.02)


def settings(run, log, tmp_path, *asked):
    done = run("estimate", log, "-e", "residual-rls", *asked, "-o", tmp_path / "out.parquet", "--json")
    assert done.returncode == 0, done.stderr
    (joint,) = json.loads(done.stdout)["joints"]
    return joint


def test_the_residual_is_faster_than_the_filter_before_it(run, samples, tmp_path):
    log = samples / "vsa2_exp1.mcap"
    free = settings(run, log, tmp_path)["settings"]
    window = round(free["window"] / 1e-3) + 1
    assert free["bandwidth"] == pytest.approx(3.0 * savgol_cutoff(window, 5) / 1e-3)
    longer = settings(run, log, tmp_path, "--tune", "window=0.4")["settings"]
    assert longer["bandwidth"] < 0.6 * free["bandwidth"]


@pytest.mark.parametrize("value", ["1e-6", "1e6"])
def test_a_bandwidth_that_samples_cannot_follow_is_refused(run, samples, tmp_path, value):
    log = samples / "vsa2_exp1.mcap"
    done = run("estimate", log, "-e", "residual-rls", "--tune", f"bandwidth={value}", "-o", tmp_path / "out.parquet")
    assert done.returncode == 2
    assert "cannot follow a bandwidth" in done.stderr
    assert not (tmp_path / "out.parquet").exists()


@pytest.mark.parametrize(("estimator", "name"), [("impedance", "alpha"), ("grioli-bicchi", "window"), ("direct", "c")])
def test_infinity_is_no_value(run, samples, estimator, name):
    done = run("estimate", samples / "vsa2_exp1.mcap", "-e", estimator, "--tune", f"{name}=inf")
    assert done.returncode == 2
    assert f"--tune {name}" in done.stderr


@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls", "batch-ls"])
def test_a_window_longer_than_the_motion_is_told(run, samples, tmp_path, estimator):
    log, out = samples / "vsa2_exp1.mcap", tmp_path / "out.parquet"
    warned = run("estimate", log, "-e", estimator, "--tune", "window=2", "-o", out)
    assert warned.returncode == 0, warned.stderr
    assert "smooths the motion away" in " ".join((warned.stdout + warned.stderr).split())
    quiet = run("estimate", log, "-e", estimator, "--tune", "window=0.1", "-o", out)
    assert "smooths" not in quiet.stdout + quiet.stderr
    assert np.isfinite(pq.read_table(out)["stiffness"].to_numpy(zero_copy_only=False)).any()
