"""The simpler models that Shin 2021 §IV-B compares with: what each is, against hand formulas, scipy and a textbook filter."""

import dataclasses

import msgspec
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, least_squares

from vsalog.core.errors import EstimatorError
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.estimators.pam_linear import LinearPamFold
from vsalog.estimators.pam_models import FORCE_MODELS, FRICTION_MODELS, as_if, fitted_force
from vsalog.estimators.pam_noise import pam_noise
from vsalog.mechanics.muscle_forces import contraction_force
from vsalog.reproduce.measure import Setting, estimate
from vsalog.rig import Rig
from vsalog.rig.schema import BraidForce, ExponentialForce, LinearForce, SimpleFriction, SpringForce, TonduFriction
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

replace = msgspec.structs.replace
RIG = Rig.preset("pam").file
JOINT = RIG.joint["pam"]
MUSCLES = (JOINT.muscle_1, JOINT.muscle_2)
PRESSURES = (4.2e5, 4.6e5)
PERIOD = 1e-3


@pytest.fixture(scope="module")
def experiment():
    scenario = Scenario.find("pam-exp1", RIG)
    return simulate(RIG, scenario.inputs(RIG), 4.0, seed=3)


def run(experiment, name, estimator="pam-ukf", **tune):
    return estimate(experiment, Setting("", estimator, {"model": name} | tune), "pam")["total"]


def level():
    """T_s + T_p of Shin 2021 §II-B4 at ψ = 0, written out with the printed numbers."""
    out, length = 0.1013e6, 0.165
    f1 = (7.045e-3 * length - 1.017e-3) * PRESSURES[0] - 556.8 * length + 72.86
    f2 = (6.423e-3 * length - 9.184e-4) * PRESSURES[1] - 197.8 * length + 15.75
    tube = 4e8 * sum(1.0 / (p - out) ** 2 for p in PRESSURES)
    return 0.006 * 0.2 * abs(f1 + f2 - 0.256 * 9.80) + tube


def test_simpler_frictions_have_the_rigs_level():
    assert as_if(JOINT, "hybrid", PRESSURES) is JOINT
    assert as_if(JOINT, "frictionless", PRESSURES).friction is None
    simple, tondu = (as_if(JOINT, f"{n}-friction", PRESSURES).friction for n in ("simple", "tondu"))
    assert isinstance(simple, SimpleFriction)
    assert simple.level == pytest.approx(level(), rel=1e-12)
    assert isinstance(tondu, TonduFriction)
    # Of §IV-B: f_s = 0.146, f_k = 0.03285, ẋ_k = 0.8.
    assert tondu.static == pytest.approx(level(), rel=1e-12)
    assert tondu.kinetic / tondu.static == pytest.approx(0.03285 / 0.146, rel=1e-12)
    assert tondu.speed == 0.8
    for name in FRICTION_MODELS:
        assert replace(as_if(JOINT, name, PRESSURES), friction=JOINT.friction) == JOINT


@pytest.mark.parametrize("name", [*FRICTION_MODELS, *FORCE_MODELS])
def test_a_name_is_the_same_as_a_rig_that_says_so(experiment, name):
    measured = experiment.joints["pam"].measured
    working = tuple(float(np.median(measured[f"pressure_{i}"])) for i in (1, 2))
    other = replace(RIG, joint={"pam": as_if(JOINT, name, working)})
    told = run(dataclasses.replace(experiment, rig=other), "hybrid")
    named, rigs = run(experiment, name), run(experiment, "hybrid")
    for column in ("link_position", "flexibility_torque", "stiffness"):
        np.testing.assert_array_equal(named[column], told[column])
        assert np.nanmax(np.abs(named[column] - rigs[column])) > 0.0


def grid(muscle):
    travel = 0.0365 * np.sin(np.deg2rad(25.0))
    lengths = muscle.length + np.linspace(-travel, travel, 50)
    return (v.ravel() for v in np.meshgrid(lengths, np.linspace(0.1013e6, 0.71e6, 50)))


