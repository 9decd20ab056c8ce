"""A PI controller of two muscles: what it computes, where it ends, and that it knows no more than it is reported."""

import numpy as np
import pytest

from vsalog.core.errors import SimulationError
from vsalog.estimation.live import LiveEstimate
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

SCENARIO = """
duration = "8 s"
period = "5 ms"
[joint.pam.pi_control]
of = "link_position"
feedback = "FEEDBACK"
proportional = 5.45
integral = 6.0
bias = "5.5 V"
[[joint.pam.pi_control.reference]]
type = "steps"
times = ["0.5 s"]
values = ["10 deg"]
"""


def played(feedback, text=SCENARIO, duration=8.0, **options):
    rig = Rig.preset("pam")
    scenario = Scenario.from_toml(text.replace("FEEDBACK", feedback))
    controllers = scenario.controllers(rig.file)
    return simulate(
        rig.file,
        {},
        duration,
        period=5e-3,
        controllers=controllers,
        estimator=LiveEstimate,
        believed=rig.file,
        **options,
    )


def test_the_valves_are_opened_as_the_sum_says():
    """The voltages of a whole run, from what the encoder said, by the textbook's sum."""
    done = played("sensor", duration=3.0)
    angle = done.measured["link_position"]
    error = np.where(done.time >= 0.5, np.radians(10.0), 0.0) - angle
    u = 5.45 * error + 6.0 * np.cumsum(error) * 5e-3
    for role, sign in (("valve_1", 1.0), ("valve_2", -1.0)):
        assert done.measured[role][0] == 5.5
        np.testing.assert_allclose(done.measured[role][1:], 5.5 + sign * u[:-1], atol=1e-9)


@pytest.mark.parametrize("feedback", ["sensor", "pam-ukf"])
def test_the_angle_comes_to_its_reference(feedback):
    """Shin 2021 §IV-C: a steady error of 5.25 % of 40° at most."""
    done = played(feedback)
    angle = np.degrees(done.truth["link_position"])
    assert np.abs(angle[done.time > 7.0] - 10.0).max() < 0.0525 * 40.0
    assert np.abs(angle[done.time < 0.5]).max() < 1.0


def test_a_clamped_joint_comes_to_its_torque():
    """A steady error of 5 % of 4 N·m at most."""
    rig = Rig.preset("pam").with_settings({"joint.pam.seesaw.held_at": "0 deg"})
    text = SCENARIO.replace("link_position", "torque_sensor").replace("10 deg", "1 N·m").replace("FEEDBACK", "pam-ukf")
    controllers = Scenario.from_toml(text).controllers(rig.file)
    done = simulate(rig.file, {}, 5.0, period=5e-3, controllers=controllers, estimator=LiveEstimate)
    late = done.time > 4.0
    assert np.abs(done.truth["transmission_torque"][late] - 1.0).max() < 0.05 * 4.0


def test_a_valve_at_its_end_does_not_wind_the_integral_up():
    """A reference that cannot be reached, and then one that can."""
    text = SCENARIO.replace('times = ["0.5 s"]', 'times = ["0.5 s", "4 s"]').replace(
        '["10 deg"]', '["80 deg", "0 deg"]'
    )
    done = played("sensor", text)
    assert done.truth["valve_1"].max() == pytest.approx(10.0)
    # What was summed up is no more than the valve could do: it turns round at once.
    assert done.truth["valve_1"][done.time > 4.02].max() < 8.0


def test_it_is_refused_for_other_joints():
    scenario = Scenario.from_toml(SCENARIO.replace("FEEDBACK", "sensor").replace("joint.pam", "joint.sea"))
    with pytest.raises(SimulationError, match="valve_1"):
        scenario.controllers(Rig.preset("sea").file)
