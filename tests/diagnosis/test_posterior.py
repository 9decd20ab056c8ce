"""The most probable values: against scipy's minimum of the same deviance and prior, and under a common factor on all torques."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize
from written_out import Truth, channels, joint_of

from vsalog.diagnosis import posterior
from vsalog.diagnosis.causes.base import with_part, with_signal
from vsalog.diagnosis.discrepancy import Weights, weighted_by
from vsalog.diagnosis.linear import carried, formed_of, linearised, placed, variants_of
from vsalog.diagnosis.posterior import Problem, begun_by, most_probable
from vsalog.diagnosis.selection import blocks_of, sites_of, stage_about
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint
from vsalog.residuals.system import build_system

# Held torques act half a sample later; those of the written-out joint are smooth.
SMOOTH = 0.0


def deviance(weights, joint):
    """The deviance of a joint as it is."""
    return weights.deviance(formed_of(weights.system, joint, ()))


@dataclass
class Case:
    """A log with what its rig lacks, and the equations of it."""

    problem: Problem
    weights: Weights
    system: object
    sites: list

    def site(self, cause, parameters=1):
        return next(s for s in self.sites if s.cause == cause and len(s.parameters) == parameters)

    def loss(self, fit):
        """Half of deviance and prior; a number within its prior's deviation has a Gaussian one."""
        linear = most_probable(self.problem, self.weights, fit).linear
        deviation = np.concatenate([v.deviation for v in linear.variants])
        rig = np.concatenate([v.rig for v in linear.variants])

        def at(values):
            there = self.problem.joint
            start = 0
            for site, own in fit:
                there = site.apply(there, values[start : start + own.size].tolist())
                start += own.size
            off = np.abs((values - rig) / deviation)
            # Beyond its deviation a number costs as its logarithm.
            prior = np.where(off > 1.0, 1.0 + 2.0 * np.log(np.maximum(off, 1.0)), off**2)
            return 0.5 * (deviance(self.weights, there) + float(np.sum(prior)))

        return at, deviation


@cache
def case(truth, **options):
    joint, found = joint_of(), channels(truth, duration=8.0, seed=2, **options).thinned()
    system = build_system(joint, found, balance_for(joint), SMOOTH)
    setting = setting_of(joint, system)
    return Case(Problem(joint, setting, {}), weighted_by(system, np.zeros_like(system.weights)), system,
                sites_of(setting, frozenset()))  # fmt: skip


HIDDEN = {
    ("motor.viscous_friction", "link.inertia"): (Truth(damping=0.055, link_inertia=0.031), (0.055, 0.031)),
    ("transmission.stiffness", "sensor.torque_gain"): (Truth(stiffness=12.3, cubic=153.75, gain=1.01), (1.025, 1.01)),
    ("sensor.torque_offset", "sensor.torque_delay"): (Truth(offset=0.02, delay=1e-3), (0.02, 1e-3)),
    ("motor.inertia", "transmission.nonlinearity", "link.gravity"): (
        Truth(inertia=0.0205, cubic=160.0, gravity=1.52),
        (0.0205, 10.0, 1.52),
    ),
}


@pytest.mark.parametrize("causes", HIDDEN, ids="+".join)
def test_the_values_are_those_of_scipys_minimum(causes):
    """Corrected Gauss-Newton steps end within a part of a standard deviation of where the deviance is least."""
    truth, expected = HIDDEN[causes]
    c = case(truth)
    start = tuple((c.site(name), np.array(c.site(name).start)) for name in causes)
    found = most_probable(c.problem, c.weights, start)
    values = np.concatenate([v for _, v in found.fit])
    spread = np.sqrt(np.diag(found.covariance))
    loss, deviation = c.loss(found.fit)
    corners = values + np.vstack([np.zeros(values.size), 2.0 * np.diag(spread)])
    options = {"xatol": 1e-4, "fatol": 1e-4, "maxfev": 600, "initial_simplex": corners / deviation}
    best = minimize(lambda u: loss(u * deviation), values / deviation, method="Nelder-Mead", options=options)
    assert np.all(np.abs(values - best.x * deviation) < 0.3 * spread)
    assert loss(values) - best.fun < 0.1
    assert np.all(np.abs(values - expected) < 5.0 * spread)


