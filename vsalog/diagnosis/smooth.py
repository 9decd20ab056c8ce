"""Smooth unknown functions of a joint's signals: hypotheses for what the catalogue lacks.

A cause is believed when it explains a log better than a torque that is any smooth function of one signal of its side, in either
direction of the motion alike or opposite. Each function is a short cosine series over the signal's ranks whose terms have a
prior that falls with their order (a Gaussian process on a compact interval; Solin and Särkkä 2020, Statistics and Computing 30).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.balance import Motion
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.remainder import variables_of
from vsalog.diagnosis.sides import spring_direction
from vsalog.diagnosis.system import EXACT, System

Array = NDArray[np.float64]

# What the sites are called: no cause of the catalogue.
UNKNOWN = "unknown"
# Terms of a series, and the prior deviation of its first one as a part of the side's torque: that of a torque sensor's gain.
TERMS, SIZE = 6, 0.05


def smooth_sites(system: System, joint: Any, motion: Motion) -> list[Site]:
    """Return one hypothesis per side and signal, and per side, signal and direction of the motion.

    Parameters
    ----------
    system : of the log
    joint : of the rig
    motion : what the joint did
    """
    known = {name: x for name, (x, _) in variables_of(system, motion).items()}
    sites = []
    for side, direction, names, rate in _sides(system, joint, motion):
        push = np.where(system.weights > 0.0, direction, 0.0)
        for name in (n for n in (*names, rate) if n in known):
            series = _series(known[name])
            sites.append(_site(f"{side}({name})", push, series))
            if rate in known and name != rate:
                sites.append(_site(f"{side}({name}, direction)", push, np.sign(known[rate])[:, None] * series))
    return sites


def _sides(system: System, joint: Any, motion: Motion) -> Iterator[tuple[str, Array, Sequence[str], str]]:
    """Yield sides: name, change of the equations (m,) with a torque of the prior's size, signals, and the rate's signal."""
    size = SIZE * np.sqrt(np.diag(system.exact)) / EXACT
    springs = [s for s in motion.deflections if s not in motion.measured]
    for i, name in enumerate(system.names):
        if system.units[i] != "N*m":
            continue
        own = size * np.eye(len(system.names))[i]
        suffix = name[name.rindex("_") :] if name[-1:] in "12" else ""
        if name.startswith("motor"):
            yield name, own, ("time", f"motor_position{suffix}", f"motor_torque{suffix}"), f"motor_velocity{suffix}"
        elif name == "secondary_motor":
            yield name, own, ("time", "setpoint", "secondary_torque"), ""
        elif name == "link":
            yield name, own, ("time", "link_position"), "link_velocity"
        elif name.startswith("transmission"):
            # A torque sensor errs over what it measures; without a spring to compare it with, this is the spring's equation.
            yield (
                f"torque_sensor{suffix}" if springs else name,
                own,
                ("time", f"deflection{suffix}"),
                ("" if springs else f"deflection_rate{suffix}"),
            )
    for suffix in springs:
        direction = spring_direction(system, joint, suffix) * float(size.max(initial=0.0))
        yield f"transmission{suffix}", direction, ("time", f"deflection{suffix}"), f"deflection_rate{suffix}"


def _series(x: Array) -> Array:
    """Return the terms of a series over a signal, shape (R, TERMS), 0 where it is not known."""
    good = np.isfinite(x)
    rank = np.searchsorted(np.sort(x[good]), x[good]) / max(int(np.count_nonzero(good)), 1)
    order = np.arange(1.0, TERMS + 1.0)
    out = np.zeros((x.size, TERMS))
    out[good] = 2.0**0.5 * np.cos(np.pi * order * rank[:, None]) / order
    return out


def _site(part: str, push: Array, series: Array) -> Site:
    terms = tuple(Parameter(f"term_{k + 1}", "1", 0.0, 1.0) for k in range(series.shape[1]))
    return Site(UNKNOWN, part, terms, _as_it_is, added=push[:, :, None] * np.nan_to_num(series)[:, None, :])


def _as_it_is(joint: Any, values: Sequence[float]) -> Any:
    return joint
