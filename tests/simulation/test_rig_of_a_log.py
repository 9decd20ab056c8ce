"""The rig that a simulated log carries names no channel that the log does not have."""

import json

import pytest

PUSH = """
[joint.sea]
external_torque = [{ type = "sine", amplitude = 3, frequency = 0.8 }, { type = "sine", amplitude = 3, frequency = 2.1 }]
motor_position = [{ type = "sine", amplitude = 0.25, frequency = 1.1 }]
"""


@pytest.mark.parametrize("log", ["log.mcap", "log.csv"])
def test_a_motor_that_is_moved_as_prescribed_has_no_torque_in_it(run, tmp_path, log):
    (tmp_path / "push.toml").write_text(PUSH)
    done = run("simulate", "sea", "--scenario", "push.toml", "--duration", "4 s", "-o", log)
    assert done.returncode == 0, done.stderr
    done = run("estimate", log, "--json")
    assert done.returncode == 0, done.stderr
    (joint,) = json.loads(done.stdout)["joints"]
    assert joint["estimator"] == "smoother"
    assert "motor_torque in the rig" in joint["reason"]
