"""Formulas of effects against others that say the same: inverses, polynomials, closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.effects.backlash import beyond_gap, engaged
from vsalog.effects.body_torque import body_torque
from vsalog.effects.calibration import reading, zeroed
from vsalog.effects.contact import Contact
from vsalog.effects.delay import EFFECT as DELAYS
from vsalog.effects.delay import late, shifted
from vsalog.effects.drive import commanded_for, delivered
from vsalog.effects.eccentricity import Eccentricity
from vsalog.effects.friction import Friction, bristles_after, stribeck
from vsalog.effects.gravity import GRAVITY, Payload, holding_torque
from vsalog.effects.hysteresis import loop_slope, slipped
from vsalog.effects.reading_error import measured
from vsalog.effects.spring import stiffened

TIME = np.linspace(0.0, 2.0, 201)
ANGLE = 3.0 * np.sin(4.0 * TIME)
FINITE = st.floats(-1e3, 1e3)


@given(gain=st.floats(0.1, 10.0), offset=FINITE, drift=FINITE)
def test_a_reading_is_undone(gain, offset, drift):
    said = reading(ANGLE, TIME, gain, offset, drift)
    np.testing.assert_allclose(zeroed(said, TIME, offset, drift) / gain, ANGLE, atol=1e-9)


@given(gain=st.floats(0.5, 2.0), amplitude=st.floats(0.0, 0.3), phase=st.floats(-4.0, 4.0))
def test_an_eccentricity_is_undone_with_its_slope(gain, amplitude, phase):
    disc = Eccentricity(amplitude=amplitude, phase=phase)
    said = gain * ANGLE + amplitude * np.sin(ANGLE + phase)
    np.testing.assert_allclose(measured((disc,), said, gain, 500, 1e-14), ANGLE, atol=1e-12)
    near = 1e-6
    for whole, derivative in ((disc.error, disc.slope), (disc.slope, disc.curvature)):
        difference = (whole(ANGLE + near) - whole(ANGLE - near)) / (2.0 * near)
        np.testing.assert_allclose(derivative(ANGLE), difference, atol=1e-9)
    assert np.all(np.abs(disc.error(ANGLE)) <= disc.largest[0])
    assert np.all(np.abs(disc.slope(ANGLE)) <= disc.largest[1])


@given(
    gain=st.floats(-2.0, 2.0).filter(lambda gain: abs(gain) > 0.1),
    share=st.floats(0.0, 0.999),
    phase=st.floats(-4.0, 4.0),
)
def test_a_large_eccentricity_is_undone_in_as_many_rounds_as_a_double_has_bits(gain, share, phase):
    disc = Eccentricity(amplitude=share * abs(gain), phase=phase)
    said = gain * ANGLE + disc.error(ANGLE)
    x = measured((disc,), said, gain, 52, 1e-8)
    np.testing.assert_allclose(gain * x + disc.error(x), said, atol=1e-12)


@given(gain=st.floats(0.1, 10.0), offset=FINITE)
def test_a_drive_delivers_what_it_was_told_for(gain, offset):
    np.testing.assert_allclose(delivered(commanded_for(ANGLE, gain, offset), gain, offset), ANGLE, atol=1e-9)
    assert delivered(ANGLE, 1.0, 0.0) is ANGLE


def test_a_drives_step_comes_before_its_gain():
    np.testing.assert_allclose(delivered(np.array([0.24, -0.26]), 3.0, 0.1, 0.1), [0.7, -0.8])


@given(st.floats(-5.0, 5.0))
def test_a_shift_by_parts_of_a_sample_is_exact_for_cubics(samples):
    k = np.arange(60.0)
    cubic = np.stack([k**3 - 20.0 * k**2, 3.0 * k**2, 6.0 * k])
    inside = slice(10, 50)
    there = (k + samples)[inside]
    expected = np.stack([there**3 - 20.0 * there**2, 3.0 * there**2, 6.0 * there])
    np.testing.assert_allclose(shifted(cubic, samples)[:, inside], expected, rtol=1e-9, atol=1e-6)


def test_a_late_signal_goes_on_beyond_its_ends_as_it_does_there():
    parabola = 1.0 + 2.0 * TIME - 0.7 * TIME**2
    for delay in (-0.05, 0.05):
        then = TIME - delay
        np.testing.assert_allclose(late(parabola, TIME, delay), 1.0 + 2.0 * then - 0.7 * then**2, atol=1e-4)


@given(phi=FINITE, half=st.floats(0.0, 10.0))
def test_a_gap_takes_its_half_off_either_side(phi, half):
    u, side = beyond_gap(phi, half)
    if half > 0.0:
        assert u == pytest.approx(np.sign(phi) * max(abs(phi) - half, 0.0))
        assert bool(side) == bool(engaged(np.array([phi]), 2.0 * half, np.array([1.0]))[0])
    assert beyond_gap(phi, 0.0)[0] == phi


def test_bristles_follow_their_equation():
    stiffness, level, z = 40.0, 0.3, 0.002
    for dx in (0.004, -0.004):
        parts, now = 100_000, z
        for _ in range(parts):
            now += dx / parts - stiffness * abs(dx / parts) * now / level
        assert bristles_after(z, dx, level / stiffness, stiffness, level) == pytest.approx(now, rel=1e-4)
        torque = bristles_after(stiffness * z, dx, level, stiffness, level)
        assert torque == pytest.approx(stiffness * now, rel=1e-4)


def test_friction_of_two_at_one_shaft():
    one, other = Friction(coulomb=0.2, load=0.1), Friction(coulomb=0.1, static=0.4, stribeck_velocity=0.5)
    assert one.along_with(Friction()) == one == Friction().along_with(one)
    both = one.along_with(other)
    assert (both.coulomb, both.breakaway, both.load) == pytest.approx((0.3, 0.6, 0.1))
    assert both.stribeck_velocity == 0.5
    assert stribeck(0.3, 0.5, 0.5) == pytest.approx(0.3 / np.e)


def test_a_loop_saturates_and_a_slip_element_slips():
    assert loop_slope(1.0, 2.0, 2.0, 1.5, 1.0) == pytest.approx(0.0)
    assert loop_slope(0.0, 2.0, 2.0, 1.5, 0.7) == 2.0
    assert loop_slope(1.0, -2.0, 2.0, 1.0, 1.0) == pytest.approx(-4.0)
    assert [slipped(0.1, change, 10.0, 0.3) for change in (0.01, 0.1, -0.1)] == pytest.approx([0.2, 0.3, -0.3])
    assert stiffened(0.01, 10.0, -1.0, 0.2) == pytest.approx(1.1 * 0.8)


@given(mass=st.floats(0.01, 100.0), distance=st.floats(0.01, 10.0))
def test_a_payload_is_known_by_inertia_and_weight(mass, distance):
    load = Payload.of(mass * distance**2, mass * 9.81 * distance)
    assert (load.mass, load.distance) == pytest.approx((mass, distance))
    assert (load.inertia, load.weight) == pytest.approx((mass * distance**2, mass * GRAVITY * distance))
    assert holding_torque(load.weight, 0.3, 0.3 + np.pi / 2) == pytest.approx(load.weight)


def test_a_push_swells_and_fades():
    push = Contact(start=0.5, duration=0.2, torque=-3.0)
    time = np.array([0.4, 0.5, 0.55, 0.6, 0.7, 0.8])
    torque = body_torque((push,), 1.0, np.zeros(6), np.zeros(6), time)
    np.testing.assert_allclose(torque, [0, 0, -1.5, -3, 0, 0], atol=1e-12)


def test_a_seconds_pendulum_is_a_metre_long():
    """Less six millimetres: it swings to and fro in two seconds."""
    load = Payload(mass=3.0, distance=0.994)
    assert 2.0 * np.pi * (load.inertia / load.weight) ** 0.5 == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(("seconds", "possible"), [(0.04, True), (0.07, False)])
def test_no_channel_is_late_by_more_than_a_twentieth_of_a_second(seconds, possible):
    assert all((cause.low <= seconds <= cause.high) == possible for cause in DELAYS.causes)