def test_the_covariance_is_the_curvature_of_the_deviance():
    """By differences: ∂²(½ deviance) of two causes, within what the correction for noise takes off."""
    c = case(HIDDEN["motor.viscous_friction", "link.inertia"][0])
    names = ("motor.viscous_friction", "link.inertia")
    found = most_probable(c.problem, c.weights, tuple((c.site(n), np.array(c.site(n).start)) for n in names))
    values = np.concatenate([v for _, v in found.fit])
    loss, _ = c.loss(found.fit)
    step = 0.5 * np.sqrt(np.diag(found.covariance))
    H = np.empty((2, 2))
    for i in range(2):
        for j in range(2):
            a, b = step[i] * np.eye(2)[i], step[j] * np.eye(2)[j]
            H[i, j] = (loss(values + a + b) - loss(values + a - b) - loss(values - a + b) + loss(values - a - b)) / (
                4 * step[i] * step[j]
            )
    np.testing.assert_allclose(np.diag(np.linalg.inv(H)), np.diag(found.covariance), rtol=0.15)


def test_the_start_does_not_matter():
    c = case(HIDDEN["motor.viscous_friction", "link.inertia"][0])
    near, far = c.site("motor.viscous_friction"), c.site("link.inertia")
    ends = [
        most_probable(c.problem, c.weights, ((near, np.array([a])), (far, np.array([b]))))
        for a, b in ((0.05, 0.03), (0.2, 0.01), (0.0, 0.09))
    ]
    spread = np.sqrt(np.diag(ends[0].covariance))
    values = [np.concatenate([v for _, v in end.fit]) for end in ends]
    for end, there in zip(ends[1:], values[1:], strict=True):
        assert np.all(np.abs(there - values[0]) < 0.3 * spread)
        assert end.score == pytest.approx(ends[0].score, abs=0.2)


def test_a_fit_never_ends_worse_than_it_began():
    c = case(HIDDEN["transmission.stiffness", "sensor.torque_gain"][0])
    for factor, gain in ((0.06, 0.06), (5.0, 3.0), (1.0, 1.0)):
        start = (
            (c.site("transmission.stiffness"), np.array([factor])),
            (c.site("sensor.torque_gain"), np.array([gain])),
        )
        found = most_probable(c.problem, c.weights, start)
        loss, _ = c.loss(found.fit)
        assert loss(np.concatenate([v for _, v in found.fit])) <= loss(np.array([factor, gain])) + 1e-9


def test_bounds_hold():
    """A log of less friction than none: the damping ends at its bound, with what the data would have there."""
    c = case(Truth(damping=0.0, at_motor=lambda a, da: 0.05 * da))
    site = c.site("motor.viscous_friction")
    found = most_probable(c.problem, c.weights, ((site, np.array([0.05])),))
    assert found.fit[0][1][0] == 0.0


def test_no_cause_scores_its_deviance():
    c = case(Truth())
    found = most_probable(c.problem, c.weights, ())
    assert found.fit == ()
    assert found.keys == frozenset()
    assert found.score == pytest.approx(0.5 * deviance(c.weights, c.problem.joint))


def test_what_is_hidden_is_more_probable_than_nothing_and_what_is_not_is_less():
    c = case(Truth(damping=0.055))
    nothing = most_probable(c.problem, c.weights, ()).score
    for cause, sign in (("motor.viscous_friction", -1.0), ("link.gravity", 1.0), ("sensor.torque_offset", 1.0)):
        found = most_probable(c.problem, c.weights, ((c.site(cause), np.array(c.site(cause).start)),))
        assert np.sign(found.score - nothing) == sign, cause


