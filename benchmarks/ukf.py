"""Time per step of the unscented filter of a pneumatic joint, against filterpy's on the same model.

    python -m benchmarks.ukf

Both run Shin's filter (four states, two pressures measured, α = 1, β = κ = 0, points drawn again between prediction and
correction) over the same samples of a simulated joint at 1 kHz, in turn in the same run, and have to arrive at the same state.
Ours is `PamFold.block` as an estimator uses it, with everything it writes. filterpy's calls the model for one sigma point at a
time, two ways: *compiled*, our own compiled transition, so that what is left is filterpy's own work; and *in Python*, the same
equations in plain Python, as a user of filterpy would write them, which the target is about.

Exits with 1 where a target is missed.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from benchmarks.measure import machine, side_by_side
from vsalog.estimators.pam_noise import pam_noise
from vsalog.estimators.pam_states import PamFold, pam_transition
from vsalog.mechanics.pneumatics import valve_opening
from vsalog.rig import Rig
from vsalog.rig.schema import LinearForce, PneumaticJoint, PressureFriction
from vsalog.simulation.pneumatic import simulate_pneumatic

PERIOD, SAMPLES, OTHER_SAMPLES, ROUNDS, SENSOR = 1e-3, 20_000, 300, 9, 100.0
MICROSECONDS, FASTER = 5.0, 100.0


def in_python(joint: PneumaticJoint, h: float):
    """The model's step, (P₁, P₂, ψ, ψ̇) and (α₁, α₂) → state, in plain Python."""
    air, seesaw, friction = joint.air, joint.seesaw, joint.friction
    assert isinstance(friction, PressureFriction)
    sides = []
    for muscle, valve, side in ((joint.muscle_1, joint.valve_1, -1.0), (joint.muscle_2, joint.valve_2, 1.0)):
        assert isinstance(muscle.force, LinearForce)
        sides.append((muscle, muscle.force, valve, side))
    k, heat = air.heat_ratio, air.gas_constant * air.temperature
    critical = (2.0 / (k + 1.0)) ** (k / (k - 1.0))

    def nozzle(up: float, down: float) -> float:
        if up < down:
            return -nozzle(down, up)
        r = max(down / up, critical)
        return up * math.sqrt(2.0 * k / (k - 1.0) * (r ** (2.0 / k) - r ** ((k + 1.0) / k)) / heat)

    def volume(muscle, side: float, psi: float) -> float:
        l = muscle.length + side * seesaw.radius * math.sin(psi)  # noqa: E741
        return (muscle.volume_curvature * l + muscle.volume_slope) * l + muscle.volume_constant

    def step(x, dt, u):
        p, psi, v = [x[0], x[1]], x[2], x[3]
        middle = psi + 0.5 * h * v
        pulls, volumes, flows = [], [], []
        for i, (muscle, force, valve, side) in enumerate(sides):
            volumes.append(volume(muscle, side, middle))
            flow = u[i] * nozzle(air.supply_pressure, x[i]) - (1.0 - u[i]) * nozzle(x[i], air.outside_pressure)
            flow *= valve.inflow_area if flow > 0.0 else valve.outflow_area
            flows.append(h * air.inflow_index * heat * flow / volumes[i])
            p[i] *= (volume(muscle, side, psi) / volumes[i]) ** air.volume_index
            length = muscle.length + side * seesaw.radius * math.sin(middle)
            pressure = p[i] + 0.5 * flows[i]
            pulls.append(
                (force.area_slope * length + force.area) * pressure + force.passive_slope * length + force.passive
            )
            p[i] += flows[i]
        torque = seesaw.radius * math.cos(middle) * (pulls[0] - pulls[1]) - seesaw.return_stiffness * middle
        z = h / seesaw.inertia
        free = v + z * torque
        level = friction.shaft_radius * friction.shaft_coefficient * abs(sum(pulls) - seesaw.mass * seesaw.gravity)
        level += friction.muscle * sum(
            (a + 0.5 * b - b - air.outside_pressure) ** -2.0 for a, b in zip(p, flows, strict=True)
        )
        slip = max(abs(free) - z * level, 0.0) / (1.0 + z * friction.viscous)
        speed = math.copysign(slip, free)
        end = middle + 0.5 * h * speed
        after = [volume(muscle, side, end) for muscle, _, _, side in sides]
        return np.array([*(p[i] * (volumes[i] / after[i]) ** air.volume_index for i in range(2)), end, speed])

    return step