def textbook_pull(name, x, p, length, rest):
    """Tondu and Lopez 2000 eq. 5; the forms of Sárosi 2012, and Wickramatunge and Leephakpreeda 2010. Numbers scaled to 1."""
    bar = p / 1e5
    if name == "braid-force":
        area, angle = x
        grown = 3.0 / np.tan(angle) ** 2 * (length / rest) ** 2
        return 10.0 * area * bar * (grown - 1.0 / np.sin(angle) ** 2)
    if name == "exponential-force":
        short = 1.0 - length / rest
        return (x[0] * bar + x[1]) * np.exp(x[2] * short) + x[3] * bar * short + x[4] * bar + x[5]
    s = 10.0 * (length - x[4])
    return (x[0] + x[1] * s**2 + x[2] * bar * s + x[3] * bar**2) * s


STARTS = {
    "braid-force": [3.0, 0.9],
    "exponential-force": [1.0, 1.0, -1.5, -100.0, 10.0, 1.0],
    "spring-force": [1.0, 1.0, 1.0, 0.1, 0.12],
}
BOUNDS = {
    "braid-force": ([0.1, 0.2], [100.0, 1.5]),
    "exponential-force": ([-1e4, -1e4, -60.0, -1e5, -1e4, -1e4], [1e4, 1e4, -1.0, 1e5, 1e4, 1e4]),
    "spring-force": ([-1e4, -1e5, -1e4, -1e3, 0.0825], [1e4, 1e5, 1e4, 1e3, 0.163]),
}


@pytest.mark.parametrize("muscle", MUSCLES, ids=["1", "2"])
@pytest.mark.parametrize("name", FORCE_MODELS)
def test_no_nonlinear_fit_of_the_form_comes_nearer_to_the_rigs_pull(name, muscle):
    length, pressure = grid(muscle)
    wanted = contraction_force(muscle, JOINT.air, pressure, length)
    force = fitted_force(muscle, JOINT.air, JOINT.seesaw.radius, name)
    ours = contraction_force(replace(muscle, force=force), JOINT.air, pressure, length)

    def left(x):
        return textbook_pull(name, x, pressure - 0.1013e6, length, muscle.length) - wanted

    theirs = least_squares(left, STARTS[name], bounds=BOUNDS[name], x_scale="jac", max_nfev=2000)
    assert np.sum((ours - wanted) ** 2) <= 2.0 * theirs.cost * (1.0 + 1e-4)


@pytest.mark.parametrize(
    ("name", "force"),
    [
        ("braid-force", BraidForce(rest_length=0.18, rest_radius=0.01, braid_angle=0.45)),
        ("exponential-force", ExponentialForce(0.165, a1=-4e-5, a2=20.0, a3=-9.0, a4=-1e-3, a5=2e-4, a6=-20.0)),
        ("spring-force", SpringForce(rest_length=0.12, c0=300.0, c1=2e4, c2=0.05, c3=1e-9)),
    ],
)
def test_a_pull_that_has_the_form_is_found_again(name, force):
    muscle = replace(JOINT.muscle_1, force=force, force_gain=1.3)
    length, pressure = grid(muscle)
    wanted = contraction_force(muscle, JOINT.air, pressure, length)
    joint = as_if(replace(JOINT, muscle_1=muscle), name, PRESSURES)
    found = contraction_force(joint.muscle_1, JOINT.air, pressure, length)
    np.testing.assert_allclose(found, wanted, atol=2e-5 * np.abs(wanted).max())


def test_a_pull_that_no_braid_has_is_refused():
    upside_down = replace(
        JOINT.muscle_1, force=LinearForce(area_slope=-7e-3, area=1.3e-3, passive_slope=0.0, passive=0.0)
    )
    with pytest.raises(EstimatorError, match="no braid"):
        as_if(replace(JOINT, muscle_1=upside_down), "braid-force", PRESSURES)


