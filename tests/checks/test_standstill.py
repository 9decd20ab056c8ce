"""An encoder that stands still for a while: distinguished from a motor or a link that is held, by the torque."""

import json

import numpy as np
import pytest
from command_line import vsalog_run
from elastic_arm import RIG

pytestmark = pytest.mark.share(2)

PERIOD, COUNT, STIFFNESS, STEP = 2e-3, 10_000, 2.0, 1e-3
T = np.arange(COUNT) * PERIOD


def soft(held=None, seconds=(0.0, 0.0)):
    """Positions and their derivatives of a spring that gives way by as much as it moves; one of its ends is held for a while.

    Returns
    -------
    q, θ : shape (3, N): each with its rate and acceleration
    """

    def moved(*parts):
        return sum(a * np.array([np.sin(w * T), w * np.cos(w * T), -w * w * np.sin(w * T)]) for a, w in parts)

    middle, half = moved((0.5, 2.1), (0.3, 3.7)), 0.5 * moved((0.3, 2.9), (0.3, 5.3))
    ends = {"q": middle + half, "theta": middle - half}
    if held:
        # It comes to rest and leaves again by a smooth step of a tenth of a second.
        begin, end = seconds
        s = np.clip((T - begin) / 0.1, 0.0, 1.0) - np.clip((T - end + 0.1) / 0.1, 0.0, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        still = ends[held][0] * (1.0 - share) + ends[held][0][int(begin / PERIOD)] * share
        rate = np.gradient(still, PERIOD)
        ends[held] = np.array([still, rate, np.gradient(rate, PERIOD)])
    return ends["q"], ends["theta"]


def findings(folder, estimator, q, theta, stuck=None, seconds=(0.0, 0.0)):
    """Return the findings of an encoder that was stuck."""
    rng = np.random.default_rng(1)
    torque = STIFFNESS * (q[0] - theta[0])
    seen = {"q": STEP * np.round(q[0] / STEP), "theta": STEP * np.round(theta[0] / STEP)}
    if stuck:
        first, last = (int(s / PERIOD) for s in seconds)
        seen[stuck][first:last] = seen[stuck][first]
    motor = 0.05 * theta[2] + 0.3 * theta[1] - torque
    table = np.column_stack([T, seen["q"], seen["theta"], motor, torque])
    table[:, 3:] += 0.01 * rng.standard_normal((COUNT, 2))
    np.savetxt(folder / "arm.csv", table, delimiter=",", header="time,q,theta,tau,sensor", comments="")
    (folder / "arm.rig.toml").write_text(RIG)
    done = vsalog_run("estimate", "arm.csv", "-e", estimator, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    (joint,) = json.loads(done.stdout)["joints"]
    return [f for f in joint["findings"] if f["code"] == "encoder.stuck"]


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["residual-rls", "direct"])
@pytest.mark.parametrize(("name", "role"), [("q", "link_position"), ("theta", "motor_position")])
@pytest.mark.parametrize("seconds", [(12.0, 20.0), (6.0, 9.0)])
def test_an_encoder_of_a_soft_spring_that_is_stuck_once(tmp_path, estimator, name, role, seconds):
    (found,) = findings(tmp_path, estimator, *soft(), name, seconds)
    assert found["part"] == role
    assert found["value"] > found["limit"]
    assert (found["evidence"]["begin"], found["evidence"]["end"]) == pytest.approx(seconds, abs=0.03)


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["residual-rls", "direct"])
@pytest.mark.parametrize("held", ["q", "theta"])
@pytest.mark.parametrize("seconds", [(11.0, 19.0), (6.0, 9.0)])
def test_an_end_that_is_held_while_the_spring_gives_way(tmp_path, estimator, held, seconds):
    assert findings(tmp_path, estimator, *soft(held, seconds)) == []
