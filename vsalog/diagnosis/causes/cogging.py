"""Cogging that a rig does not have: where in its residual a search for waves begins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    Starts,
    angle_of,
    moved_motors,
    position_of,
    scale_of,
    with_part,
)
from vsalog.effects.base import Exactness
from vsalog.effects.cogging import Cogging
from vsalog.uncertainty.long_run import FEWEST_SAMPLES

Array = NDArray[np.float64]

# Number of the orders, strongest in the remainder, with which a search begins [1]: harmonics of one wave are strong together.
STRONGEST_ORDERS = 3


class MotorCogging(Cause):
    """A torque that repeats over the rotor's turn."""

    name = "motor.cogging"
    exact = Exactness.WAVY
    title = "A torque repeats over the turn of the {part}'s rotor (cogging, or a gear's teeth), which the rig lacks"
    says = "its motor equation is off by a wave over the motor's position"
    confirm = "Let the motor turn slowly, at constant speed and without load: its torque repeats with the angle, not with time."
    reference = "Petrović, Ortega, Stanković, Tadmor (2000), IEEE Transactions on Power Electronics 15(5)"
    signature = "motor equation: sin(n θ), cos(n θ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            role = position_of(setting, name)
            if role not in setting.roles:
                continue
            torque, _ = scale_of(setting, name)
            ratio = getattr(setting.joint, name).gear_ratio
            theta = angle_of(setting.joint, setting.roles[role], name)
            span = float(np.nanmax(theta) - np.nanmin(theta)) * ratio or 1.0
            # Slots and poles of a motor, and teeth of a gear, repeat up to some dozens of times per turn.
            orders = tuple(float(n) for n in range(1, 73))
            order = Parameter(
                "order", "1", 1.0, 0.01 / span, 0.1, 1.2 * orders[-1], 1.0 / span, shape=True, starts=orders
            )
            parameters = (
                Parameter("cosine", "N*m", 0.0, 1e-3 * torque, key="cogging.torque", scale=torque),
                Parameter("sine", "N*m", 0.0, 1e-3 * torque, key="cogging.torque", scale=torque),
                order,
            )
            starts = _waves(setting.joint, name, role, np.array(orders))
            yield Site(self.name, name, parameters, _cogging(name), starts, _cogging_report)


def _cogging(name: str) -> Any:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        here = _cogging_report(values)
        wave = Cogging(torque=here["torque"][0], order=here["order"][0], phase=here["phase"][0])
        return with_part(joint, name, cogging=(*getattr(joint, name).cogging, wave))

    return apply


def _cogging_report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    # torque · sin(order · θ + phase) = sine · sin + cosine · cos
    cosine, sine, order = (float(v) for v in values)
    return {
        "torque": (float(np.hypot(cosine, sine)), "N*m"),
        "order": (order, "1"),
        "phase": (float(np.arctan2(cosine, sine)), "rad"),
    }


def _waves(joint: Any, name: str, role: str, orders: Array) -> Starts:
    """Look for waves of some orders over the rotor's turn in the residual of the motor equation."""

    def starts(left: Remainder) -> list[tuple[float, ...]]:
        residual = left.equations.get(name)
        theta = angle_of(joint, left.roles[role], name) * getattr(joint, name).gear_ratio
        if residual is None:
            residual = left.equations.get("link")
        if residual is None:
            return []
        good = np.isfinite(residual) & np.isfinite(theta)
        if np.count_nonzero(good) < FEWEST_SAMPLES:
            return []
        y, x = residual[good] - np.mean(residual[good]), theta[good]
        # Less than a turn shows little of slow waves.
        passed = orders[orders * np.ptp(x) > 2.0 * np.pi]
        power = [abs(np.mean(y * np.exp(-1j * n * x))) for n in passed]
        best = passed[np.argsort(power)[::-1][:STRONGEST_ORDERS]]
        found: list[tuple[float, ...]] = []
        for n in best:
            basis = np.stack([np.cos(n * x), np.sin(n * x), np.ones_like(x)], axis=-1)
            # The equation has −cogging on its left side.
            cosine, sine, _ = -np.linalg.lstsq(basis, y, rcond=None)[0]
            found.append((float(cosine), float(sine), float(n)))
        return found

    return starts
