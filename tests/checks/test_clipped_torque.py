"""A torque sensor that is clipped has no samples there: an estimate is neither made from them nor wrong by them."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.checks.sensor import without_clipped
from vsalog.core.signals import JointSignals

PERIOD, STIFFNESS = 0.004, 100.0
RIG = """
[joint.elbow]
kind = "elastic"
[joint.elbow.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "tau"
"""


def channels():
    """Return time and channels of a linear spring in closed form, whose torque sensor ends at 45 % of the largest torque."""
    draw, time = np.random.default_rng(3), np.arange(0.0, 20.0, PERIOD)
    deflection = 0.02 * np.sin(3.1 * time) + 0.015 * np.sin(7.9 * time + 1.0) + 0.01 * np.sin(1.3 * time + 2.0)
    torque = STIFFNESS * deflection + 0.02 * draw.standard_normal(time.size)
    limit = 0.45 * np.abs(torque).max()
    q = 0.3 * np.sin(2.0 * time)
    noise = 1e-5 * draw.standard_normal((2, time.size))
    return time, {"q": q + noise[0], "theta": q - deflection + noise[1], "tau": np.clip(torque, -limit, limit)}


def bound(time, **roles):
    count = time.size
    return JointSignals("j", PERIOD, (time * 1e9).astype(np.int64), time, roles, time == 0.0, np.zeros(count, np.int32))


def test_a_clipped_torque_is_missing_and_a_clipped_position_is_not():
    time, made = channels()
    theta = np.clip(made["theta"], -0.25, 0.25)
    signals = bound(time, torque_sensor=made["tau"], motor_torque=made["tau"], motor_position=theta)
    left = without_clipped(signals).roles
    there = np.abs(made["tau"]) == np.abs(made["tau"]).max()
    assert 0.3 < there.mean() < 0.7
    np.testing.assert_array_equal(left["torque_sensor"], np.where(there, np.nan, made["tau"]))
    assert left["motor_torque"] is signals.roles["motor_torque"]
    assert left["motor_position"] is theta


def test_signals_that_are_not_clipped_stay_as_they_are():
    time, _made = channels()
    signals = bound(time, torque_sensor=np.sin(time) + 1e-3 * np.random.default_rng(0).standard_normal(time.size))
    assert without_clipped(signals) is signals


@pytest.mark.parametrize("estimator", ["smoother", "direct"])
def test_a_spring_is_estimated_where_its_torque_is_not_clipped(tmp_path, estimator):
    time, made = channels()
    (tmp_path / "rig.toml").write_text(RIG)
    table = np.column_stack((time, *made.values()))
    np.savetxt(tmp_path / "log.csv", table, "%.9g", ",", header=",".join(("time", *made)), comments="")
    done = vsalog_run("estimate", "log.csv", "--rig", "rig.toml", "-e", estimator, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = {f["code"] for f in json.loads(done.stdout)["joints"][0]["findings"]}
    assert found & {"sensor.saturated", "sensor.clipped"}
    assert "spring.not_polynomial" not in found
    (trace,) = tmp_path.glob("*.parquet")
    columns = pq.read_table(trace).to_pydict()
    excited = np.array(columns["excited"])
    assert 0.3 < excited.mean() < 0.95
    off = np.array(columns["stiffness"])[excited] / STIFFNESS - 1.0
    assert np.sqrt(np.mean(off**2)) < 0.02
