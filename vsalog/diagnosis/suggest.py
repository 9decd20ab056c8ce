"""The next experiment: the one that best separates what this log leaves confused, from the rig's own simulation.

Each candidate is simulated with one of two hypotheses in the rig, its equations are formed as those of a log are, with that
log's noise, and the other hypothesis is fitted to them. Its residual is what separates the two:

    D² = (Σ r_other² − Σ r_own²) / n,    r the whitened averages, n of them,

so that D is how far the two are apart, in standard deviations of one average (the T-criterion of Atkinson and Fedorov 1975,
The design of experiments for discriminating between two rival models). Of all candidates the one is proposed whose smallest
separation per second is largest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vsalog.binding.joint import bind
from vsalog.core.errors import DiagnosisError, VsalogError
from vsalog.core.progress import counted
from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.diagnosis.joint import JointDiagnosis, Progress
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.posterior import ITERATIONS, Problem
from vsalog.diagnosis.subsets import BEST
from vsalog.diagnosis.suggest_candidates import Candidate, Trial, candidates
from vsalog.diagnosis.suggest_questions import Hypothesis, Questions, ordinary_causes, questions_of, shown
from vsalog.diagnosis.suggest_range import Seen, seen_in
from vsalog.effects.gravity import GRAVITY
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.per_log import in_last
from vsalog.residuals.sensing import bare
from vsalog.residuals.system import System, build_system
from vsalog.rig import Rig
from vsalog.rig.schema import Payload, PneumaticJoint, RigFile
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.scenario_schema import ScenarioFile
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Suggestion:
    """An experiment that is proposed.

    Attributes
    ----------
    joint : that it drives
    best : the candidate, as it was simulated
    questions : that it is to answer
    of_several : whether the rig has other joints
    """

    joint: str
    best: Trial
    questions: Questions
    of_several: bool


def suggest(rig: Rig, found: Sequence[JointDiagnosis], progress: Progress = lambda _: None) -> Suggestion:
    """Propose the experiment that would separate most causes.

    Parameters
    ----------
    rig : as given
    found : about each joint; the first one that has causes confused is asked about, else the first
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        Nothing can be proposed: the joint cannot be simulated, or the log shows no motion that could be repeated.
    """
    open_ones = [(one, questions_of(one)) for one in found]
    one, questions = next((o for o in open_ones if o[1].confused), open_ones[0])
    if not questions.asked:
        raise DiagnosisError(f"joint '{one.name}': another experiment could not show anything more")
    subject = Subject(one.name, one.joint, in_last(one.extended), one.system, one.selection.problem)
    bench, questions = Bench(rig, subject, seen_in(subject.extended, one.system)), questions.in_another_log()
    progress(f"joint {one.name}: looking for the experiment that would separate most causes")
    return Suggestion(one.name, bench.best(questions), questions, len(rig.joints) > 1)


@dataclass(frozen=True, slots=True)
class Subject:
    """A joint that an experiment is looked for.

    Attributes
    ----------
    name : of the joint
    joint : as the rig has it, on the joint's side
    extended : with what is known to be wrong
    system : of a log of it, or of a motion that was simulated
    problem : what its causes are sought with
    """

    name: str
    joint: Any
    extended: Any
    system: System
    problem: Problem


@dataclass(frozen=True, slots=True)
class Bench:
    """What candidates are simulated with.

    Attributes
    ----------
    rig : as given
    subject : the joint
    seen : what it bears
    """

    rig: Rig
    subject: Subject
    seen: Seen

    @property
    def period(self) -> float:
        """Sample time [s]."""
        channels = self.subject.system.channels
        return max((channels.whole or channels).period, DESIGN.shortest_period)

    def best(self, questions: Questions) -> Trial:
        """Return the candidate that separates best.

        Raises
        ------
        VsalogError
            None can be simulated.
        """
        plain = self.subject.joint
        trials = self._first_look(plain, None, questions)
        if questions.confused:
            trials = self._both_ways(plain, trials, questions)
            trials = self._rich(plain, trials, questions)
        best = max(trials, key=lambda p: _worth(p, trials, questions))
        payload = payload_for(plain, questions)
        if payload is not None:
            loaded = with_fields(plain, link=with_fields(plain.link, payload=payload))
            trial = self._tried(loaded, best.candidate, payload, questions)
            if trial is not None and _worth(trial, trials, questions) > DESIGN.worthwhile * _worth(
                best, trials, questions
            ):
                return trial
        return best

    def _first_look(self, plain: Any, payload: Payload | None, questions: Questions) -> list[Trial]:
        """Simulate every candidate with the first hypothesis of each question."""
        whole = self.rig.file
        file = with_fields(whole, joint={**whole.joint, self.subject.name: self.subject.extended})
        trials, why = list[Trial](), None
        every = list(candidates(self.subject.name, self.subject.extended, file, self.seen, self.period))
        for candidate in counted("experiments", every):
            try:
                one = self._tried(plain, candidate, payload, questions, False)
            except VsalogError as error:
                why = error
                continue
            if one is not None:
                trials.append(one)
        if not trials:
            raise why or DiagnosisError(
                f"joint '{self.subject.name}': no experiment stays within the positions, speeds and torques that this log shows"
            )
        return trials

    def _both_ways(self, plain: Any, trials: list[Trial], questions: Questions) -> list[Trial]:
        """Simulate the best ones with the other hypotheses too; what separates less counts."""
        ranked = sorted(trials, key=lambda p: -_worth(p, trials, questions))[:BEST]
        checked = [self._tried(plain, p.candidate, p.payload, questions) for p in ranked]
        return [c for c in checked if c is not None] or ranked

    def _rich(self, plain: Any, trials: list[Trial], questions: Questions) -> list[Trial]:
        """Return, of those that separate about as well as the best, the one that shows most of all other causes.

        What separates two causes may leave others free to take part: a motion without acceleration does not determine inertia.
        """
        worth = [_worth(p, trials, questions) for p in trials]
        # What the best one separates has to stay separated.
        bar = max(max(worth) / DESIGN.worthwhile, min(max(worth), DESIGN.separate))
        near = [p for p, w in zip(trials, worth, strict=True) if w >= bar]
        return [max(near, key=lambda p: self._shown(plain, p.candidate.file, questions.asked[0].one))]

    def _shown(self, plain: Any, file: ScenarioFile, truth: Hypothesis) -> float:
        """Return how far causes of an ordinary size move the equations of an experiment, on the geometric mean."""
        try:
            system = self.simulated(placed(plain, truth.fit), file)
        except Left:
            return 0.0
        others = ordinary_causes(self.subject.problem, truth)
        return float(np.mean([np.log(max(shown(system, plain, o, truth), 1e-6)) for o, _ in others])) if others else 0.0

    def _tried(
        self,
        plain: Any,
        candidate: Candidate,
        payload: Payload | None,
        questions: Questions,
        both: bool = True,
    ) -> Trial | None:
        """Return how well a candidate separates, as large as it may be; none where it cannot be small enough."""
        for _ in range(ITERATIONS):
            try:
                return Trial(candidate, self._separations(plain, candidate.file, questions, both), payload)
            except Left as left:
                candidate = candidate.with_share(candidate.share * DESIGN.share / left.taken)
        return None

    def _separations(self, plain: Any, file: ScenarioFile, questions: Questions, both: bool) -> Array:
        """Return D of each question.

        Raises
        ------
        Left
            A motion leaves what was seen.
        """
        if not questions.confused:
            nothing = questions.asked[0].other
            system = self.simulated(placed(plain, nothing.fit), file)
            return np.array([shown(system, plain, q.one, nothing) for q in questions.asked])
        systems = dict[int, System]()
        out = np.full(len(questions.asked), np.inf)
        for i, question in enumerate(questions.asked):
            ways = [(question.one, question.other), (question.other, question.one)]
            for own, other in ways if both and not question.nested else ways[:1]:
                if id(own) not in systems:
                    systems[id(own)] = self.simulated(placed(plain, own.fit), file)
                out[i] = min(out[i], separation(systems[id(own)], plain, own, other))
        return out

    def simulated(self, joint: Any, file: ScenarioFile) -> System:
        """Simulate a scenario with a joint and form its equations; `Left` where the motion leaves what was seen."""
        log, name, rig = self.subject.system.channels, self.subject.name, self._with(joint)
        own = with_fields(file, joint={n: d for n, d in file.joint.items() if n in rig.joint})
        inputs = Scenario(own).inputs(rig)
        experiment = simulate(rig, inputs, file.duration, period=file.period, ideal=True)
        taken = self.seen.taken(experiment.joints[name].truth)
        if taken > 1.0:
            raise Left(taken)
        signals = bind([experiment.recording()], name, bare(joint), list(log.raw))
        channels = replace(channels_of(signals), noise=log.noise, spread=log.spread).thinned()
        # A servo's torque is held from sample to sample; valves follow their voltage as it is.
        hold = 0.0 if isinstance(joint, PneumaticJoint) else 0.5 * file.period
        return build_system(joint, channels, balance_for(joint), hold)

    def _with(self, joint: Any) -> RigFile:
        """Return the rig with the joint in it; joints that do not move with it are left out."""
        file, name = self.rig.file, self.subject.name
        chained = [] if file.chain is None else [link.joint for link in file.chain.link]
        joints = {n: j for n, j in file.joint.items() if n == name or (name in chained and n in chained)}
        return with_fields(file, joint={**joints, name: joint}, chain=file.chain if name in chained else None)


class Left(Exception):
    """A motion leaves what was seen: the factor by which it is larger."""

    def __init__(self, taken: float) -> None:
        super().__init__(taken)
        self.taken = taken


def separation(system: System, joint: Any, own: Hypothesis, other: Hypothesis, predicted: bool = False) -> float:
    """Return how far two hypotheses are apart, in standard deviations of one average.

    Parameters
    ----------
    system : of an experiment that was simulated with `own` in the rig
    joint : of the rig, without either
    own, other : with the values to begin with
    predicted : the experiment was simulated with neither; what `own` would change is predicted from its equations
    """
    mine = own.residual(system, joint)
    there = mine if predicted else np.zeros_like(mine)

    def residual(values: Array) -> Array:
        return other.at(values).residual(system, joint) - there

    def jacobian(values: Array) -> Array:
        return other.at(values).jacobian(system, joint)

    parameters = [p for site, _ in other.fit for p in site.parameters]
    low, high = np.array([(p.low, p.high) for p in parameters]).T
    start, steps = np.clip(other.values, low, high), [p.step for p in parameters]
    theirs = least_squares(residual, start, jacobian, (low, high), x_scale=steps)
    more = 2.0 * float(theirs.cost) - float((mine - there) @ (mine - there))
    return float(np.sqrt(max(more, 0.0) / max(system.count, 1)))


def payload_for(joint: Any, questions: Questions) -> Payload | None:
    """Return a mass that changes inertia and weight alike; none without gravity, or where a payload is in question."""
    link = getattr(joint, "link", None)
    asked = {site.cause for q in questions.asked for h in (q.one, q.other) for site, _ in h.fit}
    if link is None or not link.gravity_torque or link.payload is not None or "link.payload" in asked:
        return None
    distance = float(f"{GRAVITY * link.inertia / abs(link.gravity_torque):.2g}")
    return Payload(mass=float(f"{DESIGN.payload * link.inertia / distance**2:.2g}"), distance=distance)


def _worth(one: Trial, among: Sequence[Trial], questions: Questions) -> float:
    """Return what an experiment is worth.

    Where causes are confused that is the smallest separation of those pairs that any of the candidates separates; where the log
    could not have shown something, how many times smaller it may be to show, on the geometric mean.
    """
    if not questions.confused:
        now = np.array([max(q.now, 1e-6) for q in questions.asked])
        return float(np.exp(np.mean(np.log(np.maximum(one.separations, 1e-6) / now))))
    best = np.max([p.separations for p in among], axis=0)
    answered = best >= DESIGN.separate
    chosen = one.separations[answered] if answered.any() else one.separations
    return float(np.min(chosen))
