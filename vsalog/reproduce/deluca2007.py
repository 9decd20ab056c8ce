"""De Luca, Schröder, Thümmel, ICRA 2007: the statements about the acceleration observer. No number of its errors is printed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.optimize import brentq

from vsalog.estimators.acceleration_group import NAME
from vsalog.estimators.methods.acceleration_observer import PAPER_FREQUENCY, AccelerationFold
from vsalog.filters.acceleration_arm import arm_start, observe_arm
from vsalog.filters.acceleration_observer import characteristic, error_matrix, observer_gains
from vsalog.mechanics.kinematics import chain_motion, point_position, specific_force
from vsalog.reproduce.deluca2007_motion import OBSERVER, PAPER, STATES
from vsalog.reproduce.measure import Study, assemble, column, estimate, root_mean_square, with_noise
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.rig import Rig
from vsalog.rig.schema import Accelerometer, Chain, RigFile
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

RIG, SCENARIO, JOINT = "kuka-kr15", "kuka-kr15-exp1", "axis1"
CONDITIONS = (
    "an arm of the size of a KUKA KR15/2, its first axis, through the preset's motion; state over the whole run"
)
CHOSEN = "everything of the arm but the observer's frequency near 250 rad/s: preset and scenario kuka-kr15"


@dataclass(frozen=True, slots=True)
class Criteria:
    """Thresholds for the paper's statements, which are without numbers.

    Attributes
    ----------
    rate : share within which the rate of decay is met
    alike : share within which errors are alike
    blind : times as much noise, where a sensor measures nothing
    heavier : mass of the forearm, unknown to the observer, over the rig's
    """

    rate: float = 0.02
    alike: float = 0.05
    blind: float = 20.0
    heavier: float = 1.5


CRITERIA = Criteria()


def observer(study: Study) -> Result:
    """§V: state errors of the observer on the first axis; theorem 1 and the singular configurations of §V."""
    rig = Rig.preset(RIG).file
    motion = _motion(rig)
    noisy = with_noise(motion, study.seeds)
    stated = Row(
        item="deluca2007", paper=PAPER, place="§V-A", quantity="", of="axis 1", settings=OBSERVER.label, estimator=NAME,
        tune=OBSERVER.whole_tune, window="whole run", conditions=CONDITIONS, chosen=CHOSEN, compare="holds",
    )  # fmt: skip
    study.say("deluca2007: observer")
    errors = [_errors(experiment) for experiment in noisy]
    rows = [
        stated.with_values(
            quantity=f"rms error of the observed {what}", unit=unit, printed=statement, compare="none",
            ours=Spread.of([e[name] for e in errors]), remark="vsalog's default is the paper's frequency here",
        )
        for what, unit, name, statement in STATES
    ]  # fmt: skip
    study.say("deluca2007: decay, payload, singular configurations")
    return Result([*rows, _decay(stated, motion), _heavier(stated, rig, noisy[0], study), *_singular(stated, rig)], [])


def _motion(rig: RigFile) -> Experiment:
    scenario = Scenario.find(SCENARIO, rig)
    return simulate(rig, scenario.inputs(rig), scenario.file.duration, ideal=True)


def _errors(experiment: Experiment) -> dict[str, float]:
    """Return the rms error of each state on the first axis."""
    found, truth = estimate(experiment, OBSERVER, JOINT), experiment.joints[JOINT].truth
    return {name: root_mean_square(column(found, name), truth[name]) for _, _, name, _ in STATES}


def _decay(row: Row, motion: Experiment) -> Row:
    """Theorem 1: how fast two observers of the same signals converge, along their eigenvector."""
    fold, signals = assemble(motion, OBSERVER, JOINT)
    assert isinstance(fold, AccelerationFold)
    inputs = [part[:400] for part in fold.inputs(signals[:400])]
    begun = observe_arm(fold.arm, arm_start(len(fold.group.members)), *(part[:100] for part in inputs))[4]
    off = begun.x.copy()
    off[fold.group.place] += [0.0, 1e-5, 0.0, 1e-3]
    one, other = (
        observe_arm(fold.arm, start, *(part[100:] for part in inputs))[0][:, fold.group.place]
        for start in (begun, begun._replace(x=off))
    )
    motor = fold.group.members[fold.group.place].motor
    gains = observer_gains(motor, characteristic(PAPER_FREQUENCY, 1.0))
    left = eig(error_matrix(motor, gains), left=True, right=False)[1][:, 0]
    count = round(5.0 / (PAPER_FREQUENCY * signals.period))
    along = np.log(np.abs((other - one)[:count] @ left.conj()))
    rate = -float(np.polyfit(np.arange(count) * signals.period, along, 1)[0])
    return row.with_values(
        place="Theorem 1",
        quantity="rate at which a wrong start is forgotten",
        unit="rad/s",
        printed=f"as assigned, {PAPER_FREQUENCY:g}",
        ours=f"{rate:.1f}",
        window="first 20 ms",
        holds=abs(rate / PAPER_FREQUENCY - 1.0) < CRITERIA.rate,
    )


def _heavier(row: Row, rig: RigFile, plain: Experiment, study: Study) -> Row:
    """Remark 1: the same observer on an arm whose forearm is heavier than in its rig."""
    chain = _chain(rig)
    *before, last = chain.link
    heavy = with_fields(
        last, mass=CRITERIA.heavier * last.mass, inertia=tuple(CRITERIA.heavier * i for i in last.inertia)
    )
    actual = with_fields(rig, chain=with_fields(chain, link=(*before, heavy)))
    loaded = replace(with_noise(_motion(actual), study.seeds[:1])[0], rig=rig)
    ratios = [_errors(loaded)[name] / _errors(plain)[name] - 1.0 for name in ("link_position", "link_velocity")]
    return row.with_values(
        place="Remark 1",
        quantity="rms errors of link position and velocity with a forearm half as heavy again, which the rig does not know",
        printed="no knowledge of the link dynamics is required",
        ours=f"{ratios[0]:+.1%}, {ratios[1]:+.1%}",
        holds=max(map(abs, ratios)) < CRITERIA.alike,
    )


def _singular(row: Row, rig: RigFile) -> list[Row]:
    """Fig. 2: with the one accelerometer on the third link, where the transformation of its readings cannot be inverted."""
    chain = _chain(rig)
    mounting = chain.link[2].accelerometer
    assert mounting is not None
    usual = _noise_gain(chain, mounting, np.array([0.0, -0.5, 1.2]))

    def aside(q2: float) -> float:
        """How far in front of axis 1 the sensor is."""
        q = np.array([0.0, q2, 1.2])
        return float(point_position(chain_motion(chain, q, 0.0 * q, 0.0 * q)[2], mounting.position)[0])

    lever = chain.link[2].length + mounting.position[0]
    in_line = -float(np.arctan2(mounting.position[1], lever))
    places = (
        ("above joint axis 1", np.array([0.0, float(brentq(aside, -1.8, -0.5)), 1.2])),
        ("in line with axes 2 and 3", np.array([0.0, -0.5, in_line])),
    )
    rows = []
    for where, q in places:
        # Slightly off, for exactly there the noise is unbounded.
        ratio = _noise_gain(chain, mounting, q + np.array([0.0, 1e-3, 1e-3])) / usual
        rows.append(
            row.with_values(
                place="Fig. 2",
                of="all axes",
                quantity=f"noise of the link accelerations with the sensor {where}, of that elsewhere",
                printed="singular",
                ours=f"{ratio:.3g} times, 1 mrad off",
                window="one position",
                holds=ratio > CRITERIA.blind,
            )
        )
    return rows


def _noise_gain(chain: Chain, mounting: Accelerometer, q: Array) -> float:
    """Return the standard deviation of the worst joint's q̈ under unit noise of one tri-axial accelerometer on the last link."""
    still = np.zeros_like(q)

    def reading(ddq: Array) -> Array:
        return specific_force(chain_motion(chain, q, still, ddq)[-1], mounting, chain.gravity)

    T = np.array([reading(e) - reading(still) for e in np.eye(q.size)]).T
    return float(np.linalg.norm(np.linalg.inv(T), axis=1).max())


def _chain(rig: RigFile) -> Chain:
    assert rig.chain is not None
    return rig.chain
