"""The equations made straight: columns against differences by hand, estimates against the truth where regressors are noisy."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from written_out import Truth, channels, joint_of

from vsalog.diagnosis.causes.base import Parameter, Site, with_part
from vsalog.diagnosis.discrepancy import left_out
from vsalog.diagnosis.linear import Linear, Variant, candidates_of, clash, corrected, linearised, placed, variants_of
from vsalog.diagnosis.selection import remainder, sites_of
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

N, COPIES = 4000, 4


@dataclass
class Lines:
    """Stands for a system of one equation, x · slopes − y, whose regressors x are noisy; the "joint" is the slopes."""

    x: np.ndarray
    y: np.ndarray
    noisy: tuple = ()
    size: float = 1.0

    names = ("line",)
    covariance = np.eye(1)

    @property
    def weights(self):
        return np.ones((self.y.size, 1))

    @property
    def pattern(self):
        return np.ones(self.y.size, dtype=np.int64)

    @property
    def whiteners(self):
        return {1: np.eye(1) / self.size}

    def whole_delays(self, joint):
        return {}

    def averaged(self, joint):
        return (self.x @ np.array(joint) - self.y)[:, None]

    def white(self, rows):
        return rows / self.size


def lines(seed, truth, noise, about=0.1):
    """Data whose regressors and answers carry noise, and copies that carry it twice; `noise` is the regressors' [1]."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((N, len(truth))) @ np.array([[1.0, 0.5], [0.0, 1.0]])
    y = x @ np.array(truth)

    def sensed(x, y):
        # The same sensor is in the second regressor and in the answer.
        e = noise * rng.standard_normal(x.shape)
        return x + e, y + about * rng.standard_normal(y.size) + 0.5 * e[:, 1]

    xm, ym = sensed(x, y)
    copies = tuple(Lines(*sensed(xm, ym)) for _ in range(COPIES))
    size = float(np.hypot(about, noise))
    return Lines(xm, ym, tuple(replace(c, size=size) for c in copies), size)


def slope(index):
    """A cause that changes one slope, which the rig has at 1; a far stop and no tie to the rig."""

    def apply(joint, values):
        return (*joint[:index], float(values[0]), *joint[index + 1 :])

    name = ("motor.inertia", "motor.viscous_friction")[index]
    return Site(name, "motor", (Parameter("value", "1", 1.0, 1e-3),), apply)


def estimate(system, fit=()):
    variants = [replace(v, deviation=np.array([100.0])) for v in loose(fit)]
    linear = linearised(system, (1.0, 1.0), fit, variants)
    c = candidates_of(linear, system)
    both = np.ones(2, dtype=bool)
    covariance = np.linalg.inv(np.eye(2) + c.information) * 100.0**2
    return 1.0 + 100.0 * c.solution(both), covariance, linear


def loose(fit):
    """Variants of the two slopes, made by hand: the prior of a number that no rig has is none of the catalogue's."""
    held = {site.key: values for site, values in fit}
    out = []
    for site in (slope(0), slope(1)):
        base = held.get(site.key, np.array([1.0]))
        inside = site.key in held
        out.append(Variant(site, base, base[None, :] + 1e-3, (0,), np.ones(1), np.ones(1), 1.0, inside))
    return out


TRUTH = (2.0, -1.5)


def test_noisy_regressors_do_not_attenuate_the_estimate():
    """Least squares shrink a slope by the noise's part of its regressor; corrected, the mean over many logs is the truth."""
    corrected, plain, told = [], [], []
    for seed in range(60):
        system = lines(seed, TRUTH, noise=0.3)
        values, covariance, _ = estimate(system)
        corrected.append(values)
        told.append(np.sqrt(np.diag(covariance)))
        plain.append(np.linalg.lstsq(system.x, system.y)[0])
    corrected, plain = np.array(corrected), np.array(plain)
    sure = 4.0 * corrected.std(axis=0) / np.sqrt(60)
    assert np.all(np.abs(corrected.mean(axis=0) - TRUTH) < sure)
    assert np.all(np.abs(plain.mean(axis=0) - TRUTH) > 3.0 * sure)
    assert np.all(np.abs(plain.mean(axis=0) - TRUTH) > 0.03 * np.abs(TRUTH))


