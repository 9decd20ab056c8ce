"""Values of `--tune` that are far off are refused in words, or told what they cost; what is left open follows the samples."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.signal import freqz

from vsalog.filters.savitzky_golay import savgol_cutoff, savgol_weights

pytestmark = pytest.mark.share(4)


@pytest.mark.parametrize(("window", "degree"), [(51, 5), (101, 5), (201, 4), (1601, 5), (101, 15)])
def test_the_cutoff_is_where_the_filter_has_lost_three_decibels(window, degree):
    value = savgol_weights(window, degree, 0)[0]
    _, response = freqz(value, worN=[savgol_cutoff(window, degree)])
    assert abs(response[0]) == pytest.approx(10 ** (-3 / 20), rel=0.02)


def settings(run, log, tmp_path, *asked, estimator="residual-rls"):
    done = run("estimate", log, "-e", estimator, *asked, "-o", tmp_path / "out.parquet", "--json")
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


@pytest.mark.parametrize("value", ["1e-6", "1048", "1e6", "1e308"])
def test_a_bandwidth_that_samples_cannot_follow_is_refused(run, samples, tmp_path, value):
    """At 1 kHz a third of half the sample rate is π/3 · 1000 = 1047.2 rad/s."""
    log = samples / "vsa2_exp1.mcap"
    done = run("estimate", log, "-e", "residual-rls", "--tune", f"bandwidth={value}", "-o", tmp_path / "out.parquet")
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert "cannot follow a bandwidth" in done.stderr
    assert not (tmp_path / "out.parquet").exists()


def test_a_bandwidth_just_below_a_third_of_half_the_rate_is_taken(run, samples, tmp_path):
    joint = settings(run, samples / "vsa2_exp1.mcap", tmp_path, "--tune", "bandwidth=1047")
    assert joint["settings"]["bandwidth"] == 1047.0


@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls", "direct", "impedance", "grioli-bicchi"])
@pytest.mark.parametrize("value", ["1e308", "1e5"])
def test_a_window_longer_than_any_log_is_refused_in_one_line(run, samples, tmp_path, estimator, value):
    log = samples / ("sea_exp1.csv" if estimator in ("direct", "impedance") else "vsa2_exp1.mcap")
    done = run("estimate", log, "-e", estimator, "--tune", f"window={value}", "-o", tmp_path / "out.parquet")
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert "window" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("estimator", "name"), [("impedance", "alpha"), ("grioli-bicchi", "window"), ("direct", "c")])
def test_infinity_is_no_value(run, samples, estimator, name):
    done = run("estimate", samples / "vsa2_exp1.mcap", "-e", estimator, "--tune", f"{name}=inf")
    assert done.returncode == 2
    assert f"--tune {name}" in done.stderr


@pytest.mark.every(3)
@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls", "batch-ls"])
def test_a_window_longer_than_the_motion_is_reported(run, samples, tmp_path, estimator):
    log, out = samples / "vsa2_exp1.mcap", tmp_path / "out.parquet"
    warned = run("estimate", log, "-e", estimator, "--tune", "window=2", "-o", out, "--json")
    assert warned.returncode == 0, warned.stderr
    assert "filter.smooths_motion" in warned.stdout
    quiet = run("estimate", log, "-e", estimator, "--tune", "window=0.1", "-o", out, "--json")
    assert quiet.returncode == 0, quiet.stderr
    assert "filter.smooths_motion" not in quiet.stdout
    assert np.isfinite(pq.read_table(out)["stiffness"].to_numpy(zero_copy_only=False)).any()


@pytest.mark.parametrize(
    ("estimator", "asked", "words"),
    [
        ("residual-rls", "p0=abc", "--tune p0=abc: has to be a number above 0"),
        ("residual-rls", "degree=31", "--tune degree=31: has to be a whole number at least 1 and at most 30"),
        ("residual-rls", "c=2", "a number above 0 and at most 1"),
        ("residual-rls", "matched=7", "true or false"),
        ("direct", "filter=foo", "one of: "),
        ("impedance", "filter=kinematic", "--tune rates come from"),
    ],
)
def test_what_a_value_has_to_be_is_reported_in_words(run, samples, estimator, asked, words):
    done = run("estimate", samples / "vsa2_exp1.mcap", "-e", estimator, "--tune", asked)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())


@pytest.mark.parametrize("role", ["motor position", "torque sensor"])
def test_samples_that_are_missing_are_not_blamed_on_the_motion(run, samples, tmp_path, role):
    """Six in ten samples of one signal are no number, side by side: those that are left are too few for any window."""
    header, *lines = (samples / "sea_exp1.csv").read_text().splitlines()
    column = next(i for i, name in enumerate(header.split(",")) if name.startswith(role))
    rows = [line.split(",") for line in lines]
    for i, row in enumerate(rows):
        if i % 10 < 6:
            row[column] = "nan"
    (tmp_path / "log.csv").write_text("\n".join([header, *map(",".join, rows)]) + "\n")
    joint = settings(run, tmp_path / "log.csv", tmp_path, "--rig", samples / "sea_exp1.rig.toml", estimator="direct")
    found = {finding["code"]: finding["value"] for finding in joint["findings"]}
    assert found == {"recording.not_finite": 6001.0, "estimate.torn": 0.0}


@pytest.mark.every(2)
@pytest.mark.parametrize(("estimator", "log"), [("impedance", "sea_exp1.csv"), ("grioli-bicchi", "vsa2_exp1.mcap")])
def test_a_gain_without_a_memory_supports_no_noise(run, samples, tmp_path, estimator, log):
    """What is excited all the same is as far from the rest's median as its band says."""
    out = tmp_path / "out.parquet"
    done = run("estimate", samples / log, "-e", estimator, "--tune", "alpha=1e30", "-o", out)
    assert done.returncode == 0, done.stderr
    usual = run("estimate", samples / log, "-e", estimator, "-o", tmp_path / "usual.parquet")
    assert usual.returncode == 0, usual.stderr
    shares = []
    for path in (out, tmp_path / "usual.parquet"):
        table = pq.read_table(path)
        shares.append(
            np.mean(
                [
                    e
                    for e, t in zip(*(table[c].to_pylist() for c in ("excited", "transmission")), strict=True)
                    if t == "total"
                ]
            )
        )
    assert shares[0] < 0.5 * shares[1]
