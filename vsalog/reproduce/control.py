"""Controllers in the loop: De Luca 2007, Figs. 5–6, and Shin 2021, Fig. 14; on other machines than the controllers know."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray

from vsalog.estimation.live import LiveEstimate
from vsalog.reproduce.measure import Study
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.reproduce.shin_machines import STATED, machine
from vsalog.rig import Rig
from vsalog.rig.schema import PneumaticJoint
from vsalog.simulation.control import StateFeedback
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

DELUCA = {"acceleration-observer": "the observer's state", "motor": "motor states alone"}
SHIN = (
    ("pam-angle-control", "link_position", "angle", np.radians(40.0), 5.25),
    ("pam-torque-control", "transmission_torque", "torque", 4.0, 5.0),
)


@dataclass(frozen=True, slots=True)
class Trials:
    """What is chosen here, since no paper prints it.

    Attributes
    ----------
    softness : De Luca: the spring's stiffness over what the controller takes it for
    significant : De Luca: an improvement is significant that leaves no more than this part
    swing : De Luca: duration [s]
    steady : Shin: how long before the next step an error counts as steady [s]
    machines : Shin: how many are controlled; each takes a minute
    """

    softness: float = 0.8
    significant: float = 0.75
    swing: float = 2.2
    steady: float = 1.0
    machines: int = 3


TRIALS = Trials()


def state_feedback(study: Study) -> Result:
    """De Luca 2007 §V-B: the controller of eq. 13 on the observer's state, and on motor states alone."""
    common = Row(
        item="deluca2007-control", paper="De Luca 2007", place="Figs. 5–6", quantity="", of="axis 1",
        estimator="acceleration-observer", settings="the paper's", window="whole run",
        conditions="an arm of the size of a KUKA KR15/2, stretched out: 5° of axis 1 from rest to rest, slowest eigenvalues at"
        " 30 rad/s",
        chosen="everything of the arm and the motion but these 5° and 30 rad/s: preset kuka-kr15, scenario kuka-kr15-control; the"
        f" spring of axis 1 is {100 * (1 - TRIALS.softness):.0f} % softer than the controller takes it for",
    )  # fmt: skip
    over, ringing = dict[str, float](), dict[str, float]()
    for feedback in DELUCA:
        study.say(f"deluca2007-control: {DELUCA[feedback]}")
        q, step, arrived = _swung(feedback, study.seeds[0])
        over[feedback] = 100.0 * float(np.max(q[arrived:]) / step - 1.0)
        ringing[feedback] = 100.0 * float(np.std(q[arrived:])) / step
    rows = []
    for name, unit, found in (
        ("overshoot of the link", "%", over),
        ("swinging of the link once there, rms", "%", ringing),
    ):
        with_it, without = found["acceleration-observer"], found["motor"]
        rows.append(
            common.with_values(
                quantity=name,
                unit=unit,
                printed="significant improvements over motor states alone",
                ours=f"{with_it:.2g} instead of {without:.2g}",
                compare="holds",
                holds=with_it < TRIALS.significant * without,
            )
        )
    return Result(rows, [])


def _swung(feedback: str, seed: int) -> tuple[Array, float, int]:
    """Return the link's position, how far it was to go, and the sample from which it should be there."""
    rig = Rig.preset("kuka-kr15")
    scenario = Scenario.load("kuka-kr15-control").lasting(TRIALS.swing, None)
    stiffness = rig.joints["axis1"].transmission.stiffness  # type: ignore[union-attr]
    actual = rig.with_settings({"joint.axis1.transmission.stiffness": f"{TRIALS.softness * stiffness!r}"})
    asked = scenario.controllers(rig.file)["axis1"]
    assert isinstance(asked, StateFeedback)
    played = simulate(
        actual.file, scenario.inputs(rig.file), TRIALS.swing, seed=seed, believed=rig.file,
        controllers={"axis1": replace(asked, feedback=feedback)}, estimator=LiveEstimate,  # type: ignore[arg-type]
    )  # fmt: skip
    reference = np.asarray(asked.reference(played.time))  # type: ignore[operator]
    arrived = int(np.argmax(reference >= reference[-1] * (1.0 - 1e-9)))
    return played.joints["axis1"].truth["link_position"], float(reference[-1]), arrived


def pressures_alone(study: Study) -> Result:
    """Shin 2021 §IV-C: the PI controller on the filter's angle, and on its torque."""
    rows = []
    for scenario, role, what, span, printed in SHIN:
        errors = []
        for seed in study.seeds[: TRIALS.machines]:
            study.say(f"shin-control: {what}, machine {seed}")
            errors.append(100.0 * _steady_error(*_controlled(scenario, role, seed)) / span)
        rows.append(
            Row(
                item="shin-control", paper="Shin 2021", place="§IV-C, Fig. 14", quantity="largest steady error by its range",
                unit="%", of=what, settings="the paper's", estimator="pam-ukf", printed=printed, ours=Spread.of(errors),
                window=f"last {TRIALS.steady:g} s of each step", compare="lower",
                conditions="two pneumatic muscles under the paper's PI controller, which reads the pressures alone;"
                + (" the joint clamped at 0°" if what == "torque" else " the joint free"),
                chosen="references in steps of 10 s (torque) and 20 s (angle); T_I as a gain per second; samples of 5 ms",
                remark=STATED,
            )
        )  # fmt: skip
    return Result(rows, [])


def _controlled(name: str, role: str, seed: int) -> tuple[Array, Array, Array]:
    """Return time, reference and truth of what is controlled on a machine that is not what the rig says."""
    rig = Rig.preset("pam").file
    joint = rig.joint["pam"]
    assert isinstance(joint, PneumaticJoint)
    if role != "link_position":
        joint = with_fields(joint, seesaw=with_fields(joint.seesaw, held_at=0.0))
    believed, actual = (with_fields(rig, joint={"pam": j}) for j in (joint, machine(joint, seed)))
    scenario = Scenario.load(name)
    control = scenario.controllers(believed)
    played: Experiment = simulate(
        actual,
        {},
        scenario.file.duration,
        period=scenario.file.period,
        seed=seed,
        controllers=control,
        believed=believed,
        estimator=LiveEstimate,
    )
    reference = np.asarray(control["pam"].reference(played.time))  # type: ignore[operator]
    return played.time, reference, played.truth[role]


def _steady_error(time: Array, reference: Array, truth: Array) -> float:
    """Return the largest error in the time before each step of the reference, and before the end."""
    steps = [*time[1:][np.diff(reference) != 0.0], time[-1]]
    late = np.any([(time < end) & (time >= end - TRIALS.steady) for end in steps], axis=0)
    return float(np.max(np.abs(reference - truth)[late]))
