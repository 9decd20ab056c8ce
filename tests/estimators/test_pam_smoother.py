"""pam-smoother against textbook smoothers, the truth of simulations, and logs with holes."""

from dataclasses import replace as with_fields

import msgspec
import numpy as np
import pytest

from vsalog.estimation.joint import choose, estimate_joint
from vsalog.estimators.pam_linear import LinearPamFold
from vsalog.estimators.pam_noise import PamNoise, pam_noise
from vsalog.estimators.pam_states import PamFold, pam_transition
from vsalog.estimators.spool import Spool
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

pytestmark = pytest.mark.share(2)

RIG = Rig.preset("pam").file
JOINT = RIG.joint["pam"]
SENSOR = 500.0


def noisy(seed=0, duration=8.0, joint=JOINT):
    rig = msgspec.structs.replace(RIG, joint={"pam": joint})
    return simulate(rig, Scenario.find("pam-exp1", rig).inputs(rig), duration, seed=seed)


def noise_for(joint, period):
    return pam_noise(joint, period, (4.5e5, 4.5e5), (SENSOR, SENSOR))


def pressures_and_valves(count, missing=True):
    """Return pressures that wander, some of them missing, and valves that jump, some commands missing for long."""
    rng = np.random.default_rng(4)
    z = 4.5e5 + np.cumsum(2e3 * rng.normal(size=(count, 2)), axis=0)
    u = np.repeat(rng.uniform(4.5, 6.5, (count // 50 + 1, 2)), 50, axis=0)[:count]
    if missing:
        z[rng.random((count, 2)) < 0.2] = np.nan
        z[60:80] = np.nan
        u[100:140, 1] = np.nan
    z[0] = 4.5e5
    return z, u


def filtered_and_smoothed(fold, z, u):
    """Return the filter's means and covariances, the smoother's, and what acted."""
    before = fold.start()
    acting, _ = fold.acting(before, len(z), u[:, 0], u[:, 1], None)
    _, trace = fold.block(before, z[:, 0], z[:, 1], u[:, 0], u[:, 1])
    x, S = trace.x.copy(), trace.S.copy()
    fold.smooth(x, S, acting, np.arange(len(z)) < len(z) - 1, np.empty(4), np.empty((4, 4)))
    return (trace.x, trace.S @ trace.S.transpose(0, 2, 1)), (x, S @ S.transpose(0, 2, 1)), acting


def process_noise(noise, acting):
    flows = np.where(np.isnan(acting[:2]), noise.unknown_flow, noise.process[:2])
    return np.diag(np.array([*flows, *noise.process[2:]]) ** 2)


def agree(found, expected, tolerance):
    """Means by their deviations, covariances by theirs."""
    deviation = np.sqrt(np.einsum("nii->ni", expected[1]))
    off = np.abs(found[0] - expected[0]) / deviation
    assert off.max() < tolerance, off.max()
    scale = deviation[:, :, None] * deviation[:, None, :]
    assert (np.abs(found[1] - expected[1]) / scale).max() < tolerance


@pytest.mark.parametrize(("period", "steps"), [(1e-3, 1), (4e-3, 4)])
def test_for_a_linear_model_it_is_the_kalman_smoother(period, steps):
    """Rauch, Tung, Striebel (1965): P_s = P_k + D (P_s' − P') Dᵀ, D = P_k Aᵀ P'⁻¹, over the model's steps at once."""
    noise = noise_for(JOINT, period)
    fold = LinearPamFold(JOINT, period, noise, (4.5e5, 4.6e5))
    assert fold.steps == steps
    z, u = pressures_and_valves(200)
    (x, P), smoothed, acting = filtered_and_smoothed(fold, z, u)
    xs, Ps = x.copy(), P.copy()
    for k in range(len(z) - 2, -1, -1):
        m, A, ahead = x[k], np.eye(4), P[k]
        for _ in range(steps):
            m = fold.at + fold.A @ (m - fold.at) + fold.B @ np.nan_to_num(acting[k] - fold.held_by)
            A = fold.A @ A
            ahead = fold.A @ ahead @ fold.A.T + process_noise(noise, acting[k]) / steps
        D = np.linalg.solve(ahead, A @ P[k]).T
        xs[k] = x[k] + D @ (xs[k + 1] - m)
        Ps[k] = P[k] + D @ (Ps[k + 1] - ahead) @ D.T
    agree(smoothed, (xs, Ps), 1e-9)


def unscented(mean, P, function):
    """Return the 2 n sigma points of κ = 0 and what a function makes of them, as rows."""
    steps = np.sqrt(len(mean)) * np.linalg.cholesky(P).T
    points = np.vstack([mean + steps, mean - steps])
    return points, np.array([function(point) for point in points])


def test_a_nonlinear_model_is_smoothed_by_the_equations_of_the_paper():
    """Särkkä 2008 in covariances, with κ = 0 and a step of the joint's model."""
    noise = noise_for(JOINT, 1e-3)
    fold = PamFold(JOINT, 1e-3, noise)
    z, u = pressures_and_valves(120)
    (x, P), smoothed, acting = filtered_and_smoothed(fold, z, u)

    def step(state, k):
        Y = np.empty((4, 1))
        pam_transition(state.reshape(4, 1).copy(), 0, acting[k], fold._model, Y)
        return Y[:, 0]

    xs, Ps = x.copy(), P.copy()
    for k in range(len(z) - 2, -1, -1):
        points, moved = unscented(x[k], P[k], lambda state, k=k: step(state, k))
        m = moved.mean(axis=0)
        ahead = (moved - m).T @ (moved - m) / 8.0 + process_noise(noise, acting[k])
        C = (points - x[k]).T @ (moved - m) / 8.0
        D = np.linalg.solve(ahead, C.T).T
        xs[k] = x[k] + D @ (xs[k + 1] - m)
        Ps[k] = P[k] + D @ (Ps[k + 1] - ahead) @ D.T
    agree(smoothed, (xs, Ps), 1e-6)


def test_a_state_that_is_known_exactly_stays_so_and_the_others_do_not_mind():
    """A joint that is held: its angle has no variance, so the pressures are smoothed as if they were alone."""
    held = msgspec.structs.replace(JOINT, seesaw=msgspec.structs.replace(JOINT.seesaw, held_at=0.0))
    noise = noise_for(held, 1e-3)
    fold = PamFold(held, 1e-3, noise)
    z, u = pressures_and_valves(200)
    (_, P), (xs, Ps), acting = filtered_and_smoothed(fold, z, u)
    np.testing.assert_array_equal(xs[:, 2:], np.broadcast_to([0.0, 0.0], (200, 2)))
    np.testing.assert_array_equal(Ps[:, 2:], 0.0)
    for i in range(2):
        for k in range(198, -1, -1):
            # In a millisecond a deviation of the pressure hardly changes by what flows.
            ahead = P[k, i, i] + process_noise(noise, acting[k])[i, i]
            expected = P[k, i, i] + (P[k, i, i] / ahead) ** 2 * (Ps[k + 1, i, i] - ahead)
            assert Ps[k, i, i] == pytest.approx(expected, rel=0.02), (i, k)


def test_a_velocity_that_friction_stops_tells_nothing_of_what_it_was():
    noise = PamNoise((SENSOR, SENSOR), (100.0, 100.0, 0.0, 0.0), (1e4, 1e4), (1e-3, 1e-2))
    z, u = np.full((20, 2), 4.5e5), np.full((20, 2), 5.5)
    (_, P), (_, Ps), _ = filtered_and_smoothed(PamFold(JOINT, 1e-3, noise), z, u)
    assert P[1, 3, 3] == 0.0
    assert Ps[0, 3, 3] == pytest.approx(P[0, 3, 3], rel=1e-3)


def estimated(recording, estimator, block=None, joint=JOINT):
    choice = choose("pam", joint, estimator, {})
    given = {} if block is None else {"block": block}
    return estimate_joint([recording], "pam", joint, choice, **given)


@pytest.fixture(scope="module")
def log():
    return noisy()


@pytest.fixture(scope="module")
def recording(log):
    return log.recording()


@pytest.fixture(scope="module")
def both(recording):
    return {name: estimated(recording, name).trace["total"] for name in ("pam-ukf", "pam-smoother")}


TRUTHS = {"link_position": "link_position", "flexibility_torque": "transmission_torque", "stiffness": "stiffness"}


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(("column", "truth"), TRUTHS.items())
def test_it_is_nearer_to_the_truth_than_the_filter_and_says_so(both, log, column, truth):
    off = {name: trace[column] - log.truth[truth] for name, trace in both.items()}
    std = {name: trace[f"{column}_std"] for name, trace in both.items()}
    assert rms(off["pam-smoother"]) < 0.8 * rms(off["pam-ukf"])
    assert rms(std["pam-smoother"]) < 0.8 * rms(std["pam-ukf"])
    held = np.mean(np.abs(off["pam-smoother"]) < 1.96 * std["pam-smoother"])
    assert held > 0.92
    assert 0.6 < rms(off["pam-smoother"] / std["pam-smoother"]) < 1.2


def test_the_last_sample_is_the_filter_s_and_no_deviation_is_larger(both):
    filtered, smoothed = both["pam-ukf"], both["pam-smoother"]
    for name in ("link_position", "link_velocity", "pressure_1", "pressure_2"):
        assert smoothed[name][-1] == filtered[name][-1]
        assert (smoothed[f"{name}_std"][1:] <= filtered[f"{name}_std"][1:] * (1.0 + 1e-3)).all(), name


def changed(recording, role, change):
    channel = getattr(JOINT.signals, role)
    channel = channel if isinstance(channel, str) else channel.channel
    old = recording.channels[channel]
    return with_fields(
        recording, channels={**recording.channels, channel: with_fields(old, values=change(old.values.copy()))}
    )


def lose(first, last):
    def change(values):
        values[first:last] = np.nan
        return values

    return change


def test_a_missing_pressure_is_bridged_from_both_sides(recording, both, log):
    lossy = changed(recording, "pressure_1", lose(3000, 3400))
    found = {name: estimated(lossy, name).trace["total"] for name in both}
    there = slice(3000, 3400)
    off = {name: trace["pressure_1"][there] - log.truth["pressure_1"][there] for name, trace in found.items()}
    assert rms(off["pam-smoother"]) < 0.8 * rms(off["pam-ukf"])
    std = {name: trace["pressure_1_std"] for name, trace in found.items()}
    assert std["pam-smoother"][3399] < 0.5 * std["pam-ukf"][3399]
    assert std["pam-smoother"][3200] > 2.0 * both["pam-smoother"]["pressure_1_std"][3200]


def test_nothing_is_carried_over_a_gap(recording):
    """The last sample before a gap is the filter's, as at the end of a log, and no other."""
    begin = min(c.stamps[0] for c in recording.channels.values())

    def outside(channel):
        kept = (channel.stamps < begin + 4 * 10**9) | (channel.stamps >= begin + 5 * 10**9)
        return with_fields(channel, stamps=channel.stamps[kept], values=channel.values[kept])

    gapped = with_fields(recording, channels={name: outside(c) for name, c in recording.channels.items()})
    filtered, smoothed = (estimated(gapped, name).trace["total"]["pressure_1"] for name in ("pam-ukf", "pam-smoother"))
    np.testing.assert_array_equal(np.flatnonzero(filtered == smoothed), [3999, len(filtered) - 1])


def test_blocks_of_any_size_give_the_same_bits(recording, both, monkeypatch):
    backwards = Spool.backwards
    monkeypatch.setattr(Spool, "backwards", lambda spool: backwards(spool, 101))
    cut = estimated(recording, "pam-smoother", block=997).trace["total"]
    for column, values in both["pam-smoother"].items():
        np.testing.assert_array_equal(cut[column], values, err_msg=column)


def test_where_the_filter_has_lost_the_joint_nothing_is_reported(recording):
    signals = JOINT.signals
    crossed = msgspec.structs.replace(
        JOINT, signals=msgspec.structs.replace(signals, valve_1=signals.valve_2, valve_2=signals.valve_1)
    )
    filtered, smoothed = (estimated(recording, name, joint=crossed) for name in ("pam-ukf", "pam-smoother"))
    assert "pressure.not_explained" in {f.code for f in smoothed.findings}
    lost = np.isnan(filtered.trace["total"]["stiffness"])
    assert lost.mean() > 0.5
    assert np.isnan(smoothed.trace["total"]["stiffness"][lost]).all()
    last = np.flatnonzero(~lost[:-1] & lost[1:])
    assert last.size
    for name in ("link_position", "pressure_1_std"):
        np.testing.assert_array_equal(smoothed.trace["total"][name][last], filtered.trace["total"][name][last])
