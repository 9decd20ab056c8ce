"""What no cause explains: how much of it there is, on which side, and which signals it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import (
    INTERVALS,
    MOST_BLOCKS,
    REPORTED_SHARE,
    Association,
    association,
    block_index,
    block_moments,
    hats,
)
from vsalog.core.significance import FALSE_ALARM
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.residuals.balance import Motion
from vsalog.residuals.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Dependent:
    """A variable that a remainder depends on: its name, and the part of the remainder's square that it predicts."""

    name: str
    share: float


def variables_of(system: System, motion: Motion) -> dict[str, tuple[Array, str]]:
    """Return what remainders may depend on: name → (averages, shape (R,), unit)."""
    found: dict[str, tuple[Array, str]] = {"time": (system.time, "s")}
    for suffix, theta in motion.motors.items():
        found[f"motor_position{suffix}"] = system.average(theta[0]), "rad"
        found[f"motor_velocity{suffix}"] = system.average(theta[1]), "rad/s"
    if motion.link is not None:
        found["link_position"] = system.average(motion.link[0]), "rad"
        found["link_velocity"] = system.average(motion.link[1]), "rad/s"
    for suffix, phi in motion.deflections.items():
        found[f"deflection{suffix}"] = system.average(phi[0]), "rad"
        found[f"deflection_rate{suffix}"] = system.average(phi[1]), "rad/s"
    for role, values in motion.roles.items():
        if role.startswith(("motor_torque", "setpoint", "secondary_torque", "pressure")):
            unit = "m" if role == "setpoint" else "Pa" if role.startswith("pressure") else "N*m"
            found[role] = system.average(values[0]), unit
    return {name: (x, unit) for name, (x, unit) in found.items() if np.isfinite(x).any() and np.nanstd(x) > 0.0}


def depends_on(rows: Array, variables: Mapping[str, tuple[Array, str]]) -> list[Dependent]:
    """Return the variables that predict a remainder in blocks that they were not fitted to, each beyond those before it.

    Parameters
    ----------
    rows : shape (R,), over its noise; NaN where it does not count
    variables : name → (values, unit)
    """
    chosen: list[Dependent] = []
    left = dict(variables)
    while left:
        before = [variables[d.name][0] for d in chosen]
        found = {name: _predicted(rows, x, beyond=before) for name, (x, _) in left.items()}
        clear = {name: f for name, f in found.items() if f is not None and f.p_value * len(variables) <= FALSE_ALARM}
        best = max(clear, key=lambda name: clear[name].share, default=None)
        if best is None or clear[best].share < REPORTED_SHARE:
            break
        chosen.append(Dependent(best, clear[best].share))
        left = {name: left[name] for name in clear if name != best}
    return chosen


def loop_over(rows: Array, variables: Mapping[str, tuple[Array, str]], dependents: Sequence[Dependent]) -> str | None:
    """Return the deflection over which a remainder that seems to depend on time is a loop; none where there is none.

    A joint that is loaded and unloaded once passes each deflection once each way: time predicts all that they predict. Where
    these two predict as much as time, the dependence is a loop, which a joint may have, not its history.

    Parameters
    ----------
    rows, variables : as of `depends_on`
    dependents : by it
    """
    if not dependents or dependents[0].name != "time":
        return None
    for name in variables:
        rate = rate_of(name)
        if rate not in variables:
            continue
        x, speed = variables[name][0], variables[rate][0]
        moving = np.where(np.abs(speed) > NEGLIGIBLE_SHARE * np.nanmax(np.abs(speed)), rows, np.nan)
        apart = np.where(speed < 0.0, x + 2.0 * (np.nanmax(x) - np.nanmin(x)), x)
        by_time = predicted_share(moving, variables["time"][0])
        if predicted_share(moving, apart, once=True) >= by_time - REPORTED_SHARE:
            return name
    return None


def rate_of(deflection: str) -> str:
    """Return the name of the variable that is a deflection's rate."""
    return deflection.replace("deflection", "deflection_rate") if deflection.startswith("deflection") else ""


def predicted_share(rows: Array, x: Array, once: bool = False) -> float:
    """Return the part of a remainder's square that a curve over a variable predicts, held out by blocks.

    Other blocks do not contain the same times, nor what a log passes `once`: there, pairs of neighbouring rows
    are blocks by turns.
    """
    found = _predicted(rows, x, once)
    return 0.0 if found is None else found.share


def _predicted(rows: Array, x: Array, once: bool = False, beyond: Sequence[Array] = ()) -> Association | None:
    """Return how a remainder depends on a curve over a variable, beyond curves over others."""
    good = (
        np.isfinite(rows) & np.isfinite(x) & np.isfinite(np.array(beyond).reshape(len(beyond), rows.size)).all(axis=0)
    )
    if np.count_nonzero(good) < 4 * INTERVALS:
        return None
    e, curves = rows[good], []
    for v in (x[good], *(other[good] for other in beyond)):
        knots = np.unique(np.quantile(v, np.linspace(0.0, 1.0, INTERVALS + 1)))
        if knots.size < 4:
            return None
        curves.append(hats(v, knots))
        once = once or bool(np.all(np.diff(v) > 0.0))
    columns, blocks = np.column_stack((*curves, e)), block_index(e.size)
    own = curves[0].shape[1]
    if once:
        # Neighbours share their bells. Each block has pairs from all over the log.
        pairs = np.arange(e.size) // 2
        turns = pairs % min(MOST_BLOCKS, max(pairs.size // 4, 1))
        order = np.argsort(turns, kind="stable")
        columns, blocks = columns[order], turns[order]
    return association(block_moments(columns, blocks), range(own), range(own, columns.shape[1] - 1), join=not once)


def curve_of(rows: Array, x: Array) -> list[tuple[float, float, float, float]]:
    """Return ends, mean and standard error over intervals of a variable."""
    good = np.isfinite(rows) & np.isfinite(x)
    e, v = rows[good], x[good]
    edges = np.unique(np.quantile(v, np.linspace(0.0, 1.0, INTERVALS + 1)))
    index = np.clip(np.searchsorted(edges, v, side="right") - 1, 0, max(edges.size - 2, 0))
    out = []
    for k in range(edges.size - 1):
        own = e[index == k]
        if own.size:
            # Rows overlap by half: every second one is independent.
            error = float(np.std(own) / np.sqrt(max(own.size / 2.0, 1.0)))
            out.append((float(edges[k]), float(edges[k + 1]), float(np.mean(own)), error))
    return out
