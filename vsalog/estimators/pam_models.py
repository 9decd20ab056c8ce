"""The simpler models of a pneumatic joint that Shin, Ibayashi, Kogiso (2021) §IV-B compares the hybrid model with.

Table III replaces the whole model by a linear one, or its friction (eq. 10) by a simpler law or by none; Table IV replaces the
contraction force (eq. 6–7) by empirical models. A name means "as if the rig's friction, or force, were that". Numbers that
the simpler law needs follow from the rig and the log, since the paper's are of its own machine, and partly without units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from vsalog.core.errors import EstimatorError
from vsalog.mechanics.muscle_forces import contraction_force
from vsalog.mechanics.pneumatic_friction import friction_level
from vsalog.mechanics.pneumatics import muscle_pulls
from vsalog.rig.schema import (
    Air,
    BraidForce,
    ExponentialForce,
    Muscle,
    MuscleForce,
    PneumaticJoint,
    SimpleFriction,
    SpringForce,
    TonduFriction,
)

Array = NDArray[np.float64]

FrictionModel = Literal["frictionless", "simple-friction", "tondu-friction"]
ForceModel = Literal["braid-force", "exponential-force", "spring-force"]
ModelName = Literal["hybrid", "linear", FrictionModel, ForceModel]

FRICTION_MODELS, FORCE_MODELS = get_args(FrictionModel), get_args(ForceModel)


@dataclass(frozen=True, slots=True)
class Shin2021:
    """What the paper prints.

    Attributes
    ----------
    angle : by which the joint turns to either side [rad], §II-A
    static, kinetic : f_s and f_k of Tondu's friction, §IV-B, whose quotient is printed without doubt
    speed : ẋ_k of it, taken for rad/s
    sensor : deviations of P₁ and P₂ [Pa], §IV: R = diag(1e8, 1e8)
    state : deviations of P₁, P₂ [Pa], ψ [rad] and ψ̇ [rad/s]: P(0) = Q = diag(1e-5, 1e-4, 1e6, 1e6) of ψ, ψ̇, P₁, P₂
    """

    angle: float = float(np.deg2rad(25.0))
    static: float = 0.146
    kinetic: float = 0.03285
    speed: float = 0.8
    sensor: tuple[float, float] = (1e4, 1e4)
    state: tuple[float, float, float, float] = (1e3, 1e3, 1e-5**0.5, 1e-2)


PRINTED = Shin2021()

# Where the one number that does not enter linearly is looked for: the exponent a₃, and the rest length by the muscle's length.
# As a₃ → 0 the exponential becomes eq. 6–7: for a rig with the paper's force the fit ends at this bound, and hardly differs.
SEARCHED: Mapping[str, tuple[float, float]] = {"exponential-force": (-60.0, -1.0), "spring-force": (0.5, 0.99)}


def as_if(joint: PneumaticJoint, model: ModelName, pressures: tuple[float, float]) -> PneumaticJoint:
    """Return the joint as a simpler model sees it.

    Parameters
    ----------
    joint : of the rig
    model : ``hybrid`` and ``linear`` leave it as it is (the latter is no rig's, see `pam_linear`); ``frictionless`` is without
        eq. 10; ``simple-friction`` has F_r sgn ψ̇ with F_r = T_s + T_p at `pressures`, ψ = 0; ``tondu-friction`` has
        sgn ψ̇ ((f_s − f_k) exp(−|ψ̇|/ẋ_k) + f_k) with f_s that level, f_k/f_s and ẋ_k as printed; ``braid-force``,
        ``exponential-force`` and ``spring-force`` have `fitted_force` in place of eq. 6–7
    pressures : about which the joint works, P₁ and P₂, absolute [Pa]

    Raises
    ------
    EstimatorError
        The force cannot take that form.
    """
    if model in FORCE_MODELS:
        muscles = (
            replace(m, force=fitted_force(m, joint.air, joint.seesaw.radius, model), force_gain=1.0)
            for m in (joint.muscle_1, joint.muscle_2)
        )
        return replace(joint, **dict(zip(("muscle_1", "muscle_2"), muscles, strict=True)))
    if model not in FRICTION_MODELS:
        return joint
    f1, f2 = muscle_pulls(joint, 0.0, *pressures)
    level = float(friction_level(joint, *pressures, f1, f2, 0.0))
    laws = {
        "frictionless": None,
        "simple-friction": SimpleFriction(level=level),
        "tondu-friction": TonduFriction(
            static=level, kinetic=PRINTED.kinetic / PRINTED.static * level, speed=PRINTED.speed
        ),
    }
    return replace(joint, friction=laws[model])


def fitted_force(muscle: Muscle, air: Air, radius: float, model: str) -> MuscleForce:
    """Return the empirical force of that form which is nearest to a muscle's pull, by least squares.

    It is fitted over the lengths that the paper's joint makes and all pressures the supply can make.
    The paper prints neither the forms nor their coefficients; the forms are those of `vsalog.mechanics.muscle_forces`. All but
    one number of each enter linearly. That one is looked for within bounds; of the braid it is no number of its own,
    since its pull has two, π r₀² a / l_rest² and π r₀² b, and any rest length gives the same.

    Parameters
    ----------
    muscle, air : of the rig; `force_gain` is in the fit
    radius : of the seesaw [m]
    model : one of `FORCE_MODELS`

    Raises
    ------
    EstimatorError
        The nearest braid is none: its pull would not fall as the muscle shortens.
    """
    travel = radius * np.sin(PRINTED.angle)
    lengths, pressures = (
        grid.ravel()
        for grid in np.meshgrid(
            muscle.length + np.linspace(-travel, travel),
            np.linspace(air.outside_pressure, air.supply_pressure),
        )
    )
    pull, gauge = contraction_force(muscle, air, pressures, lengths), pressures - air.outside_pressure

    if model == "braid-force":
        (grown, held), _ = _solved(np.column_stack([gauge * (lengths / muscle.length) ** 2, -gauge]), pull)
        # π r₀² a = grown and π r₀² b = held with a = 3/tan²α₀ and b = 1 + a/3.
        area = held - grown / 3.0
        if not (area > 0.0 and grown > 0.0):
            raise EstimatorError(
                "model=braid-force: no braid pulls as these muscles do; is the force of the rig right?"
            )
        angle = float(np.arctan(np.sqrt(3.0 * area / grown)))
        return BraidForce(rest_length=muscle.length, rest_radius=float(np.sqrt(area / np.pi)), braid_angle=angle)
    if model == "exponential-force":

        def exponential(exponent: float) -> Array:
            short = 1.0 - lengths / muscle.length
            growth = np.exp(exponent * short)
            return np.column_stack([gauge * growth, growth, gauge * short, gauge, np.ones_like(gauge)])

        a3 = _nearest(exponential, pull, SEARCHED[model])
        a1, a2, a4, a5, a6 = _solved(exponential(a3), pull)[0]
        return ExponentialForce(rest_length=muscle.length, a1=a1, a2=a2, a3=a3, a4=a4, a5=a5, a6=a6)

    def spring(share: float) -> Array:
        s = lengths - share * muscle.length
        return np.column_stack([s, s**3, gauge * s**2, gauge**2 * s])

    share = _nearest(spring, pull, SEARCHED[model])
    c0, c1, c2, c3 = _solved(spring(share), pull)[0]
    return SpringForce(rest_length=share * muscle.length, c0=c0, c1=c1, c2=c2, c3=c3)


def _solved(columns: Array, pull: Array) -> tuple[list[float], float]:
    """Return least squares' coefficients, of columns brought to one size first, and the sum of squares left."""
    sizes = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / sizes, pull, rcond=None)[0]
    return [float(c) for c in found / sizes], float(np.sum((pull - columns / sizes @ found) ** 2))


def _nearest(columns: Callable[[float], Array], pull: Array, bounds: tuple[float, float]) -> float:
    return float(minimize_scalar(lambda x: _solved(columns(x), pull)[1], bounds=bounds, method="bounded").x)