def test_a_model_that_is_carried_on_is_exact_where_it_is_carried_to_and_keeps_its_columns():
    c = case(Truth(damping=0.055))
    site = c.site("motor.viscous_friction")
    start, there = ((site, np.array([v])) for v in (0.05, 0.08))
    formed = formed_of(c.system, c.problem.joint, (there,))
    variants = variants_of([site], c.problem.setting, None, (start,), {})
    begun = linearised(c.system, c.problem.joint, (start,), variants)
    moved = carried(begun, (there,), formed)
    scale = np.abs(formed).max()
    np.testing.assert_array_equal(moved.columns, begun.columns)
    np.testing.assert_allclose(moved.residual + moved.columns @ moved.now, formed[0], atol=1e-12 * scale)
    every = moved.columns + moved.noise_columns
    np.testing.assert_allclose(
        moved.residual + moved.noise_residual + every @ moved.now, formed[1:], atol=1e-12 * scale
    )
    # Damping is in the equations as it is, so the columns and what is left of them without it are the same everywhere.
    anew = linearised(c.system, c.problem.joint, (there,), variants_of([site], c.problem.setting, None, (there,), {}))
    np.testing.assert_allclose(moved.residual, anew.residual, atol=1e-6 * scale)
    assert moved.variants[0].base == there[1]


def test_a_sets_linear_values_begin_its_fit():
    """What the linear model of all causes says of a set is near where the fit of it ends."""
    truth, expected = HIDDEN["motor.inertia", "transmission.nonlinearity", "link.gravity"]
    c = case(truth)
    stage = stage_about(c.problem, c.system, c.sites, (), blocks_of(c.system), SMOOTH)
    names = ("motor.inertia", "transmission.nonlinearity", "link.gravity")
    chosen = np.array([v.site.cause in names for v in stage.unknowns.variants])
    begun = {site.cause: values for site, values in begun_by(stage.unknowns, stage.candidates, chosen)}
    for name, value in zip(names, expected, strict=True):
        assert begun[name][0] == pytest.approx(value, rel=0.1)


def scaled(joint, factor):
    """A joint with all that is a torque so many times as large, and its torque sensor's gain so many times smaller."""
    motor, link, spring = joint.motor, joint.link, joint.transmission
    joint = with_part(joint, "motor", inertia=factor * motor.inertia, damping=factor * motor.damping,
                      torque_gain=factor * motor.torque_gain)  # fmt: skip
    joint = with_part(joint, "transmission", stiffness=factor * spring.stiffness, cubic=factor * spring.cubic)
    return with_part(joint, "link", inertia=factor * link.inertia, damping=factor * link.damping,
                     gravity_torque=factor * link.gravity_torque)  # fmt: skip


@pytest.mark.parametrize("factor", [1.1, 0.5, 4.0])
@pytest.mark.parametrize("truth", [Truth(), Truth(damping=0.08)], ids=["right", "wrong"])
def test_a_common_factor_on_all_torques_leaves_the_deviance_as_it_is(factor, truth):
    """Only the prior tells torque constants from inertias: the noise of equations in larger torques is as much larger."""
    plain, c = at_joint(joint_of()), case(truth)
    other = with_signal(scaled(plain, factor), "torque_sensor", gain=1.0 / factor)
    assert deviance(c.weights, other) == pytest.approx(deviance(c.weights, plain), rel=1e-3)
    # Without the sensor's gain it is another joint.
    assert deviance(c.weights, scaled(plain, factor)) > 1.2 * deviance(c.weights, plain)


def test_a_simulations_information_takes_the_place_of_the_equations():
    c = case(Truth(damping=0.055))
    found = most_probable(c.problem, c.weights, ((c.site("motor.viscous_friction"), np.array([0.05])),))
    deviation = found.linear.variants[0].deviation[0]
    surer = replace(found, simulated=np.array([[400.0]]))
    assert surer.covariance[0, 0] == pytest.approx(deviation**2 / 400.0)
    assert placed(c.problem.joint, found.fit).motor.damping == pytest.approx(0.055, rel=0.05)


@pytest.mark.parametrize(("gain", "ends"), [(0.07, True), (0.15, False)])
def test_a_fit_ends_where_its_deviance_gains_less_than_a_tenth(monkeypatch, gain, ends):
    c, asked = case(HIDDEN["motor.viscous_friction", "link.inertia"][0]), []

    def deviance(_):
        asked.append(10.0 - (gain if asked else 0.0))
        return asked[-1]

    monkeypatch.setattr(posterior, "_surprise", lambda unknowns: 0.0)
    names = ("motor.viscous_friction", "link.inertia")
    start = tuple((c.site(name), np.array(c.site(name).start)) for name in names)
    most_probable(c.problem, SimpleNamespace(system=c.system, deviance=deviance), start)
    assert (len(asked) == 2) is ends
