"""Which causes: none in clean logs, the hidden one where there is one, both where there are two; nothing that is not worth it."""

import numpy as np
import pytest
from written_out import ELASTIC, ROLES, Truth, channels, drive, elastic, joint_of, log, sensed, signals

from vsalog.diagnosis.linear import formed_of, placed
from vsalog.diagnosis.selection import _exchanged, _settled, blocks_of, nothing_found, select, sites_in, sites_of
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

pytestmark = pytest.mark.share(5)


def system_of(found, joint, hold=0.5):
    thin = found.thinned()
    return build_system(joint, thin, balance_for(joint), hold * found.period)


def selected(found, joint=None, barred=frozenset()):
    joint = joint or joint_of()
    system = system_of(found, joint)
    return select(system, joint, setting_of(joint, system), barred, {})


def named(selection):
    return [choice.site.cause for choice in selection.choices]


def material(selection):
    return [choice.site.cause for choice in selection.choices if choice.size >= 1.0]


def told(selection, cause):
    """Name → value of the only cause of that name."""
    (values,) = [(site, values) for site, values in selection.posterior.fit if site.cause == cause]
    return {name: value for name, (value, _) in values[0].reported(values[1].tolist()).items()}


def squares(selection, joint=None):
    """Mean square of the equations over their noise, with what was found."""
    system = selection.system
    there = placed(joint or joint_of(), selection.posterior.fit)
    return float(np.sum(system.whitened(there) ** 2)) / system.count


@pytest.mark.every(2)
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


@pytest.mark.every(3)
@pytest.mark.parametrize("cause", HIDDEN)
def test_the_hidden_cause_is_found_alone_and_with_its_size(cause):
    truth, expected = HIDDEN[cause]
    selection = selected(channels(truth, duration=8.0, seed=2))
    assert material(selection) == [cause]
    for name, value in expected.items():
        assert told(selection, cause)[name] == pytest.approx(value, rel=0.05), name
    (choice,) = [c for c in selection.choices if c.site.cause == cause]
    assert choice.odds > np.log(9.0)
    # Noise is measured on the same log: the equations close to within a third of it.
    assert squares(selection) < 1.3
    bare = selection.system.whitened(joint_of())
    assert squares(selection) * selection.system.count < np.sum(bare**2)


def test_dry_friction_is_found_though_it_is_smoothed_at_rest():
    """The test's own friction is a steep hyperbolic tangent."""
    selection = selected(channels(Truth(coulomb=0.05), duration=8.0, seed=2))
    assert material(selection) == ["motor.coulomb_friction"]
    assert told(selection, "motor.coulomb_friction")["torque"] == pytest.approx(0.05, rel=0.05)


def test_two_causes_are_both_found():
    truth = Truth(damping=0.08, stiffness=13.2, cubic=165.0)
    selection = selected(channels(truth, duration=8.0, seed=4))
    assert set(material(selection)) == {"motor.viscous_friction", "transmission.stiffness"}
    assert told(selection, "motor.viscous_friction")["damping"] == pytest.approx(0.08, rel=0.05)
    assert told(selection, "transmission.stiffness")["factor"] == pytest.approx(1.1, rel=0.02)


def test_without_a_torque_sensor_the_cause_is_first_or_among_those_that_fit_alike():
    roles = [r for r in ROLES if r != "torque_sensor"]
    selection = selected(channels(Truth(link_inertia=0.033), duration=8.0, seed=2, roles=roles))
    assert selection.choices
    largest = max(selection.choices, key=lambda c: c.size)
    assert "link.inertia" in [largest.site.cause, *(r.cause for r in largest.rivals)]
    # What is listed is a whole set that really fits about as well: by the deviance under the same weights.

    def deviance(fit):
        return selection.weights.deviance(formed_of(selection.weights.system, joint_of(), fit))

    best = deviance(selection.posterior.fit)
    for choice in selection.choices:
        for rival in choice.rivals:
            assert rival in [site for site, _ in choice.instead]
            assert deviance(choice.instead) < 1.5 * best


def test_of_two_late_encoders_a_late_drive_is_one_next_to_a_late_encoder():
    """No torque sensor says which of three clocks is right: all three delays are one class."""
    time, said = log(duration=8.0, seed=3, roles=[r for r in ROLES if r != "torque_sensor"])
    for role, samples in (("motor_position", 2), ("link_position", 4)):
        said[role] = np.concatenate([np.full(samples, said[role][0]), said[role][:-samples]])
    selection = selected(channels_of(signals(said, time[1] - time[0])))
    delays = {c.site.key: c for c in selection.choices if "delay" in c.site.cause or "clock" in c.site.cause}
    every = {("motor.torque_delay", "motor"), *(("sensor.clock_skew", f"{end}_position") for end in ("motor", "link"))}
    assert len(delays) == 2
    for choice in delays.values():
        assert set(delays) | {r.key for r in choice.rivals} == every
        assert choice.odds < np.log(2.0)
        # One of two, or fewer; without any of the three the log is improbable.
        assert choice.probability <= 0.5
        assert choice.class_odds > np.log(20.0)


def test_an_effect_far_below_the_noise_is_not_named():
    assert named(selected(channels(Truth(damping=0.0501), duration=8.0, seed=5))) == []


