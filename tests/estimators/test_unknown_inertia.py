"""A motor whose inertia is not known: its torque is divided between inertia and spring, which noise and changes confuse."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from elastic_drive import INERTIA, elastic_drive, write_log

pytestmark = pytest.mark.share(2)

RIG = """
[joint.elbow]
kind = "elastic"
[joint.elbow.signals]
motor_position = "motor_position"
link_position = "link_position"
motor_torque = "motor_torque"
"""


def estimated(folder, log, more=""):
    """Return the trace, and the codes of all findings."""
    (folder / "rig.toml").write_text(RIG + more)
    done = vsalog_run("estimate", log, "--rig", "rig.toml", "-e", "smoother", "-o", "t.parquet", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    (joint,) = json.loads(done.stdout)["joints"]
    codes = {finding["code"] for finding in joint["findings"]}
    table = pq.read_table(folder / "t.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}, codes


@pytest.mark.parametrize("seed", [1, 4])
def test_a_spring_that_swings_is_told_from_inertia(tmp_path, seed):
    """Without a torque sensor, noise that takes up what is not explained yet hides both."""

    def part(time):
        return 1.0 + 0.1 * np.sin(0.2 * np.pi * time)

    log = write_log(tmp_path / "log.csv", elastic_drive(seconds=20.0, seed=seed, part=part), leave=("torque_sensor",))
    trace, codes = estimated(tmp_path, log)
    excited, true = trace["excited"], 100.0 * part(trace["time"])
    assert excited.mean() > 0.9
    assert np.nanmedian(np.abs(trace["stiffness"] / true - 1.0)[excited]) < 0.02
    assert np.nanmedian(trace["motor_inertia"]) == pytest.approx(INERTIA, rel=0.05)
    assert "stiffness.changed" in codes


def test_a_deflection_of_a_few_steps_gives_no_gain_and_no_delay(tmp_path):
    """The torque of a stiff spring is nearly proportional to the acceleration, which noise of the deflection would favour."""
    log = write_log(tmp_path / "log.csv", elastic_drive(stiffness=1000.0, seconds=30.0, seed=2))
    trace, codes = estimated(tmp_path, log, 'torque_sensor = "torque_sensor"\n')
    assert not codes & {"torque.gain_differs", "residual.follows_motion", "signal.late"}
    assert np.nanmedian(trace["stiffness"]) == pytest.approx(1000.0, rel=0.01)
    assert np.nanmedian(trace["motor_inertia"]) == pytest.approx(INERTIA, rel=0.02)
