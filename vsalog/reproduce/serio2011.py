"""Serio, Grioli, Sardellitti, Tsagarakis, Bicchi, ICRA 2011: errors of the decoupled impedance observer, Figs. 4 and 5.

The paper's settings are run as printed: the stiffness observer with its gain on differences from one sample to the next, and
the extended Kalman filter of §VII with its Q, R and P(0), written out here since `impedance` derives its own. The coupled
observers of §III-A need a push of known size; the two are compared where the link is pushed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from vsalog.core.trace import Trace
from vsalog.reproduce.drawing import Figure, figure, over
from vsalog.reproduce.flacco2012_experiment import nominal_stiffness, softer
from vsalog.reproduce.measure import Setting, Study, column, estimate, mean_relative, with_noise
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.rig.parts import Link
from vsalog.rig.schema import RigFile, SerialJoint, Signal
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import awas_rig
from vsalog.simulation.inputs import Input, sine, sum_of
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

PAPER = "Serio 2011"
# Figs. 4 and 5: mean relative errors [%].
PRINTED = {"stiffness": 5.1, "damping": 6.7, "inertia": 9.8}
EXPERIMENT = {"stiffness": 38.2, "damping": 9.4, "inertia": 12.2}


@dataclass(frozen=True, slots=True)
class Tuning:
    """The values that §IV prints: the gain α [1/rad], and Q, R and P(0) of the filter as multiples of identities."""

    alpha: float
    Q: float
    R: float
    P0: float

    @property
    def label(self) -> str:
        """As a row's tuning states it, apart from α."""
        return f"Q = {self.Q:g} I, R = {self.R:g} I, P(0) = {self.P0:g} I, x(0) = 0"


SIMULATED = Tuning(2000.0, 1e-3, 1e-3, 1e4)
MEASURED = Tuning(8.0, 1e-5, 1e-6, 1e2)
OBSERVERS = {"stiffness": "stiffness", "damping": "link_damping", "inertia": "link_inertia"}
UNITS = {"stiffness": "N·m/rad", "damping": "N·m·s/rad", "inertia": "kg·m²"}
DEFAULT = Setting("vsalog's default", "impedance", {})
MOTION = "AwAS, sinusoidal torques of both motors, 20 s at 1 kHz from rest; the mean of |x̂ − x|/x"
CHOSEN = (
    "15 N·m at 2 Hz on the joint's side of the motor and 293 N·m at 0.1 Hz on that of the secondary motor, which move φ over"
    " ±0.1 rad and r over 50 to 100 mm; encoders and torque noise of the preset awas; all inertias and dampings as Flacco 2012"
    " eq. 53 has them"
)
IDEAL = (
    f"{CHOSEN}; sensors without steps and noise, for the text attributes the experiment's larger errors to its encoders"
)
MACHINE = f"{CHOSEN}; a machine with k_s = 0.0107 kN/mm and 0.01422 in the rig, as Flacco 2012 §8 found of the AwAS"
DIFFERS = "amplitudes and frequencies of the torques, on which the errors depend, are not printed"
TORQUES: Mapping[str, Input] = {"motor_torque": sine(15.0, 2.0), "secondary_torque": sine(293.0, 0.1)}
OTHER_METHOD = (
    "another method than the paper's, for comparison: {} The first samples, before there is an estimate, do not count"
)
NOISE_DIFFERENCED = (
    "differences from one sample to the next of an encoder and of a noisy torque are mostly noise, which is followed"
)
NOISE_IN_RATE = (
    "the printed R assumes 0.001 rad/s for a velocity by differences, with an encoder's steps of 0.16 rad/s, and noise in"
    " the regressor biases the damping, which the link hardly shows"
)
FROM_NOTHING = (
    "over the whole run the mean is unbounded: with x(0) = 0 as printed the filter begins with an infinite inertia"
)
NOMINAL = (
    "the paper has no other truth than the nominal model; a machine whose spring is a quarter softer is off by a third"
)


def simulated(study: Study) -> Result:
    """Figs. 4 and 5: mean relative errors of the link's stiffness, damping and inertia."""
    study.say("serio2011: simulating")
    believed = awas_rig()
    nominal = simulated_by(believed, believed)
    recordings = with_noise(nominal, study.seeds)
    softer_recordings = with_noise(simulated_by(softer(believed), believed), study.seeds)
    common = Row(
        item="serio2011", paper=PAPER, place="Fig. 4", quantity="", unit="%", window="after 1 s", conditions=MOTION,
        chosen=CHOSEN, differs=DIFFERS,
    )  # fmt: skip
    study.say("serio2011: the paper's settings")
    ideal, fourth = _as_printed(common.with_values(chosen=IDEAL), [nominal], SIMULATED, PRINTED)
    loud = common.with_values(of="decoupled observers, sensors with steps and noise")
    noisy, _ = _as_printed(loud, recordings, SIMULATED, PRINTED)
    experiment = common.with_values(place="Fig. 5", chosen=MACHINE)
    fifth, drawn = _as_printed(experiment, softer_recordings, MEASURED, EXPERIMENT)
    rows = [*ideal, *noisy, *fifth]
    rows.append(_against_nominal(fifth[0], softer_recordings))
    for row, recorded, printed in ((common, recordings, PRINTED), (experiment, softer_recordings, EXPERIMENT)):
        study.say(f"serio2011: {DEFAULT.label}, {row.place}")
        rows += by_default(row, recorded, printed)
    rows += _others(study, common, recordings)
    rows += _pushed(study, common)
    figures = [*_figures("4", fourth, IDEAL), *_figures("5", drawn, MACHINE)]
    return Result(rows, figures)


