"""An encoder that reads unevenly round its turn: found where the stiffness is off by it, and even ones are left alone."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from elastic_arm import RIG

pytestmark = pytest.mark.share(3)

PERIOD, COUNT, STIFFNESS = 2e-3, 10_000, 60.0
SHAPE, FOLLOWS = "residual.shape_over_position", "residual.follows_motion"


def log(folder, seed=0, link=lambda q: q, cogging=lambda theta: 0.0 * theta, offset=0.0):
    """A linear spring between a link that swings and its motor; `link` is what the link's encoder makes of its angle."""
    t, rng = np.arange(COUNT) * PERIOD, np.random.default_rng(seed)

    def swings(*parts):
        """Sum of sines, with its first two derivatives."""
        return [sum(a * w**n * np.sin(w * t + seed + n * np.pi / 2.0) for a, w in parts) for n in range(3)]

    q, theta = swings((0.8, 1.3), (0.5, 3.7)), swings((0.79, 1.3), (0.52, 3.7), (0.01, 7.1))
    torque = STIFFNESS * (q[0] - theta[0])
    step = 2.0 * np.pi / 36_000
    columns = (
        t,
        step * np.round(link(q[0]) / step),
        step * np.round(theta[0] / step),
        0.05 * theta[2] + 0.3 * theta[1] - torque + cogging(theta[0]) + 0.01 * rng.standard_normal(COUNT),
        torque + offset + 0.02 * rng.standard_normal(COUNT),
    )
    np.savetxt(folder / "arm.csv", np.column_stack(columns), "%.9g", ",", header="time,q,theta,tau,sensor", comments="")
    (folder / "arm.rig.toml").write_text(RIG)


def estimated(folder, estimator):
    """Return of how much of what is excited the stiffness is off by 5 % and three deviations, and the findings by code."""
    done = vsalog_run("estimate", "arm.csv", "-e", estimator, "-o", "arm.parquet", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    trace = pq.read_table(folder / "arm.parquet").to_pandas()
    trace = trace[trace["excited"] & (trace["transmission"] == "1")]
    off = np.abs(trace["stiffness"] - STIFFNESS)
    found = {finding["code"]: finding for finding in json.loads(done.stdout)["joints"][0]["findings"]}
    return np.mean((off > 0.05 * STIFFNESS) & (off > 3.0 * trace["stiffness_std"])), found


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["residual-rls", "direct", "algebraic"])
@pytest.mark.parametrize(("most", "times"), [(5e-3, 3), (5e-3, 7)])
def test_a_link_encoder_that_errs_several_times_a_turn_is_found(tmp_path, estimator, most, times):
    log(tmp_path, link=lambda q: q + most * np.sin(times * q))
    wrong, found = estimated(tmp_path, estimator)
    # Else there would be nothing to find.
    assert wrong > 0.01
    # Where the motion happens to be alike it is the motor's acceleration that it is taken for.
    assert SHAPE in found or FOLLOWS in found


def test_it_is_a_shape_over_a_position(tmp_path):
    log(tmp_path, link=lambda q: q + 5e-3 * np.sin(7.0 * q))
    shape = estimated(tmp_path, "direct")[1][SHAPE]
    assert shape["evidence"]["position"] in ("link_position", "motor_position")
    assert shape["value"] > shape["limit"]


def test_an_offset_of_the_torque_sensor_is_reported_as_one(tmp_path):
    log(tmp_path, offset=0.4)
    found = estimated(tmp_path, "smoother")[1]
    assert found["fit.offset"]["value"] == pytest.approx(0.4, rel=0.02)
    assert not {SHAPE, FOLLOWS, "residual.shape_over_deflection", "residual.not_noise"} & set(found)


def test_a_motor_that_cogs_is_found_by_the_method_that_reads_its_torque(tmp_path):
    log(tmp_path, cogging=lambda theta: 0.3 * np.sin(6.0 * theta))
    assert SHAPE in estimated(tmp_path, "residual-rls")[1]
    assert SHAPE not in estimated(tmp_path, "direct")[1]


@pytest.mark.every(5)
@pytest.mark.parametrize(
    "estimator", ["residual-rls", "direct", "algebraic", "grioli-parametric", "qr-rls", "batch-ls"]
)
@pytest.mark.parametrize("seed", range(3))
def test_an_even_encoder_is_left_alone(tmp_path, estimator, seed):
    log(tmp_path, seed)
    wrong, found = estimated(tmp_path, estimator)
    assert wrong < 0.01
    assert not any("shape_over" in code for code in found)
