"""De Luca 2007 §V: the two motions of axis 1, 5° and 30°, under the controller of eq. 13; Figs. 3 to 6."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.estimation.live import LiveEstimate
from vsalog.estimators.acceleration_group import NAME
from vsalog.estimators.methods.acceleration_observer import PAPER_FREQUENCY
from vsalog.reproduce.drawing import Figure, figure, over
from vsalog.reproduce.measure import Setting, Study, column, estimate, root_mean_square
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.rig import Rig
from vsalog.rig.schema import ElasticJoint
from vsalog.simulation.control import StateFeedback
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.inputs import Signal, rest_to_rest
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

PAPER, AXIS = "De Luca 2007", "axis1"
OBSERVER = Setting("the paper's", NAME, {"frequency": PAPER_FREQUENCY})
FEEDBACK = {NAME: "full state", "motor": "motor states alone"}
STATES = (
    ("link position", "rad", "link_position", "pretty good"),
    ("joint torsion q − θ", "rad", "deflection", "some errors, with fairly small peaks"),
    ("link velocity", "rad/s", "link_velocity", "pretty good"),
    ("motor position", "rad", "motor_position", "very close, being measured"),
    ("motor velocity", "rad/s", "motor_velocity", "very close"),
)


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion of axis 1 from rest to rest.

    Attributes
    ----------
    degrees : travelled, as printed
    rise : time it takes [s], chosen
    observed, controlled : numbers of its figures
    """

    degrees: float
    rise: float
    observed: int
    controlled: int


@dataclass(frozen=True, slots=True)
class Trials:
    """Chosen values, which the paper does not print.

    Attributes
    ----------
    softness : the spring's stiffness over the controller's value
    significant : an improvement is significant if no more than this part remains
    start, after : when the motion begins, and how long it is watched once it is over [s]
    """

    softness: float = 0.8
    significant: float = 0.75
    start: float = 0.2
    after: float = 0.7


MOTIONS = (Motion(5.0, 0.3, 3, 5), Motion(30.0, 0.5, 4, 6))
TRIALS = Trials()
CONDITIONS = (
    "an arm of the size of a KUKA KR15/2, stretched out: {:g}° of axis 1 from rest to rest under eq. 13, slowest eigenvalues at"
    " 30 rad/s, observer at 250 rad/s"
)
CHOSEN = (
    "everything of the arm and the motion but its length, 30 and 250 rad/s: preset kuka-kr15, scenario kuka-kr15-control, in"
    f" {' and '.join(f'{m.rise:g}' for m in MOTIONS)} s; the spring of axis 1 is {100 * (1 - TRIALS.softness):.0f} % softer than"
    " controller and observer assume"
)