def simulated_by(machine: RigFile, believed: RigFile, **more: Input) -> Experiment:
    """Play Serio's two torques, and further inputs, on a machine; the log has the nominal rig."""
    experiment = simulate(machine, {"awas": {**TORQUES, **more}}, 20.0, period=1e-3, ideal=True)
    return replace(experiment, rig=believed)


def truth(recording: Experiment, what: str) -> Array:
    """Return the link's true stiffness, damping or inertia, shape (N,)."""
    if what == "stiffness":
        return recording.truth["stiffness"]
    link = _link(recording.rig)
    return np.full_like(recording.time, link.damping if what == "damping" else link.inertia)


def _link(rig: RigFile) -> Link:
    joint = rig.joint["awas"]
    assert isinstance(joint, SerialJoint)
    assert joint.link is not None
    return joint.link


def _row(common: Row, what: str, printed: Mapping[str, float] | None, errors: Sequence[float], **more: str) -> Row:
    return common.with_values(
        quantity=f"mean relative error of the link's {what}",
        of=common.of or "decoupled observers",
        estimator=common.estimator or "impedance",
        printed=None if printed is None else printed[what],
        ours=Spread.of(errors),
        **more,
    )


def by_default(common: Row, recordings: Sequence[Experiment], printed: Mapping[str, float]) -> list[Row]:
    """Return the rows of vsalog's own settings."""
    traces = [estimate(e, DEFAULT) for e in recordings]
    own = common.with_values(settings=DEFAULT.label, window="whole run")
    return [_row(own, what, printed, _relative(traces, recordings, what)) for what in OBSERVERS]


def _relative(traces: Sequence[Trace], recordings: Sequence[Experiment], what: str) -> list[float]:
    return [mean_relative(column(t, OBSERVERS[what]), truth(e, what)) for t, e in zip(traces, recordings, strict=True)]


def _as_printed(
    common: Row, recordings: Sequence[Experiment], tuning: Tuning, printed: Mapping[str, float]
) -> tuple[list[Row], dict[str, tuple[Array, Array, Array]]]:
    """Return the rows of printed settings, and for a figure what → (time, true, estimated) of the first recording."""
    observer = Setting("the paper's", "impedance", {"derivative": "difference", "alpha": tuning.alpha})
    stiffness = np.array([column(estimate(e, observer), "stiffness") for e in recordings])
    q, u = (np.array([e.measured[role] for e in recordings]) for role in ("link_position", "torque_sensor"))
    x = link_filter(q, -u, recordings[0].period, tuning)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = {"stiffness": stiffness, "damping": x[..., 3] / x[..., 2], "inertia": 1.0 / x[..., 2]}
    start = round(1.0 / recordings[0].period)
    tune = {**observer.tune, "filter_of_the_link": tuning.label}
    own = common.with_values(settings=observer.label, tune=tune)
    rows = []
    for what, values in found.items():
        errors = [mean_relative(v[start:], truth(e, what)[start:]) for v, e in zip(values, recordings, strict=True)]
        reason = NOISE_DIFFERENCED if what == "stiffness" else NOISE_IN_RATE
        row = _row(own, what, printed, errors).because(reason)
        rows.append(row if what == "stiffness" else row.with_values(remark=FROM_NOTHING))
    first = recordings[0]
    return rows, {what: (first.time, truth(first, what), values[0]) for what, values in found.items()}


