"""The impedance observers: the stiffness observer against closed forms, the link's filter against a textbook one, and both
against a joint that is integrated here."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from vsalog.cli import cli
from vsalog.filters.link_ekf import LinkNoise, estimate_link, link_start, restarted
from vsalog.filters.stiffness_observer import observe_stiffness, observer_start
from vsalog.reproduce.measure import with_noise
from vsalog.reproduce.rows import Row
from vsalog.reproduce.serio2011 import PRINTED, by_default, simulated_by
from vsalog.simulation.experiments import awas_rig

pytestmark = pytest.mark.share(4)

T = 1e-3


def observed(torque_rate, deflection_rate, alpha, use=None):
    use = np.ones(len(torque_rate), dtype=bool) if use is None else use
    return observe_stiffness(observer_start(), np.array(torque_rate), np.array(deflection_rate), use, alpha, T)[:3]


def test_a_constant_stiffness_is_known_at_once_and_without_spread():
    rate = np.cos(np.arange(500) * 0.01)
    stiffness, spread, learnt = observed(30.0 * rate, rate, 5.0)
    np.testing.assert_allclose(stiffness, 30.0, rtol=1e-12)
    np.testing.assert_allclose(spread, 0.0, atol=1e-9)
    # Each sample fills 1 − exp(−α |φ̇| T) of what is empty.
    np.testing.assert_allclose(learnt, 1.0 - np.exp(-5.0 * T * np.cumsum(np.abs(rate))), rtol=1e-9)


def test_a_step_is_followed_with_the_time_constant_that_alpha_sets():
    """dK̂/dt = α |φ̇| (K − K̂), with K̂ settled before the step."""
    n, alpha, rate = 20_000, 20.0, 0.5
    K = np.where(np.arange(2 * n) < n, 10.0, 40.0)
    stiffness, _, _ = observed(K * rate, np.full(2 * n, rate), alpha)
    after = np.arange(1, n + 1) * T
    np.testing.assert_allclose(stiffness[n:], 40.0 - 30.0 * np.exp(-alpha * rate * after), rtol=1e-9)


def test_what_is_not_used_teaches_nothing():
    rate = np.ones(100)
    use = np.arange(100) < 50
    stiffness, _, learnt = observed(np.where(use, 3.0, 1e9), rate, 10.0, use)
    np.testing.assert_allclose(stiffness, 3.0)
    assert np.ptp(learnt[50:]) == 0.0
    assert np.isnan(observed(rate, rate, 10.0, use & False)[0]).all()


def link_step(x, torque):
    """One sample by the implicit midpoint rule: q̈ = a u − b (q̇ + ½ T q̈)."""
    q, v, a, b = x
    acceleration = (a * torque - b * v) / (1 + b * T / 2)
    return np.array([q + T * v + T**2 / 2 * acceleration, v + T * acceleration, a, b])


def textbook(q, u, noise):
    """An extended Kalman filter in matrices, updates in Joseph's form (e.g. Bar-Shalom, Li, Kirubarajan 2001).

    The torque's noise acts through 1/I, whose square's expectation is that of the estimate and its variance.
    """
    x = np.array([q[0], 0.0, 0.0, 0.0])
    P = np.diag([noise.position, noise.velocity, noise.mobility, noise.decay]) ** 2
    Q = np.diag([0.0, 0.0, (noise.wander * noise.mobility) ** 2 * T, (noise.wander * noise.decay) ** 2 * T])
    H, one = np.array([[1.0, 0.0, 0.0, 0.0]]), np.eye(4)
    out = [x]
    for k in range(1, q.size):
        torque = 0.5 * (u[k - 1] + u[k])
        a, b = x[2:]
        # Derivatives of the step by differences of complex numbers, exact to rounding.
        F = np.column_stack([link_step(x + 1e-30j * one[i], torque).imag / 1e-30 for i in range(4)])
        accelerate = np.array([[T**2 / 2], [T], [0.0], [0.0]]) / (1 + b * T / 2)
        x = link_step(x, torque)
        P = F @ P @ F.T
        P_a = P[2, 2]
        P = P + Q + (a**2 + P_a) * noise.torque**2 * accelerate @ accelerate.T
        K = P @ H.T / (H @ P @ H.T + noise.position**2)
        x = x + K[:, 0] * (q[k] - x[0])
        P = (one - K @ H) @ P @ (one - K @ H).T + K @ K.T * noise.position**2
        out.append(x)
    return np.array(out)


def test_the_link_s_filter_is_the_textbook_s():
    rng = np.random.default_rng(3)
    t = np.arange(3000) * T
    u = 2.0 * np.sin(9.0 * t) + np.sin(23.0 * t)
    q = solve_ivp(
        lambda s, y: [y[1], (np.interp(s, t, u) - 0.3 * y[1]) / 0.04], (0.0, t[-1]), [0.1, 0.0], t_eval=t, rtol=1e-9, atol=1e-12
    ).y[0] + 1e-5 * rng.standard_normal(t.size)  # fmt: skip
    noise = LinkNoise(1e-5, 0.01, 5.0, 100.0, 100.0, 1e-4)
    x, P, _, _ = estimate_link(link_start(noise), q, u, T, noise, 1e4)
    np.testing.assert_allclose(x, textbook(q, u, noise), rtol=1e-6, atol=1e-8)
    a, b = x[-1, 2:]
    assert 1.0 / a == pytest.approx(0.04, rel=5e-3)
    assert b / a == pytest.approx(0.3, rel=2e-2)
    assert np.linalg.eigvalsh(P[-1]).min() > 0.0


def test_another_run_begins_elsewhere_with_the_same_link():
    t = np.arange(4000) * T
    u, noise = np.sin(12.0 * t), LinkNoise(1e-6, 1e-3, 5.0, 100.0, 100.0, 0.0)
    q = -np.sin(12.0 * t) / (0.05 * 144.0) + t / (0.05 * 12.0)
    _, _, _, state = estimate_link(link_start(noise), q, u, T, noise, 1e4)
    x, _, _, _ = estimate_link(restarted(state), q[:50] + 7.0, u[:50], T, noise, 1e4)
    assert x[0, 0] == pytest.approx(q[0] + 7.0)
    assert 1.0 / x[-1, 2] == pytest.approx(0.05, rel=1e-2)
    missing = np.full(20, np.nan)
    x, _, _, _ = estimate_link(state, missing, missing, T, noise, 1e4)
    assert np.isfinite(x).all()


def joint_log(path, inertia=0.03, damping=0.05, weight=0.4, noise=1.0):
    """A hardening spring, 60 N·m/rad and more, between a motor that is moved and a link that hangs: 12 s at 1 kHz."""
    rng = np.random.default_rng(0)
    t = np.arange(12_000) * T

    def theta(s):
        return 0.25 * np.sin(7.0 * s) + 0.2 * np.sin(2.3 * s)

    def spring(phi):
        return 60.0 * phi + 4000.0 * phi**3

    def motion(s, y):
        return [y[1], (-spring(y[0] - theta(s)) - damping * y[1] - weight * np.sin(y[0])) / inertia]

    q = solve_ivp(motion, (0.0, t[-1]), [0.0, 3.0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    phi = q - theta(t)
    step = noise * 2 * np.pi / 2**17 + 1e-12
    columns = {
        "time": t,
        "q": np.round(q / step) * step,
        "theta": np.round(theta(t) / step) * step,
        "torque": spring(phi) + noise * 0.005 * rng.standard_normal(t.size),
    }
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    rig = path.with_suffix(".rig.toml")
    rig.write_text(
        f"""[joint.arm]
