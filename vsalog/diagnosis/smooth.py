"""Smooth unknown functions of a joint's signals: hypotheses for what the catalogue lacks.

A cause is believed when it explains a log better than a torque that is any smooth function of one signal of its side, in either
direction of the motion alike or opposite. Each function is a short cosine series over the signal's ranks whose terms have a
prior that falls with their order (a Gaussian process on a compact interval; Solin and Särkkä 2020, Statistics and Computing 30).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import INTERVAL
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.remainder import variables_of
from vsalog.diagnosis.sides import spring_direction
from vsalog.residuals.balance import Motion, Side
from vsalog.residuals.kinds import motion_for
from vsalog.residuals.sensing import true_roles
from vsalog.residuals.system import EXACT, System
from vsalog.rig.tolerance import default_deviation

Array = NDArray[np.float64]

# What the sites are called: no cause of the catalogue.
UNKNOWN = "unknown"
# Terms of a series [1]: what is sharper is no smooth function.
TERMS = 6


@dataclass(frozen=True, slots=True)
class SmoothSite(Site):
    """A torque that is a smooth function of a signal.

    Attributes
    ----------
    side : of the joint it acts on
    equation : in which it is looked at
    variable : signal, as `remainder.variables_of` names it
    rate : signal whose sign the function is multiplied with; empty where it is not
    """

    side: Side = "motor"
    equation: str = ""
    variable: str = ""
    rate: str = ""


def smooth_sites(system: System, joint: Any) -> list[Site]:
    """Return one hypothesis per side and signal, and per side, signal and direction of the motion.

    A function of a noisy signal is noisy: otherwise one of the torque of its own equation would remove that torque's noise.

    Parameters
    ----------
    system : of the log
    joint : of the rig, with the causes that were found
    """
    motions = [_motion(s, joint) for s in (system, *system.noisy)]
    seen = [{n: x for n, (x, _) in variables_of(system, motion).items()} for motion in motions]
    known = {name: np.stack([other.get(name, x) for other in seen]) for name, x in seen[0].items()}
    sites: list[Site] = []
    for part, side, equation, direction, names, rate in _places(system, joint, motions[0]):
        push = np.where(system.weights > 0.0, direction, 0.0)
        for name in (n for n in (*names, rate) if n in known):
            series = _series(known[name])
            ways = {"": series}
            if rate in known and name != rate:
                ways[rate] = np.sign(known[rate])[..., None] * series
            for way, shape in ways.items():
                terms = tuple(Parameter(f"term_{k + 1}", "1", 0.0, 1.0) for k in range(TERMS))
                added = push[:, :, None] * np.nan_to_num(shape)[:, :, None, :]
                site = SmoothSite(UNKNOWN, f"{part}, {name}, {way}", terms, _as_it_is, added=added)
                sites.append(replace(site, side=side, equation=equation, variable=name, rate=way))
    return sites


def _motion(system: System, joint: Any) -> Motion:
    channels = system.channels
    return motion_for(joint, true_roles(joint, channels, system.hold), channels.time, channels.spread)


def _as_it_is(joint: Any, values: Sequence[float]) -> Any:
    return joint


def _places(system: System, joint: Any, motion: Motion) -> Iterator[tuple[str, Side, str, Array, Sequence[str], str]]:
    """Yield part, side, equation, change of the equations (m,) with a torque of the prior's size, signals, and the rate's."""
    # The first term is as large as a torque sensor's gain may be off.
    size = INTERVAL * default_deviation("gain", 1.0, 1.0) * np.sqrt(np.diag(system.exact)) / EXACT
    springs = [s for s in motion.deflections if s not in motion.measured]
    for i, name in enumerate(system.names):
        if system.units[i] != "N*m":
            continue
        own = size * np.eye(len(system.names))[i]
        suffix = name[-2:] if name.endswith(("_1", "_2")) else ""
        if name == "secondary_motor":
            yield name, "motor", name, own, ("time", "setpoint", "secondary_torque"), ""
        elif name.startswith("motor"):
            signals = ("time", f"motor_position{suffix}", f"motor_torque{suffix}")
            yield name, "motor", name, own, signals, f"motor_velocity{suffix}"
        elif name == "link":
            yield name, "link", name, own, ("time", "link_position"), "link_velocity"
        elif name.startswith("transmission") and springs:
            # Compared with a spring, it is the torque sensor that errs over what it measures.
            yield f"torque_sensor{suffix}", "sensor", name, own, ("time", f"deflection{suffix}"), ""
        elif name.startswith("transmission"):
            yield name, "transmission", name, own, ("time", f"deflection{suffix}"), f"deflection_rate{suffix}"
    for suffix in springs:
        direction = spring_direction(system, joint, suffix) * float(size.max(initial=0.0))
        shown = max(np.flatnonzero(direction), key=lambda i: size[i], default=None)
        if shown is not None:
            names = ("time", f"deflection{suffix}")
            yield (
                f"transmission{suffix}", "transmission", system.names[shown], direction, names, f"deflection_rate{suffix}",
            )  # fmt: skip


def _series(x: Array) -> Array:
    """Return the terms of a series over a signal and copies of it, shape (1 + K, R, TERMS), 0 where it is not known."""
    ranked = np.sort(x[0][np.isfinite(x[0])])
    rank = np.interp(x, ranked, (np.arange(ranked.size) + 0.5) / ranked.size)
    order = np.arange(1.0, TERMS + 1.0)
    return np.where(np.isfinite(x)[..., None], 2.0**0.5 * np.cos(np.pi * order * rank[..., None]) / order, 0.0)
