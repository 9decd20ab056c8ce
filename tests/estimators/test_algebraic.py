"""The algebraic estimator: its filters against integrals in closed form, itself against a machine written out here."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from vsalog.binding.joint import bind
from vsalog.core.errors import EstimatorError, FilterError
from vsalog.core.recording import Channel, Recording
from vsalog.core.trace import Trace
from vsalog.estimators.device import device_of
from vsalog.estimators.methods.algebraic import fir_weights
from vsalog.estimators.registry import method
from vsalog.estimators.tuning import read_tuning
from vsalog.rig import Rig

T = 1e-3
RIG = """
[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = 0.02
damping = 0.05
[joint.arm.transmission]
type = "unknown"
[joint.arm.basis]
order = 3
odd = true
[joint.arm.signals]
motor_position = "theta"
link_position = "q"
motor_torque = "tau"
"""
STIFFNESS, CUBIC = 12.0, 150.0
ROLES = ("motor_position", "link_position", "motor_torque")


def bump(s):
    return (s * (1.0 - s)) ** 3 if 0.0 < s < 1.0 else 0.0


@settings(max_examples=40, deadline=None)
@given(
    taps=st.integers(7, 400),
    period=st.floats(1e-4, 1e-2),
    offset=st.floats(-10.0, 10.0),
    slope=st.floats(-10.0, 10.0),
    bend=st.floats(-10.0, 10.0),
)
def test_the_filters_are_exact_on_parabolas(taps, period, offset, slope, bend):
    t = (np.arange(taps) - 0.5 * (taps - 1)) * period
    x = offset + slope * t + 0.5 * bend * t**2
    value, first, second = fir_weights(taps, period)
    size = (abs(offset) + 1.0) * taps
    assert first @ x == pytest.approx(slope, abs=1e-9 * size / period)
    assert second @ x == pytest.approx(bend, abs=1e-9 * size / period**2)
    assert value.sum() == pytest.approx(1.0)
    assert value.min() >= 0.0


@pytest.mark.parametrize("frequency", [0.5, 3.0, 8.0])
def test_the_filters_are_the_integrals_of_operational_calculus(frequency):
    """∫ w x, ∫ w ẋ and ∫ w ẍ of a sine, by quadrature of the derivatives that the filters do not take."""
    taps = 151
    span, w = (taps - 1) * T, 2.0 * np.pi * frequency
    x = np.sin(w * np.arange(taps) * T + 0.3)
    norm = quad(bump, 0.0, 1.0)[0]
    for weights, derivative, size in zip(
        fir_weights(taps, T),
        (lambda t: np.sin(w * t + 0.3), lambda t: w * np.cos(w * t + 0.3), lambda t: -(w**2) * np.sin(w * t + 0.3)),
        (1.0, w, w**2),
        strict=True,
    ):
        exact = quad(lambda s, f=derivative: bump(s) * f(s * span), 0.0, 1.0)[0] / norm
        assert weights @ x == pytest.approx(exact, abs=2e-3 * size)


def machine(duration=12.0, damping=0.05):
    """A motor and a link with a hardening spring between them, from scipy's integrator: θ, q, τ at every sample."""

    def torque(t):
        return 0.9 * np.sin(2.1 * t) + 0.5 * np.sin(7.3 * t + 1.0) + 0.3 * np.sin(15.7 * t + 2.0)

    def moving(t, x):
        q, dq, a, da = x
        spring = STIFFNESS * (q - a) + CUBIC * (q - a) ** 3
        return [
            dq,
            -(spring + 0.02 * dq + 1.5 * np.sin(q)) / 0.03,
            da,
            (torque(t) + spring - damping * da) / 0.02,
        ]

    t = np.arange(round(duration / T)) * T
    x = solve_ivp(moving, (0.0, t[-1]), np.zeros(4), t_eval=t, rtol=1e-9, atol=1e-11).y
    return t, x[2], x[0], torque(t)


@pytest.fixture(scope="module")
def played():
    return machine()


def recorded(played, noise=0.0, step=0.0, turns=0.0, seed=0):
    t, theta, q, tau = played
    rng = np.random.default_rng(seed)

    def encoder(x):
        x = x + turns + 1e-3 * step * rng.standard_normal(x.size)
        return np.round(x / step) * step if step else x

    columns = {"theta": encoder(theta), "q": encoder(q), "tau": tau + noise * rng.standard_normal(t.size)}
    stamps = np.round(t * 1e9).astype(np.int64)
    channels = {n: Channel(n, stamps, v, None, "table", "table") for n, v in columns.items()}
    return Recording(
        path=Path("log.csv"), format="csv", channels=channels, streams={}, unread={}, rig_text=None, findings=()
    )


def estimated(recording, rig=RIG, **tune):
    joint = Rig.from_toml(rig, "here").joints["arm"]
    signals = bind([recording], "arm", joint, ROLES)
    module = method("algebraic")
    tuning = read_tuning(module.TUNING, "algebraic", {k: str(v) for k, v in tune.items()})
    fold = module.build(device_of("arm", joint, signals.roles), signals, tuning)
    state, parts = fold.start(), []
    for block in signals.blocks(5000):
        state, traces = fold.step(state, block)
        parts += traces
    state, traces = fold.finish(state)
    return Trace.concatenate([*parts, *traces]), fold.model(state)


def true_stiffness(trace):
    return STIFFNESS + 3.0 * CUBIC * trace["1"]["deflection"] ** 2


def test_the_spring_of_a_machine_from_another_integrator_is_found(played):
    trace, model = estimated(recorded(played))
    late = trace["1"]["excited"] & (trace.time > 4.0)
    assert late.mean() > 0.6
    error = trace["1"]["stiffness"][late] / true_stiffness(trace)[late] - 1.0
    assert np.sqrt(np.mean(error**2)) < 2e-3
    assert model.modality == "RESIDUAL"


def test_many_turns_of_the_encoder_change_nothing(played):
    near = estimated(recorded(played))[0]
    far = estimated(recorded(played, turns=2.0**14))[0]
    late = near["1"]["excited"] & (near.time > 4.0)
    np.testing.assert_allclose(far["1"]["stiffness"][late], near["1"]["stiffness"][late], rtol=1e-5)


def test_the_band_contains_the_truth(played):
    held = []
    for seed in range(40):
        trace, _ = estimated(recorded(played, noise=0.05, step=2.0 * np.pi / 36_000, seed=seed))
        one, rows = trace["1"], slice(6000, 11_900, 500)
        off = np.abs(one["stiffness"] - true_stiffness(trace))[rows]
        held.append(np.mean(off <= 1.96 * one["stiffness_std"][rows]))
    assert 0.88 <= np.mean(held) <= 1.0


def test_a_longer_span_averages_more_noise(played):
    noisy = recorded(played, noise=0.2, step=2.0 * np.pi / 36_000)
    spread = []
    for span in (0.03, 0.15):
        trace, _ = estimated(noisy, span=span)
        left = trace["1"]["residual"] - trace["1"]["residual_fit"]
        spread.append(np.nanstd(left[4000:]))
    assert spread[1] < 0.5 * spread[0]


def test_a_rig_with_dry_friction_has_it_taken_off(played):
    """Friction put on the recorded torque here, by its sign, is in the rig too."""
    t, theta, q, tau = played
    rate = np.gradient(theta, T)
    rubbing = (t, theta, q, tau + 0.1 * np.sign(rate))
    rig = RIG.replace("damping = 0.05\n", "damping = 0.05\nfriction = { coulomb = 0.1 }\n")
    errors = []
    for text in (RIG, rig):
        trace, _ = estimated(recorded(rubbing), text)
        late = trace["1"]["excited"] & (trace.time > 4.0)
        errors.append(np.sqrt(np.mean((trace["1"]["stiffness"][late] / true_stiffness(trace)[late] - 1.0) ** 2)))
    assert errors[1] < 0.02
    assert errors[1] < 0.5 * errors[0]


def test_what_is_missing_is_reported(played):
    recording = recorded(played)
    with pytest.raises(EstimatorError, match="needs the motor's inertia"):
        estimated(recording, RIG.replace("inertia = 0.02\n", ""))
    with pytest.raises(FilterError, match="too few"):
        estimated(recording, span=0.004)
    with pytest.raises(FilterError, match="longest stretch"):
        estimated(recording, span=20.0)
    device, module = device_of("arm", Rig.from_toml(RIG, "here").joints["arm"]), method("algebraic")
    with pytest.raises(EstimatorError, match="motor_torque"):
        module.roles(device, ("motor_position", "link_position"), module.TUNING())