def link_filter(position: Array, torque: Array, period: float, tuning: Tuning) -> Array:
    """Return the states (q, q̇, 1/I, N/I) of the link by the extended Kalman filter as printed, shape (N, M, 4).

    Eq. 10–12 and 21–25 with x₃ and x₄ in the places that eq. 11 gives them, for eq. 12 has them exchanged: q̈ = x₃ u − x₄ q̇. R
    is 2 × 2: position and velocity are measured, the latter by eq. 15.

    Parameters
    ----------
    position, torque : shape (M, N), of M recordings [rad], and the torque on the link [N·m]
    period : T_c [s]
    tuning : Q, R and P(0)
    """
    count, samples = position.shape
    velocity = np.diff(position, axis=1, prepend=position[:, :1]) / period
    x, P = np.zeros((count, 4)), np.tile(tuning.P0 * np.eye(4), (count, 1, 1))
    F, Q, R = np.tile(np.eye(4), (count, 1, 1)), tuning.Q * np.eye(4), tuning.R * np.eye(2)
    F[:, 0, 1] = period
    states = np.empty((samples, count, 4))
    for k in range(samples):
        if k > 0:
            u = torque[:, k - 1]
            F[:, 1, 1], F[:, 1, 2], F[:, 1, 3] = 1.0 - period * x[:, 3], period * u, -period * x[:, 1]
            acceleration = x[:, 2] * u - x[:, 3] * x[:, 1]
            x = x + period * np.column_stack((x[:, 1], acceleration, np.zeros((count, 2))))
            P = F @ P @ F.transpose(0, 2, 1) + Q
        gain = P[:, :, :2] @ np.linalg.inv(P[:, :2, :2] + R)
        measured = np.column_stack((position[:, k], velocity[:, k]))
        x = x + (gain @ (measured - x[:, :2])[:, :, None])[:, :, 0]
        P = P - gain @ P[:, :2, :]
        states[k] = x
    return np.moveaxis(states, 0, 1)


def _against_nominal(row: Row, recordings: Sequence[Experiment]) -> Row:
    setting = Setting("", "impedance", {name: row.tune[name] for name in ("derivative", "alpha")})
    errors = [
        mean_relative(column(estimate(e, setting), "stiffness")[1000:], nominal_stiffness(e)[1000:]) for e in recordings
    ]
    return row.with_values(of="decoupled observers, against the nominal stiffness", ours=Spread.of(errors), remark=NOMINAL,
                           reason="")  # fmt: skip


def _others(study: Study, common: Row, recordings: Sequence[Experiment]) -> list[Row]:
    """Rows of other estimators' stiffness."""
    rows = []
    for name, why in (
        ("residual-rls", "it needs no torque sensor and no derivative of one."),
        ("direct", "it needs the torque sensor, but no parameter of the motor."),
        ("grioli-bicchi", "the observer of §II-A on the motor's equation of motion, without a torque sensor."),
        ("grioli-parametric", "it learns a model from the torque sensor's rate."),
    ):
        study.say(f"serio2011: {name}")
        setting = Setting("vsalog's default", name, {})
        errors = [mean_relative(column(estimate(e, setting), "stiffness"), truth(e, "stiffness")) for e in recordings]
        other = common.with_values(
            of=f"{name} instead", settings=setting.label, estimator=name, compare="none", window="whole run",
            remark=OTHER_METHOD.format(why),
        )  # fmt: skip
        rows.append(_row(other, "stiffness", PRINTED, errors))
    return rows


def _pushed(study: Study, common: Row) -> list[Row]:
    """The coupled observers (§III-A) and the decoupled ones (§III-B), from the right guess of the inertia and thrice that."""
    study.say("serio2011: simulating a push")
    believed = awas_rig()
    joint = believed.joint["awas"]
    assert isinstance(joint, SerialJoint)
    sensed = changed(joint.signals, external_torque=Signal(channel="/push.effort[link]", noise=0.05))
    rig = changed(believed, joint={"awas": changed(joint, signals=sensed)})
    push = sum_of(sine(5.0, 0.7), sine(5.0, 3.1), sine(5.0, 5.3))
    # Over five seeds these errors spread by some percent of themselves: two are enough.
    recordings = with_noise(simulated_by(rig, rig, external_torque=push), study.seeds[:2])
    inertia = _link(rig).inertia
    rows = []
    for name, tune, what in (
        ("impedance", {}, "decoupled observers, link pushed"),
        ("impedance-coupled", {}, "coupled observers, link pushed"),
        ("impedance-coupled", {"inertia": 3.0 * inertia}, "coupled observers, link pushed, guess thrice the inertia"),
    ):
        study.say(f"serio2011: {what}")
        setting = Setting("vsalog's default" if not tune else "another initial guess", name, tune)
        traces = [estimate(e, setting) for e in recordings]
        own = common.with_values(
            place="§III-A", of=what, settings=setting.label, estimator=name, tune=setting.whole_tune, compare="none",
            window="whole run", conditions=f"{MOTION}; the link is pushed by 5 N·m at 0.7, 3.1 and 5.3 Hz each",
            remark="the paper prints no number: it states that the coupled observers depend on their initial guess",
        )  # fmt: skip
        rows += [_row(own, q, None, _relative(traces, recordings, q)) for q in ("stiffness", "inertia")]
    return rows


def _figures(number: str, drawn: Mapping[str, tuple[Array, Array, Array]], chosen: str) -> list[Figure]:
    setting = "the paper's settings"
    return [
        figure(PAPER, f"{number}{letter}", f"AwAS: {what}, {setting}", (
            over(time, {"estimated": found, "actual": actual}, f"{what} [{UNITS[what]}]", by="actual", margin=1.0),
        ), MOTION.split(";")[0], chosen)
        for letter, (what, (time, actual, found)) in zip("abc", drawn.items(), strict=True)
    ]  # fmt: skip
