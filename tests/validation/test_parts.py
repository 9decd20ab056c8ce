"""Region, independence, and what an error is said to depend on."""

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from vsalog.checks.torque_independence import computed_from
from vsalog.core.region import inside_region
from vsalog.validation.dependence import dependences
from vsalog.validation.signatures import loops

pytestmark = pytest.mark.share(3)

RNG = np.random.default_rng(3)
T = np.arange(20_000) * 1e-3
PHI = 0.1 * np.sin(2 * np.pi * 0.31 * T) + 0.05 * np.sin(2 * np.pi * 1.3 * T)
RATE = np.gradient(PHI, 1e-3)
TORQUE = 20.0 * PHI + 500.0 * PHI**3
NOISE = 0.005 * RNG.standard_normal(T.size)


def winding(corners, x, y):
    """Winding number of a polygon about points, from the angles its edges are seen under."""
    turned = np.zeros_like(x)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = np.arctan2(ay - y, ax - x), np.arctan2(by - y, bx - x)
        turned += (b - a + np.pi) % (2 * np.pi) - np.pi
    return np.round(turned / (2 * np.pi)).astype(int)


def test_inside_a_hull_is_what_a_polygon_says():
    hull = ((-0.1, 0.05), (0.1, 0.05), (0.12, 0.08), (0.0, 0.1), (-0.12, 0.08))
    x, y = RNG.uniform(-0.2, 0.2, 5000), RNG.uniform(0.03, 0.12, 5000)
    ours = inside_region(hull, x, y)
    theirs = winding(np.array(hull), x, y) != 0
    assert np.all(ours[theirs])
    # A margin of 1 % of the span on either axis is granted.
    assert np.mean(ours != theirs) < 0.03
    assert np.array_equal(inside_region(hull[::-1], x, y), ours)


def test_inside_an_interval_and_with_a_set_point_that_stood_still():
    x = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    assert inside_region(((-0.1,), (0.1,)), x, None).tolist() == [False, True, True, True, False]
    still = inside_region(((-0.1, 0.03), (0.1, 0.03)), x, np.array([0.03, 0.03, 0.031, 0.03, 0.03]))
    assert still.tolist() == [False, True, False, True, False]
    assert not inside_region((), x, None).any()


def test_a_computed_torque_is_found_and_a_measured_one_is_not():
    found = computed_from(-40.0 * PHI, "j", "torque_sensor", PHI, "the deflection")
    assert (found.code, found.evidence["factor"]) == ("torque.computed", pytest.approx(-40.0))
    single = (-40.0 * PHI).astype(np.float32).astype(np.float64)
    assert computed_from(single, "j", "torque_sensor", PHI, "the deflection").code == "torque.computed"
    assert computed_from(TORQUE, "j", "torque_sensor", PHI, "the deflection").code == "torque.function"
    step = 2 * np.pi / 4096
    encoder = np.round(PHI / step) * step
    torque = 20 * encoder + 500 * encoder**3
    assert computed_from(torque, "j", "torque_sensor", encoder, "the deflection").code == "torque.function"
    # A sensor of its own: noise, or a true deflection behind the encoder's steps, or a loop.
    assert computed_from(TORQUE + NOISE, "j", "torque_sensor", PHI, "x") is None
    assert computed_from(TORQUE, "j", "torque_sensor", encoder, "x") is None
    assert computed_from(TORQUE + 0.01 * np.sign(RATE), "j", "torque_sensor", PHI, "x") is None
    assert computed_from(np.full(T.size, 2.0), "j", "torque_sensor", PHI, "x") is None