def test_what_is_left_of_blocks_that_were_not_seen_is_all_of_the_noise():
    """Least squares make a prediction from noisy regressors small by shrinking it; corrected, its error is the true slopes'."""
    noise, about = 1.0, 0.1
    found, plain = [], []
    for seed in range(20):
        system, blocks = lines(seed, TRUTH, noise, about), np.arange(N) * 8 // N
        linear = estimate(system)[2]
        found.append(np.mean(left_out(linear, system, np.ones(2, dtype=bool), blocks) ** 2))
        plain.append(np.mean((system.y - system.x @ np.linalg.lstsq(system.x, system.y)[0]) ** 2))
    expected = noise**2 * (TRUTH[0] ** 2 + (TRUTH[1] - 0.5) ** 2) + about**2
    assert np.mean(found) == pytest.approx(expected, rel=0.03)
    assert np.mean(plain) < 0.6 * expected


def test_without_noise_in_the_regressors_it_is_least_squares():
    system = lines(3, TRUTH, noise=0.0)
    expected = np.linalg.lstsq(system.x, system.y)[0]
    # The noise of the answers, drawn once more, is all that the correction has to say.
    np.testing.assert_allclose(estimate(system)[0], expected, atol=3e-3)
    exact = replace(system, noisy=(system,))
    np.testing.assert_allclose(estimate(exact)[0], expected, atol=1e-6)


def test_noise_alone_is_no_information():
    """Regressors of nothing but noise say nothing of a slope, however many there are."""
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((N, 2)), rng.standard_normal(N)
    copies = tuple(Lines(x + rng.standard_normal((N, 2)), y + rng.standard_normal(N)) for _ in range(COPIES))
    c = candidates_of(linearised(Lines(x, y, copies), (1.0, 1.0), (), loose(())), Lines(x, y, copies))
    # Corrected, what is left of N rows is the sampling error of a difference of sums, squared.
    assert np.trace(c.information) < 0.01 * N


def test_columns_that_are_rounding_where_their_noise_is_not_say_nothing():
    """As of causes that act only where rows are left out: the information of the others is what it is without them."""
    rng = np.random.default_rng(0)
    sizes = np.r_[np.ones(20), np.full(5, 1e-15)]
    columns = rng.standard_normal((N, 1, 25)) @ (np.eye(25) + 0.3 * rng.standard_normal((25, 25))) * sizes
    noise = rng.standard_normal((2, N, 1, 25)) * np.r_[np.full(20, 0.3), np.ones(5)]
    noise[..., 20:] -= (
        noise[..., :20] @ np.linalg.lstsq(noise[..., :20].reshape(-1, 20), noise[..., 20:].reshape(-1, 5))[0]
    )

    def information(own):
        linear = Linear((), np.arange(26), np.zeros(25)[own], rng.standard_normal((N, 1)), columns[..., own],
                        noise[..., own], np.zeros((2, N, 1)))  # fmt: skip
        found = corrected(linear, Lines(np.zeros((N, 2)), np.zeros(N)))
        calibrated = found.columns @ found.calibration
        return calibrated.T @ calibrated

    np.testing.assert_allclose(information(slice(25))[:20, :20], information(slice(20)), rtol=1e-6, atol=1e-6 * N)


def test_the_fit_that_the_equations_are_made_straight_about_does_not_matter():
    """They are straight: from wherever they are extrapolated, the estimate is the same."""
    system = lines(4, TRUTH, noise=0.3)
    here, _, linear = estimate(system)
    fit = ((slope(0), np.array([4.0])), (slope(1), np.array([-3.0])))
    there, _, other = estimate(system, fit)
    np.testing.assert_allclose(there, here, atol=1e-8)
    np.testing.assert_allclose(other.residual, linear.residual, atol=1e-9)
    np.testing.assert_allclose(other.now * 100.0, [3.0, -4.0])


@cache
def elastic():
    """A log of the joint as the rig has it: system, joint, setting and the residual."""
    found, joint = channels(duration=6.0, seed=1).thinned(), joint_of()
    system = build_system(joint, found, balance_for(joint))
    setting = setting_of(joint, system)
    return system, joint, setting, remainder(system, joint)


def sites():
    return sites_of(elastic()[2], frozenset())


def site(cause, parameters=1):
    return next(s for s in sites() if s.cause == cause and len(s.parameters) == parameters)