kind = "elastic"
link = {{ inertia = {2 * inertia}, damping = 0.0, gravity_torque = {weight} }}
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "torque"
"""
    )
    return 60.0 + 12_000.0 * phi**2


def estimated(log, folder, *options):
    result = CliRunner().invoke(
        cli, ["estimate", str(log), "--estimator", "impedance", "--force", "-o", str(folder) + "/", "--json", *options]
    )
    assert result.exit_code == 0, result.output
    table = pq.read_table(folder / f"{log.stem}.stiffness.parquet").to_pydict()
    rows = [i for i, name in enumerate(table["transmission"]) if name == "total"]
    return {name: np.array([values[i] for i in rows], dtype=object) for name, values in table.items()}, json.loads(
        result.stdout
    )


def numbers(values):
    return np.array([np.nan if v is None else float(v) for v in values])


@pytest.mark.parametrize(
    ("options", "noise"),
    [((), 1.0), (("--tune", "derivative=difference"), 1e-4)],
    ids=["filter", "difference"],
)
def test_a_joint_s_impedance_is_found_without_any_motor_data(tmp_path, options, noise):
    """The rig says twice the inertia and no damping: neither is used. Differences are for signals with next to no noise."""
    true = joint_log(tmp_path / "arm.csv", noise=noise)
    trace, _ = estimated(tmp_path / "arm.csv", tmp_path, *options)
    excited = trace["excited"].astype(bool)
    assert excited.mean() > 0.9
    error, std = numbers(trace["stiffness"]) - true, numbers(trace["stiffness_std"])
    assert np.median(np.abs(error / true)[excited]) < 0.01
    assert np.mean(np.abs(error)[excited] < 2.0 * std[excited]) > 0.9
    assert np.median((std / true)[excited]) < 0.05
    late = slice(-1000, None)
    for name, value in (("link_inertia", 0.03), ("link_damping", 0.05)):
        found, deviation = numbers(trace[name])[late], numbers(trace[f"{name}_std"])[late]
        assert np.all(np.abs(found - value) < 3.0 * deviation), name
        assert np.all(deviation < 0.2 * value), name


def test_a_weight_that_the_rig_does_not_know_is_reported(tmp_path):
    joint_log(tmp_path / "arm.csv", weight=3.0)
    rig = tmp_path / "arm.rig.toml"
    rig.write_text(rig.read_text().replace("gravity_torque = 3.0", "gravity_torque = 0.0"))
    _, said = estimated(tmp_path / "arm.csv", tmp_path)
    assert "link.not_explained" in json.dumps(said) or "link.filter_restarted" in json.dumps(said)


def test_what_cannot_be_is_refused_in_words(tmp_path, run):
    joint_log(tmp_path / "arm.csv")
    wrong = run("estimate", "arm.csv", "--estimator", "impedance", "--tune", "filter=kinematic")
    assert wrong.returncode == 2
    assert "derivative=difference" in wrong.stderr
    rig = tmp_path / "arm.rig.toml"
    rig.write_text(rig.read_text().replace('torque_sensor = "torque"\n', ""))
    missing = run("estimate", "arm.csv", "--estimator", "impedance")
    assert missing.returncode == 2
    assert "torque_sensor" in missing.stderr
    assert not list(tmp_path.glob("*.parquet"))


def test_serio_s_simulated_experiment_is_met():
    """Fig. 4: 5.1 % for the stiffness, 6.7 % for the damping, 9.8 % for the inertia."""
    rig = awas_rig()
    common = Row(item="", paper="", place="", quantity="")
    rows = by_default(common, with_noise(simulated_by(rig, rig), [0]), PRINTED)
    assert len(rows) == 3
    for row in rows:
        assert row.ours.median <= row.printed, row.quantity


def swinging(period, count, noise=0.0, rest=0.0, inertia=0.05, damping=0.4, seed=0):
    """A link that rests for a while and is then swung, solved here: its position and the torque on it, with noise."""
    t, rng = np.arange(count) * period, np.random.default_rng(seed)

    def force(s):
        after = np.maximum(s - rest, 0.0)
        return 0.8 * np.sin(9.0 * after) + 0.5 * np.sin(23.0 * after)

    def motion(s, y):
        return [y[1], (force(s) - damping * y[1]) / inertia]

    q = solve_ivp(motion, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=period).y[0]
    return q + 1e-5 * rng.standard_normal(count), force(t) + noise * rng.standard_normal(count)


def test_a_link_at_rest_does_not_teach_that_nothing_moves_it():
    """What is noise of the torque would otherwise be taken for a torque that leaves the link where it is."""
    q, u = swinging(T, 6000, noise=0.05, rest=3.0)
    q = np.round(q / 2e-4) * 2e-4
    noise = LinkNoise(6e-5, 0.05, 5.0, 200.0, 200.0, 1e-4)
    x, P, excess, _ = estimate_link(link_start(noise), q, u, T, noise, 1e4)
    a, std = x[-1, 2], np.sqrt(P[-1, 2, 2])
    assert abs(a - 20.0) < 3.0 * std
    assert 1.0 / a == pytest.approx(0.05, rel=0.03)
    assert excess[-1] < 2.0


def test_few_samples_of_a_damped_link_are_enough():
    """At 40 Hz N/I = 8 1/s slows the link by a fifth within a sample."""
    q, u = swinging(0.025, 800)
    noise = LinkNoise(1e-5, 1e-4, 5.0, 200.0, 200.0, 0.0)
    x, _, _, _ = estimate_link(link_start(noise), q, u, 0.025, noise, 1e4)
    assert 1.0 / x[-1, 2] == pytest.approx(0.05, rel=0.04)
    assert x[-1, 3] / x[-1, 2] == pytest.approx(0.4, rel=0.04)


def test_a_filter_that_came_to_something_impossible_begins_again():
    """A torque of the wrong sign: 1/I would be negative."""
    q, u = swinging(T, 6000)
    noise = LinkNoise(1e-5, 0.01, 5.0, 200.0, 200.0, 1e-4)
    x, _, excess, state = estimate_link(link_start(noise), q, -u, T, noise, 1e4)
    assert state.last[3] > 3
    assert np.isinf(excess[-1])
    assert np.isnan(x).any(axis=1).sum() == state.last[3]


def swung_log(path, q, u, period, seed=0):
    """A log of a link that swings, and the rig that goes with it."""
    t = np.arange(q.size) * period
    theta = 0.3 * np.sin(2.0 * t) + 1e-5 * np.random.default_rng(seed).standard_normal(q.size)
    columns = {"time": t, "q": q, "theta": theta, "torque": -u}
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    path.with_suffix(".rig.toml").write_text(
        """[joint.arm]
