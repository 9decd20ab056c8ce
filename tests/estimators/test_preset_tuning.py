"""`--preset-tuning paper`: the values that a method's paper prints, and what is tuned on top of them."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from vsalog.cli import _run

# Flacco 2012 §6.1 and §6.2.
CAUSAL = ("filter=kinematic", "shape=6", "settle=0", "bandwidth=300", "matched=false")
PRINTED = {"vsa2": (*CAUSAL, "p0=1e6", "c=1e-5"), "awas": (*CAUSAL, "p0=1e20", "c=1e-20")}


@pytest.fixture
def vsalog(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)

    def vsalog(*args):
        monkeypatch.setattr("sys.argv", ["vsalog", *args])
        code = _run()
        return code, *capsys.readouterr()

    return vsalog


def stiffness(path):
    return np.asarray(pq.read_table(path, columns=["stiffness"])["stiffness"])


@pytest.mark.parametrize("preset", PRINTED)
def test_it_is_what_the_paper_prints(vsalog, preset):
    assert vsalog("simulate", preset, "--duration", "3 s", "-o", "log.parquet")[0] == 0
    assert (
        vsalog("estimate", "log.parquet", "-e", "residual-rls", "--preset-tuning", "paper", "-o", "a.parquet")[0] == 0
    )
    tuned = [text for value in PRINTED[preset] for text in ("--tune", value)]
    assert vsalog("estimate", "log.parquet", "-e", "residual-rls", *tuned, "-o", "b.parquet")[0] == 0
    np.testing.assert_array_equal(stiffness("a.parquet"), stiffness("b.parquet"))
    assert vsalog("estimate", "log.parquet", "-e", "residual-rls", "-o", "c.parquet")[0] == 0
    assert not np.array_equal(stiffness("a.parquet"), stiffness("c.parquet"), equal_nan=True)


def test_what_is_tuned_goes_on_top_and_a_run_repeats_itself(vsalog):
    assert vsalog("simulate", "vsa2", "--duration", "3 s", "-o", "log.parquet")[0] == 0
    asked = ("estimate", "log.parquet", "-e", "residual-rls", "--preset-tuning", "paper", "--tune", "bandwidth=100")
    code, out, _ = vsalog(*asked, "-o", "a.parquet", "--json")
    assert code == 0
    (joint,) = json.loads(out)["joints"]
    assert joint["settings"]["bandwidth"] == 100.0
    assert joint["settings"]["matched"] is False
    assert vsalog("estimate", "--from", "a.parquet", "-o", "b.parquet")[0] == 0
    np.testing.assert_array_equal(stiffness("a.parquet"), stiffness("b.parquet"))


def test_a_method_without_printed_values_refuses_it_and_compare_knows_it(vsalog):
    assert vsalog("simulate", "vsa2", "--duration", "3 s", "-o", "log.parquet")[0] == 0
    code, _, err = vsalog("estimate", "log.parquet", "-e", "direct", "--preset-tuning", "paper")
    assert code == 2
    assert "direct: no paper prints values of its tuning" in err
    code, out, err = vsalog("compare", "log.parquet", "-e", "residual-rls:preset=paper,residual-rls", "--json")
    assert code == 0, err
    rows = json.loads(out)["rows"]
    first, second = (
        next(r for r in rows if r["estimator"] == e) for e in ("residual-rls:preset=paper", "residual-rls")
    )
    assert first["relative_std"] != second["relative_std"]
    code, _, err = vsalog("compare", "log.parquet", "-e", "residual-rls:preset=mine")
    assert code == 2
    assert "'mine'" in err


def test_the_ukf_takes_the_printed_covariances(vsalog):
    """Shin §V prints sensors of 10 kPa and an angle that wanders by √1e-5 rad a sample: the estimate is that uncertain."""
    assert vsalog("simulate", "pam", "--duration", "6 s", "-o", "log.parquet")[0] == 0
    assert vsalog("estimate", "log.parquet", "--preset-tuning", "paper", "-o", "a.parquet")[0] == 0
    assert vsalog("estimate", "log.parquet", "-o", "b.parquet")[0] == 0
    told = [pq.read_table(f"{name}.parquet").to_pandas() for name in "ab"]
    # Pressures of Q = (1 kPa)² a sample and R = (10 kPa)² leave what a scalar Kalman filter in the steady state does.
    q, r = 1e3**2, 1e4**2
    steady = np.sqrt(0.5 * (-q + np.sqrt(q * q + 4 * q * r)))
    assert np.median(told[0]["pressure_1_std"]) == pytest.approx(steady, rel=0.2)
    assert np.median(told[1]["pressure_1_std"]) < 0.1 * steady
    assert np.median(told[0]["link_position_std"]) > np.median(told[1]["link_position_std"])


def test_the_observer_takes_the_printed_differences_and_gain(vsalog):
    """Serio eq. 13 and 15, by the print's Euler steps, at the gain of the experiment (§IV-C): α = 8."""
    assert vsalog("simulate", "sea", "-o", "log.parquet")[0] == 0
    code, out, err = vsalog(
        "estimate", "log.parquet", "-e", "impedance", "--preset-tuning", "paper", "-o", "a.parquet", "--json"
    )
    assert code == 0, err
    (joint,) = json.loads(out)["joints"]
    assert joint["settings"]["alpha"] == 8.0
    assert joint["settings"]["derivative"] == "difference"
    log = pq.read_table("log.parquet").to_pandas()
    phi = (log["/joint_states.position[link]"] - log["/joint_states.position[motor]"]).to_numpy()
    moved, risen = np.diff(phi), np.diff(log["/joint_torque.effort[transmission]"].to_numpy())
    K = np.zeros(phi.size)
    for k in range(1, phi.size):  # dividing by T_c and multiplying with it cancel
        K[k] = K[k - 1] + 8.0 * (risen[k - 1] - K[k - 1] * moved[k - 1]) * np.sign(moved[k - 1])
    trace = pq.read_table("a.parquet").to_pandas()
    ours = trace[trace["transmission"] == "total"]["stiffness"].to_numpy()
    # The start at zero, which ours takes out, is forgotten by then; exact and Euler's steps differ by half of α |Δφ|.
    late = slice(phi.size // 2, None)
    assert np.max(np.abs(moved)) < 0.005
    np.testing.assert_allclose(ours[late], K[late], rtol=0.02)