# --- the linear model


def flow_in(opening, pressure):
    """The bracket of Shin 2021 §II-B2: α m_in − (1 − α) m_out per area, ISO nozzles."""
    k, heat = 1.4, 287.0 * 293.0

    def nozzle(up, down):
        ratio = max(down / up, (2.0 / (k + 1.0)) ** (k / (k - 1.0)))
        return up * np.sqrt(2.0 * k / (k - 1.0) / heat * (ratio ** (2.0 / k) - ratio ** ((k + 1.0) / k)))

    return opening * nozzle(0.71e6, pressure) - (1.0 - opening) * nozzle(pressure, 0.1013e6)


def rate(x, u):
    """Eq. 11 without dry friction for (P₁, P₂, ψ, ψ̇), with the mean of both orifices, from the printed numbers."""
    p, psi, speed = x[:2], x[2], x[3]
    lengths = 0.165 + 0.0365 * np.sin(psi) * np.array([-1.0, 1.0])
    rates = 0.0365 * np.cos(psi) * speed * np.array([-1.0, 1.0])
    volume = -2.440e-2 * lengths**2 + 6.824e-3 * lengths - 4.254e-4
    swelling = (2.0 * -2.440e-2 * lengths + 6.824e-3) * rates
    area = 0.5 * (5.184e-8 + 7.776e-8)
    flows = area * np.array([flow_in(u[i], p[i]) for i in range(2)])
    filling = 1.1 * 287.0 * 293.0 * flows / volume - 0.4545 * swelling / volume * p
    f1 = (7.045e-3 * lengths[0] - 1.017e-3) * p[0] - 556.8 * lengths[0] + 72.86
    f2 = (6.423e-3 * lengths[1] - 9.184e-4) * p[1] - 197.8 * lengths[1] + 15.75
    torque = 0.0365 * np.cos(psi) * (f1 - f2)
    turn = (torque - 2.256e-3 * speed - 4.117e-4 * psi + u[2]) / 4.263e-4
    return np.array([*filling, speed, turn]), torque


def slopes(function, at, sizes):
    return np.array([(function(at + s) - function(at - s)) / (2.0 * np.abs(s).max()) for s in np.diag(sizes)]).T


def linear_fold(joint=JOINT, period=PERIOD):
    noise = pam_noise(joint, period, PRESSURES, (100.0, 120.0), flow=0.25)
    return LinearPamFold(joint, period, noise, PRESSURES)


def test_the_linear_model_is_the_hybrid_ones_first_derivative():
    sizes = np.array([10.0, 10.0, 1e-6, 1e-6])
    off = []
    for period in (1e-3, 5e-4):
        fold = linear_fold(period=period)
        assert fold.steps == 1
        rest = brentq(lambda psi: rate(np.array([*PRESSURES, psi, 0.0]), np.full(3, 0.0))[0][3], -0.4, 0.4)
        assert fold.at[2] == pytest.approx(rest, abs=1e-9)
        for i in range(2):
            assert flow_in(fold.held_by[i], PRESSURES[i]) == pytest.approx(0.0, abs=1e-9)
        u = fold.held_by
        A = slopes(lambda x, u=u: rate(x, u)[0], fold.at, sizes)
        B = slopes(lambda v, x=fold.at: rate(x, v)[0], u, np.array([1e-6, 1e-6, 1e-6]))
        both = expm(period * np.block([[A, B], [np.zeros((3, 7))]]))[:4]
        scale = np.array([1e5, 1e5, 0.1, 0.1 * np.sqrt(-A[3, 2])])
        mine, exact = (
            np.hstack([a * scale / scale[:, None], b / scale[:, None]])
            for a, b in ((fold.A, fold.B), (both[:, :4], both[:, 4:]))
        )
        off.append(np.abs(mine - exact).max())
        torque = slopes(lambda x, u=u: np.atleast_1d(rate(x, u)[1]), fold.at, sizes)[0]
        np.testing.assert_allclose(fold.slope * scale, torque * scale, rtol=1e-6, atol=1e-9)
        assert fold.torque == pytest.approx(rate(fold.at, u)[1], rel=1e-9)
    # A step errs by its square: of first order over a run, as the hybrid model's.
    assert 3.0 < off[0] / off[1] < 9.0
    assert off[0] < 0.02


