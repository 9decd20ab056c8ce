"""The pneumatic joint of Shin 2021 written out by hand, with its Table II, for comparison; and the rigs that are compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from vsalog.rig import Rig
from vsalog.rig.schema import (
    PneumaticJoint,
)

Array = NDArray[np.float64]
replace = msgspec.structs.replace
STRETCH = 500  # samples over which a voltage is held
SLIPPING, FREE, STUCK = 1.0, 0.0, None


def pam() -> PneumaticJoint:
    joint = Rig.preset("pam").joints["pam"]
    assert isinstance(joint, PneumaticJoint)
    return joint


PAM = pam()
SMOOTH = replace(PAM, friction=None)
# The same muscle twice, so that equal voltages balance.
EQUAL = replace(PAM, muscle_2=PAM.muscle_1)
# Sealed off: no air comes or goes.
SEALED = replace(
    SMOOTH,
    valve_1=replace(PAM.valve_1, inflow_area=0.0, outflow_area=0.0),
    valve_2=replace(PAM.valve_2, inflow_area=0.0, outflow_area=0.0),
)


def seconds(duration: float) -> Array:
    return np.arange(round(duration * 1000) + 1) * 1e-3


def stretches(seed: int, count: int, low: float = 4.0, high: float = 6.3) -> Array:
    values = np.random.default_rng(seed).uniform(low, high, count)
    return np.append(np.repeat(values, STRETCH), values[-1])


def opening(voltage: float) -> float:
    return float(np.interp(voltage, [0, 4, 5, 5.5, 6, 6.5, 10], [0, 0.2, 0.44, 0.5, 0.6, 0.8, 1]))


def nozzle(up: float, down: float) -> float:
    """Flow per area in g/s/mm² at pressures in bar, by the flow function of the textbooks; 1 bar mm² = 0.1 N."""
    r = max(down / up, (2.0 / 2.4) ** 3.5)
    return 0.1 * up * np.sqrt(7.0 * (r ** (10.0 / 7.0) - r ** (12.0 / 7.0)) / (287.0 * 293.0)) * 1e3


def pulls(psi: float, a: float, b: float) -> tuple[float, float]:
    """Muscles' pulls [N] at pressures in bar, Table II (with the sign of p_w22 turned)."""
    l1, l2 = 0.165 - 0.0365 * np.sin(psi), 0.165 + 0.0365 * np.sin(psi)
    f1 = (7.045e-3 * l1 - 1.017e-3) * a * 1e5 - 556.8 * l1 + 72.86
    f2 = (6.423e-3 * l2 - 9.184e-4) * b * 1e5 - 197.8 * l2 + 15.75
    return f1, f2


def drive(x: Array, push: float) -> float:
    f1, f2 = pulls(x[0], x[2], x[3])
    return 0.0365 * np.cos(x[0]) * (f1 - f2) - 4.117e-4 * x[0] + push


def level(x: Array) -> float:
    f1, f2 = pulls(x[0], x[2], x[3])
    tube = 4e8 * sum((1e5 * p - 101300.0) ** -2.0 for p in x[2:])
    return 0.006 * 0.2 * abs(f1 + f2 - 0.256 * 9.8) + tube


def equations(x: Array, alphas: tuple[float, float], push: float, way: float | None) -> list[float]:
    """Eq. 11 of the paper for (ψ, ψ̇, P₁, P₂) with pressures in bar, slipping in direction `way`, stuck, or free."""
    psi, omega = x[0], x[1]
    if way is STUCK:
        out, omega = [0.0, 0.0], 0.0
    else:
        friction = 0.0 if way == FREE else 2.256e-3 * omega + way * level(x)
        out = [omega, (drive(x, push) - friction) / 4.263e-4]
    for i, sign in ((0, -1.0), (1, 1.0)):
        p, l = x[2 + i], 0.165 + sign * 0.0365 * np.sin(psi)  # noqa: E741
        volume = -2.44e-2 * l * l + 6.824e-3 * l - 4.254e-4
        swelling = (2.0 * -2.44e-2 * l + 6.824e-3) * sign * 0.0365 * np.cos(psi) * omega
        m = alphas[i] * nozzle(7.1, p) - (1.0 - alphas[i]) * nozzle(p, 1.013)
        m *= (0.05184 if m > 0.0 else 0.07776) * 1e-3
        out.append(1.1 * 287.0 * 293.0 * m / volume * 1e-5 - 0.4545 * swelling / volume * p)
    return out


def solved(
    start: Array, time: Array, alphas: Callable[[float], tuple[float, float]], push: Callable[[float], float]
) -> Array:
    """Integrate without friction, shape (4, N), pressures in Pa."""
    solution = solve_ivp(
        lambda t, x: equations(x, alphas(t), push(t), FREE),
        (time[0], time[-1]), start * [1.0, 1.0, 1e-5, 1e-5], "DOP853", time, rtol=1e-10, atol=1e-12, max_step=0.02,
    )  # fmt: skip
    assert solution.success
    return np.asarray(solution.y) * np.array([[1.0], [1.0], [1e5], [1e5]])


def states(truth: Mapping[str, Array]) -> Array:
    return np.stack([truth[name] for name in ("link_position", "link_velocity", "pressure_1", "pressure_2")])


def assert_close_in_range(found: Array, expected: Array, tolerance: float) -> None:
    for row, wanted in zip(found, expected, strict=True):
        assert np.abs(row - wanted).max() < tolerance * np.ptp(wanted)
