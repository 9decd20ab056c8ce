"""What a residual follows: a late encoder, a wrong inertia, damping nobody knows of; and nothing where nothing is wrong."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from command_line import vsalog_run

from vsalog.estimators.residual_motion import (
    ACCELERATION,
    POSITION,
    SPEED,
    followers,
    following,
    misfit,
    motion_rows_block,
    motion_rows_start,
)

pytestmark = pytest.mark.share(3)

PERIOD, STIFFNESS = 1e-3, 20.0
TIME = np.arange(20_000) * PERIOD


def motion():
    """A motor and a link that lags behind it, each a sum of sines, with their derivatives in closed form."""
    parts = ((0.5, 3.1, 0.0), (0.3, 7.7, 1.0), (0.1, 15.0, 2.0))
    theta = sum(a * np.sin(w * TIME + p) for a, w, p in parts)
    speed = sum(a * w * np.cos(w * TIME + p) for a, w, p in parts)
    acceleration = -sum(a * w**2 * np.sin(w * TIME + p) for a, w, p in parts)
    phi = sum(0.2 * a * np.sin(w * TIME + p - 0.7 * w / 3.1) for a, w, p in parts)
    return theta, speed, acceleration, phi


def look(phi, torque, speed, blocks=(TIME.size,), position=None, window=51):
    """The sums over a log of a linear spring, cut into blocks."""
    F, slopes, state = phi[:, None], np.ones((TIME.size, 1)), motion_rows_start(1)
    position = np.zeros(TIME.size) if position is None else position
    use, starts = np.ones(TIME.size, dtype=bool), np.arange(TIME.size) == 0
    for begin, end in pairwise((0, *blocks)):
        cut = slice(begin, end)
        state = motion_rows_block(
            state, F[cut], slopes[cut], torque[cut], (position[cut], speed[cut]), use[cut], starts[cut], window, PERIOD
        )
    return state


def noise(seed=0):
    return np.random.default_rng(seed).normal(0.0, 0.05, TIME.size)


def test_an_unknown_damping_and_an_unknown_inertia_are_found_with_their_size():
    _, speed, acceleration, phi = motion()
    for extra, suspect, size in ((speed, SPEED, 0.3), (acceleration, ACCELERATION, 0.05)):
        state = look(phi, STIFFNESS * phi + size * extra + noise(), speed)
        found = followers(state, 0.001, 0.0)
        assert found[0].suspect == suspect
        assert found[0].coefficient == pytest.approx(size, rel=0.02)
        assert found[0].stiffness == pytest.approx(STIFFNESS, rel=0.01)
        # What it says the stiffness moves by is what plain least squares was off by.
        plain = float(phi @ (STIFFNESS * phi + size * extra) / (phi @ phi))
        assert found[0].moved == pytest.approx(abs(plain / STIFFNESS - 1.0), rel=0.1)


def test_a_late_encoder_is_found_with_its_delay():
    theta, speed, _, phi = motion()
    late = 0.004
    q = np.interp(TIME - late, TIME, theta + phi)
    found = followers(look(q - theta, STIFFNESS * phi + noise(), speed), 0.001, 0.0)
    assert found[0].suspect == SPEED
    assert found[0].coefficient / found[0].stiffness == pytest.approx(late, rel=0.15)
    finding = following("a", "1", found[:1], None, 0.001)
    assert (finding.code, finding.value) == ("residual.follows_motion", found[0].moved)
    assert finding.evidence["signal"] == SPEED
    assert finding.evidence["speed_stiffness_change"] == found[0].moved
    assert "the link's encoder" in finding.evidence["explained_by"]
    assert "damping missing in the rig" in finding.evidence["explained_by"]


def test_what_is_an_unknown_of_the_equation_is_not_suspected():
    _, speed, acceleration, phi = motion()
    state = look(phi, STIFFNESS * phi + 0.3 * speed + 0.05 * acceleration + noise(), speed)
    assert followers(state, 0.001, 0.0) != []
    assert followers(state, 0.001, 0.0, (POSITION,)) == []


# Of a long window there are three averages of four, in which nothing can be told from anything.
@pytest.mark.parametrize(("part", "window"), [(0.03, 51), (1.0, 51), (1.0, TIME.size // 14)])
def test_a_wrong_gain_of_the_motor_s_encoder_is_found_with_its_size(part, window):
    theta, speed, _, phi = motion()
    # The encoder reads a part too far, so that the deflection comes out that much of the position smaller.
    read = (1.0 + part) * theta
    rows = look(phi - part * theta, STIFFNESS * phi + 0.1 * noise(), (1.0 + part) * speed, position=read, window=window)
    found = followers(rows, 0.001, 0.0)
    assert found[0].suspect == POSITION
    assert found[0].coefficient / found[0].stiffness == pytest.approx(part / (1.0 + part), rel=0.05)
    explained_by = following("a", "1", found, None, 0.001).evidence["explained_by"]
    assert f"the motor's encoder reading {part:.1%} too much" in explained_by


def test_nothing_is_reported_of_a_spring_that_is_one():
    _, speed, _, phi = motion()
    assert followers(look(phi, STIFFNESS * phi + noise(), speed), 0.0, 0.0) == []


COURSES = {
    "ramp": 1.0 - 0.3 * TIME / TIME[-1],
    "jump": np.where(TIME < 8.9, 1.0, 0.8),
    "two jumps": np.select([TIME < 6.1, TIME < 13.4], [1.0, 1.3], 0.9),
}


def carried(course):
    """A spring that carries a link's inertia: its torque follows the motor's acceleration, whatever its stiffness does."""
    _, speed, acceleration, _ = motion()
    torque = 0.05 * acceleration
    return torque / (STIFFNESS * course), torque + noise(), speed


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_a_spring_that_changes_leaves_a_residual_that_follows_no_motion(course):
    phi, torque, speed = carried(course)
    assert followers(look(phi, torque, speed), 0.001, 0.0) == []


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_a_damping_is_found_whatever_the_spring_does(course):
    _, speed, _, phi = motion()
    found = followers(look(phi, STIFFNESS * course * phi + 0.3 * speed + noise(), speed), 0.001, 0.0)
    assert [f.suspect for f in found] == [SPEED]
    assert found[0].coefficient == pytest.approx(0.3, rel=0.1)


def test_nothing_is_told_that_is_within_what_is_claimed_or_within_a_step():
    _, speed, _, phi = motion()
    state = look(phi, STIFFNESS * phi + 0.3 * speed + noise(), speed)
    (found,) = followers(state, 0.001, 0.0)
    assert followers(state, found.moved, 0.0) == []
    assert followers(state, 0.001, 1.0) == []


def test_noise_on_both_sides_is_not_taken_for_an_inertia():
    """A torque computed from a noisy acceleration, and that acceleration: they go together, but less in longer averages."""
    _, speed, _, phi = motion()
    noisy = speed + np.random.default_rng(1).normal(0.0, 0.02, TIME.size)
    jitter = np.convolve(noisy - speed, np.ones(51) / 51, mode="same")
    torque = STIFFNESS * phi + 0.5 * np.gradient(jitter, PERIOD) + noise()
    assert followers(look(phi, torque, speed + jitter), 0.0, 0.0) == []


def test_a_spring_that_is_no_spring_is_reported_and_noise_is_not():
    _, speed, _, phi = motion()
    cubic = STIFFNESS * phi + 400.0 * phi**3
    share = misfit(look(phi, cubic + noise(), speed), 0.0)
    plain = cubic - float(phi @ cubic / (phi @ phi)) * phi
    assert share == pytest.approx(np.std(plain) / np.std(cubic), rel=0.2)
    loud = 20.0 * noise(1)
    assert misfit(look(phi, STIFFNESS * phi + loud, speed), 0.0) is None
    # And not where an encoder's steps make as much.
    assert misfit(look(phi, cubic + noise(), speed), 1.0) is None


def test_blocks_of_any_size_and_gaps_give_the_same_sums():
    _, speed, _, phi = motion()
    torque = STIFFNESS * phi + noise()
    whole, parts = look(phi, torque, speed), look(phi, torque, speed, (7, 900, 901, 13_000, TIME.size))
    for a, b in zip((*whole.short, *whole.long), (*parts.short, *parts.long), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.fixture(scope="module")
def findings_of(tmp_path_factory):
    """Simulate a log, once for each machine; return what an estimator finds about it, by code."""
    folder, played = tmp_path_factory.mktemp("machines"), {}

    def find(estimator, preset, *actual):
        log = played.setdefault((preset, *actual), folder / f"{len(played)}.mcap")
        if not log.exists():
            machine = [x for change in actual for x in ("--actual", change)]
            done = vsalog_run(
                "simulate", preset, "--scenario", "multisine", "--duration", "10 s", *machine, "-o", log, cwd=folder
            )
            assert done.returncode == 0, done.stderr
        done = vsalog_run("estimate", log, "-e", estimator, "-o", "trace.parquet", "--force", "--json", cwd=folder)
        assert done.returncode == 0, done.stderr
        return {finding["code"]: finding for finding in json.loads(done.stdout)["joints"][0]["findings"]}

    return find


@pytest.mark.parametrize("estimator", ["direct", "residual-rls", "algebraic"])
def test_a_link_encoder_that_is_late_is_reported(findings_of, estimator):
    assert "residual.follows_motion" in findings_of(estimator, "awas", "joint.awas.signals.link_position.delay=2 ms")


@pytest.mark.parametrize(("gain", "told"), [("1e-9", True), ("1", False)])
def test_a_set_point_that_is_dead_is_named(findings_of, gain, told):
    """Findings do not change the exit code, which `findings_of` asserts to be 0."""
    found = findings_of("residual-rls", "awas", f"joint.awas.signals.setpoint.gain={gain}")
    assert ("setpoint.constant" in found) == told
    assert any(finding["severity"] == "invalidates" for finding in found.values()) == told


@pytest.mark.parametrize("estimator", ["residual-rls", "algebraic"])
def test_a_motor_heavier_than_its_rig_is_reported_with_its_inertia(findings_of, estimator):
    found = findings_of(estimator, "sea", "joint.sea.motor.inertia=0.1 kg*m^2")["residual.follows_motion"]
    assert 0.08 - found["evidence"]["acceleration_coefficient"] == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("estimator", ["direct", "residual-rls", "algebraic", "grioli-parametric"])
def test_a_machine_that_is_as_its_rig_says_is_not_accused(findings_of, estimator):
    assert not [code for code in findings_of(estimator, "sea") if code.startswith("residual.")]
