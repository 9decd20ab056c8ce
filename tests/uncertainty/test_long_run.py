"""What noise makes of a fit: Monte Carlo against noises of every colour, and the wavelets against their definition."""

import numpy as np
import pytest
from scipy.signal import lfilter

from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.rls import RlsState, rls_block
from vsalog.uncertainty.long_run import long_run_block, long_run_covariance, long_run_start

pytestmark = pytest.mark.share(2)

SAMPLES = 3000


def fitted(F, y, e, *, integral=False, fresh=None, forgetting=1.0):
    """Return the last estimate of eᵀ ξ and its standard deviation."""
    count, n = F.shape
    use, fresh = np.ones(count, dtype=bool), np.zeros(count, dtype=bool) if fresh is None else fresh
    E = np.broadcast_to(e, (count, 1, n)).copy()
    out = qr_block(QrState.start(n), F, y, use, fresh, E, np.ones(1, dtype=bool), forgetting)
    variance = long_run_block(long_run_start(n), F, y, out[5], use, fresh, out[2], integral, forgetting)[1]
    return out[1][-1, 0], np.sqrt(variance[-1, 0])


def slow_motion(rng, count=SAMPLES, cycles=6.0):
    """Regressors as a joint's: a few slow sines and their cubes."""
    t = np.arange(count) / count * cycles / 6.0
    x = sum(
        a * np.sin(2.0 * np.pi * f * t + p)
        for a, f, p in zip((1.0, 0.5), (6.0, 9.7), rng.uniform(0, 6, 2), strict=True)
    )
    return np.stack([x, x**3], axis=1)


def coloured(kind, rng, count=SAMPLES):
    e = rng.normal(size=count + 200)
    if kind == "AR(1)":
        e = lfilter([1.0], [1.0, -0.9], e)
    elif kind == "smooth":  # as a Savitzky–Golay filter leaves it: neighbours almost equal, yet soon forgotten
        e = lfilter(np.hanning(40), [1.0], e)
    elif kind == "differentiated":  # an encoder's noise in a torque: twice, then smoothed
        e = lfilter(np.hanning(20), [1.0], np.diff(e, 2, append=[0.0, 0.0]))
    return e[200:]


@pytest.mark.parametrize("kind", ["white", "AR(1)", "smooth", "differentiated"])
def test_the_uncertainty_covers_the_truth_whatever_the_colour(kind):
    """Monte Carlo: two standard deviations cover about 95 % and are no wider than need be."""
    rng, truth, e = np.random.default_rng(10), np.array([1.0, -2.0]), np.array([1.0, 1.0])
    z = []
    for _ in range(150):
        F = slow_motion(rng)
        value, std = fitted(F, F @ truth + 0.3 * coloured(kind, rng), e)
        z.append((value - e @ truth) / std)
    assert np.mean(np.abs(z) < 1.96) >= 0.90
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_noise_that_lasts_a_thousand_samples_is_in_some_octave():
    """Seven octaves end at that length, and what lies beyond is only guessed from them."""
    rng, z, count, lasting = np.random.default_rng(22), [], 2**17, 1000
    for _ in range(60):
        F = np.sin(2.0 * np.pi * np.arange(count) / 20_000 + rng.uniform(0, 6))[:, None]
        noise = lfilter([1.0], [1.0, -np.exp(-1.0 / lasting)], rng.normal(size=count + 10 * lasting))[10 * lasting :]
        value, std = fitted(F, F[:, 0] + noise, np.ones(1))
        z.append((value - 1.0) / std)
    assert np.mean(np.abs(z) < 1.96) >= 0.90
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_noise_that_comes_with_the_motion_is_not_averaged_over_the_rests():
    """Jerks between rests, with errors that only the jerks have: spread over the whole log these would look small."""
    rng, truth, e, count, z = np.random.default_rng(16), np.array([1.0, -2.0]), np.array([1.0, 1.0]), 30_000, []
    for _ in range(60):
        at = rng.uniform(100, count - 100, (100, 1))
        jerks = np.exp(-0.5 * ((np.arange(count) - at) / 20.0) ** 2).sum(axis=0)
        F = slow_motion(rng, count, cycles=600.0) * (jerks + 1e-3)[:, None]
        noise = 0.1 * coloured("smooth", rng, count) * jerks + 0.002 * rng.normal(size=count)
        value, std = fitted(F, F @ truth + noise, e)
        z.append((value - e @ truth) / std)
    assert np.mean(np.abs(z) < 1.96) >= 0.90
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_noise_that_wanders_is_computed_from_its_increments():
    """An integrated equation: white noise of a torque becomes a random walk, next to a constant that begins again."""
    rng, truth, z, naive = np.random.default_rng(11), np.array([3.0, 1.0, -2.0]), [], []
    fresh = np.arange(SAMPLES) == 1800
    for _ in range(150):
        F = np.hstack([np.ones((SAMPLES, 1)), slow_motion(rng)])
        walk = np.cumsum(0.05 * rng.normal(size=SAMPLES))
        y = F @ truth + walk + np.where(np.arange(SAMPLES) >= 1800, 7.0 - walk[1800], 0.0)
        value, std = fitted(F, y, np.array([0.0, 1.0, 1.0]), integral=True, fresh=fresh)
        z.append((value + 1.0) / std)
        naive.append((value + 1.0) / fitted(F, y, np.array([0.0, 1.0, 1.0]), fresh=fresh)[1])
    assert np.mean(np.abs(z) < 1.96) >= 0.90
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.mean(np.abs(naive) < 1.96) < 0.9


