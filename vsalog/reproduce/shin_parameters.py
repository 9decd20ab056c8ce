"""Shin 2021 §II-C, Fig. 4: the effect of the parameters found by trial and error on a step of the angle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.reproduce.drawing import figure, over
from vsalog.reproduce.measure import Study
from vsalog.reproduce.rows import Result, Row
from vsalog.rig import Rig
from vsalog.rig.schema import PneumaticJoint, PressureFriction
from vsalog.simulation.inputs import table
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """The step that is chosen, and by how much a parameter is raised.

    Attributes
    ----------
    bias, change : voltage of both valves before, and by how much each goes, one up and one down [V]
    at, duration : [s]
    factors : of each parameter
    """

    bias: float = 5.5
    change: float = 0.6
    at: float = 0.5
    duration: float = 12.0
    factors: tuple[float, ...] = (0.5, 1.0, 2.0)


STEP = Step()


def _friction(joint: PneumaticJoint, factor: float, *names: str) -> PneumaticJoint:
    assert isinstance(joint.friction, PressureFriction)
    changed = {name: factor * getattr(joint.friction, name) for name in names}
    return replace(joint, friction=replace(joint.friction, **changed))


def _area(joint: PneumaticJoint, factor: float) -> PneumaticJoint:
    valves = [
        replace(v, inflow_area=factor * v.inflow_area, outflow_area=factor * v.outflow_area)
        for v in (joint.valve_1, joint.valve_2)
    ]
    return replace(joint, valve_1=valves[0], valve_2=valves[1])


# Parameter → how it is changed, and the text's statement: a smaller steady angle (steady), or a faster transient.
PARAMETERS: dict[str, tuple[Callable[[PneumaticJoint, float], PneumaticJoint], str]] = {
    "T_p'": (lambda joint, factor: _friction(joint, factor, "muscle"), "steady"),
    "μ_s": (lambda joint, factor: _friction(joint, factor, "shaft_coefficient"), "steady"),
    "A₀": (_area, "faster"),
    "k₁": (lambda j, factor: replace(j, air=replace(j.air, inflow_index=factor * j.air.inflow_index)), "faster"),
    "k₂": (lambda j, factor: replace(j, air=replace(j.air, volume_index=factor * j.air.volume_index)), "faster"),
}
STATEMENTS = {
    "steady": "the larger it is, the smaller the steady angle",
    "faster": "the larger it is, the faster the transient",
}


def guideline(study: Study) -> Result:
    """Fig. 4: steps of the angle with each parameter halved and doubled."""
    joint = Rig.preset("pam").file.joint["pam"]
    assert isinstance(joint, PneumaticJoint)
    rows, panels = [], []
    conditions = (
        f"the model of two pneumatic muscles, both valves from {STEP.bias:g} V by ± {STEP.change:g} V at {STEP.at:g} s"
    )
    chosen = "the step, and factors of a half and two"
    for name, (change, kind) in PARAMETERS.items():
        study.say(f"shin-parameters: {name}")
        angles = {f"{name} × {factor:g}": step_response(change(joint, factor)) for factor in STEP.factors}
        time: Array = 1e-3 * np.arange(round(1e3 * STEP.duration) + 1, dtype=np.float64)
        panels.append(over(time, angles, "angle [°]", scale=180.0 / np.pi, title=name))
        found = [np.degrees(a[-1]) if kind == "steady" else rise_time(time, a) for a in angles.values()]
        unit = "°" if kind == "steady" else "s"
        rows.append(
            Row(
                item="shin-parameters", paper="Shin 2021", place="Fig. 4", of=name, printed=STATEMENTS[kind], compare="holds",
                quantity="angle at the end of a step" if kind == "steady" else "time to half of a step",
                ours=" > ".join(f"{value:.3g} {unit}" for value in found),
                holds=all(a > b for a, b in pairwise(found)), settings="the paper's model",
                window="one step", conditions=conditions, chosen=chosen,
            ).because(REASONS.get(name, ""))
        )  # fmt: skip
    return Result(
        rows,
        [figure("Shin 2021", 4, "What the parameters do to a step of the angle", tuple(panels), conditions, chosen)],
    )


REASONS = {
    "k₂": "by eq. 4 the joint's own motion works against the pressures that drive it, the more the larger k₂ is",
}


def step_response(joint: PneumaticJoint) -> Array:
    """Return the angle under the step, shape (N,) at 1 kHz [rad]."""
    rig = Rig.preset("pam").file
    times = np.array([0.0, STEP.at])
    valves = {
        f"valve_{i}": table(times, np.array([STEP.bias, STEP.bias + sign * STEP.change]), held=True)
        for i, sign in ((1, 1.0), (2, -1.0))
    }
    simulated = simulate(replace(rig, joint={"pam": joint}), {"pam": valves}, STEP.duration, ideal=True, steps=2)
    return simulated.truth["link_position"]


def rise_time(time: Array, angle: Array) -> float:
    """Return when half of the way is covered, after the step [s]."""
    share = (angle - angle[0]) / (angle[-1] - angle[0])
    return float(time[np.argmax(share >= 0.5)]) - STEP.at
