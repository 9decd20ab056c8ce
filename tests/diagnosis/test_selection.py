"""Which causes: none in clean logs, the hidden one where there is one, both where there are two; nothing that does not matter."""

import numpy as np
import pytest
from written_out import ELASTIC, ROLES, Truth, channels, drive, elastic, joint_of, sensed, signals

from vsalog.diagnosis.channels import channels_of
from vsalog.diagnosis.found import MATERIAL
from vsalog.diagnosis.kinds import balance_for
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.selection import blocks_of, select
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.system import build_system


def selected(found, hold=0.5, joint=None):
    joint, thin = joint or joint_of(), found.thinned()
    system = build_system(joint, thin, balance_for(joint), hold * found.period)
    return select(system, joint, setting_of(joint, system), frozenset(), {})


def named(selection):
    """Return the causes that matter."""
    return [choice.site.cause for choice in selection.choices if choice.size >= MATERIAL]


def values_of(selection, cause):
    return next(v for s, v in selection.posterior.fit if s.cause == cause)


def left_over(selection, joint):
    return float(np.sum(selection.system.whitened(joint) ** 2))


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_found_in_a_clean_log(seed):
    """Its torque is smooth, not held from sample to sample: that must not look like a delay either."""
    assert named(selected(channels(seed=seed, duration=8.0))) == []


HIDDEN = {
    "motor.viscous_friction": (Truth(damping=0.07), {"damping": 0.07}),
    "motor.inertia": (Truth(inertia=0.0215), {"inertia": 0.0215}),
    "transmission.stiffness": (Truth(stiffness=13.2, cubic=165.0), {"factor": 1.1}),
    "transmission.nonlinearity": (Truth(cubic=250.0), {"cubic": 100.0}),
    "transmission.asymmetry": (Truth(extra=lambda t, a, phi: 0.06 * abs(12 * phi + 150 * phi**3)), {"asymmetry": 0.06}),
    "transmission.stiffness_drift": (
        Truth(extra=lambda t, a, phi: 0.01 * t * (12 * phi + 150 * phi**3)),
        {"rate": 0.01},
    ),
    "link.inertia": (Truth(link_inertia=0.032), {"inertia": 0.032}),
    "link.gravity": (Truth(gravity=1.6), {"torque": 1.6}),
    "link.viscous_friction": (Truth(link_damping=0.035), {"damping": 0.035}),
    "link.contact": (Truth(push=(4.0, 0.3, 0.5)), {"start": 4.0, "duration": 0.3, "torque": 0.5}),
    "sensor.torque_gain": (Truth(gain=1.05), {"gain": 1.05}),
    "sensor.torque_offset": (Truth(offset=0.04), {"offset": 0.04}),
    "sensor.torque_delay": (Truth(delay=3e-3), {"delay": 3e-3}),
}


@pytest.mark.parametrize("cause", HIDDEN)
def test_the_hidden_cause_is_found_alone_and_with_its_size(cause):
    truth, expected = HIDDEN[cause]
    selection = selected(channels(truth, duration=8.0, seed=2))
    assert named(selection) == [cause]
    choice = next(c for c in selection.choices if c.site.cause == cause)
    told = choice.site.reported(values_of(selection, cause).tolist())
    for name, value in expected.items():
        assert told[name][0] == pytest.approx(value, rel=0.05), name
    assert choice.odds > np.log(9.0)
    extended = placed(joint_of(), selection.posterior.fit)
    assert left_over(selection, extended) < 1.3 * selection.system.count
    assert left_over(selection, extended) < left_over(selection, joint_of())


def test_dry_friction_is_found_though_it_is_smoothed_at_rest():
    """The test's own friction is a steep hyperbolic tangent."""
    selection = selected(channels(Truth(coulomb=0.05), duration=8.0, seed=2))
    assert named(selection) == ["motor.coulomb_friction"]
    assert values_of(selection, "motor.coulomb_friction")[0] == pytest.approx(0.05, rel=0.05)


def test_two_causes_are_both_found():
    truth = Truth(damping=0.08, stiffness=13.2, cubic=165.0)
    selection = selected(channels(truth, duration=8.0, seed=4))
    assert set(named(selection)) == {"motor.viscous_friction", "transmission.stiffness"}
    assert values_of(selection, "motor.viscous_friction")[0] == pytest.approx(0.08, rel=0.05)
    assert values_of(selection, "transmission.stiffness")[0] == pytest.approx(1.1, rel=0.02)


def test_without_a_torque_sensor_the_cause_is_first_or_among_those_that_fit_alike():
    roles = [r for r in ROLES if r != "torque_sensor"]
    selection = selected(channels(Truth(link_inertia=0.033), duration=8.0, seed=2, roles=roles))
    told = {c.site.cause for c in selection.choices} | {r.site.cause for c in selection.choices for r in c.rivals}
    assert "link.inertia" in told


def test_an_effect_far_below_the_noise_is_not_named():
    assert named(selected(channels(Truth(damping=0.0501), duration=8.0, seed=5))) == []


def test_what_no_cause_has_is_not_named_with_confidence():
    """A magnetic detent of the motor at one angle."""
    truth = Truth(extra=lambda t, a, phi: 0.15 * np.exp(-(((a - 0.3) / 0.05) ** 2)))
    selection = selected(channels(truth, duration=8.0, seed=6))
    extended = placed(joint_of(), selection.posterior.fit)
    assert left_over(selection, extended) > 0.2 * left_over(selection, joint_of())


def test_blocks_are_stretches_of_time_of_a_second_at_least():
    for duration, expected in ((4.0, 8), (12.0, 11), (40.0, 24)):
        found = channels(duration=duration, seed=1).thinned()
        system = build_system(joint_of(), found, balance_for(joint_of()))
        blocks = blocks_of(system)
        assert blocks.size == system.centres.size
        assert np.all(np.diff(blocks) >= 0)
        sizes = np.bincount(blocks)
        assert sizes.size == pytest.approx(expected, abs=1)
        assert np.ptp(sizes) <= 2


@pytest.mark.parametrize("late", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_torques_that_are_held_and_such_that_are_not_are_told_apart_where_that_is_little(late, seed):
    """A motor that is damped much takes a torque of half a sample's delay for inertia: D θ̇ changes by D T/2 θ̈, here 15 % of B.

    What is held acts half a sample later, so the log's drive does.
    """
    heavy, period, drawn = Truth(damping=3.0), 2e-3, drive(seed)
    time = np.arange(4000) * period
    moved = elastic(time, heavy, lambda t: 3.0 * drawn(t - late * period))
    moved["motor_torque"][0] = 3.0 * drawn(time)
    found = channels_of(signals(sensed(moved, time, heavy, seed, loud=16.0), period))
    selection = selected(found, joint=joint_of(ELASTIC.replace("damping = 0.05", "damping = 3.0")))
    assert named(selection) == []
    assert (selection.system.hold > 0.0) == (late > 0.0)


def test_a_cause_that_is_driven_as_far_as_it_may_go_is_not_taken():
    """A torque sensor that shows a thousandth of the torque is no matter of its gain."""
    assert named(selected(channels(Truth(gain=0.001), duration=8.0, seed=4))) != ["sensor.torque_gain"]