def compiled(fold: PamFold):
    """The model's step by our compiled transition, a sigma point at a time."""
    X, Y, full = np.zeros((4, 1)), np.zeros((4, 1)), np.zeros(3)

    def step(x, dt, u):
        X[:, 0], full[:2] = x, u
        pam_transition(X, 0, full, fold._model, Y)
        return Y[:, 0].copy()

    return step


def main() -> int:
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        print("filterpy is not installed: pip install filterpy", file=sys.stderr)
        return 1
    joint = Rig.preset("pam").joints["pam"]
    assert isinstance(joint, PneumaticJoint)
    time = np.arange(SAMPLES) * PERIOD
    volts = [5.5 + s * 1.5 * np.sin(2.0 * np.pi * 0.4 * time) + np.sin(2.0 * np.pi * 0.31 * time) for s in (1.0, -1.0)]
    truth = simulate_pneumatic(joint, {"valve_1": volts[0], "valve_2": volts[1]}, time)
    rng = np.random.default_rng(0)
    z = [truth[f"pressure_{i}"] + SENSOR * rng.normal(size=SAMPLES) for i in (1, 2)]
    noise = pam_noise(joint, PERIOD, (float(np.median(z[0])), float(np.median(z[1]))), (SENSOR, SENSOR))
    fold = PamFold(joint, PERIOD, noise)
    assert fold.steps == 1
    u = np.column_stack([valve_opening(joint.valve_1, volts[0]), valve_opening(joint.valve_2, volts[1])])
    both = np.column_stack(z)
    first = fold.block(fold.start(), z[0][:1], z[1][:1], volts[0][:1], volts[1][:1])[0]
    ended: dict[str, np.ndarray] = {}

    def ours() -> None:
        ended["vsalog"] = fold.block(fold.start(), *z, *volts)[1].x[OTHER_SAMPLES]

    def theirs(name: str, step):
        def run() -> None:
            points = MerweScaledSigmaPoints(4, 1.0, 0.0, 0.0)
            ukf = UnscentedKalmanFilter(4, 2, PERIOD, lambda x: x[:2], step, points)
            ukf.x, ukf.P = first.x.copy(), first.S @ first.S.T
            ukf.Q, ukf.R = np.diag(noise.process) ** 2, np.diag(noise.pressure) ** 2
            for k in range(1, OTHER_SAMPLES + 1):
                ukf.predict(u=u[k - 1])
                ukf.update(both[k])
            ended[name] = ukf.x

        return run

    calls = {
        "vsalog": ours,
        "filterpy, model compiled": theirs("filterpy, model compiled", compiled(PamFold(joint, PERIOD, noise))),
        "filterpy, model in Python": theirs("filterpy, model in Python", in_python(joint, PERIOD)),
    }
    times = side_by_side(calls, ROUNDS)
    scale = np.array([1e5, 1e5, 0.1, 0.1])
    for name, x in ended.items():
        np.testing.assert_allclose(x / scale, ended["vsalog"] / scale, rtol=1e-6, atol=1e-6, err_msg=name)
    print(machine("numpy", "numba", "filterpy"))
    steps = {name: (SAMPLES - 1 if name == "vsalog" else OTHER_SAMPLES) for name in times}
    micro = {name: 1e6 * t.least / steps[name] for name, t in times.items()}
    for name, t in times.items():
        ratio = "" if name == "vsalog" else f"   {micro[name] / micro['vsalog']:7.0f} times ours"
        print(f"{name:28s} {micro[name]:9.2f} µs per step (median {1e6 * t.median / steps[name]:.2f}){ratio}")
    missed = micro["vsalog"] > MICROSECONDS or micro["filterpy, model in Python"] < FASTER * micro["vsalog"]
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
