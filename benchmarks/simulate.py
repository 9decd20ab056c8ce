"""Time of the simulation, against scipy's solve_ivp at the accuracy it reaches.

    python -m benchmarks.simulate

A VSA-II at 1 kHz (Flacco 2012 §6.1). Its torques are noisy and held from sample to sample, as by a drive. scipy
gets the equations in plain Python with scalars, the fastest it can be given, and is asked in two ways: for the whole motion,
through all the jumps, which never becomes as exact, and, beyond the target, sample by sample, begun again at each. Exits with 1
where a target is missed.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.measure import Time, machine, side_by_side
from vsalog.rig import Rig
from vsalog.simulation.inputs import sine
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

MINUTE = np.arange(60_001) * 1e-3
SECONDS = 2  # of the motion that scipy is given; its time is scaled to a minute
ROUNDS = 7
SECONDS_PER_MINUTE, FASTER = 0.5, 100.0

Rate = Callable[[float, np.ndarray], tuple[float, ...]]


def torque(phi: float) -> float:
    s = 1.8 * math.sin(0.5 * phi)
    return 0.5 * (math.asin(s) - 0.5 * phi) * (1.8 * math.cos(0.5 * phi) / math.sqrt(1.0 - s * s) - 1.0)


def rate(one: Callable[[float], float], two: Callable[[float], float]) -> Rate:
    def derivative(t, x):
        q, dq, a, da, b, db = x
        e1, e2 = torque(q - a), torque(q - b)
        return (
            dq, (-e1 - e2 - 5e-3 * dq - 60e-3 * math.sin(q)) / 2e-3,
            da, (one(t) + e1 - 1e-3 * da) / 7.3e-3, db, (two(t) + e2 - 1e-3 * db) / 7.3e-3,
        )  # fmt: skip

    return derivative


def sample_by_sample(one, two, method: str, rtol: float) -> np.ndarray:
    states = np.zeros((len(one), 6))
    for k in range(len(one) - 1):
        held = rate(lambda t, v=one[k]: v, lambda t, v=two[k]: v)
        found = solve_ivp(held, (0.0, 1e-3), states[k], method, rtol=rtol, atol=1e-3 * rtol)
        states[k + 1] = found.y[:, -1]
    return states.T


def through_all(one, two, method: str, rtol: float, time_: np.ndarray) -> np.ndarray:
    last = len(one) - 1

    def hold(values):
        return lambda t: values[min(int(t * 1000.0 + 1e-9), last)]

    found = solve_ivp(
        rate(hold(one), hold(two)), (0.0, time_[-1]), [0.0] * 6, method, time_, rtol=rtol, atol=1e-2 * rtol
    )
    return np.asarray(found.y)


def main() -> int:
    print(machine("vsalog", "numba", "numpy", "scipy"))
    rng = np.random.default_rng(0)
    smooth = [sine(0.05, 0.05), sine(0.05, 1.0)]
    held = [s(MINUTE) + 1e-3 * rng.standard_normal(MINUTE.size) for s in smooth]
    plant = build({"j": Rig.preset("vsa2").file.joint["vsa2"]})

    def ours(torques, time_=MINUTE):
        return play(plant, {"j": {"motor_torque_1": torques[0], "motor_torque_2": torques[1]}}, time_)["j"]

    part = MINUTE[: SECONDS * 1000 + 1]
    first = [h[: part.size].tolist() for h in held]
    reference = sample_by_sample(*first, "DOP853", 1e-12)

    def error(q, dq) -> float:
        return max(np.abs(x - y).max() / np.ptp(y) for x, y in zip((q, dq), (reference[0], reference[1]), strict=True))

    times: dict[str, Time] = side_by_side(
        {
            "held": lambda: ours(held),
            "smooth": lambda: ours(smooth),
            "part": lambda: ours([h[: part.size] for h in held], part),
        },
        ROUNDS,
    )
    found = ours([h[: part.size] for h in held], part)
    own = times["part"].median / SECONDS
    print(
        f"\none minute, torques held: {times['held'].median:.3f} s; smooth: {times['smooth'].median:.3f} s (median of {ROUNDS})"
    )
    print(f"\n{'per second of motion':44}{'ms':>9}{'error / range':>15}{'vsalog faster':>15}")
    print(f"{'vsalog':44}{1e3 * own:9.2f}{error(found['link_position'], found['link_velocity']):15.1e}")
    least_gain = math.inf
    for method, rtol, restarted in (
        ("RK45", 1e-6, True), ("DOP853", 1e-6, True), ("RK45", 1e-8, False), ("LSODA", 1e-10, False), ("DOP853", 1e-10, False),
    ):  # fmt: skip
        ask = sample_by_sample if restarted else through_all
        rest = (method, rtol) if restarted else (method, rtol, part)
        start = time.perf_counter()
        states = ask(*first, *rest)
        taken = time.perf_counter() - start
        gain = taken / SECONDS / own
        if not restarted:
            least_gain = min(least_gain, gain)
        label = f"solve_ivp {method} {rtol:g}, " + ("begun anew at each sample" if restarted else "through all jumps")
        print(f"{label:44}{1e3 * taken / SECONDS:9.1f}{error(states[0], states[1]):15.1e}{gain:15.0f}")
    met = times["held"].median <= SECONDS_PER_MINUTE and least_gain >= FASTER
    told = "met" if met else "MISSED"
    print(
        f"\ntargets: a minute in {SECONDS_PER_MINUTE:g} s, {FASTER:g} times as fast as scipy through all jumps: {told}"
    )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