EFFECTS = {
    "offset": (0.4 + 0.0 * T, "error.offset", {"offset": -0.4}),
    "torque": (0.2 * TORQUE, "error.gain", {"gain": 1.2}),
    "deflection": (300.0 * (PHI**2 - np.mean(PHI**2)), "error.spring_shape", {}),
    "velocity": (0.8 * RATE, "error.velocity", {}),
    "direction": (0.3 * np.sign(RATE), "error.friction", {"apart": 0.6}),
    "loading": (0.3 * np.sign(RATE * PHI), "error.loading", {"apart": 0.6}),
    "time": (0.05 * (T - T.mean()), "error.drift_of_torque", {}),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_hidden_effect_is_named(name):
    """What is measured has an effect that the prediction lacks."""
    effect, code, evidence = EFFECTS[name]
    measured = TORQUE + effect + NOISE
    variables = {"deflection": PHI, "velocity": RATE, "loading": np.sign(RATE * PHI), "time": T}
    found = dependences(TORQUE - measured, TORQUE, variables)
    assert (found[0].on, found[0].code) == (name, code)
    assert found[0].evidence == pytest.approx(evidence, rel=0.02)


def test_a_swapped_sign_is_named():
    found = dependences(TORQUE - (-TORQUE + NOISE), TORQUE, {"deflection": PHI})
    assert (found[0].on, found[0].code) == ("torque", "error.sign")


def test_what_cannot_be_separated_is_reported():
    """A linear spring's deflection that is zeroed wrongly and a torque sensor's offset leave the same error."""
    variables = {"deflection": PHI, "stiffness": np.full(T.size, 20.0)}
    (found,) = dependences(0.4 + NOISE, 20.0 * PHI, variables)
    assert {found.on, *found.not_told_from} >= {"offset", "zero"}
    # One that hardens leaves another one.
    variables = {"deflection": PHI, "stiffness": 20.0 + 1500.0 * PHI**2}
    (found,) = dependences(0.02 * variables["stiffness"] + NOISE, TORQUE, variables)
    assert (found.on, found.not_told_from) == ("zero", ())


@pytest.mark.every(2)
@pytest.mark.parametrize("alike", [1, 100, 1000])
def test_noise_that_stays_alike_is_rarely_given_a_cause(alike):
    """Forty logs: a cause is reported of at most one of them, however slow the noise is."""
    causes = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        phi = 0.03 * sum(np.sin(2 * np.pi * rng.uniform(0.1, 1.5) * T + rng.uniform(0, 6)) for _ in range(6))
        rate, sigma = np.gradient(phi, 1e-3), 20.0 + 1500.0 * phi**2
        a = np.exp(-1.0 / alike)
        error = lfilter([1.0], [1.0, -a], rng.standard_normal(T.size + 10_000))[10_000:]
        q = 0.3 * np.sin(T) + phi
        variables = {"deflection": phi, "velocity": rate, "loading": np.sign(rate * phi), "time": T, "stiffness": sigma,
                     "link_position": q, "velocity of link_position": np.gradient(q, 1e-3)}  # fmt: skip
        variables |= loops(phi, np.arange(phi.size))
        found = dependences(0.01 * error, 20.0 * phi + 500.0 * phi**3, variables)
        causes += any(d.on != "itself" for d in found)
    assert causes <= 1


def test_two_causes_are_reported_one_after_the_other():
    variables = {"deflection": PHI, "velocity": RATE, "time": T, "stiffness": 20.0 + 1500.0 * PHI**2}
    found = dependences(TORQUE - (1.3 * TORQUE + 0.25 + NOISE), TORQUE, variables)
    assert {d.on for d in found} == {"torque", "offset"}
    assert sum(d.share for d in found) == pytest.approx(1.0, abs=0.01)


def test_noise_depends_on_nothing():
    noise = 0.2 * RNG.standard_normal(T.size)
    variables = {"deflection": PHI, "velocity": RATE, "loading": np.sign(RATE * PHI), "time": T}
    assert [d.on for d in dependences(noise, TORQUE, variables)] == []


def test_a_negligible_error_is_worth_no_cause():
    assert dependences(1e-4 * TORQUE, TORQUE, {"deflection": PHI}) == ()


def test_what_a_filter_makes_alike_is_no_missing_effect():
    noise = savgol_filter(0.2 * RNG.standard_normal(T.size), 51, 5)
    variables = {"deflection": PHI, "time": T}
    assert [d.on for d in dependences(noise, TORQUE, variables)] == ["itself"]
    assert dependences(noise, TORQUE, variables, smoothing=22.0) == ()
    slow = np.convolve(RNG.standard_normal(T.size), np.ones(400), "same") / 20.0
    assert [d.on for d in dependences(slow, TORQUE, {}, smoothing=22.0)] == ["itself"]