def test_its_filter_is_the_textbooks_kalman_filter():
    fold, count, rng = linear_fold(), 300, np.random.default_rng(4)
    z = np.array(PRESSURES) + np.cumsum(rng.normal(size=(count, 2)) * 300.0, axis=0)
    volts = rng.uniform(4.5, 6.5, (count, 2))
    trace = fold.block(fold.start(), z[:, 0], z[:, 1], volts[:, 0], volts[:, 1])[1]
    x, P = trace.x[0], trace.S[0] @ trace.S[0].T
    np.testing.assert_array_equal(x[:2], z[0])
    Q, R, H = np.diag(fold.noise.process) ** 2, np.diag(fold.noise.pressure) ** 2, np.eye(2, 4)
    for k in range(1, count):
        valve = [
            np.interp(v, JOINT.valve_1.voltage, JOINT.valve_1.opening) - h
            for v, h in zip(volts[k - 1], fold.held_by[:2], strict=True)
        ]
        x = fold.at + fold.A @ (x - fold.at) + fold.B @ np.array([*valve, 0.0])
        P = fold.A @ P @ fold.A.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z[k] - x[:2]), P - K @ H @ P
    size = np.sqrt(np.diag(P))
    np.testing.assert_allclose((trace.x[-1] - x) / size, 0.0, atol=1e-6)
    np.testing.assert_allclose(trace.S[-1] @ trace.S[-1].T / np.outer(size, size), P / np.outer(size, size), atol=1e-7)
    told = fold.estimates(trace)
    assert told["torque"][-1] == pytest.approx(fold.torque + fold.slope @ (x - fold.at), rel=1e-6)
    assert told["torque_std"][-1] == pytest.approx(np.sqrt(fold.slope @ P @ fold.slope), rel=1e-6)
    assert np.ptp(told["stiffness"]) == 0.0


def test_a_linear_joint_that_is_held_does_not_turn():
    held = replace(JOINT, seesaw=replace(JOINT.seesaw, held_at=0.05))
    fold = linear_fold(held)
    z = np.linspace([4e5, 4.6e5], [4.3e5, 4.5e5], 200)
    trace = fold.block(fold.start(), z[:, 0], z[:, 1], np.full(200, 6.0), np.full(200, np.nan))[1]
    np.testing.assert_array_equal(trace.x[:, 2], 0.05)
    np.testing.assert_array_equal(trace.x[:, 3], 0.0)
    assert np.isfinite(trace.x).all()


@pytest.mark.parametrize("estimator", ["pam-ukf", "pam-model"])
def test_blocks_of_the_linear_model_give_the_same_bits(experiment, estimator):
    recording, joint = experiment.recording(), JOINT
    choice = choose("pam", joint, estimator, {"model": "linear"})
    whole = estimate_joint([recording], "pam", joint, choice).trace["total"]
    cut = estimate_joint([recording], "pam", joint, choice, block=701).trace["total"]
    for column, values in whole.items():
        np.testing.assert_array_equal(cut[column], values, err_msg=column)
    assert np.isfinite(whole["link_position"]).mean() > 0.99


def test_unknown_models_are_refused_with_what_there_is():
    with pytest.raises(EstimatorError, match="model"):
        choose("pam", JOINT, "pam-ukf", {"model": "perfect"})
    for name in ("hybrid", "linear", *FRICTION_MODELS, *FORCE_MODELS):
        for estimator in ("pam-ukf", "pam-model"):
            assert choose("pam", JOINT, estimator, {"model": name}).tuning.model == name
