"""The stacked residual system: white where there is noise alone, and each row the average it is reported to be."""

from dataclasses import replace

import numpy as np
import pytest
from written_out import Truth, channels, joint_of, log, motion, sensed, signals

from vsalog.diagnosis.causes.base import with_signal
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system, formed


def system_of(found, joint=None):
    joint = joint or joint_of()
    return build_system(joint, found, balance_for(joint))


# Ten times as loud as other logs: what filters cannot do exactly is nothing next to it.
LOUD = {"duration": 20.0, "loud": 10.0}


@pytest.fixture(scope="module")
def clean():
    return system_of(channels(**LOUD))


def test_the_rows_of_a_log_of_noise_alone_are_white(clean):
    """The rig is right, so what is left is noise: its covariance over the whitened rows is the unit matrix."""
    rows = clean.whitened(joint_of())
    rows = rows[(clean.weights > 0).all(axis=1)]
    assert len(rows) > 500
    # Bells overlap by half, so rows are worth somewhat fewer; four standard deviations of a mean of squares.
    np.testing.assert_allclose(rows.T @ rows / len(rows), np.eye(3), atol=4 * np.sqrt(2 * 1.5 / len(rows)))


def test_the_noise_told_is_that_of_other_logs_of_the_same_motion(clean):
    """Forty logs whose noise this test draws: the spread of a row over them is what one log tells of itself."""
    time, moved = motion(Truth(), LOUD["duration"], 2e-3, 0)
    rows = []
    for seed in range(40):
        other = channels_of(signals(sensed(moved, time, Truth(), 1000 + seed, LOUD["loud"]), time[1]))
        rows.append(replace(clean, channels=other).averaged(joint_of()))
    rows = np.stack(rows)[:, (clean.weights > 0).all(axis=1)]
    off = rows - rows.mean(axis=0)
    expected = np.einsum("kri,krj->ij", off, off) / (39 * rows.shape[1])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # Told from two copies of the log: four standard deviations of a mean of squares, as above.
    atol = 4 * np.sqrt(2 * 1.5 / (2 * rows.shape[1]))
    np.testing.assert_allclose(clean.covariance / scale, expected / scale, atol=atol)
    assert clean.names == ("motor", "transmission", "link")
    assert clean.units == ("N*m",) * 3


