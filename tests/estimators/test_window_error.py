"""Filters of the smoother: the expected error of a fit, the window chosen by it, and functions that are filtered themselves."""

from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from tests.estimators.test_smoother import PERIOD, SEA, bound, errors, estimated, machine, without
from vsalog.core.basis import PolynomialBasis
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import device_of
from vsalog.estimators.folding import run
from vsalog.estimators.function_roles import Functions, function_roles
from vsalog.estimators.methods.smoother import SmootherTuning
from vsalog.estimators.registry import method
from vsalog.estimators.window_error import CHOOSING, Driven, _square_error, exact_window
from vsalog.filters.derivative_weights import derivative_weights

pytestmark = pytest.mark.share(2)

K, B, D = 60.0, 0.04, 0.3
MOTOR = Driven("motor_torque", "motor_position", None)


def played(seed, noise, period=2e-3, count=6000, torque_noise=0.02):
    """Return signals of a motor that drives a link through a spring, in closed form, with white noise."""
    rng, t = np.random.default_rng(seed), np.arange(count) * period
    turns = np.array([0.4, 1.1, 2.3, 4.1]) * 2.0 * np.pi
    size, phase = np.array([0.3, 0.2, 0.1, 0.05]), np.array([0.3, 1.7, 4.0, 2.2])
    swings = [size * turns**k * np.sin(np.outer(t, turns) + phase + k * np.pi / 2.0) for k in range(3)]
    theta, velocity, acceleration = (own.sum(axis=1) for own in swings)
    # A link of inertia M that the spring alone drives: M q̈ = K (θ − q).
    q = (swings[0] / (1.0 - 0.08 * turns**2 / K)).sum(axis=1)
    tau = B * acceleration + D * velocity - K * (q - theta)
    starts = np.zeros(count, dtype=bool)
    starts[0] = True
    signals = {
        "motor_position": theta + noise * rng.normal(size=count),
        "link_position": q + noise * rng.normal(size=count),
        "motor_torque": tau + torque_noise * rng.normal(size=count),
        "torque_sensor": K * (q - theta) + torque_noise * rng.normal(size=count),
    }
    return JointSignals(
        "sea", period, np.round(t * 1e9).astype(np.int64), t, signals, starts, np.zeros(count, dtype=np.int32)
    )


def view_of(signals):
    own = SEA.joint["sea"]
    joint = msgspec.structs.replace(own, motor=msgspec.structs.replace(own.motor, inertia=None, damping=0.0))
    return device_of("sea", joint, signals.roles)


def fitted(signals, weights, known_inertia):
    """Return the stiffness, or the inertia next to a torque sensor, by least squares behind a filter."""
    behind = {role: [np.correlate(x, w) for w in weights] for role, x in signals.roles.items()}
    (theta, velocity, acceleration), q = behind["motor_position"], behind["link_position"][0]
    phi, tau, sensed = q - theta, behind["motor_torque"][0], behind["torque_sensor"][0]
    size = np.sqrt(np.mean((signals.roles["link_position"] - signals.roles["motor_position"]) ** 2))
    cubed = np.correlate((signals.roles["link_position"] - signals.roles["motor_position"]) ** 3, weights[0])
    one, way = np.ones_like(phi), np.sign(velocity)
    if known_inertia is None:
        return np.linalg.lstsq(np.column_stack((one, acceleration, velocity, way)), tau + sensed, rcond=None)[0][1] / B
    A = np.column_stack((phi, cubed, one, acceleration, velocity, way))
    x = np.linalg.lstsq(A, tau, rcond=None)[0]
    return -(x[0] + 3.0 * size**2 * x[1]) / K


@pytest.mark.parametrize(("noise", "window"), [(1e-4, 21), (1e-4, 77), (1e-4, 153), (1e-3, 77)])
@pytest.mark.parametrize("sensed", [False, True])
def test_the_expected_error_is_that_of_fits_to_logs(noise, window, sensed):
    weights = derivative_weights(window, 5, 2, 2e-3)
    off, expected = [], []
    for seed in range(12):
        signals = played(seed, noise)
        driven = MOTOR._replace(transmitted="torque_sensor") if sensed else MOTOR
        expected.append(_square_error(view_of(signals).transmissions[0], signals, weights, len(signals), driven))
        off.append(fitted(signals, weights, None if sensed else B) - 1.0)
    found = np.sqrt(np.mean(np.square(off)))
    if np.isinf(expected).any():
        assert found > 0.2
    else:
        assert 0.4 < np.sqrt(np.mean(expected)) / found < 2.5


def test_the_window_is_as_good_as_the_best_and_no_longer_than_need_be():
    for noise in (3e-6, 1e-4, 1e-3):
        signals = played(1, noise)
        device = view_of(signals)
        tuning = exact_window(device, signals, SmootherTuning(), lambda view: [MOTOR])
        window = 2 * round(0.5 * tuning.window / 2e-3) + 1
        tried = {
            w: _square_error(device.transmissions[0], signals, derivative_weights(w, 5, 2, 2e-3), len(signals), MOTOR)
            for w in (11, 21, 39, 77, 153, 303)
        }
        assert tried[window] <= CHOOSING.as_good * min(tried.values())
        assert all(tried[w] > CHOOSING.as_good * min(tried.values()) for w in (77, 153, 303) if w < window)
    slow = played(1, 1e-5, period=2e-2, count=1500)
    tuning = exact_window(view_of(slow), slow, SmootherTuning(), lambda view: [MOTOR])
    assert tuning.window < 76 * 2e-2


