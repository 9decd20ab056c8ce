"""Noise in regressors: what an encoder adds behind a filter, the bias of a fit, and what is reported of motions of few steps."""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.signal import savgol_filter as scipys

from vsalog.binding.joint import offered_roles
from vsalog.core.errors import EstimatorError
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.reproduce.measure import Setting, assemble, estimate, with_noise
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate
from vsalog.uncertainty.errors_in_variables import DeflectionNoise, RegressorNoise, bias_block, bias_start
from vsalog.uncertainty.sensor_error import sensor_error

PERIOD = 1e-3
TIME = np.arange(20_000) * PERIOD


def behind(window, error):
    """What scipy's filter makes of an error: value, first and second derivative, where the window is whole."""
    inner = slice(window, -window)
    return [scipys(error, window, 5, deriv=d, delta=PERIOD)[inner] for d in range(3)]


@pytest.mark.parametrize("steps", [2.5, 6.0, 20.0, 300.0])
@pytest.mark.parametrize("window", [51, 201])
def test_what_an_encoder_adds_is_what_it_adds(steps, window):
    """KnownEffects motion, rounded here: the error is there to be filtered; computed from the rounded samples alone."""
    motion = steps * np.sin(2 * np.pi * 0.83 * TIME) + 0.4 * steps * np.sin(2 * np.pi * 0.31 * TIME + 1.0)
    recorded = np.round(motion)
    value, rate, acceleration = behind(window, recorded - motion)
    weights = savgol_weights(window, 5, 2, PERIOD)
    told = sensor_error(recorded, window)
    white = 12.0**-0.5
    assert told.rms(weights[1]) == pytest.approx(np.std(rate), rel=0.35)
    assert told.product(weights[0], weights[2]) == pytest.approx(np.mean(value * acceleration), rel=0.6)
    if steps < 10.0 and window == 51:
        # Steps that are taken one by one are far from white.
        assert np.std(rate) > 1.5 * white * np.linalg.norm(weights[1])


def test_a_swing_that_takes_little_more_than_the_longer_window_keeps_its_size():
    """Of 300 samples, where 201 are smoothed: a parabola would flatten it, and its steps would come less often."""
    motion = 3.0 * np.sin(2 * np.pi * np.arange(TIME.size) / 299.9)
    recorded = np.round(motion)
    rate = behind(51, recorded - motion)[1]
    told = sensor_error(recorded, 51).rms(savgol_weights(51, 5, 2, PERIOD)[1])
    assert told == pytest.approx(np.std(rate), rel=0.15)


