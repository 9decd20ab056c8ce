"""An antagonistic joint of two pneumatic muscles: air, valves, torque and stiffness as pure functions, in SI.

After Shin, Ibayashi, Kogiso (2021); the numbers are those of their equations. Pressures are absolute. Muscle 1 shortens with a
positive angle ψ, muscle 2 with a negative one. `muscle_forces` has the contraction force, `pneumatic_friction` the friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from vsalog.core.errors import SimulationError
from vsalog.mechanics.muscle_forces import contraction_force, force_slopes
from vsalog.rig.schema import Air, Muscle, PneumaticJoint, Valve

Array = NDArray[np.float64]

# Angles at which a rest position is looked for, to ±89°.
_ANGLES = np.deg2rad(np.linspace(-89.0, 89.0, 1781))


def muscle_lengths(joint: PneumaticJoint, psi: ArrayLike) -> tuple[Array, Array]:
    """Return both muscles' lengths, l₁ = L₀ − r sin ψ and l₂ = L₀ + r sin ψ [m] (eq. 2), each the shape of `psi` [rad]."""
    travel = joint.seesaw.radius * np.sin(np.asarray(psi, dtype=np.float64))
    return np.asarray(joint.muscle_1.length - travel), np.asarray(joint.muscle_2.length + travel)


def muscle_volume(muscle: Muscle, length: ArrayLike) -> Array:
    """Return V = D₁ l² + D₂ l + D₃ [m³] (eq. 3) at lengths [m] of any shape; not positive beyond the fitted range."""
    x = np.asarray(length, dtype=np.float64)
    return np.asarray((muscle.volume_curvature * x + muscle.volume_slope) * x + muscle.volume_constant)


def volume_slope(muscle: Muscle, length: ArrayLike) -> Array:
    """Return dV/dl = 2 D₁ l + D₂ [m²] (below eq. 3); negative where a muscle thickens as it shortens. V̇ = (dV/dl) l̇."""
    return np.asarray(2.0 * muscle.volume_curvature * np.asarray(length, dtype=np.float64) + muscle.volume_slope)


def critical_ratio(air: Air) -> float:
    """Return the ratio of pressures at and below which an orifice is choked, (2/(k + 1))^(k/(k − 1))."""
    k = air.heat_ratio
    return float((2.0 / (k + 1.0)) ** (k / (k - 1.0)))


def orifice_flow(air: Air, area: ArrayLike, upstream: ArrayLike, downstream: ArrayLike) -> Array:
    """Return the mass flow through an orifice [kg/s], the standard isentropic nozzle (eq. 5, whose print is cut short here).

    With ϱ = P_down / P_up,  ṁ = A P_up / √(RT) · √(2k/(k − 1) (ϱ^(2/k) − ϱ^((k+1)/k))) where ϱ is above `critical_ratio`
    (subsonic); below it the flow is choked and stays what it is there. It turns round with the pressures, of which the paper,
    whose pressures stay between outside and supply, does not speak.

    Parameters
    ----------
    air : of the rig
    area : effective [m²]
    upstream, downstream : absolute pressures [Pa], above 0; all broadcast

    Returns
    -------
    broadcast shape; positive from `upstream` to `downstream`
    """
    up, down = np.asarray(upstream, dtype=np.float64), np.asarray(downstream, dtype=np.float64)
    high, low = np.maximum(up, down), np.minimum(up, down)
    k = air.heat_ratio
    ratio = np.maximum(low / high, critical_ratio(air))
    inside = np.maximum(ratio ** (2.0 / k) - ratio ** ((k + 1.0) / k), 0.0)
    size = high * np.sqrt(2.0 * k / (k - 1.0) * inside / (air.gas_constant * air.temperature))
    return np.asarray(np.asarray(area) * np.sign(up - down) * size)


def valve_opening(valve: Valve, voltage: ArrayLike) -> Array:
    """Return α = κ(u + offset), 0 to 1, of a commanded voltage u [V] (§II-B2, Fig. 5c: straight lines between points)."""
    return np.asarray(np.interp(np.asarray(voltage, dtype=np.float64) + valve.offset, valve.voltage, valve.opening))


