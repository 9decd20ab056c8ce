"""Values fitted to simulated windows: nearer to the truth than those of the equations, and as sure as they say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from written_out import Truth, channels, joint_of

from vsalog.diagnosis import trajectory
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.found import found_by
from vsalog.diagnosis.gain import weighed
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.posterior import Problem, most_probable
from vsalog.diagnosis.selection import Choice, Selection, blocks_of, choices_of, sites_of, stage_about
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.subsets import Ranked
from vsalog.diagnosis.trajectory import _as_seen, refined
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system
from vsalog.residuals.windows import windows_of


def selection_of(found, causes):
    """What a search that found just these causes hands on; torques are smooth."""
    joint = joint_of()
    system = build_system(joint, found, balance_for(joint))
    setting = setting_of(joint, system)
    problem, sites, blocks = Problem(joint, setting, {}), sites_of(setting, frozenset()), blocks_of(system)
    own = [next(s for s in sites if s.cause == cause) for cause in causes]
    stage = stage_about(problem, system, sites, tuple((s, np.array(s.start)) for s in own), blocks, 0.0)
    posterior = most_probable(problem, stage.weights, tuple((s, np.array(s.start)) for s in own))
    stage = stage_about(problem, system, sites, posterior.fit, blocks, 0.0)
    posterior = most_probable(problem, stage.weights, posterior.fit)
    chosen = np.array([v.inside for v in stage.unknowns.variants])
    best = Ranked(chosen, stage.candidates.scored(chosen))
    choices = tuple(choices_of(problem, stage, stage.candidates, best, stage.unknowns.variants, posterior))
    return Selection(problem, stage, posterior, choices, blocks)


def windows_for(found, selection):
    joint = selection.problem.joint
    return weighed(placed(joint, selection.posterior.fit), windows_of(joint, found, False))


def values_of(selection):
    return np.concatenate([v for _, v in selection.posterior.fit])


def spread_of(selection):
    return np.sqrt(np.diag(selection.posterior.covariance))


def moved(selection, off):
    """The selection with its values so many of the equations' standard deviations away."""
    fit, start, spread = [], 0, spread_of(selection)
    for site, values in selection.posterior.fit:
        own = slice(start, start + values.size)
        fit.append((site, values + off * spread[own]))
        start += values.size
    return replace(selection, posterior=replace(selection.posterior, fit=tuple(fit)))


HIDDEN = {
    ("motor.inertia", "motor.viscous_friction"): (Truth(inertia=0.0215, damping=0.06), (0.0215, 0.06)),
    ("link.inertia", "link.viscous_friction"): (Truth(link_inertia=0.032, link_damping=0.03), (0.032, 0.03)),
    ("motor.coulomb_friction",): (Truth(coulomb=0.05), (0.05,)),
}


@pytest.mark.every(3)
@pytest.mark.parametrize("causes", HIDDEN, ids="+".join)
def test_values_are_nearer_to_the_truth_and_as_sure_as_is_reported(causes):
    """Over several logs, from values two standard deviations away from those of the equations."""
    truth, expected = HIDDEN[causes]
    before, after, off = [], [], []
    for seed in range(4):
        found = channels(truth, duration=8.0, seed=seed).thinned()
        first = moved(selection_of(found, causes), (-2.0, 2.0)[seed % 2])
        then = refined(first, windows_for(found, first))
        assert [s.cause for s, _ in then.posterior.fit] == list(causes)
        before.append(values_of(first) - expected)
        after.append(values_of(then) - expected)
        told = {f.site.cause: next(iter(f.numbers().values())) for f in found_by(then, joint_of())}
        off.append([(told[c][0] - e) / told[c][1] for c, e in zip(causes, expected, strict=True)])
        # What is simulated adds to what the equations say.
        assert np.all(spread_of(then) < spread_of(first))
    assert np.all(np.mean(np.square(after), axis=0) < 0.6 * np.mean(np.square(before), axis=0))
    # Four logs: a chi-square of four and more degrees of freedom, and none far out.
    assert np.max(np.abs(off)) < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_a_log_without_causes_stays_as_it_is():
    found = channels(duration=8.0, seed=1).thinned()
    first = selection_of(found, ())
    then = refined(first, windows_for(found, first))
    assert then.posterior.fit == ()
    assert then.choices == ()
    assert then.posterior.simulated is None


def test_a_causes_size_is_the_larger_of_equations_and_trajectories():
    """A damping that is far off shows in the windows by more than what a simulation may be off."""
    found = channels(Truth(damping=0.09), duration=8.0, seed=1).thinned()
    first = selection_of(found, ("motor.viscous_friction",))
    then = refined(first, windows_for(found, first))
    (small,), (large,) = first.choices, then.choices
    assert large.size >= small.size
    assert large.size > 1.0
    assert large.site.key == small.site.key
    assert then.posterior.simulated.shape == (1, 1)


def test_a_value_that_is_far_off_is_brought_back():
    """Ten standard deviations: more than the prior of the equations would have, and the trajectories say so."""
    truth, expected = HIDDEN["motor.inertia", "motor.viscous_friction"]
    found = channels(truth, duration=8.0, seed=3).thinned()
    first = moved(selection_of(found, ("motor.inertia", "motor.viscous_friction")), 10.0)
    then = refined(first, windows_for(found, first))
    assert np.all(np.abs(values_of(then) - expected) < 0.3 * np.abs(values_of(first) - expected))


def test_windows_that_do_not_do_what_derivatives_promise_change_no_values(monkeypatch):
    """Most of them, as where what sticks and slips decides what follows: the values of the equations stay."""
    found = channels(Truth(damping=0.06), duration=8.0, seed=0).thinned()
    first = moved(selection_of(found, ("motor.viscous_friction",)), 2.0)
    windows, begun = windows_for(found, first), trajectory.begun
    count = len(windows.spans)
    for far, stays in ((count // 2, False), (count // 2 + 1, True)):
        bent = np.arange(far)
        monkeypatch.setattr(trajectory, "begun", lambda *a, bent=bent, **k: replace(begun(*a, **k), far=bent))
        then = refined(first, windows)
        assert np.array_equal(values_of(then), values_of(first)) is stays


@pytest.mark.parametrize(("size", "over"), [(0.0, 0.0), (0.1, 0.2), (5.0, np.inf)])
def test_a_cause_is_as_large_as_in_equations_or_trajectories_whichever_shows_more(size, over):
    """A change by the noise is what takes a trajectory to √2 times its noise: 1 / √3 of what takes it to twice."""
    site = Site("cause", "part", (Parameter("number", "1", 0.0, 1e-3),), lambda joint, values: joint)
    variant = SimpleNamespace(free=(0,), rig=np.zeros(1), deviation=np.ones(1))
    posterior = SimpleNamespace(fit=[(site, np.ones(1))], linear=SimpleNamespace(first=[0, 1], variants=[variant]))
    selection = SimpleNamespace(posterior=posterior, choices=[Choice(site, (9.0,), (), size, over)])
    windows = SimpleNamespace(spans=np.zeros((2, 2)), roles=["link_position"])
    (seen,) = _as_seen(selection, windows, np.ones((2, 30, 1)))
    assert seen.size == pytest.approx(max(size, 3.0**-0.5))
    assert seen.over_model_error == pytest.approx(seen.size * (over / size if size else 1.0))
