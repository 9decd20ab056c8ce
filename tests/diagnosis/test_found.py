"""What a log determines of a cause: intervals against the rig's own values and zero, and what a cause matters by."""

import numpy as np
import pytest
from written_out import channels, joint_of

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.found import Found
from vsalog.diagnosis.joint import balance_for, setting_of
from vsalog.diagnosis.selection import Choice
from vsalog.residuals.system import build_system


@pytest.fixture(scope="module")
def setting():
    joint, found = joint_of(), channels(duration=4.0).thinned()
    return setting_of(joint, build_system(joint, found, balance_for(joint)))


def site_of(setting, cause):
    return next(iter(catalogue()[cause].sites(setting)))


def found(setting, cause, values, spread, rivals=(), size=3.0, odds=9.0, **more):
    site = site_of(setting, cause)
    choice = Choice(site, odds if isinstance(odds, tuple) else (odds,), rivals, size, **more)
    return Found(site, np.array(values), np.diag(np.square(spread)), choice, 0.5)


@pytest.mark.parametrize(
    ("cause", "value", "spread", "told"),
    [
        # The rig's motor has an inertia of 0.02 kg·m².
        ("motor.inertia", 0.03, 0.004, True),
        ("motor.inertia", 0.03, 0.006, False),
        # Far from the rig, but no farther from nothing than it is uncertain.
        ("motor.inertia", 0.005, 0.003, False),
        ("motor.torque_offset", 0.1, 0.04, True),
        ("motor.torque_offset", 0.1, 0.06, False),
        ("motor.torque_constant", 1.1, 0.04, True),
        ("motor.torque_constant", 1.1, 0.06, False),
    ],
)
def test_a_number_is_determined_where_its_interval_excludes_the_rigs_and_zero(setting, cause, value, spread, told):
    one = found(setting, cause, [value], [spread])
    assert list(one.determined().values()) == [told]
    assert one.material is told


def test_a_shape_is_determined_as_the_strength_of_its_cause_is(setting):
    site = site_of(setting, "motor.stribeck_friction")
    shapes = {p.name for p in site.parameters if p.shape}
    values = [2.0 * p.start or 0.1 for p in site.parameters]
    for part, told in ((0.1, True), (1.0, False)):
        one = found(setting, "motor.stribeck_friction", values, part * np.abs(values))
        assert shapes
        assert {one.determined()[name] for name in shapes} == {told}


def test_an_undetermined_member_of_a_class_matters_and_one_alone_does_not(setting):
    rivals = (site_of(setting, "link.inertia"),)
    values = ("motor.inertia", [0.03], [0.1])
    assert found(setting, *values, rivals=rivals).material
    assert not found(setting, *values).material
    assert not found(setting, *values, rivals=rivals, size=0.5).material


def test_a_member_is_as_sure_as_its_odds_against_all_others_and_its_class_as_sure_as_without_any(setting):
    """Three members that explain a log alike: each is there with a third; without all of them it is improbable by 1 to 99."""
    rivals = (site_of(setting, "link.inertia"),)
    one = found(setting, "motor.inertia", [0.03], [0.1], rivals=rivals, odds=(0.0, 0.0, np.log(99.0)))
    assert one.confidence == pytest.approx(0.997 / (1.0 + 1.0 + 1.0 + 1.0 / 99.0), rel=1e-12)
    assert one.class_confidence == pytest.approx(0.997 * 0.99, rel=1e-12)


@pytest.mark.parametrize(
    ("odds", "confidence"), [(-np.inf, 0.4985), (0.0, 0.4985), (np.log(19.0), 0.94715), (1e6, 0.997)]
)
def test_no_cause_is_surer_than_the_catalogue_is_complete(setting, odds, confidence):
    """Of 1000 causes with overwhelming odds 3 are not there, where equations close; a set that is kept is no less probable."""
    assert found(setting, "motor.inertia", [0.03], [1e-3], odds=odds).confidence == pytest.approx(confidence, rel=1e-12)


@pytest.mark.parametrize("size", [0.3, 1.0, 1.5, 3.0])
def test_a_cause_no_larger_than_model_error_may_be_part_of_that(setting, size):
    """Model error along the cause's direction is as large as on the whole: the share of 10⁵ such draws that is smaller."""
    draws = np.abs(np.random.default_rng(7).standard_normal(100_000))
    one = found(setting, "motor.inertia", [0.03], [1e-3], odds=1e6, over_model_error=size)
    assert one.confidence == pytest.approx(0.997 * np.mean(draws < size), abs=0.006)
    assert one.class_confidence == one.confidence


def test_strengths_that_stand_for_one_another_are_determined_together():
    """A loop of 0.09 N·m is shared between two elements; how large both are together is well known, or it is not."""
    strengths = tuple(Parameter(name, "N*m", 0.0, 1e-3, low=0.0) for name in ("torque", "slip_limit"))
    site = Site("transmission.hysteresis", "transmission", strengths, lambda joint, values: joint)
    for spread, told in ((0.01, True), (0.06, False)):
        covariance = 0.05**2 * (np.eye(2) - 0.5) + spread**2 / 2.0
        one = Found(site, np.array([0.045, 0.045]), covariance, Choice(site, (9.0,), (), 3.0), 0.5)
        assert not any(one.determined().values())
        assert one.material is told