@pytest.mark.parametrize("noise", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("steps", [20.0, 300.0])
def test_noise_before_the_steps_is_part_of_what_an_encoder_adds(steps, noise):
    """Below a step's size noise and rounding are both there; either alone would be too little, or too smooth."""
    motion = steps * np.sin(2 * np.pi * 0.83 * TIME) + 0.4 * steps * np.sin(2 * np.pi * 0.31 * TIME + 1.0)
    recorded = np.round(motion + np.random.default_rng(4).normal(0.0, noise, TIME.size))
    _, rate, acceleration = behind(51, recorded - motion)
    weights, told = savgol_weights(51, 5, 2, PERIOD), sensor_error(recorded, 51)
    assert told.rms(weights[1]) == pytest.approx(np.std(rate), rel=0.2)
    assert told.rms(weights[2]) == pytest.approx(np.std(acceleration), rel=0.2)


def test_white_noise_is_measured_by_its_size():
    recorded = np.sin(TIME) + np.random.default_rng(3).normal(0.0, 0.01, TIME.size)
    weights = savgol_weights(51, 5, 2, PERIOD)
    told = sensor_error(recorded, 51)
    assert told.rms(weights[0]) == pytest.approx(0.01 * np.linalg.norm(weights[0]), rel=0.05)
    assert sensor_error(np.full(100, np.nan), 51).rms(weights[0]) == 0.0


def biased(noise, seen, estimate, weights, discount, integral=False):
    """A line's slope through abscissae `seen`, and the part of its information that is noise, by numpy."""
    count, n = seen.shape
    P = np.linalg.inv((weights[:, None] * seen).T @ seen)
    E = np.zeros((count, 1, n))
    E[:, 0, -1] = 1.0
    T, unknowns = np.broadcast_to(E[0] @ P, E.shape), np.broadcast_to(estimate, (count, n))
    ones = np.ones(count, dtype=bool)
    state, told = bias_block(
        bias_start(n), RegressorNoise((noise,)), E, T, unknowns, unknowns[:, -1:], ones, ~ones, integral, discount
    )
    return told[-1, 0], P[-1, -1], state


@pytest.mark.parametrize("sigma", [0.1, 0.5])
@pytest.mark.parametrize("discount", [1.0, 0.999])
def test_a_bent_fit_is_bent_by_what_is_counted(discount, sigma):
    """A line through noisy abscissae: attenuation, in expectation, however much of it there is already."""
    rng, stiffness = np.random.default_rng(0), 2.0
    x = rng.normal(0.0, 1.0, 4000)
    weights = discount ** np.arange(x.size)[::-1]
    slopes = []
    for _ in range(200):
        seen = x + rng.normal(0.0, sigma, x.size)
        slopes.append(np.sum(weights * seen * stiffness * x) / np.sum(weights * seen * seen))
    estimate = np.mean(slopes)
    told, P, state = biased(DeflectionNoise(sigma**2), seen[:, None], [estimate], weights, discount)
    part = sigma**2 * weights.sum() * P
    assert np.sqrt(told**2 - (part * estimate) ** 2) == pytest.approx(stiffness - estimate, rel=0.05)
    assert state.covariance(np.array([estimate]))[0, 0] * P**2 == pytest.approx((part * estimate) ** 2)


def test_noise_that_the_torque_shares_bends_the_other_way():
    rng, stiffness, sigma, shared = np.random.default_rng(0), 2.0, 0.1, 0.3
    x, stiffer = rng.normal(0.0, 1.0, 4000), []
    for _ in range(200):
        e = rng.normal(0.0, sigma, x.size)
        seen = x + e
        stiffer.append(np.sum(seen * shared * e) / np.sum(seen * seen))
    told, _, _ = biased(DeflectionNoise(0.0, shared * sigma**2), seen[:, None], [stiffness], np.ones(x.size), 1.0)
    assert told == pytest.approx(np.mean(stiffer), rel=0.05)


@pytest.mark.parametrize("discount", [1.0, 0.9995])
def test_a_fit_to_an_integral_is_bent_by_a_walk(discount):
    """∫τ dt = k ∫φ dt + c, where φ is noisy: what the integral makes of noise is larger the longer it lasts."""
    rng, stiffness, sigma, period = np.random.default_rng(2), 2.0, 0.4, 0.01
    phi = np.sin(2 * np.pi * 0.7 * np.arange(4000) * period)
    y = stiffness * period * np.cumsum(phi)
    weights, slopes = discount ** np.arange(phi.size)[::-1], []
    root = np.sqrt(weights)
    for _ in range(300):
        seen = np.column_stack((np.ones_like(phi), period * np.cumsum(phi + rng.normal(0.0, sigma, phi.size))))
        slopes.append(np.linalg.lstsq(root[:, None] * seen, root * y, rcond=None)[0][1])
    exact = np.column_stack((np.ones_like(phi), period * np.cumsum(phi)))
    # The information that the fits have on average, with the noise's own in it.
    steps = np.cumsum(weights[::-1])[::-1]
    noise = (sigma * period) ** 2 * np.sum(steps - steps**2 / steps[0])
    clean = 1.0 / np.linalg.inv((weights[:, None] * exact).T @ exact)[1, 1]
    told, P, _ = biased(
        DeflectionNoise((sigma * period) ** 2),
        exact * np.sqrt((clean + noise) / clean),
        [0.0, np.mean(slopes)],
        weights,
        discount,
        True,
    )
    first = np.sqrt(told**2 - (noise * P * np.mean(slopes)) ** 2)
    assert first == pytest.approx(stiffness - np.mean(slopes), rel=0.15)
    assert first > 0.01 * stiffness


def test_of_noise_alone_nothing_is_known():
    told, _, _ = biased(DeflectionNoise(0.6), np.ones((100, 1)), [1.0], np.ones(100), 1.0)
    assert told == np.inf


@pytest.mark.parametrize("integral", [False, True])
def test_blocks_of_any_size_sum_up_to_the_same_bits(integral):
    rng, count = np.random.default_rng(1), 300
    E, T, unknowns = rng.normal(size=(count, 3, 3)), rng.normal(size=(count, 3, 3)), rng.normal(size=(count, 3))
    use, fresh = rng.random(count) > 0.1, np.arange(count) % 110 == 0
    noise = RegressorNoise((DeflectionNoise(0.2, 0.1), DeflectionNoise(0.3)), np.array([0.0, 0.2, 0.1]))
    values = np.einsum("kmi,ki->km", E, unknowns)
    _, whole = bias_block(bias_start(3), noise, E, T, unknowns, values, use, fresh, integral, 0.99)
    state, parts = bias_start(3), []
    for k in range(0, count, 7):
        part = slice(k, k + 7)
        state, told = bias_block(
            state, noise, E[part], T[part], unknowns[part], values[part], use[part], fresh[part], integral, 0.99
        )
        parts.append(told)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def small(preset, share):
    """A preset's first experiment with its motors' torques made smaller."""
    rig = Rig.preset(preset).file
    joint = next(iter(rig.joint))
    inputs = Scenario.find(f"{preset}-exp1", rig).lasting(20.0, None).inputs(rig)[joint]
    drives = {role: (lambda t, x=x: share * np.asarray(x(t))) for role, x in inputs.items()}
    (sensed,) = with_noise(simulate(rig, {joint: drives}, 20.0, ideal=True), (900,))
    return joint, sensed


@pytest.mark.parametrize(("share", "estimator"), [(s, e) for s in (0.1, 0.03) for e in ("residual-rls", "qr-rls")])
def test_a_small_motion_is_estimated_or_said_to_be_uncertain(share, estimator):
    joint, sensed = small("vsa2", share)
    trace, held = estimate(sensed, Setting("", estimator, {}), joint), []
    for name in ("1", "2"):
        found, true = trace[name], sensed.truth[f"stiffness_{name}"]
        told = np.asarray(found["excited"], dtype=bool)
        error = np.abs(found["stiffness"] - true)
        if estimator == "qr-rls" and share == 0.03 and told.mean() < 0.3:
            # Sixteen steps of an integrated equation tell nothing, and that is reported.
            assert np.median((error / true)[true.size // 2 :]) > 0.1
            continue
        assert told.mean() > 0.3
        error = error[told]
        assert np.median(error / found["stiffness_std"][told]) < 1.96
        if estimator == "residual-rls":
            assert np.median(error / true[told]) < 0.03
        held.append(np.mean(error < 1.96 * found["stiffness_std"][told]))
    assert np.mean(held) > 0.8


@pytest.mark.parametrize("estimator", ["direct", "residual-rls", "qr-rls", "batch-ls"])
def test_a_deflection_of_a_few_steps_supports_nothing(estimator):
    joint, sensed = small("sea", 0.003)
    fold, signals = assemble(sensed, Setting("", estimator, {}), joint)
    assert "deflection.too_small" in [finding.code for finding in fold.findings(fold.start())]
    assert not np.any(estimate(sensed, Setting("", estimator, {}), joint)["1"]["excited"])
    assert set(offered_roles(sensed.rig.joint[joint])) <= set(signals.roles)


@pytest.mark.parametrize(
    ("preset", "estimator", "most"),
    [("vsa2", "residual-rls", 0.01), ("vsa2", "direct", 0.007), ("cubic-antagonist", "residual-rls", 0.002)],
)
def test_few_samples_per_second_are_not_smoothed_away(preset, estimator, most):
    """At 50 Hz 51 samples last a second, as long as the motion's period."""
    rig = Rig.preset(preset).file
    joint = next(iter(rig.joint))
    scenario = Scenario.find(f"{preset}-exp1", rig).lasting(20.0, None)
    (sensed,) = with_noise(simulate(rig, scenario.inputs(rig), 20.0, period=0.02, ideal=True), (3,))
    fold, _ = assemble(sensed, Setting("", estimator, {}), joint)
    assert fold.conditioner.window < 51
    trace = estimate(sensed, Setting("", estimator, {}), joint)
    for name in ("1", "2"):
        told = np.asarray(trace[name]["excited"], dtype=bool)
        off = np.abs(trace[name]["stiffness"] / sensed.truth[f"stiffness_{name}"] - 1.0)[told]
        assert told.mean() > 0.5
        assert np.median(off) < most
    with pytest.raises(EstimatorError, match="cannot follow"):
        assemble(sensed, Setting("", "residual-rls", {"bandwidth": 300.0}), joint)


def test_an_algebraic_estimate_behind_coarse_encoders_is_hardly_supported():
    """200 pulses per turn: steps of 0.03 rad pass its short filters, and its largest error was three times the stiffness."""
    rig = Rig.preset("sea").file
    coarse = {"resolution": 2 * np.pi / 200}
    signals = replace(
        rig.joint["sea"].signals,
        motor_position=replace(rig.joint["sea"].signals.motor_position, **coarse),
        link_position=replace(rig.joint["sea"].signals.link_position, **coarse),
    )
    rig = replace(rig, joint={"sea": replace(rig.joint["sea"], signals=signals)})
    inputs = Scenario.find("sea-exp1", rig).lasting(20.0, None).inputs(rig)
    (sensed,) = with_noise(simulate(rig, inputs, 20.0, ideal=True), (3,))
    found = estimate(sensed, Setting("", "algebraic", {}), "sea")["1"]
    error = np.abs(found["stiffness"] / sensed.truth["stiffness"] - 1.0)
    told = np.asarray(found["excited"], dtype=bool)
    assert told.mean() < 0.1
    assert not told.any() or np.median(error[told]) < 0.15


def test_rates_that_are_lost_in_encoders_steps_bend_the_band_too():
    """A chirp begins slower than the encoders see: a fit of rates looked four times as sure as it was."""
    rig = Rig.preset("awas").file
    inputs = Scenario.find("chirp", rig).lasting(8.0, None).inputs(rig)
    (sensed,) = with_noise(simulate(rig, inputs, 8.0, ideal=True), (3,))
    found = estimate(sensed, Setting("", "grioli-parametric", {}), "awas")["1"]
    told = np.asarray(found["excited"], dtype=bool)
    error = np.abs(found["stiffness"] - sensed.truth["stiffness"])[told]
    assert told.mean() > 0.25
    assert np.mean(error < 1.96 * np.asarray(found["stiffness_std"])[told]) > 0.85
