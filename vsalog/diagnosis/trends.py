"""What a cause that may differ from log to log is in each of them: since when it is there, and how fast it grows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from vsalog.core.significance import INTERVAL, SIGNIFICANCE
from vsalog.diagnosis.document import Trend
from vsalog.diagnosis.found import Found
from vsalog.diagnosis.joint import JointDiagnosis
from vsalog.diagnosis.posterior import most_probable

Array = NDArray[np.float64]


def trends_of(found: JointDiagnosis, logs: Sequence[str], begins: Sequence[float | None]) -> list[Trend]:
    """Return the course of each cause that was found in a log of its own.

    A cause that is found in some logs is fitted in all of them, so that each says what it says of it.

    Parameters
    ----------
    found : of a joint
    logs : their names
    begins : when each begins [s since 1970]; None where that is not known
    """
    selection = found.selection
    fit = selection.posterior.fit
    own = {(site.cause, site.part): site for site, _ in fit if site.log is not None}
    if not own:
        return []
    there = {site.key for site, _ in fit}
    every = [replace(site, log=(k, len(logs))) for site in own.values() for k in range(len(logs))]
    more = [(site, np.array(site.start)) for site in every if site.key not in there]
    posterior = most_probable(selection.problem, selection.weights, (*fit, *more))
    covariance, first, numbers = posterior.covariance, posterior.linear.first, dict[tuple[str, str], Found]()
    choice = selection.choices[0]
    for g, (site, values) in enumerate(posterior.fit):
        part = slice(int(first[g]), int(first[g + 1]))
        numbers[site.key] = Found(site, values, covariance[part, part], choice, 0.0)
    out = []
    for site in own.values():
        courses = [numbers[replace(site, log=(k, len(logs))).key] for k in range(len(logs))]
        for name, (rig, unit) in courses[0].absent().items():
            told = [one.numbers()[name] for one in courses]
            out.append(_trend(found.name, site.cause, site.part, name, unit, rig, logs, begins, told))
    return out


def _trend(
    joint: str, cause: str, part: str, name: str, unit: str, rig: float, logs: Sequence[str], begins: Sequence[float | None],
    told: Sequence[tuple[float, float, str]],
) -> Trend:  # fmt: skip
    values, spread = np.array([t[0] for t in told]), np.array([t[1] for t in told])
    order = np.argsort([np.inf if b is None else b for b in begins], kind="stable")
    there = np.abs(values - rig)[order] > INTERVAL * spread[order]
    gone = np.flatnonzero(~there)
    since = int(gone[-1]) + 1 if gone.size else 0
    rate = _rate(values, spread, begins)
    return Trend(
        joint=joint, cause=cause, part=part, number=name, unit=unit, rig=rig, logs=tuple(logs),
        begins=tuple(None if b is None else datetime.fromtimestamp(b, UTC).isoformat(timespec="seconds") for b in begins),
        values=tuple(values.tolist()),
        intervals=tuple((float(v - INTERVAL * s), float(v + INTERVAL * s)) for v, s in zip(values, spread, strict=True)),
        since=logs[int(order[since])] if since < len(logs) else None,
        per_day=None if rate is None else rate[0],
        per_day_interval=None if rate is None else (rate[1], rate[2]),
    )  # fmt: skip


def _rate(values: Array, spread: Array, begins: Sequence[float | None]) -> tuple[float, float, float] | None:
    """Return the slope of a line through values over days, weighed by their spread, and its 95 % interval; None without dates.

    Where the values scatter about the line more than they are uncertain, their scatter counts.
    """
    dated = [i for i, b in enumerate(begins) if b is not None]
    if len(dated) < 3 or len({begins[i] for i in dated}) < 3:
        return None
    days = np.array([float(begins[i]) / timedelta(days=1).total_seconds() for i in dated])  # type: ignore[arg-type]
    days -= days.mean()
    y, sigma = values[dated], np.maximum(spread[dated], np.finfo(np.float64).tiny)
    A = np.stack([np.ones_like(days), days], axis=1) / sigma[:, None]
    information = np.linalg.inv(A.T @ A)
    line = information @ (A.T @ (y / sigma))
    degrees = len(dated) - 2
    scatter = max(float(np.sum((y / sigma - A @ line) ** 2)) / degrees, 1.0)
    quantile = INTERVAL if scatter == 1.0 else float(student.isf(0.5 * SIGNIFICANCE, degrees))
    half = quantile * float(np.sqrt(information[1, 1] * scatter))
    return float(line[1]), float(line[1]) - half, float(line[1]) + half
