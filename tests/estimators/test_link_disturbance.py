"""What acts on a link next to what is known: friction and constant torques of known size, on a motion in closed form."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.estimators.link_disturbance import disturbance_of

INERTIA, DAMPING = 0.05, 0.1
TIME = np.arange(10_000) * 1e-3


def moving(friction=0.0, constant=0.0, seed=0):
    parts = ((1.0, 3.1, 0.0), (0.5, 7.7, 1.0), (0.2, 13.0, 2.0))
    rate = sum(a * w * np.cos(w * TIME + p) for a, w, p in parts)
    acceleration = -sum(a * w**2 * np.sin(w * TIME + p) for a, w, p in parts)
    noise = np.random.default_rng(seed).normal(0.0, 0.05, TIME.size)
    torque = INERTIA * acceleration + DAMPING * rate + friction * np.sign(rate) + constant + noise
    return torque, rate, acceleration


@pytest.mark.parametrize(("friction", "constant"), [(0.1, 0.0), (0.1, -0.2), (0.1, 0.2)])
def test_what_acts_is_found_with_its_size_and_what_it_costs(friction, constant):
    torque, rate, acceleration = moving(friction, constant)
    found = disturbance_of(torque, rate, acceleration, 51)
    # What is known to act is inertia, damping, friction and, with the other sign, what pushes unseen.
    assert (found.friction, found.torque) == pytest.approx((friction, -constant), rel=0.1)
    (finding,) = found.findings("arm")
    assert (finding.code, finding.value) == ("link.other_torque", found.moved.max())
    plain = np.linalg.lstsq(np.column_stack((acceleration, rate)), torque, rcond=None)[0]
    np.testing.assert_allclose(found.plain, plain, rtol=0.01)
    np.testing.assert_allclose(found.moved, np.abs(plain / [INERTIA, DAMPING] - 1.0), atol=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_of_a_link_that_is_one_nothing_is_reported(seed):
    found = disturbance_of(*moving(seed=seed), 51)
    assert found.findings("arm") == []
    assert not found.moved.any()
    np.testing.assert_allclose(found.plain, [INERTIA, DAMPING], rtol=0.02)


def test_what_costs_nothing_is_not_told():
    """A constant torque is separated from inertia and damping by any motion that swings."""
    assert disturbance_of(*moving(constant=-0.2), 51).findings("arm") == []


def test_too_little_is_no_reference():
    found = disturbance_of(*(x[:500] for x in moving(0.3)), 51)
    assert found.findings("arm") == []
    assert np.isnan(found.plain).all()


@pytest.mark.parametrize(("friction", "given"), [("0.02", True), ("0.1", False)])
def test_friction_of_the_link_is_reported_and_is_in_the_deviation(tmp_path, friction, given):
    change = f"joint.sea.link.friction.coulomb={friction} N*m"
    done = vsalog_run("simulate", "sea", "--duration", "10 s", "--actual", change, "-o", "log.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = vsalog_run("estimate", "log.mcap", "-e", "impedance", "-o", "t.parquet", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (found,) = (f for f in json.loads(done.stdout)["joints"][0]["findings"] if f["code"] == "link.other_torque")
    assert found["evidence"]["friction"] == pytest.approx(float(friction), rel=0.15)
    damping, std = (
        pq.read_table(tmp_path / "t.parquet")[name].to_numpy(zero_copy_only=False).astype(float)[-1]
        for name in ("link_damping", "link_damping_std")
    )
    assert (abs(damping - DAMPING) < 1.96 * std) if given else np.isnan(damping)