def valve_flow(valve: Valve, air: Air, opening: ArrayLike, pressure: ArrayLike) -> Array:
    """Return the mass flow into the muscle, m = A₀ (α m_in − (1 − α) m_out) [kg/s] (between eq. 4 and 5).

    m_in comes from the supply, m_out goes to the outside, both per area. A₀ = A₁ where m > 0, else A₂; both areas are positive,
    so that the bracket's sign decides.

    Parameters
    ----------
    valve, air : of the rig
    opening : α, of `valve_opening`
    pressure : in the muscle, absolute [Pa]; broadcast against `opening`
    """
    alpha, p = np.asarray(opening, dtype=np.float64), np.asarray(pressure, dtype=np.float64)
    flow = alpha * orifice_flow(air, 1.0, air.supply_pressure, p)
    flow = flow - (1.0 - alpha) * orifice_flow(air, 1.0, p, air.outside_pressure)
    return np.asarray(valve.area_scale * np.where(flow > 0.0, valve.inflow_area, valve.outflow_area) * flow)


def pressure_rate(
    air: Air, muscle: Muscle, pressure: ArrayLike, length: ArrayLike, speed: ArrayLike, flow: ArrayLike
) -> Array:
    """Return Ṗ = k₁ R T (m − leak) / V − k₂ (V̇/V) P [Pa/s] (eq. 4; the leak is not in the paper).

    Parameters
    ----------
    air, muscle : of the rig
    pressure : absolute [Pa]
    length, speed : of the muscle, l [m] and l̇ [m/s]
    flow : of the valve into the muscle, of `valve_flow` [kg/s]; all broadcast
    """
    p, volume = np.asarray(pressure, dtype=np.float64), muscle_volume(muscle, length)
    net = np.asarray(flow) - orifice_flow(air, muscle.leak_area, p, air.outside_pressure)
    filling = air.inflow_index * air.gas_constant * air.temperature * net
    return np.asarray((filling - air.volume_index * volume_slope(muscle, length) * np.asarray(speed) * p) / volume)


def muscle_pulls(joint: PneumaticJoint, psi: ArrayLike, p1: ArrayLike, p2: ArrayLike) -> tuple[Array, Array]:
    """Return F₁ and F₂ [N] at the angle ψ [rad] and the absolute pressures [Pa] (eq. 2, 6, 7); all broadcast."""
    l1, l2 = muscle_lengths(joint, psi)
    return contraction_force(joint.muscle_1, joint.air, p1, l1), contraction_force(joint.muscle_2, joint.air, p2, l2)


def joint_torque(joint: PneumaticJoint, psi: ArrayLike, p1: ArrayLike, p2: ArrayLike) -> Array:
    """Return τ = r cos ψ (F₁ − F₂) [N·m], what a torque meter on the joint reads (eq. 9); parameters as `muscle_pulls`."""
    f1, f2 = muscle_pulls(joint, psi, p1, p2)
    return np.asarray(joint.seesaw.radius * np.cos(np.asarray(psi, dtype=np.float64)) * (f1 - f2))


def isobaric_stiffness(joint: PneumaticJoint, psi: ArrayLike, p1: ArrayLike, p2: ArrayLike) -> Array:
    """Return −∂τ/∂ψ at constant pressures [N·m/rad]: the stiffness that is felt slowly, with the valves holding P₁ and P₂.

    From eq. 9 and dl₁/dψ = −r cos ψ, dl₂/dψ = r cos ψ (eq. 2):

        −∂τ/∂ψ = r sin ψ (F₁ − F₂) + r² cos² ψ (∂F₁/∂l₁ + ∂F₂/∂l₂).

    The seesaw's own k_s is not in it. Parameters as `muscle_pulls`.
    """
    return _stiffness(joint, psi, p1, p2, trapped=False)


def trapped_stiffness(joint: PneumaticJoint, psi: ArrayLike, p1: ArrayLike, p2: ArrayLike) -> Array:
    """Return −dτ/dψ with the air locked in [N·m/rad]: the stiffness that is felt at once, before air has flowed.

    Without flow eq. 4 is dP/P = −k₂ dV/V, so that dP/dl = −k₂ (P/V) dV/dl, and each muscle's slope in the isobaric formula
    becomes dF/dl = ∂F/∂l + ∂F/∂P dP/dl. Stretching a muscle squeezes its air (dV/dl < 0), so this is the larger one. Not
    meaningful where a volume is not positive. Parameters as `muscle_pulls`.
    """
    return _stiffness(joint, psi, p1, p2, trapped=True)


