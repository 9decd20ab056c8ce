"""Causes fitted again by simulation, where noise enters as it does in the log; and how sure their values are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.fit import applied, newton_step, parameters_of, solved
from vsalog.diagnosis.windows import Shot, Windows, begun, by_states, in_windows, shoot
from vsalog.errors import SimulationError

Array = NDArray[np.float64]

ROUNDS, ENOUGH = 5, 1e-3


@dataclass(frozen=True, slots=True)
class Refit:
    """Causes fitted by simulation.

    Attributes
    ----------
    values : of all parameters
    covariance : of the values, from how much the windows pull apart
    shot : the simulation with them
    """

    values: Array
    covariance: Array
    shot: Shot


def refit(joint: Any, sites: Sequence[Site], start: Array, windows: Windows) -> Refit | None:
    """Fit causes to the simulation of the windows, the windows' beginnings free.

    Parameters
    ----------
    joint : of the rig, without the causes
    sites : the causes
    start : their values to begin with
    windows : to fit to

    Returns
    -------
    The fit, or none where the simulation fails with such values
    """
    parameters = parameters_of(sites)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    reach = np.array([p.reach for p in parameters])
    values = np.array(start, dtype=np.float64)
    try:
        shot = begun(applied(joint, sites, values), windows)
        for _ in range(ROUNDS):
            r, S, P = _derivatives(joint, sites, values, windows, shot)
            step, follow = _step(r, S, P, values, low, high)
            step = np.clip(step, -reach, reach)
            before = float(np.sum(r**2))
            for share in (1.0, 0.3, 0.1):
                trial_values = np.clip(values + share * step, low, high)
                moved = shot.states + np.stack([follow[w] @ (trial_values - values) for w in range(len(r))])
                trial = _tried(joint, sites, trial_values, windows, moved - _correction(r, S))
                if trial is not None and float(np.sum(in_windows(trial, windows) ** 2)) < before:
                    values, shot = trial_values, trial
                    break
            else:
                break
            if before - float(np.sum(in_windows(shot, windows) ** 2)) < ENOUGH * before:
                break
        r, S, P = _derivatives(joint, sites, values, windows, shot)
    except SimulationError:
        return None
    return Refit(values, _covariance(r, S, P), shot)


def _tried(joint: Any, sites: Sequence[Site], values: Array, windows: Windows, states: Array) -> Shot | None:
    try:
        return shoot(applied(joint, sites, values), windows, states)
    except SimulationError:
        return None


def _derivatives(
    joint: Any, sites: Sequence[Site], values: Array, windows: Windows, shot: Shot
) -> tuple[Array, Array, Array]:
    """Return errors by window, their change with the states, and with the values."""
    r = in_windows(shot, windows)
    now = applied(joint, sites, values)
    S = by_states(now, windows, shot)
    parameters = parameters_of(sites)
    P = np.empty((*r.shape, values.size))
    for i, parameter in enumerate(parameters):
        step = parameter.step if values[i] + parameter.step <= parameter.high else -parameter.step
        moved = values.copy()
        moved[i] += step
        P[..., i] = (in_windows(shoot(applied(joint, sites, moved), windows, shot.states), windows) - r) / step
    return r, S, P


def _projected(r: Array, S: Array, P: Array) -> tuple[list[Array], list[Array]]:
    """Return errors and their change with the values, less what the states can make of them."""
    left, columns = [], []
    for w in range(len(r)):
        own = S[w][:, np.linalg.norm(S[w], axis=0) > 0.0]
        q, _ = np.linalg.qr(own / np.linalg.norm(own, axis=0))
        left.append(r[w] - q @ (q.T @ r[w]))
        columns.append(P[w] - q @ (q.T @ P[w]))
    return left, columns


def _step(r: Array, S: Array, P: Array, values: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the step of the values, and how the states follow them."""
    left, columns = _projected(r, S, P)
    step = newton_step(np.concatenate(columns), np.concatenate(left), values, low, high, 0.0)
    follow = np.stack([-_least(S[w], P[w]) for w in range(len(r))])
    return step, follow


def _correction(r: Array, S: Array) -> Array:
    return np.stack([_least(S[w], r[w]) for w in range(len(r))])


def _least(S: Array, b: Array) -> Array:
    scale = np.maximum(np.linalg.norm(S, axis=0), 1e-300)
    found = np.linalg.lstsq(S / scale, b, rcond=1e-8)[0]
    return np.asarray(found / (scale[:, None] if found.ndim == 2 else scale))


def _covariance(r: Array, S: Array, P: Array) -> Array:
    """Return the covariance of the values: windows, not samples, are what is independent."""
    left, columns = _projected(r, S, P)
    g = np.stack([c.T @ e for c, e in zip(columns, left, strict=True)])
    A = np.sum([c.T @ c for c in columns], axis=0)
    count = len(g)
    freedom = max(count - A.shape[0], 1)
    inverse = np.stack([solved(A, e) for e in np.eye(A.shape[0])], axis=-1)
    return np.asarray(inverse @ (g.T @ g * count / freedom) @ inverse)
