"""Serio, Grioli, Sardellitti, Tsagarakis, Bicchi, ICRA 2011: simulated errors of the decoupled impedance observer (Fig. 4).

The coupled one of §III-A needs a push of known size; both are held against one another where the link is pushed.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from vsalog.reproduce.measure import Setting, Study, estimate, with_noise
from vsalog.reproduce.planned import Column, Planned, mean_relative, row_of
from vsalog.reproduce.rows import Curve, Figure, Panel, Result, Row, Spread
from vsalog.rig.parts import Link
from vsalog.rig.schema import SerialJoint, Signal
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import awas_experiment, awas_rig
from vsalog.simulation.inputs import sine, sum_of
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

PAPER = "Serio 2011"
# Fig. 4: mean relative errors [%].
PRINTED = {"stiffness": 5.1, "damping": 6.7, "inertia": 9.8}

OBSERVER = Planned("the decoupled impedance observer", ("impedance",))
CONDITIONS = "AwAS, sinusoidal torques of both motors, 20 s at 1 kHz from rest; the mean of |x̂ − x|/x over the run"
CHOSEN = (
    "15 N·m at 2 Hz on the joint's side of the motor and 293 N·m at 0.1 Hz on that of the secondary motor, which move φ over"
    " ±0.1 rad and r over 50 to 100 mm; encoders and torque noise of the preset awas; all inertias and dampings as Flacco 2012"
    " eq. 53 has them"
)
TORQUES = {"motor_torque": sine(15.0, 2.0), "secondary_torque": sine(293.0, 0.1)}
OTHER_METHOD = (
    "another method than the paper's, for comparison: {} The first samples, before anything is learnt, do not count"
)


def simulated(study: Study) -> Result:
    """Fig. 4: mean relative errors of the link's stiffness, damping and inertia."""
    study.say("serio2011: simulating")
    experiments = with_noise(awas_experiment(ideal=True, torques=TORQUES), study.seeds)
    common = Row(
        item="serio2011",
        paper=PAPER,
        place="Fig. 4",
        quantity="",
        unit="%",
        settings="the paper's",
        window="whole run",
        conditions=CONDITIONS,
        chosen=CHOSEN,
    )
    rows = [
        row_of(
            common.with_values(
                quantity=f"mean relative error of the link's {what}", printed=printed, of=OBSERVER.title
            ),
            OBSERVER,
            Column(column, truth, mean_relative),
            lambda: experiments,
            "awas",
            study,
        )
        for what, printed, column, truth in (
            ("stiffness", PRINTED["stiffness"], "stiffness", _stiffness),
            ("damping", PRINTED["damping"], "link_damping", _damping),
            ("inertia", PRINTED["inertia"], "link_inertia", _inertia),
        )
    ]
    time, sigma = experiments[0].time, experiments[0].truth["stiffness"]
    curves = [Curve("actual", time, sigma, "dashed")]
    for name, why in (
        ("residual-rls", "it needs no torque sensor and no derivative of one."),
        ("direct", "it needs the torque sensor, but no parameter of the motor."),
        ("grioli-bicchi", "the observer of §II-A on the motor's equation of motion, without a torque sensor."),
        ("grioli-parametric", "it learns a model from the torque sensor's rate."),
    ):
        study.say(f"serio2011: {name}")
        setting = Setting("vsalog's default", name, {})
        traces = [np.asarray(estimate(e, setting)["total"]["stiffness"], dtype=np.float64) for e in experiments]
        curves.append(Curve(name, time, traces[0]))
        rows.append(
            common.with_values(
                quantity="mean relative error of the link's stiffness",
                of=f"{name} instead",
                settings=setting.label,
                estimator=name,
                printed=PRINTED["stiffness"],
                ours=Spread.of([mean_relative(t, sigma) for t in traces]),
                compare="none",
                remark=OTHER_METHOD.format(why),
            )
        )
    rows += _pushed(study, common)
    panel = Panel(
        x_label="time [s]",
        y_label="stiffness [N·m/rad]",
        y_range=(0.0, 1.3 * float(sigma.max())),
        curves=tuple(curves),
    )
    return Result(rows, [Figure("serio2011-fig4", "AwAS: stiffness (Serio 2011, Fig. 4a)", (panel,))])


def _pushed(study: Study, common: Row) -> list[Row]:
    """The coupled observers (§III-A) and the decoupled ones (§III-B), from the right guess of the inertia and thrice that."""
    study.say("serio2011: simulating a push")
    believed = awas_rig()
    joint = believed.joint["awas"]
    assert isinstance(joint, SerialJoint)
    sensed = changed(joint.signals, external_torque=Signal(channel="/push.effort[link]", noise=0.05))
    rig = changed(believed, joint={"awas": changed(joint, signals=sensed)})
    push = sum_of(sine(5.0, 0.7), sine(5.0, 3.1), sine(5.0, 5.3))
    played = simulate(rig, {"awas": {**TORQUES, "external_torque": push}}, 20.0, period=1e-3, ideal=True)
    experiments = with_noise(played, study.seeds)
    inertia = _link(played, "awas").inertia
    rows = []
    for name, tune, what in (
        ("impedance", {}, "decoupled observers, link pushed"),
        ("impedance-coupled", {}, "coupled observers, link pushed"),
        ("impedance-coupled", {"inertia": 3.0 * inertia}, "coupled observers, link pushed, guess thrice the inertia"),
    ):
        study.say(f"serio2011: {what}")
        setting = Setting("vsalog's default" if not tune else "another initial guess", name, tune)
        traces = [estimate(e, setting)["total"] for e in experiments]
        for quantity, column, truth in (("stiffness", "stiffness", _stiffness), ("inertia", "link_inertia", _inertia)):
            if column not in traces[0]:
                continue
            errors = [
                mean_relative(np.asarray(t[column], dtype=np.float64), truth(e, "awas"))
                for t, e in zip(traces, experiments, strict=True)
            ]
            rows.append(
                common.with_values(
                    place="§III-A",
                    quantity=f"mean relative error of the link's {quantity}",
                    of=what,
                    settings=setting.label,
                    estimator=name,
                    tune=setting.whole_tune,
                    ours=Spread.of(errors),
                    compare="none",
                    conditions=f"{CONDITIONS}; the link is pushed by 5 N·m at 0.7, 3.1 and 5.3 Hz each",
                    remark="the paper prints no number: it says that the coupled observers depend on their initial guess",
                )
            )
    return rows


def _stiffness(experiment: Experiment, joint: str) -> Array:
    return experiment.joints[joint].truth["stiffness"]


def _damping(experiment: Experiment, joint: str) -> Array:
    return np.full_like(experiment.time, _link(experiment, joint).damping)


def _inertia(experiment: Experiment, joint: str) -> Array:
    return np.full_like(experiment.time, _link(experiment, joint).inertia)


def _link(experiment: Experiment, joint: str) -> Link:
    spec = experiment.rig.joint[joint]
    assert isinstance(spec, SerialJoint)
    assert spec.link is not None
    return spec.link