def mode_index(air: Air, p1: ArrayLike, p2: ArrayLike, slipping: ArrayLike) -> Array:
    """Return σ, which of the 18 subsystems of eq. 1 a state is in, 1 to 18 as float; all broadcast.

    The paper counts 18 and does not list them. Here σ = 1 + 9 · slipping + 3 · zone(P₁) + zone(P₂): a muscle's zone counts how
    many of the two pressures it has passed at which a flow changes between choked and subsonic. With the paper's pressures,
    zone 0 has the inflow choked, 1 both, 2 the outflow. The third if-then rule, A₁ or A₂, depends on the input too and
    is not counted.

    Parameters
    ----------
    air : of the rig
    p1, p2 : absolute pressures [Pa]
    slipping : whether the joint slips; sticks where False
    """
    b = critical_ratio(air)
    borders = np.sort([b * air.supply_pressure, air.outside_pressure / b])
    zone_1, zone_2 = (np.searchsorted(borders, np.asarray(p, dtype=np.float64), side="right") for p in (p1, p2))
    return np.asarray(1.0 + 9.0 * np.asarray(slipping, dtype=np.float64) + 3.0 * zone_1 + zone_2)


def resting_pressure(air: Air, valve: Valve, muscle: Muscle, opening: float) -> float:
    """Return the pressure at which as much air comes as goes [Pa]; without a leak α m_in = (1 − α) m_out (Proposition 1).

    Parameters
    ----------
    air, valve, muscle : of the rig
    opening : α, 0 to 1

    Raises
    ------
    SimulationError
        Nothing flows at any pressure: the valve's areas are zero.
    """

    def net(pressure: float) -> float:
        leak = orifice_flow(air, muscle.leak_area, pressure, air.outside_pressure)
        return float(valve_flow(valve, air, opening, pressure) - leak)

    low, high = air.outside_pressure, air.supply_pressure
    if net(low) == 0.0 and net(high) == 0.0:
        raise SimulationError("a valve whose orifice areas are zero leaves the pressure open; give a start")
    # The flow into the muscle falls with its pressure: there is one root, at an end where a valve is open to one side only.
    if net(low) <= 0.0:
        return low
    return high if net(high) >= 0.0 else float(brentq(net, low, high, xtol=1e-9 * high, rtol=1e-14))


def resting_angle(joint: PneumaticJoint, p1: float, p2: float, external: float = 0.0) -> float:
    """Return the angle ψ [rad] at which τ − k_s ψ + τ_ext = 0 and the joint comes back to it; the one nearest to 0.

    Parameters
    ----------
    joint : of the rig; one that is held rests where it is held
    p1, p2 : absolute pressures [Pa]
    external : τ_ext [N·m]

    Raises
    ------
    SimulationError
        The muscles hold the joint nowhere in the range in which their volumes are positive.
    """
    if joint.seesaw.held_at is not None:
        return joint.seesaw.held_at

    def torque(psi: ArrayLike) -> Array:
        x = np.asarray(psi, dtype=np.float64)
        return np.asarray(joint_torque(joint, x, p1, p2) - joint.seesaw.return_stiffness * x + external)

    l1, l2 = muscle_lengths(joint, _ANGLES)
    inside = (muscle_volume(joint.muscle_1, l1) > 0.0) & (muscle_volume(joint.muscle_2, l2) > 0.0)
    values = torque(_ANGLES)
    stable = np.flatnonzero(inside[:-1] & inside[1:] & (values[:-1] >= 0.0) & (values[1:] < 0.0))
    if not stable.size:
        raise SimulationError(
            f"the joint has no rest position at {p1:.4g} and {p2:.4g} Pa: the muscles would pull it beyond the angles at which"
            " their volumes are positive; give a start, or other valve voltages"
        )
    nearest = stable[np.argmin(np.abs(_ANGLES[stable]))]
    return float(brentq(lambda x: float(torque(x)), _ANGLES[nearest], _ANGLES[nearest + 1], xtol=1e-15, rtol=1e-15))


def _stiffness(joint: PneumaticJoint, psi: ArrayLike, p1: ArrayLike, p2: ArrayLike, trapped: bool) -> Array:
    angle = np.asarray(psi, dtype=np.float64)
    lever = joint.seesaw.radius * np.cos(angle)
    f1, f2 = muscle_pulls(joint, angle, p1, p2)
    total = joint.seesaw.radius * np.sin(angle) * (f1 - f2)
    muscles = (joint.muscle_1, joint.muscle_2)
    for muscle, length, pressure in zip(muscles, muscle_lengths(joint, angle), (p1, p2), strict=True):
        by_length, by_pressure = force_slopes(muscle, joint.air, pressure, length)
        if trapped:
            squeeze = joint.air.volume_index * volume_slope(muscle, length) / muscle_volume(muscle, length)
            by_length = by_length - by_pressure * squeeze * np.asarray(pressure)
        total = total + lever**2 * by_length
    return np.asarray(total)