def test_forgetting_leaves_the_noise_of_what_is_remembered():
    """With λ a mean is that of the last 1/(1 − λ²) samples or so: its variance is (1 − λ²)/(1 + λ²) of a sample's."""
    rng, forgetting = np.random.default_rng(12), 0.999
    F = np.ones((20000, 1))
    std = fitted(F, rng.normal(size=20000), np.ones(1), forgetting=forgetting)[1]
    discount = forgetting**2
    assert std == pytest.approx(np.sqrt((1.0 - discount) / (1.0 + discount)), rel=0.25)


def test_no_energy_is_lost_between_the_octaves():
    """In white noise of variance one the score's covariance is the regressors' energy."""
    rng, ratios, others, count = np.random.default_rng(13), [], [], 65536
    use = np.ones(count, dtype=bool)
    for _ in range(20):
        F, left = slow_motion(rng, count, cycles=100.0), rng.normal(size=count)
        state = long_run_block(long_run_start(2), F, left, left, use, ~use, np.zeros((count, 1, 2)), False, 1.0)[0]
        energy = state.energy[0, -1]
        np.testing.assert_allclose(energy, F.T @ F, rtol=1e-3)
        assert np.linalg.eigvalsh(energy - state.energy[0, :-1].sum(axis=0)).min() > -1e-9 * energy.max()
        M, uneven, variance = long_run_covariance(state, False)
        assert variance == pytest.approx(np.mean(left**2))
        ratios.append(np.diag(M) / np.diag(energy))
        others.append(np.diag(uneven) / np.diag(energy))
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.mean(others) == pytest.approx(1.0, abs=0.2)


def test_nothing_is_reported_of_a_few_samples():
    F, y = np.ones((60, 1)), np.random.default_rng(14).normal(size=60)
    assert np.isnan(fitted(F, y, np.ones(1))[1])


def test_an_exact_fit_has_no_spread():
    F = slow_motion(np.random.default_rng(15))
    assert fitted(F, F @ np.array([1.0, 2.0]), np.ones(2))[1] < 1e-9


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_the_noise_is_observed_alike_in_blocks(size):
    rng = np.random.default_rng(3)
    F, left, T = rng.normal(size=(2000, 3)), rng.normal(size=2000), rng.normal(size=(2000, 2, 3))
    F[:, 0], y = 1.0, rng.normal(size=2000)
    use, fresh = np.ones(2000, dtype=bool), np.arange(2000) == 700
    use[50:80] = False
    whole = long_run_block(long_run_start(3), F, y, left, use, fresh, T, True, 0.999)[1]
    state, parts = long_run_start(3), []
    for k in range(0, left.size, size):
        s = slice(k, k + size)
        state, variance = long_run_block(state, F[s], y[s], left[s], use[s], fresh[s], T[s], True, 0.999)
        parts.append(variance)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_rls_and_qr_say_the_same():
    """But for the first samples, which QR-RLS only sets its triangle up with."""
    rng, n = np.random.default_rng(16), 2
    F = slow_motion(rng)
    y = F @ np.ones(n) + rng.normal(size=SAMPLES)
    use, E = np.ones(SAMPLES, dtype=bool), np.ones((SAMPLES, 1, n))
    out = rls_block(RlsState.start(n, 1e9), F, y, use, E, np.ones(1, dtype=bool), 1.0, 1e9)
    variance = long_run_block(long_run_start(n), F, y, out[5], use, ~use, out[2], False, 1.0)[1]
    assert np.sqrt(variance[-1, 0]) == pytest.approx(fitted(F, y, np.ones(n))[1], rel=0.01)


def test_what_is_not_known_of_even_noise_is_not_known_of_uneven_noise_either():
    """Rounding may make a variance that nothing tells negative; that is no certainty, whatever the stretches say."""
    rng, count = np.random.default_rng(21), 2000
    F, left, use = rng.normal(size=(count, 2)), rng.normal(size=count), np.ones(count, dtype=bool)
    state = long_run_block(long_run_start(2), F, left, left, use, ~use, np.zeros((count, 1, 2)), False, 1.0)[0]
    nothing = state._replace(found=np.stack((-np.eye(2), np.zeros((2, 2)))))
    told = long_run_block(nothing, F[:1], left[:1], left[:1], ~use[:1], ~use[:1], np.ones((1, 1, 2)), False, 1.0)[1]
    assert np.isnan(told).all()
