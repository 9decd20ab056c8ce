"""Two torques next to each other: which share, which common power and which averages decide, on either side of each bound."""

import numpy as np
import pytest

from vsalog.checks.cross_check import CrossCheck, _is_noise, _of_torques
from vsalog.estimators.row_moments import lasts

TIME = np.arange(4000)
TORQUE = np.sin(TIME / 150.0) + 0.5 * np.sin(TIME / 61.0)


def codes(estimated, sensed, claimed=0.0):
    return [finding.code for finding in _of_torques("j", "1", estimated, sensed, claimed, {})]


@pytest.mark.parametrize(
    ("scale", "found"),
    [(0.97, []), (1.03, []), (0.92, ["cross_check.torque_scale"]), (1.08, ["cross_check.torque_scale"])],
)
def test_a_twentieth_of_a_scale_is_reported(scale, found):
    assert codes(TORQUE, scale * TORQUE) == found


@pytest.mark.parametrize(("claimed", "found"), [(0.03, ["cross_check.torque_scale"]), (0.06, [])])
def test_what_the_interval_of_the_stiffness_covers_is_not(claimed, found):
    assert codes(TORQUE, 1.1 * TORQUE, claimed) == found


@pytest.mark.parametrize(("common", "found"), [(0.3, ["cross_check.torque_unrelated"]), (0.7, [])])
def test_references_have_half_of_their_power_in_common(common, found):
    other = np.cos(TIME / 150.0) * np.std(TORQUE) * np.sqrt(2.0)
    sensed = np.sqrt(common) * TORQUE + np.sqrt(1.0 - common) * other
    assert [code for code in codes(TORQUE, sensed) if code.endswith("unrelated")] == found


def test_a_tenth_of_quick_changes_in_which_one_lags_does_not_count():
    lagging = TORQUE.copy()
    lagging[::12] += 2.0 * np.sign(TORQUE[::12])
    assert codes(TORQUE, lagging) == []


@pytest.mark.parametrize(("kept", "there"), [(0.3, False), (0.4, False), (0.6, True), (0.9, True)])
def test_what_lasts_keeps_half_of_itself_in_averages_of_four(kept, there):
    """Of noise a quarter of the power is left: the middle between that and all, on a logarithmic scale."""
    assert lasts(kept, 1.0) == there


@pytest.mark.parametrize(("correlation", "noise"), [(0.0, True), (0.3, True), (0.7, False)])
def test_averages_of_noise_hardly_depend_on_the_one_before(correlation, noise):
    white = np.random.default_rng(1).standard_normal(4000)
    averages = np.convolve(white, correlation ** np.arange(40.0))[: white.size]
    assert _is_noise(averages) == noise


@pytest.mark.parametrize(("period", "box"), [(1e-3, 50), (2e-3, 25), (1e-2, 25), (1e-4, 500)])
def test_a_twentieth_of_a_second_is_averaged_and_no_fewer_than_25_samples(period, box, monkeypatch):
    monkeypatch.setattr("vsalog.checks.cross_check.reference_roles", lambda *_: ())
    monkeypatch.setattr("vsalog.checks.cross_check.motor_roles", lambda *_: ())
    assert CrossCheck((), None, None, (), period).box == box
