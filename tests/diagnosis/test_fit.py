"""Plain least-squares fits to the equations, against scipy."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.fit import (
    applied,
    driven_out,
    fitted,
    jacobian_of,
    newton_step,
    residual_of,
    solved,
)

N = 600


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
    values, residual = fitted(Curve(line(A), data), (0.0, 0.0, 0.0), sites, np.zeros(3))
    expected, square, *_ = np.linalg.lstsq(A, data)
    np.testing.assert_allclose(values, expected, rtol=1e-6)
    assert float(residual @ residual) == pytest.approx(square[0], rel=1e-9)


def test_bounds_hold_as_lsq_linear_holds_them():
    A, data = columns(), columns() @ [1.0, -2.0, 0.5] + noise()
    sites = (site("a", 0, high=0.4), site("b", 1, low=-1.0), site("c", 2))
    values, _ = fitted(Curve(line(A), data), (0.0, 0.0, 0.0), sites, np.zeros(3))
    expected = lsq_linear(A, data, ([-np.inf, -1.0, -np.inf], [0.4, np.inf, np.inf]), tol=1e-14).x
    np.testing.assert_allclose(values, expected, atol=1e-5)


def test_a_bent_problem_ends_where_scipys_does():
    t = np.linspace(0.0, 4.0, N)

    def formula(size, rate, shift):
        return size * np.exp(-rate * t) * np.cos(3.0 * t + shift)

    data = formula(2.0, 0.7, 0.4) + 0.05 * noise()
    sites = (site("size", 0), site("rate", 1, low=0.0, reach=0.5), site("shift", 2, reach=0.5))
    values, _ = fitted(Curve(formula, data), (0.0, 0.0, 0.0), sites, np.array([1.0, 0.3, 0.0]))
    expected = least_squares(lambda x: formula(*x) - data, [1.0, 0.3, 0.0], xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose(values, expected, rtol=1e-4)


def test_no_causes_leave_everything_over():
    data = noise()
    values, residual = fitted(Curve(lambda x: np.zeros(N), data), (0.0,), (), np.zeros(0))
    np.testing.assert_array_equal(residual, -data)
    assert values.size == 0


def test_a_fit_never_ends_worse_than_it_began():
    """A formula with a wall: steps that lead to more are not taken."""
    formula = lambda x: np.full(N, 1e3 if x > 0.5 else x)  # noqa: E731
    values, residual = fitted(Curve(formula, np.full(N, 2.0)), (0.0,), (site("x", 0),), np.zeros(1))
    assert float(residual @ residual) <= N * 4.0
    assert values[0] <= 0.5


def test_derivatives_look_the_other_way_at_an_upper_bound():
    system, sites = Curve(lambda x: np.full(N, x**2), np.zeros(N)), (site("x", 0, high=1.0),)
    values = np.array([1.0])
    J = jacobian_of(system, (0.0,), sites, values, residual_of(system, (0.0,), sites, values))
    np.testing.assert_allclose(J, 2.0, rtol=1e-5)


def test_causes_are_put_in_one_after_another():
    assert applied((0.0, 0.0, 0.0), (site("b", 1, count=2), site("a", 0)), np.array([1.0, 2.0, 3.0])) == (3.0, 1.0, 2.0)


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
        values, _ = fitted(system, (0.0,) * count, (free,), np.array([0.5] * count))
        return driven_out(free.parameters, values)

    assert end(0.1, 2.0)
    assert end(-9.0, -3.5)
    assert not end(0.0, 2.0)
    assert not end(-9.0, 2.0)
    assert not end(0.1, 2.0, count=2)
    assert end(0.1, 2.0, count=2, hard=True)
    assert not end(-9.0, 2.0, count=2, hard=True)


def test_a_value_that_rounding_left_short_of_a_bound_is_at_it():
    free = site("gain", 0, 1.0, 0.05, 20.0)
    assert driven_out(free.parameters, np.array([0.050000000000000155]))
    assert driven_out(free.parameters, np.array([20.0 * (1.0 - 3e-16)]))
    assert not driven_out(free.parameters, np.array([0.05 * (1.0 + 1e-9)]))
