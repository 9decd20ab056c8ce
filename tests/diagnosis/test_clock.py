"""Delays of channels against each other: the set with the fewest late ones, and noise that comes whenever it comes."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from written_out import Truth, channels, joint_of

from vsalog.cli import cli
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.clock import all_late, counted_from, on_fewest_clocks, read_apart
from vsalog.diagnosis.common_causes import common_sites
from vsalog.diagnosis.linear import formed_of
from vsalog.diagnosis.run import Options, diagnose
from vsalog.diagnosis.selection import APART, sites_of, smooth_drive
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import earlier, whole_delays
from vsalog.residuals.system import build_system

PERIOD = 2e-3


def late(cause, part, low=-0.05):
    return Site(cause, part, (Parameter("delay", "s", 0.0, 0.25 * PERIOD, low, 0.05),), lambda joint, values: joint)


DRIVE = late("motor.torque_delay", "motor", 0.0)
ENCODERS = [late("sensor.clock_skew", role) for role in ("motor_position", "link_position")]
SENSOR = late("sensor.torque_delay", "torque_sensor")
SITES = [DRIVE, *ENCODERS, SENSOR]


def placed(*pairs):
    return tuple((site, np.array([value])) for site, value in pairs)


def values(fit):
    return {site.key: pytest.approx(float(values[0]), abs=1e-12) for site, values in fit}


def test_sensors_that_are_all_late_are_a_drive_that_is():
    fit = placed((ENCODERS[0], 5e-3), (ENCODERS[1], 5.1e-3), (SENSOR, 4.9e-3))
    assert not all_late(fit, SITES)
    found = on_fewest_clocks(fit, SITES)
    assert {site.key for site, _ in found} == {DRIVE.key}
    assert 4.9e-3 <= found[0][1][0] <= 5.1e-3


def test_the_one_that_is_late_next_to_the_others_stays_late():
    fit = placed((ENCODERS[0], 5e-3), (ENCODERS[1], 8e-3), (SENSOR, 5e-3))
    found = on_fewest_clocks(fit, SITES)
    assert {s.key: float(v[0]) for s, v in found} == values(placed((DRIVE, 5e-3), (ENCODERS[1], 3e-3)))


def test_a_time_of_all_channels_is_taken_off_and_differences_below_a_step_with_it():
    fit = placed((DRIVE, 1e-3), (ENCODERS[0], 4e-3), (ENCODERS[1], 4.1e-3), (SENSOR, 4e-3))
    assert all_late(fit, SITES)
    assert {s.key: float(v[0]) for s, v in on_fewest_clocks(fit, SITES)} == values(placed((DRIVE, 5e-3)))


def test_of_sets_about_as_probable_that_with_fewer_delays_says_whether_a_drive_is_smooth():
    """However many other causes a set has: with both encoders late by half a sample a smooth drive is one that holds."""
    others = placed(*((late(f"link.{i}", "link"), 0.1) for i in range(3)))
    both = placed((ENCODERS[0], 5e-4), (ENCODERS[1], 5e-4))
    assert not smooth_drive(0.5, both, (*placed((ENCODERS[0], 2e-3)), *others))
    assert smooth_drive(-0.5, others, both)
    assert not smooth_drive(-0.5, others, others)
    assert not smooth_drive(0.5, others, others)
    assert smooth_drive(0.5, others[:-1], others)
    assert smooth_drive(APART + 0.1, both, others)
    assert not smooth_drive(-APART - 0.1, others, both)


def test_channels_that_are_read_earlier_are_sensors_that_are_early_next_to_a_drive_that_holds():
    """And what the delays of a held drive say to the sample is read at the samples."""
    joint, half = joint_of(), 0.5 * PERIOD
    smooth = build_system(joint, channels(period=PERIOD), balance_for(joint))
    early = earlier(joint, dict.fromkeys(("motor_position", "link_position", "torque_sensor"), 0.5), PERIOD)
    held = replace(smooth, hold=half)
    np.testing.assert_allclose(replace(smooth, early=0.5).averaged(joint), held.averaged(early), rtol=0, atol=1e-12)
    np.testing.assert_allclose(replace(held, early=-0.5).averaged(early), smooth.averaged(joint), rtol=0, atol=1e-12)


def test_sets_of_held_and_smooth_drives_are_read_where_their_noise_is_alike():
    hold = 0.5 * PERIOD
    early = placed(*((site, -hold) for site in (*ENCODERS, SENSOR)))

    def apart(smooth, held, loud=None, sites=SITES):
        return read_apart(smooth, held, sites, hold, lambda site: 10.0 if site is loud else 1.0)

    assert apart((), early) == pytest.approx(hold)
    assert apart(placed((DRIVE, 3e-3 + hold)), placed((DRIVE, 3e-3))) == pytest.approx(0.0)
    assert apart((), ()) == 0.0
    assert apart((), (), DRIVE) == hold
    assert apart((), placed((SENSOR, 4e-3)), SENSOR) == -4e-3
    assert apart((), (), sites=[]) == 0.0


@pytest.mark.every(2)
@pytest.mark.parametrize("rate", [100.0, 150.0])
def test_a_sound_joint_with_a_smooth_drive_has_no_late_channel_at_any_rate(rate, tmp_path):
    """Reading between samples takes off noise: three early sensors next to a held drive seemed better than none."""
    assert (
        CliRunner().invoke(cli, ["simulate", "sea", "--rate", f"{rate:g}", "-o", f"{tmp_path}/log.parquet"]).exit_code
        == 0
    )
    assert diagnose(tmp_path / "log.parquet", None, Options()).diagnosis.verdict == "consistent"


def test_of_clocks_only_those_count_by_which_no_drive_is_early():
    """Two sensors agree that the drive is early, which none is: the drive's own clock is the one that is left."""
    fit = placed((DRIVE, 1e-3), (ENCODERS[0], -5e-3), (ENCODERS[1], -5e-3), (SENSOR, -1e-3))
    found = on_fewest_clocks(fit, SITES)
    assert {s.key: float(v[0]) for s, v in found} == values(placed((ENCODERS[0], -4e-3), (ENCODERS[1], -4e-3)))