def test_columns_are_derivatives_of_the_averaged_equations():
    """By hand: the rig's numbers a little more and a little less, in units of the prior."""
    system, joint, setting, left = elastic()
    own = [site(c) for c in ("motor.inertia", "link.gravity", "transmission.stiffness", "transmission.nonlinearity")]
    variants = variants_of(own, setting, left, (), {})
    linear = linearised(system, joint, (), variants)
    k, kk = joint.transmission.stiffness, joint.transmission.cubic
    moves = [
        lambda d: with_part(joint, "motor", inertia=joint.motor.inertia + d),
        lambda d: with_part(joint, "link", gravity_torque=joint.link.gravity_torque + d),
        lambda d: with_part(joint, "transmission", stiffness=k * (1.0 + d), cubic=kk * (1.0 + d)),
        lambda d: with_part(joint, "transmission", added_cubic=d),
    ]
    for g, (move, small) in enumerate(zip(moves, (1e-4, 1e-3, 1e-4, 1e-2), strict=True)):
        by_hand = (system.averaged(move(small)) - system.averaged(move(-small))) / (2 * small)
        np.testing.assert_allclose(
            linear.columns[..., g], by_hand * variants[g].deviation[0], atol=1e-6 * np.abs(by_hand).max() + 1e-9
        )
        for copy, columns in zip(system.noisy, linear.noise_columns, strict=True):
            more = (copy.averaged(move(small)) - copy.averaged(move(-small))) / (2 * small) - by_hand
            np.testing.assert_allclose(
                columns[..., g], more * variants[g].deviation[0], atol=1e-5 * np.abs(more).max() + 1e-9
            )
    np.testing.assert_allclose(linear.residual, system.averaged(joint), atol=1e-12)
    np.testing.assert_array_equal(linear.now, np.zeros(4))


def test_columns_about_a_fit_are_its_derivatives():
    """Where a gap is in the fit, the stiffness that stands in it is that of the rest."""
    system, joint, setting, left = elastic()
    gap, factor = site("transmission.backlash"), site("transmission.stiffness")
    fit = ((gap, np.array([0.02])), (factor, np.array([1.1])))
    variants = variants_of([gap, factor], setting, left, fit, {})
    linear = linearised(system, joint, fit, variants)
    there = lambda width, times: system.averaged(placed(joint, [(gap, np.array([width])), (factor, np.array([times]))]))  # noqa: E731
    np.testing.assert_allclose(linear.residual + linear.columns @ linear.now, there(0.02, 1.1), atol=1e-12)
    by_gap = (there(0.0201, 1.1) - there(0.0199, 1.1)) / 2e-4 * variants[0].deviation[0]
    by_factor = (there(0.02, 1.1001) - there(0.02, 1.0999)) / 2e-4 * variants[1].deviation[0]
    assert np.linalg.norm(linear.columns[..., 0] - by_gap) < 0.05 * np.linalg.norm(by_gap)
    assert np.linalg.norm(linear.columns[..., 1] - by_factor) < 1e-4 * np.linalg.norm(by_factor)
    assert linear.now == pytest.approx([0.02 / variants[0].deviation[0], 0.1 / variants[1].deviation[0]])


def test_causes_in_the_fit_have_all_numbers_free_and_others_their_strengths():
    _, _, setting, left = elastic()
    loop, push, damping = site("transmission.hysteresis", 2), site("link.contact", 3), site("motor.viscous_friction")
    fit = ((loop, np.array([0.1, 0.05])), (push, np.array([2.0, 0.3, 0.5])))
    inside = variants_of([loop, push, damping], setting, left, fit, {})
    assert [v.inside for v in inside if v.site in (loop, push)] == [True, True]
    for v in inside[:2]:
        assert v.free == tuple(range(len(v.site.parameters)))
        # Each column moves one number, and no other.
        moved = v.moved - v.base
        assert np.count_nonzero(moved) == len(v.free)
        assert np.all(np.diag(moved) != 0.0)
        for p, own in zip(v.site.parameters, v.rig, strict=True):
            held = {s.key: x for s, x in fit}[v.site.key][v.site.parameters.index(p)]
            assert own == (held if p.shape else p.start)
    outside = variants_of([loop, damping], setting, left, (), {})
    loops = [v for v in outside if v.site.cause == loop.cause]
    assert len(loops) == len(loop.starts(left)) > 1
    for v in loops:
        assert [loop.parameters[i].name for i in v.free] == ["torque"]
        assert v.price == pytest.approx(np.log(9.0) + np.log(len(loops)))
    assert sum(v.price == pytest.approx(np.log(9.0)) for v in outside) == 1


def test_what_happens_once_is_priced_for_every_place_it_might_have():
    _, _, setting, left = elastic()
    (variant, *more) = variants_of([site("link.contact", 3)], setting, left, (), {})
    assert variant.price == pytest.approx(np.log(9.0) + np.log(10.0 * setting.duration) + np.log(1 + len(more)))


def test_bounds_are_those_of_the_values_from_the_rig():
    system, joint, setting, left = elastic()
    own = [site("motor.viscous_friction"), site("transmission.stiffness")]
    linear = linearised(system, joint, (), variants_of(own, setting, left, (), {}))
    c = candidates_of(linear, system)
    for j, v in enumerate(linear.variants):
        p = v.site.parameters[0]
        assert c.low[j] * v.deviation[0] + p.start == pytest.approx(p.low)
        assert c.high[j] * v.deviation[0] + p.start == pytest.approx(p.high)