def test_what_no_cause_has_is_not_explained():
    """A magnetic detent of the motor at one angle: whatever is found leaves most of it, and it is in the weights."""
    truth = Truth(extra=lambda t, a, phi: 0.15 * np.exp(-(((a - 0.3) / 0.05) ** 2)))
    selection = selected(channels(truth, duration=8.0, seed=6))
    bare = float(np.sum(selection.system.whitened(joint_of()) ** 2)) / selection.system.count
    assert squares(selection) > 0.2 * bare
    assert np.max(np.diag(selection.weights.inflation)) > 4.0


def test_a_search_that_is_cut_short_says_that_it_did_not_settle(monkeypatch):
    """Each round begins where the last one ended: the first one, from nothing, finds a cause that it did not begin with."""
    found = selected(channels(HIDDEN["motor.inertia"][0]))
    assert found.settled
    arguments = found.problem, found.stage, sites_in(found.stage), found.blocks
    assert _settled(*arguments, found.posterior)[2]
    monkeypatch.setattr("vsalog.diagnosis.selection.ITERATIONS", 1)
    assert not _settled(*arguments)[2]


def test_a_barred_cause_is_not_named():
    found = channels(Truth(damping=0.07), duration=8.0, seed=2)
    selection = selected(found, barred=frozenset({"motor.viscous_friction"}))
    assert "motor.viscous_friction" not in named(selection)


def test_blocks_are_stretches_of_time_of_a_second_at_least():
    for duration, expected in ((4.0, 8), (12.0, 11), (40.0, 24)):
        system = system_of(channels(duration=duration, seed=1), joint_of())
        blocks = blocks_of(system)
        assert blocks.shape == system.centres.shape
        assert np.all(np.diff(blocks) >= 0)
        sizes = np.bincount(blocks)
        assert sizes.size == pytest.approx(expected, abs=1)
        assert np.ptp(sizes) <= 2


def test_where_nothing_is_looked_for_nothing_is_found():
    joint = joint_of()
    system = system_of(channels(seed=1, duration=8.0), joint)
    selection = nothing_found(system, joint, setting_of(joint, system))
    assert selection.choices == ()
    assert selection.posterior.fit == ()
    assert selection.blocks.shape == system.centres.shape


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("seed", "late"),
    [(0, 0.0), (0, 0.5), (1, 0.0), (1, 0.5), (2, 0.0), (2, 0.5)],
)
def test_torques_that_are_held_and_such_that_are_not_are_separated_where_that_is_little(late, seed):
    """A motor that is damped much takes a torque of half a sample's delay for inertia: D θ̇ changes by D T/2 θ̈, here 15 % of B.

    What is held acts half a sample later, so the log's drive does.
    """
    heavy, period, drawn = Truth(damping=3.0), 2e-3, drive(seed)
    time = np.arange(4000) * period
    moved = elastic(time, heavy, lambda t: 3.0 * drawn(t - late * period))
    moved["motor_torque"][0] = 3.0 * drawn(time)
    found = channels_of(signals(sensed(moved, time, heavy, seed, loud=16.0), period))
    selection = selected(found, joint_of(ELASTIC.replace("damping = 0.05", "damping = 3.0")))
    assert named(selection) == []
    assert (selection.system.hold > 0.0) == (late > 0.0)


@pytest.mark.every(3)
@pytest.mark.parametrize("seed", [1, 4, 5])
def test_smooth_torques_are_not_held_ones_with_every_sensor_late(seed):
    """Half a sample of all sensors together is what held torques are; one hypothesis without a cause is the more probable."""
    joint = joint_of()
    system = system_of(channels(seed=seed, duration=8.0), joint)
    selection = select(system, joint, setting_of(joint, system), frozenset(), {})
    assert named(selection) == []
    assert selection.system.hold == 0.0


def test_a_cause_that_is_driven_as_far_as_it_may_go_is_not_the_only_one():
    """A torque sensor that shows a thousandth of the torque is no matter of its gain."""
    assert material(selected(channels(Truth(gain=0.001), duration=8.0, seed=4))) != ["sensor.torque_gain"]


def test_all_causes_of_the_catalogue_are_looked_for_but_those_that_are_barred():
    joint = joint_of()
    setting = setting_of(joint, system_of(channels(seed=1, duration=8.0), joint))
    everything = {s.cause for s in sites_of(setting, frozenset())}
    assert set(HIDDEN) < everything
    assert {s.cause for s in sites_of(setting, frozenset({"link.contact"}))} == everything - {"link.contact"}


def test_a_set_with_one_cause_exchanged_keeps_all_others_as_they_are():
    """A payload out, an inertia and a gravity in; a damping keeps its value, and what only went on the way there stays."""
    joint = joint_of()
    sites = sites_of(setting_of(joint, system_of(channels(seed=1, duration=4.0), joint)), frozenset())
    of = {s.cause: s for s in sites if not s.members}
    payload, inertia, gravity = of["link.payload"], of["link.inertia"], of["link.gravity"]
    damping, offset = of["motor.viscous_friction"], of["motor.torque_offset"]
    fit = [(damping, np.array([0.07])), (payload, np.array([1.0, 0.2])), (offset, np.array([0.1]))]
    instead = [(damping, np.array([0.2])), (inertia, np.array([0.04])), (gravity, np.array([2.0, 0.0]))]
    out = {s.cause: v.tolist() for s, v in _exchanged(fit, payload, instead)}
    assert out == {
        "motor.viscous_friction": [0.07],
        "motor.torque_offset": [0.1],
        "link.inertia": [0.04],
        "link.gravity": [2.0, 0.0],
    }