def test_a_window_that_is_asked_for_is_kept():
    signals = played(0, 1e-4)
    tuning = SmootherTuning(window=0.1)
    assert exact_window(view_of(signals), signals, tuning, lambda view: [MOTOR]) is tuning
    causal = SmootherTuning(filter="kinematic")
    assert exact_window(view_of(signals), signals, causal, lambda view: [MOTOR]) is causal


def fast(at):
    """A torque up to the joint's resonance: far below it, acceleration and deflection are nearly proportional."""
    return 2.0 * np.sin(2.0 * np.pi * 0.31 * at) + 1.2 * np.sin(2.0 * np.pi * 2.3 * at) + np.sin(2.0 * np.pi * 4.9 * at)


@pytest.mark.parametrize("step", [2.0 * np.pi / 16384, 2.0 * np.pi / 4096])
def test_an_unknown_inertia_is_found_by_a_motor_s_torque_and_coarse_encoders(step):
    own = SEA.joint["sea"]
    joint = msgspec.structs.replace(own, motor=msgspec.structs.replace(own.motor, inertia=None, damping=0.0))
    t, signals, truth = machine(step=step, drive=fast)
    for part in (slice(None), slice(None, None, 2)):
        roles = {role: x[part] for role, x in without(signals, "torque_sensor").items()}
        at = replace(bound(t[part], roles), period=PERIOD * (part.step or 1))
        columns, _, _ = estimated_of(at, joint)
        assert columns["motor_inertia"][0] == pytest.approx(0.08, rel=0.03)
        relative, deviations = errors(columns, truth[part])
        assert np.median(relative[columns["excited"]]) < 0.01
        assert np.mean(deviations[columns["excited"]] < 1.96) > 0.8
        assert columns["excited"].mean() > 0.9


def estimated_of(at, joint):
    own = method("smoother")
    fold = own.build(device_of("sea", joint, at.roles), at, own.TUNING())
    blocks, state = run(fold, at)
    return Trace.concatenate(blocks)["1"], fold, state


@pytest.mark.parametrize("sensor", ["torque_sensor", "external_torque"], ids=["both torques", "motor torque"])
def test_missing_samples_shorten_no_window(sensor):
    """A fifth of the samples of each channel is lost: hardly any window has all of its own."""
    t, signals, truth = machine(seed=2)
    roles = without(signals, *({"torque_sensor", "external_torque"} - {sensor}))
    rng = np.random.default_rng(4)
    lacking = {role: np.where(rng.uniform(size=t.size) < 0.2, np.nan, x) for role, x in roles.items()}
    columns, fold, _ = estimated(t, lacking)
    relative, deviations = errors(columns, truth)
    assert fold.conditioner.near[0].shape[1] <= fold.conditioner.window
    assert columns["excited"].mean() > 0.9
    assert np.median(relative[columns["excited"]]) < 0.005
    assert np.mean(deviations[columns["excited"]] < 1.96) > 0.9


def test_a_spring_that_stiffens_is_read_as_well_in_fast_motion():
    """At 2, 5 and 9 swings in a second, a function of the filtered deflection is not the filtered function."""
    inside, wrong = [], []
    for seed in range(3):
        t, signals, truth = machine(
            seed=seed, step=2.0 * np.pi / 2**17, drive=lambda at: fast(at) + 2.0 * np.sin(2.0 * np.pi * 8.7 * at)
        )
        columns, _, _ = estimated(t, without(signals, "motor_torque"), window=0.152)
        relative, deviations = errors(columns, truth)
        inside.append(np.mean(deviations[columns["excited"]] < 1.96))
        wrong.append(np.median(relative[columns["excited"]]))
    assert np.mean(inside) > 0.85
    assert np.mean(wrong) < 0.002


def test_functions_are_formed_before_the_filter_and_free_of_the_noise_s_average():
    rng, deviation = np.random.default_rng(0), 0.03
    basis = PolynomialBasis.make(3, deflection_scale=0.5)
    phi = 0.2 + deviation * rng.normal(size=200_000)
    view = SimpleNamespace(name="1", deflection="deflection", deflection_roles=lambda offered: ("deflection",))
    signals = replace(played(0, 0.0, count=phi.size), roles={"deflection": phi})
    functions = Functions((view,), basis, (deviation**2,), None)
    state, (block,) = functions.step(functions.start(), signals)
    assert functions.finish(state)[1] == []
    for name, power in zip(function_roles(view, basis), (1, 3, 5), strict=True):
        mean = block.roles[name].mean()
        error = 5.0 * block.roles[name].std() / np.sqrt(phi.size)
        # Of the fifth power the fourth moment of the noise is left.
        assert mean == pytest.approx(
            (0.2 / 0.5) ** power, abs=error + (power == 5) * 15.0 * 0.4 * (deviation / 0.5) ** 4
        )
    assert functions.roles == function_roles(view, basis)