def motions(study: Study) -> Result:
    """Figs. 3 and 4: the observed state in both motions; Figs. 5 and 6: with it and with motor states alone."""
    rows: list[Row] = []
    observed: list[Figure] = []
    controlled: list[Figure] = []
    for motion in MOTIONS:
        runs = {}
        for feedback, title in FEEDBACK.items():
            study.say(f"deluca2007-control: {motion.degrees:g}°, {title}")
            runs[feedback] = swung(motion, feedback, study.seeds[0])
        conditions = CONDITIONS.format(motion.degrees)
        common = Row(
            item="deluca2007-control", paper=PAPER, place=f"Fig. {motion.observed}", quantity="",
            of=f"axis 1, {motion.degrees:g}°", estimator=NAME, settings=OBSERVER.label, tune=OBSERVER.whole_tune,
            window="whole run", conditions=conditions, chosen=CHOSEN, compare="none",
            remark="one seed: the motion decides, not the noise",
        )  # fmt: skip
        found = estimate(runs[NAME], OBSERVER, AXIS)
        truth = runs[NAME].joints[AXIS].truth
        rows += [
            common.with_values(
                quantity=f"rms error of the observed {what}", unit=unit, printed=statement,
                ours=Spread.of([root_mean_square(column(found, name), truth[name])]),
            )
            for what, unit, name, statement in STATES
        ]  # fmt: skip
        rows += _improved(common.with_values(place=f"Fig. {motion.controlled}", compare="holds"), motion, runs)
        title = f"axis 1 over {motion.degrees:g}°"
        panels = tuple(
            over(runs[NAME].time, {"observed": column(found, name), "actual": truth[name]}, f"[{unit}]", title=what)
            for what, unit, name, _ in (*STATES[3:], *STATES[1:3])
        )
        observed.append(figure(PAPER, motion.observed, f"Observed state, {title}", panels, conditions, CHOSEN))
        lines = {FEEDBACK[f]: run.joints[AXIS].truth["link_position"] for f, run in runs.items()}
        lines["reference"] = np.asarray(reference(motion)(runs[NAME].time))
        late = runs[NAME].time > arrival(motion) - 0.3 * motion.rise
        pair = (
            over(runs[NAME].time, lines, "link position [°]", scale=180.0 / np.pi),
            over(runs[NAME].time[late], {n: v[late] for n, v in lines.items()}, "link position [°]", scale=180.0 / np.pi,
                 title="its end"),
        )  # fmt: skip
        controlled.append(figure(PAPER, motion.controlled, f"State feedback, {title}", pair, conditions, CHOSEN))
    return Result(rows, [*observed, *controlled])


def reference(motion: Motion) -> Signal:
    """Return the planned position of the link, a function of time."""
    return rest_to_rest(np.radians(motion.degrees), motion.rise, TRIALS.start)


def arrival(motion: Motion) -> float:
    """Return when the link should be there [s]."""
    return TRIALS.start + motion.rise


def _improved(common: Row, motion: Motion, runs: Mapping[str, Experiment]) -> list[Row]:
    """Rows of overshoot and of swinging once there, by the length of the motion."""
    step, over_shoot, ringing = float(np.radians(motion.degrees)), dict[str, float](), dict[str, float]()
    for feedback, run in runs.items():
        q = run.joints[AXIS].truth["link_position"][run.time >= arrival(motion)]
        over_shoot[feedback] = 100.0 * float(np.max(q) / step - 1.0)
        ringing[feedback] = 100.0 * float(np.std(q)) / step
    rows = []
    for name, found in (("overshoot of the link", over_shoot), ("swinging of the link once there, rms", ringing)):
        with_it, without = found[NAME], found["motor"]
        rows.append(
            common.with_values(
                quantity=name,
                unit="%",
                printed="significant improvements over motor states alone (here: a quarter less)",
                ours=f"{with_it:.2g} instead of {without:.2g}",
                holds=with_it < TRIALS.significant * without,
                window="once there",
            )
        )
    return rows


def swung(motion: Motion, feedback: str, seed: int) -> Experiment:
    """Simulate a motion under the controller, on an arm whose first spring is softer than in the rig."""
    rig = Rig.preset("kuka-kr15")
    joint = rig.file.joint[AXIS]
    assert isinstance(joint, ElasticJoint)
    length = arrival(motion) + TRIALS.after
    scenario = Scenario.load("kuka-kr15-control").lasting(length, None)
    stiffness = joint.transmission.stiffness  # type: ignore[union-attr]
    actual = rig.with_settings({f"joint.{AXIS}.transmission.stiffness": f"{TRIALS.softness * stiffness!r}"})
    asked = scenario.controllers(rig.file)[AXIS]
    assert isinstance(asked, StateFeedback)
    control = replace(
        asked,
        feedback=feedback,  # type: ignore[arg-type]
        reference=reference(motion),
        tune={"frequency": f"{PAPER_FREQUENCY:g}"},
    )
    simulated = simulate(
        actual.file, scenario.inputs(rig.file), length, seed=seed, believed=rig.file, controllers={AXIS: control},
        estimator=LiveEstimate,
    )  # fmt: skip
    return replace(simulated, rig=rig.file)
