"""Where a search for causes begins, goes on and ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from written_out import channels, joint_of

from vsalog.core.finding import Finding
from vsalog.diagnosis import gain, selection, signs_and_units
from vsalog.diagnosis.causes import catalogue, cogging
from vsalog.diagnosis.causes.base import Parameter, Remainder, Site
from vsalog.diagnosis.gain import _affordable
from vsalog.diagnosis.joint import balance_for, setting_of
from vsalog.diagnosis.selection import _begins, _best, _settled, blocks_of
from vsalog.diagnosis.signs_and_units import hint_of
from vsalog.diagnosis.smooth import _series
from vsalog.diagnosis.subsets import Ranked
from vsalog.residuals.system import build_system
from vsalog.residuals.windows import Windows
from vsalog.residuals.windows_mechanical import MechanicalPlayer


def test_a_search_for_waves_begins_with_the_three_strongest():
    theta = np.linspace(0.0, 20.0, 4000)
    heights = {3.0: 0.4, 5.0: 0.1, 7.0: 0.3, 11.0: 0.2, 13.0: 0.05}
    residual = -sum(a * np.cos(n * theta + 0.3) for n, a in heights.items())
    starts = cogging._waves(joint_of(), "motor", "motor_position", np.arange(1.0, 20.0))
    found = starts(Remainder(theta, {"motor": residual}, {"motor_position": np.stack([theta] * 3)}, {}))
    assert [n for _, _, n in found] == [3.0, 7.0, 11.0]
    np.testing.assert_allclose([np.hypot(c, s) for c, s, _ in found], [0.4, 0.3, 0.2], atol=0.02)


@pytest.fixture(scope="module")
def setting():
    joint = joint_of()
    return setting_of(joint, build_system(joint, channels(duration=4.0).thinned(), balance_for(joint)))


@pytest.mark.parametrize(("share", "within"), [(1.5e-5, True), (0.7e-5, False)])
def test_friction_that_gives_way_over_less_than_a_hundred_thousandth_of_the_motion_is_a_jump(setting, share, within):
    moved = np.nanstd(setting.roles["motor_position"][0])
    (way,) = [p for s in catalogue()["motor.coulomb_friction"].sites(setting) for p in s.parameters if p.name == "way"]
    assert bool(way.low <= np.log(share * moved) <= way.high) is within


@pytest.mark.parametrize(
    ("steps", "stiff", "kept"), [(14, False, 200), (32, False, 100), (4, True, 64), (1000, False, 20), (1000, True, 20)]
)
def test_so_many_windows_are_simulated_as_take_as_long_as_all_at_sixteen_steps(monkeypatch, steps, stiff, kept):
    """A stiff step takes as long as twelve; a tenth of the windows is the least that tells as much as all."""
    player = object.__new__(MechanicalPlayer)
    player.steps, player.stiff = steps, stiff
    monkeypatch.setattr(gain, "player_of", lambda joint, channels: player)
    windows = Windows(None, np.arange(400).reshape(200, 2), (), False)
    assert len(_affordable(None, windows).spans) == kept


@pytest.mark.parametrize(("left", "closes"), [(0.04, True), (0.07, False)])
def test_a_sign_is_reported_where_it_leaves_less_than_a_twentieth(monkeypatch, left, closes):
    assert told_of(monkeypatch, 1.0, left, count=1.0) is closes


@pytest.mark.parametrize(("left", "closes"), [(70.0, True), (150.0, False)])
def test_a_sign_is_reported_where_it_leaves_less_than_a_hundred_times_the_noise(monkeypatch, left, closes):
    assert told_of(monkeypatch, 1e6, left, count=1.0) is closes


def told_of(monkeypatch, now, left, count):
    """Whether a sign is reported with which so much of the equations' squares is left."""
    about = Finding(code="rig.sign", severity="invalidates", evidence={"factor": -1.0})
    monkeypatch.setattr(signs_and_units, "_left", lambda joint, system: {"rig": now, "changed": left}[joint])
    monkeypatch.setattr(signs_and_units, "_changed", lambda joint, system: [(about, "changed", system)])
    return hint_of("arm", "rig", SimpleNamespace(count=count)) is not None


@pytest.mark.parametrize(("half_turns", "follows"), [(6, True), (7, False)])
def test_a_smooth_function_turns_six_times_at_most(half_turns, follows):
    """Over ranks, of which a series of six terms has waves of up to six half turns."""
    rank = (np.arange(500) + 0.5) / 500
    wave = np.cos(np.pi * half_turns * rank)
    (series,) = _series(rank[None])
    left = wave - series @ np.linalg.lstsq(series, wave, rcond=None)[0]
    assert np.std(left) == pytest.approx(0.0 if follows else np.std(wave), abs=1e-9)


def test_the_six_best_sets_within_ten_of_the_best_are_fitted(monkeypatch):
    assert fitted_of(monkeypatch, [0.0, 7.0, 9.0, 12.0, 18.0]) == [0.0, 7.0, 9.0]
    assert fitted_of(monkeypatch, [0.1 * k for k in range(15)]) == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])


def fitted_of(monkeypatch, scores):
    """The linear scores of the sets that are fitted."""
    fits = []
    monkeypatch.setattr(selection, "best_sets", lambda c, starts: [Ranked(s, s) for s in scores])
    monkeypatch.setattr(selection, "begun_by", lambda unknowns, c, chosen: chosen)
    monkeypatch.setattr(selection, "fitted", lambda problem, stage, b: fits.append(b) or SimpleNamespace(score=0.0))
    _best(None, SimpleNamespace(unknowns=SimpleNamespace(variants=()), candidates=None), None)
    assert fits.pop() == ()  # the set that the equations are about
    return fits


@pytest.mark.parametrize(("gained", "rounds"), [(0.7, 2), (1.5, 3)])
def test_a_search_ends_where_the_same_set_is_no_more_than_a_factor_of_e_more_probable(monkeypatch, gained, rounds):
    scores = iter([0.0, -gained, -gained])
    found = []

    def best(*_):
        found.append(SimpleNamespace(keys={"a"}, fit=(), score=next(scores)))
        return found[-1]

    stage = SimpleNamespace(system=SimpleNamespace(hold=0.0))
    monkeypatch.setattr(selection, "_best", best)
    monkeypatch.setattr(selection, "stage_about", lambda *_: stage)
    assert _settled(None, stage, (), np.zeros(0), None)[2]
    assert len(found) == rounds


@pytest.mark.parametrize(("away", "led"), [(8.0, True), (18.0, False)])
def test_a_fit_leads_a_shape_no_farther_than_in_twelve_steps(monkeypatch, away, led):
    shape = Parameter("start", "s", 0.0, 0.005, reach=0.1, shape=True)
    site = Site("link.contact", "link", (shape,), lambda joint, values: joint, lambda left: [(1.0,)])
    monkeypatch.setattr(selection, "remainder", lambda system, joint: None)
    problem, stage = SimpleNamespace(joint=joint_of()), SimpleNamespace(system=None)
    assert _begins(problem, stage, (), site, np.array([1.0 + 0.1 * away])) is led


@pytest.mark.parametrize(("duration", "blocks"), [(12.0, 12), (30.0, 24), (100.0, 24)])
def test_blocks_are_a_second_long_at_least_and_two_dozen_at_most(duration, blocks):
    assert np.unique(blocks_of(SimpleNamespace(time=np.linspace(0.0, duration, 3000)))).size == blocks