def test_what_cannot_stand_together_is_in_conflict():
    system, joint, setting, left = elastic()
    linear = linearised(system, joint, (), variants_of(sites(), setting, left, (), {}))
    c = candidates_of(linear, system)
    assert np.array_equal(c.conflict, c.conflict.T)
    assert not np.any(np.diag(c.conflict))
    names = [v.site.key for v in linear.variants]
    for a, b in zip(*np.nonzero(c.conflict), strict=True):
        assert names[a][1] == names[b][1]
        assert clash(linear.variants[a].site, linear.variants[b].site)
    for a in range(len(names)):
        for b in range(a):
            assert c.conflict[a, b] or names[a] != names[b]
    assert np.linalg.eigvalsh(c.information).min() > -1e-6 * np.linalg.eigvalsh(c.information).max()


def test_no_causes_make_no_unknowns():
    system, joint, _, _ = elastic()
    linear = linearised(system, joint, (), ())
    c = candidates_of(linear, system)
    assert linear.columns.shape == (*system.weights.shape, 0)
    assert len(c) == 0
    np.testing.assert_allclose(linear.residual, system.averaged(joint))


def test_an_inertia_is_not_attenuated_by_a_loud_encoder():
    """Over several logs of forty times the noise the corrected inertia is the truth; plain least squares' is not.

    About a third of the bias stays at such noise: the copies' noise is measured on a log that is itself as noisy.
    """
    own, joint = site("motor.inertia"), joint_of()
    corrected, plain = [], []
    for seed in range(8):
        found = channels(Truth(inertia=0.024), duration=10.0, seed=seed, loud=40.0).thinned()
        system = build_system(with_part(joint, "motor", inertia=0.024), found, balance_for(joint))
        linear = linearised(system, joint, (), variants_of([own], setting_of(joint, system), None, (), {}))
        deviation = linear.variants[0].deviation[0]
        corrected.append(0.02 + deviation * candidates_of(linear, system).solution(np.ones(1, dtype=bool))[0])
        J, r = system.white(linear.columns[..., 0]).ravel(), system.white(linear.residual).ravel()
        plain.append(0.02 - deviation * (J @ r) / (J @ J))
    spread = np.std(corrected) / np.sqrt(8)
    assert np.mean(corrected) == pytest.approx(0.024, rel=0.015)
    assert abs(np.mean(plain) - 0.024) > 2.0 * abs(np.mean(corrected) - 0.024)
    assert abs(np.mean(plain) - 0.024) > 5.0 * spread


@pytest.mark.parametrize("cause", ["motor.coulomb_friction", "motor.stribeck_friction"])
def test_a_cause_in_the_place_of_one_of_the_fit_makes_what_it_makes(cause):
    """Another shape of the same friction, or a simpler one, at the strength of the fit: the joint itself says what that is."""
    found = channels(Truth(coulomb=0.2), duration=6.0)
    joint = joint_of()
    system = build_system(joint, found.thinned(), balance_for(joint))
    setting = setting_of(joint, system)
    frictions = ("motor.coulomb_friction", "motor.stribeck_friction")
    sites = [s for s in sites_of(setting, frozenset()) if s.cause in frictions and s.part == "motor"]
    plain = min((s for s in sites if s.cause == cause), key=lambda s: len(s.parameters))
    values = {"torque": 0.2, "excess": 0.1, "velocity": 0.5}
    fit = ((plain, np.array([values[p.name] for p in plain.parameters])),)
    there = placed(joint, fit)
    variants = variants_of(sites, setting, remainder(system, there), fit, {})
    linear = linearised(system, joint, fit, variants)
    others = [g for g, v in enumerate(linear.variants) if v.instead == plain.key]
    assert {linear.variants[g].site.cause for g in others} == {cause, "motor.coulomb_friction"}
    for g in others:
        variant = linear.variants[g]
        strengths = [p.name for p in variant.site.parameters if not p.shape]
        assert list(variant.base[: len(strengths)]) == [values[name] for name in strengths]
        own = linear.columns[:, :, int(linear.first[g]) : int(linear.first[g + 1])]
        change = own @ ((variant.base[list(variant.free)] - variant.rig) / variant.deviation)
        there = system.averaged(placed(joint, [(variant.site, variant.base)]))
        np.testing.assert_allclose(linear.residual + change, there, atol=1e-9)
