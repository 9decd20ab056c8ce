"""The noise that the filter of a pneumatic joint assumes, derived from the log and from the rig's uncertainty.

Shin, Ibayashi, Kogiso (2021) §IV print Q, R and P(0) without units or reasons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsalog.core.errors import EstimatorError
from vsalog.mechanics import pneumatics as pneu
from vsalog.mechanics.pneumatic_friction import friction_level
from vsalog.mechanics.pneumatic_numbers import air_numbers
from vsalog.rig.schema import PneumaticJoint


@dataclass(frozen=True, slots=True)
class PamNoise:
    """Noise the filter assumes, standard deviations; raises EstimatorError where `pressure` is not above 0, another below.

    Attributes
    ----------
    pressure : of each pressure sensor [Pa], above 0
    process : shape (4,), what a sample adds to P₁, P₂, ψ, ψ̇ [Pa, Pa, rad, rad/s]
    unknown_flow : likewise to a pressure whose valve's command is missing [Pa]
    start : of the first angle and velocity [rad, rad/s]
    """

    pressure: tuple[float, float]
    process: tuple[float, float, float, float]
    unknown_flow: tuple[float, float]
    start: tuple[float, float]

    def __post_init__(self) -> None:
        numbers = np.array([*self.pressure, *self.process, *self.unknown_flow, *self.start])
        if not (np.isfinite(numbers).all() and (numbers >= 0.0).all() and min(self.pressure) > 0.0):
            raise EstimatorError("pam-ukf: the noise of pressure sensors has to be above 0, all other noise 0 or more")


def pam_noise(
    joint: PneumaticJoint, period: float, pressure: tuple[float, float], sensor: tuple[float, float], *,
    flow: float = 0.2, force: float = 0.04, friction: float = 0.2,
) -> PamNoise:  # fmt: skip
    """Derive the noise from the log's sample time, its sensors and the rig's uncertainty.

    A model error lasts: its state drifts at a rate b, and not at random. With white process noise of
    standard deviation q per sample and a sensor's of r ≫ q, the gain is K ≈ q/r, and the filter lags behind such an error by
    b T/K; with q = b T that is r, the sensor's own noise. A smaller q would lag more, a larger one let more noise through. So

        P :  q = b T, b = flow · the rate at which a choked supply fills a muscle, k₁ R T_air m / V
        ψ :  q = b T, b = δ/t, the angle δ that the doubted torque turns the joint by over the time t that filling it takes
        ψ̇ :  ω times that of ψ, ω the seesaw's frequency: as much energy as that of ψ

    with the doubted torque √(force² r² (F₁² + F₂²) + friction² level²), and δ = torque/K, K the stiffness with the air locked
    in, all at ψ = 0. The first angle is in friction's band, ± level/K, to whose ends sigma points, at two deviations, reach:
    from beyond it the model swings back, a joint at rest does not, and noise would be taken for that swing. The first velocity
    is at most that at which a choked supply turns the joint. Where a valve's command is missing, b is the whole rate.

    Parameters
    ----------
    joint : of the rig
    period : T [s]
    pressure : about which the joint works, P₁ and P₂ [Pa]; such as the log's medians
    sensor : standard deviation of the sensors' noise [Pa]: the larger of `noise_of` and `resolution_of`/√12 of the log
    flow, force, friction : uncertainty of the rig, as one standard deviation: share of the largest flow by which valves and
        volumes are off, share of each muscle's pull, share of the friction's level

    Raises
    ------
    EstimatorError
        A sensor's is not above 0, a number is not finite, or the muscles do not hold the joint at these pressures.
    """
    (p1, p2), seesaw = pressure, joint.seesaw
    f1, f2 = (float(f) for f in pneu.muscle_pulls(joint, 0.0, p1, p2))
    level = float(friction_level(joint, p1, p2, f1, f2, 0.0))
    stiffness = float(pneu.trapped_stiffness(joint, 0.0, p1, p2)) + seesaw.return_stiffness
    if not (np.isfinite(stiffness) and stiffness > 0.0):
        raise EstimatorError(f"pam-ukf: muscles at {p1:.4g} and {p2:.4g} Pa do not hold the joint; are these absolute?")
    pull = seesaw.radius * float(np.hypot(f1, f2))
    noisy = seesaw.radius * float(np.hypot(f1 * sensor[0] / p1, f2 * sensor[1] / p2))
    fill, swing = filling_rates(joint), float(np.sqrt(stiffness / seesaw.inertia))
    per_torque = max(fill) / joint.air.supply_pressure / stiffness
    wander = float(np.hypot(force * pull, friction * level)) * per_torque * period
    free = 1.0 if seesaw.held_at is None else 0.0
    return PamNoise(
        pressure=sensor,
        process=(flow * fill[0] * period, flow * fill[1] * period, free * wander, free * swing * wander),
        unknown_flow=(fill[0] * period, fill[1] * period),
        start=(free * float(np.hypot(0.5 * level, noisy)) / stiffness, free * pull * per_torque),
    )


def filling_rates(joint: PneumaticJoint) -> tuple[float, float]:
    """Return the rates at which the larger orifice, choked, at supply pressure, changes the pressures at ψ = 0 [Pa/s]."""
    air = joint.air
    choked = air.inflow_index * air.gas_constant * air.temperature * float(air_numbers(joint)[7]) * air.supply_pressure
    sides = ((joint.muscle_1, joint.valve_1), (joint.muscle_2, joint.valve_2))
    areas = [
        valve.area_scale * max(valve.inflow_area, valve.outflow_area) + muscle.leak_area for muscle, valve in sides
    ]
    first, second = (
        choked * a / float(pneu.muscle_volume(m, m.length)) for a, (m, _) in zip(areas, sides, strict=True)
    )
    return first, second
