"""Fits to the stacked equations: against scipy, against leaving blocks out by brute force, against many draws of noise."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.fit import (
    applied,
    block_losses,
    covariance_of,
    fitted,
    jacobian_of,
    newton_step,
    residual_of,
    solved,
)

N, BLOCKS = 600, 12
BLOCK = np.repeat(np.arange(BLOCKS), N // BLOCKS)


@dataclass
class Curve:
    """Stands for a stacked system: the "joint" is a tuple of numbers that a formula is made with."""

    formula: object
    data: np.ndarray

    def whitened(self, joint):
        return (self.formula(*joint) - self.data)[:, None]


def site(name, index, start=0.0, low=-np.inf, high=np.inf, reach=np.inf, count=1):
    parameters = tuple(Parameter(f"{name}{i}", "1", start, 1e-6, low, high, reach) for i in range(count))

    def apply(joint, values):
        changed = list(joint)
        changed[index : index + count] = [float(v) for v in values]
        return tuple(changed)

    return Site(name, "part", parameters, apply)


def columns(seed=0, count=3):
    return np.random.default_rng(seed).standard_normal((N, count))


def noise(seed=1):
    return np.random.default_rng(seed).standard_normal(N)


def line(A):
    return lambda *x: A @ np.array(x)


def test_a_straight_problem_is_solved_as_lstsq_solves_it():
    A, data = columns(), columns() @ [1.0, -2.0, 0.5] + noise()
    sites = (site("a", 0), site("b", 1, count=2))
    fit = fitted(Curve(line(A), data), (0.0, 0.0, 0.0), sites, np.zeros(3), BLOCK)
    expected, square, *_ = np.linalg.lstsq(A, data)
    np.testing.assert_allclose(fit.values, expected, rtol=1e-6)
    assert float(fit.residual @ fit.residual) == pytest.approx(square[0], rel=1e-9)
    np.testing.assert_allclose(fit.own(sites[1]), expected[1:], rtol=1e-6)
    np.testing.assert_allclose(fit.joint((9.0, 9.0, 9.0)), expected, rtol=1e-6)
    with pytest.raises(KeyError):
        fit.own(site("c", 0))


def test_bounds_hold_as_lsq_linear_holds_them():
    A, data = columns(), columns() @ [1.0, -2.0, 0.5] + noise()
    sites = (site("a", 0, high=0.4), site("b", 1, low=-1.0), site("c", 2))
    fit = fitted(Curve(line(A), data), (0.0, 0.0, 0.0), sites, np.zeros(3), BLOCK)
    expected = lsq_linear(A, data, ([-np.inf, -1.0, -np.inf], [0.4, np.inf, np.inf]), tol=1e-14).x
    np.testing.assert_allclose(fit.values, expected, atol=1e-5)


def test_a_bent_problem_ends_where_scipys_does():
    t = np.linspace(0.0, 4.0, N)

    def formula(size, rate, shift):
        return size * np.exp(-rate * t) * np.cos(3.0 * t + shift)

    data = formula(2.0, 0.7, 0.4) + 0.05 * noise()
    sites = (site("size", 0), site("rate", 1, low=0.0, reach=0.5), site("shift", 2, reach=0.5))
    fit = fitted(Curve(formula, data), (0.0, 0.0, 0.0), sites, np.array([1.0, 0.3, 0.0]), BLOCK)
    expected = least_squares(lambda x: formula(*x) - data, [1.0, 0.3, 0.0], xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose(fit.values, expected, rtol=1e-4)


def test_no_causes_leave_everything_over():
    data = noise()
    fit = fitted(Curve(lambda x: np.zeros(N), data), (0.0,), (), np.zeros(0), BLOCK)
    np.testing.assert_array_equal(fit.residual, -data)
    np.testing.assert_allclose(fit.losses, np.sum(data.reshape(BLOCKS, -1) ** 2, axis=1))
    assert fit.loss == pytest.approx(data @ data)


def test_a_fit_never_ends_worse_than_it_began():
    """A formula with a wall: steps that lead to more are not taken."""
    formula = lambda x: np.full(N, 1e3 if x > 0.5 else x)  # noqa: E731
    fit = fitted(Curve(formula, np.full(N, 2.0)), (0.0,), (site("x", 0),), np.zeros(1), BLOCK)
    assert float(fit.residual @ fit.residual) <= N * 4.0
    assert fit.values[0] <= 0.5


def test_derivatives_look_the_other_way_at_an_upper_bound():
    system, sites = Curve(lambda x: np.full(N, x**2), np.zeros(N)), (site("x", 0, high=1.0),)
    values = np.array([1.0])
    J = jacobian_of(system, (0.0,), sites, values, residual_of(system, (0.0,), sites, values))
    np.testing.assert_allclose(J, 2.0, rtol=1e-5)


def test_causes_are_put_in_one_after_another():
    assert applied((0.0, 0.0, 0.0), (site("b", 1, count=2), site("a", 0)), np.array([1.0, 2.0, 3.0])) == (3.0, 1.0, 2.0)


def test_each_block_is_judged_by_a_fit_to_the_others():
    """Brute force: B fits, each without one block, each judged on it."""
    A, data = columns(2), noise(3) + columns(2) @ [0.3, 0.0, -1.0]
    values = np.linalg.lstsq(A, data)[0]
    found = block_losses(A, A @ values - data, BLOCK)
    for b in range(BLOCKS):
        rest = b != BLOCK
        without = np.linalg.lstsq(A[rest], data[rest])[0]
        assert found[b] == pytest.approx(np.sum((A[~rest] @ without - data[~rest]) ** 2), rel=1e-8)


def test_blocks_of_unequal_length_and_a_fit_that_is_not_at_its_least():
    """One Newton step from anywhere is exact where all is straight."""
    blocks = np.sort(np.random.default_rng(5).integers(0, 7, N))
    A, data = columns(6), noise(7)
    found = block_losses(A, A @ [0.3, 0.2, -0.4] - data, blocks)
    for b in range(7):
        rest = blocks != b
        without = np.linalg.lstsq(A[rest], data[rest])[0]
        assert found[b] == pytest.approx(np.sum((A[~rest] @ without - data[~rest]) ** 2), rel=1e-8)


def test_a_column_that_explains_nothing_does_not_pay_on_held_out_blocks():
    """Over many draws, a free number makes held-out losses worse, though it makes the fit better."""
    worse = []
    for seed in range(60):
        data = noise(100 + seed)
        A = columns(seed, 1)
        value = np.linalg.lstsq(A, data)[0]
        worse.append(block_losses(A, A @ value - data, BLOCK).sum() - data @ data)
    assert np.mean(worse) > 0.0


def test_the_covariance_is_that_of_many_draws():
    """Noise of another size in each block: only what the blocks say of themselves tells the spread."""
    A = columns(8, 2)
    sizes = np.repeat(np.random.default_rng(9).uniform(0.3, 3.0, 60), N // 60)
    blocks = np.repeat(np.arange(60), N // 60)
    values, told = [], []
    for seed in range(300):
        data = sizes * np.random.default_rng(200 + seed).standard_normal(N)
        fit = fitted(Curve(line(A), data), (0.0, 0.0), (site("a", 0, count=2),), np.zeros(2), blocks)
        values.append(fit.values)
        told.append(covariance_of(fit, blocks))
    expected, mean = np.cov(np.array(values).T), np.mean(told, axis=0)
    np.testing.assert_allclose(np.diag(mean), np.diag(expected), rtol=0.25)
    # A fit that took all of the noise for alike would be wrong by more than that.
    assert abs(mean[0, 1] - expected[0, 1]) < 0.25 * np.sqrt(expected[0, 0] * expected[1, 1])


def test_normal_equations_in_wild_units():
    A = columns(10) * [1e-9, 1.0, 1e9]
    b = A.T @ noise(11)
    np.testing.assert_allclose(
        solved(A.T @ A, b) * [1e-9, 1.0, 1e9], np.linalg.lstsq(A / [1e-9, 1, 1e9], noise(11))[0], rtol=1e-6
    )


def test_directions_without_information_stay_at_zero():
    A = columns(12, 2)
    A = np.column_stack([A, A[:, 0] + A[:, 1], np.zeros(N)])
    x = solved(A.T @ A, A.T @ (A @ [1.0, 2.0, 0.0, 0.0]))
    np.testing.assert_allclose(A @ x, A @ [1.0, 2.0, 0.0, 0.0], atol=1e-8)
    assert x[3] == 0.0
    assert np.abs(x).max() < 5.0


def test_a_step_that_would_leave_all_bounds_is_none():
    J = np.ones((5, 1))
    np.testing.assert_array_equal(newton_step(J, np.ones(5), np.zeros(1), np.zeros(1), np.ones(1), 0.0), [0.0])


def test_a_wall_is_a_bound_that_all_numbers_were_driven_to_but_not_zero():
    A = columns(count=1)

    def end(low, high, count=1, hard=False):
        """Of several numbers only the first one moves the curve, to -3."""
        system = Curve(lambda *x: A[:, 0] * x[0], -3.0 * A[:, 0])
        free = site("a", 0, 0.5, low, high, count=count)
        free = replace(free, parameters=tuple(replace(p, hard=hard) for p in free.parameters))
        return fitted(system, (0.0,) * count, (free,), np.array([0.5] * count), BLOCK).at_a_wall

    assert end(0.1, 2.0)
    assert end(-9.0, -3.5)
    assert not end(0.0, 2.0)
    assert not end(-9.0, 2.0)
    assert not end(0.1, 2.0, count=2)
    assert end(0.1, 2.0, count=2, hard=True)
    assert not end(-9.0, 2.0, count=2, hard=True)