def test_an_average_is_the_bell_over_the_equation(clean):
    """By hand: weights of a raised cosine, over samples that count."""
    joint = joint_of()
    equations = {e.name: e for e in clean.equations(joint)}
    rows = clean.averaged(joint)
    half = clean.bell.size // 2
    np.testing.assert_allclose(clean.bell, clean.bell[::-1])
    assert clean.bell.sum() == pytest.approx(1.0)
    i = clean.names.index("transmission")
    used = np.flatnonzero(clean.weights[:, i] > 0)
    for r in used[:: max(1, used.size // 20)]:
        part = slice(clean.centres[r] - half, clean.centres[r] + half + 1)
        weights = clean.bell * clean.usable[i, part]
        values = np.where(clean.usable[i, part], equations["transmission"].whole[part], 0.0)
        assert rows[r, i] == pytest.approx(weights @ values / weights.sum(), abs=1e-12)


def test_an_average_of_any_signal_is_taken_alike(clean):
    line = 3.0 + 0.5 * clean.channels.time
    np.testing.assert_allclose(clean.average(line), 3.0 + 0.5 * clean.time, rtol=1e-9)


def test_what_is_not_recorded_touches_only_its_own_rows():
    """A stretch without a value takes the rows it reaches, and leaves all others as they were."""
    time, said = log(duration=8.0)
    whole = channels_of(signals(said, time[1]))
    said["torque_sensor"] = said["torque_sensor"].copy()
    said["torque_sensor"][2000:2100] = np.nan
    holed = channels_of(signals(said, time[1]))
    one, other = (system_of(c) for c in (whole, holed))
    a, b = (s.averaged(joint_of()) for s in (one, other))
    i = one.names.index("transmission")
    gone = (other.weights[:, i] == 0) & (one.weights[:, i] > 0)
    reach = 0.05 + 0.05 + 0.03
    assert gone.any()
    assert np.all(np.abs(one.time[gone] - time[2050]) < 0.1 + reach)
    assert np.all(b[gone, i] == 0.0)
    far = np.abs(one.time - time[2050]) > 0.1 + reach
    np.testing.assert_array_equal(a[far], b[far])
    # Equations that do not use the sensor keep their rows there too.
    j = one.names.index("motor")
    np.testing.assert_array_equal(a[:, j], b[:, j])


def test_where_a_velocity_has_no_sign_friction_is_not_judged(clean):
    """Rows of the motor equation near standstill do not count; those of the transmission do."""
    motor, transmission = clean.names.index("motor"), clean.names.index("transmission")
    time, moved = motion(Truth(), LOUD["duration"], 2e-3, 0)
    slow = (np.abs(moved["motor_position"][1]) < 5e-3) & (np.abs(time - 10.0) < 9.0)
    assert slow.sum() > 5
    assert not clean.usable[motor][slow].any()
    assert clean.usable[transmission][slow].mean() > 0.8


def test_a_rig_that_is_far_off_gives_numbers(clean):
    """A search may try anything; what cannot be computed counts as very wrong."""
    from vsalog.diagnosis.causes.base import with_part

    absurd = with_part(joint_of(), "transmission", stiffness=1e308, cubic=1e308)
    rows = clean.averaged(absurd)
    assert np.isfinite(rows).all()
    assert np.abs(rows).max() >= 1e5


def test_a_cause_shows_in_its_equation_at_its_size(clean):
    """A rig whose motor damps 0.03 N·m·s/rad too much leaves that times the velocity over."""
    from vsalog.diagnosis.causes.base import with_part

    wrong = with_part(joint_of(), "motor", damping=0.08)
    change = clean.averaged(wrong) - clean.averaged(joint_of())
    i = clean.names.index("motor")
    used = clean.weights[:, i] > 0.999  # an average with gaps in it is one over other samples
    assert used.sum() > 500
    expected = 0.03 * clean.average(clean.channels.roles["motor_position"][1])
    np.testing.assert_allclose(change[used, i], expected[used], rtol=0.02, atol=1e-3)
    assert np.all(change[:, clean.names.index("transmission")] == 0.0)


def test_rows_of_one_system_can_be_used_in_another(clean):
    time, moved = motion(Truth(), LOUD["duration"], 2e-3, 0)
    again = channels_of(signals(sensed(moved, time, Truth(), 5, LOUD["loud"]), time[1]))
    other = system_of(again).on_rows_of(clean)
    np.testing.assert_array_equal(other.weights, clean.weights)
    assert set(other.whiteners) == set(clean.whiteners)


def test_equations_are_formed_of_what_truly_acted():
    """What the rig states of a sensor is undone before equations are formed."""
    truth = Truth(gain=1.3, offset=0.2)
    found = channels(truth, duration=6.0)
    known = with_signal(joint_of(), "torque_sensor", gain=1.3, offset=0.2)
    by_name = {e.name: e.whole for e in formed(balance_for(known), known, found, 0.0)}
    inside = np.isfinite(by_name["transmission"])
    assert abs(np.mean(by_name["transmission"][inside])) < 1e-3
    assert np.std(by_name["transmission"][inside]) < 5e-3


def test_equations_are_averaged_over_a_twentieth_of_a_second(clean):
    """Over half of that, which is the raised cosine's width at half its height, they are separated."""
    half = np.count_nonzero(clean.bell > 0.5 * clean.bell.max()) * 2e-3
    assert half == pytest.approx(0.025, abs=2e-3)


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_without_noise_a_thousandth_of_the_torques_is_one_deviation(size):
    time = np.arange(1000) * 2e-3
    torques = {"motor_torque": 1.3 * np.sin(9.0 * time), "torque_sensor": 0.9 * np.sin(9.0 * time)}
    roles = {"motor_position": 0.2 * np.sin(9.0 * time), "link_position": 0.1 * np.cos(9.0 * time)}
    system = system_of(channels_of(signals(roles | torques, 2e-3)))
    off = 1e-3 * size * 1.3 / np.sqrt(2.0)
    change = system.whitened(with_signal(joint_of(), "torque_sensor", offset=off)) - system.whitened(joint_of())
    used = (system.weights > 0.999).all(axis=1)
    assert np.sqrt(np.mean(np.sum(change[used] ** 2, axis=1))) == pytest.approx(size, rel=0.1)