@pytest.mark.parametrize(
    "fit",
    [
        (),
        placed((ENCODERS[0], 5e-3)),
        placed((DRIVE, 5e-3)),
        placed(*((s, -5e-3) for s in (*ENCODERS, SENSOR))),
    ],
    ids=["nothing", "one sensor", "the drive", "a drive that would be early"],
)
def test_what_cannot_have_fewer_late_channels_stays(fit):
    assert on_fewest_clocks(fit, SITES) is None


def test_of_three_channels_two_are_late_whichever_is_the_clock():
    fit = placed((ENCODERS[0], 4e-3), (ENCODERS[1], 2e-3))
    sites = [DRIVE, *ENCODERS]
    assert {s.key: float(v[0]) for s, v in counted_from(fit, ENCODERS[0], sites)} == values(
        placed((DRIVE, 4e-3), (ENCODERS[1], -2e-3))
    )
    assert {s.key: float(v[0]) for s, v in counted_from(fit, ENCODERS[1], sites)} == values(
        placed((DRIVE, 2e-3), (ENCODERS[0], 2e-3))
    )
    # With a fourth channel that is in time, three would be late.
    assert counted_from(fit, ENCODERS[0], SITES) is None
    # No drive is early.
    assert counted_from(placed((ENCODERS[0], -4e-3), (ENCODERS[1], 2e-3)), ENCODERS[0], sites) is None


def test_where_a_drive_is_the_clock_sensors_are_late_against_it():
    fit = placed((ENCODERS[0], 5e-3))
    assert on_fewest_clocks(fit, ENCODERS[:1]) is None
    assert not all_late(fit, ENCODERS[:1])


def test_other_causes_and_drives_in_common_are_kept():
    drives = [late("motor.torque_delay", f"motor_{i}", 0.0) for i in (1, 2)]
    encoders = [late("sensor.clock_skew", f"motor_position_{i}") for i in (1, 2)]
    every = [*drives, *encoders, ENCODERS[1]]
    sites = [*every, *common_sites(every)]
    inertia = Site(
        "motor.inertia", "motor_1", (Parameter("inertia", "kg*m^2", 1.0, 1e-3),), lambda joint, values: joint
    )
    both = next(s for s in sites if s.members and s.cause == "sensor.clock_skew")
    found = on_fewest_clocks(placed((inertia, 1.1), (both, 5e-3), (ENCODERS[1], 5e-3)), sites)
    assert {s.key: float(v[0]) for s, v in found} == {
        inertia.key: 1.1,
        ("motor.torque_delay", "motor_1+motor_2"): pytest.approx(5e-3),
    }


def test_whole_samples_of_delays_are_taken_off_and_put_back():
    joint = joint_of()
    setting = setting_of(joint, build_system(joint, channels(seed=1, duration=8.0), balance_for(joint)))
    sites = {s.key: s for s in sites_of(setting, frozenset())}
    there = sites["motor.torque_delay", "motor"].apply(joint, [2.5 * PERIOD])
    there = sites["sensor.clock_skew", "link_position"].apply(there, [-1.1 * PERIOD])
    assert whole_delays(there, PERIOD) == {"motor": 2, "link_position": -1}
    near = earlier(there, whole_delays(there, PERIOD), PERIOD)
    assert near.motor.torque_delay == pytest.approx(0.5 * PERIOD)
    assert near.signals.link_position.delay == pytest.approx(-0.1 * PERIOD)
    assert whole_delays(sites["motor.torque_delay", "motor"].apply(joint, [0.74 * PERIOD]), PERIOD) == {}
    assert whole_delays(sites["motor.torque_delay", "motor"].apply(joint, [0.76 * PERIOD]), PERIOD) == {"motor": 1}
    assert earlier(joint, whole_delays(joint, PERIOD), PERIOD) is joint


def test_noise_does_not_depend_on_how_many_samples_a_channel_is_late():
    """The draws of noise are the same ones: another alignment of them is some parts in a hundred of a log's deviance."""
    joint = joint_of()
    system = build_system(joint, channels(Truth(), seed=3, duration=8.0), balance_for(joint))
    sites = sites_of(setting_of(joint, system), frozenset())
    period = system.channels.period
    sensors = [s for s in sites if s.cause in ("sensor.clock_skew", "sensor.torque_delay")]
    made = []
    for samples in (0.4, 3.4):
        fit = tuple((s, np.array([samples * period])) for s in sensors)
        formed = formed_of(system, joint, fit)
        made.append(formed[1:] - formed[0])
    np.testing.assert_allclose(made[0], made[1], rtol=1e-9, atol=1e-9 * np.abs(made[0]).max())