kind = "elastic"
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "torque"
"""
    )


@pytest.mark.parametrize("seed", range(4))
def test_what_the_torque_s_noise_bends_is_reported(tmp_path, seed):
    """A torque sensor half as noisy as the torque: the inertia comes out too large, and roughly by how much is reported."""
    q, u = swinging(0.01, 1500, noise=0.25, seed=seed)
    swung_log(tmp_path / "arm.csv", q, u, 0.01, seed)
    trace, _ = estimated(tmp_path / "arm.csv", tmp_path)
    inertia, std = numbers(trace["link_inertia"])[-1], numbers(trace["link_inertia_std"])[-1]
    assert inertia > 1.02 * 0.05
    assert abs(inertia - 0.05) < 2.5 * std


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("turn", "told"), [(40_000, True), (2000, True), (500, None), (200, None), (90, False), (40, False)]
)
def test_an_encoder_s_steps_are_no_motion_of_the_link(tmp_path, turn, told):
    """Steps that are taken one by one pass for accelerations, and the inertia would come out many times too small."""
    q, u = swinging(T, 8000, noise=0.005)
    step = 2.0 * np.pi / turn
    swung_log(tmp_path / "arm.csv", np.round(q / step) * step, u, T)
    trace, said = estimated(tmp_path / "arm.csv", tmp_path)
    for name, true in (("link_inertia", 0.05), ("link_damping", 0.4)):
        found, std = numbers(trace[name])[-1], numbers(trace[f"{name}_std"])[-1]
        assert told is None or np.isfinite(found) == told, name
        assert not abs(found - true) > 2.5 * std, name
    if told is False:
        assert re.search(r"link\.(estimate_biased|not_explained|filter_restarted)", json.dumps(said))


def test_steps_that_a_square_wave_repeats_are_in_the_deviations(tmp_path):
    """A link on a spring that is known, between two levels of a few steps: where they lie moves I and N by several per cent."""
    period, step, off = 5e-3, 2.0 * np.pi / 200, []
    t = np.arange(4000) * period

    def pushed(s):
        return 0.15 * np.clip(5.0 * np.sin(np.pi * s), -1.0, 1.0)

    def motion(s, y):
        return [y[1], (pushed(s) - 0.4 * y[1] - 1.5 * y[0]) / 0.05]

    q = solve_ivp(motion, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=period).y[0]
    u = pushed(t) - 1.5 * q + 0.01 * np.random.default_rng(0).standard_normal(t.size)
    for shift in np.arange(6) / 6:
        swung_log(tmp_path / "arm.csv", np.round(q / step + shift) * step, u, period)
        trace, _ = estimated(tmp_path / "arm.csv", tmp_path)
        for name, true in (("link_inertia", 0.05), ("link_damping", 0.4)):
            off.append((numbers(trace[name])[-1] - true) / numbers(trace[f"{name}_std"])[-1])
    assert np.isfinite(off).sum() >= 8
    assert np.nanmax(np.abs(off)) < 3.0
