"""What a cause that may differ from log to log is in each of them: since when it is there, and how fast it grows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import INTERVAL
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.document import Trend
from vsalog.diagnosis.found import Found, undetermined
from vsalog.diagnosis.joint import JointDiagnosis
from vsalog.diagnosis.onset import onset_of
from vsalog.diagnosis.posterior import Posterior, most_probable
from vsalog.diagnosis.selection import Choice

Array = NDArray[np.float64]


def trends_of(found: JointDiagnosis, logs: Sequence[str], begins: Sequence[float | None]) -> list[Trend]:
    """Return the course of each cause that was found in a log of its own.

    A cause that is found in some logs is fitted in all of them, so that each log gives its value.

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
    every = {key: [replace(site, log=(k, len(logs))) for k in range(len(logs))] for key, site in own.items()}
    more = [(site, np.array(site.start)) for sites in every.values() for site in sites if site.key not in there]
    posterior = most_probable(selection.problem, selection.weights, (*fit, *more))
    covariance = posterior.covariance if more else posterior.covariance + undetermined(selection)
    order, times = _in_time(begins)
    dates = tuple(None if b is None else _date(b) for b in begins)
    names, out = [*(logs[k] for k in order), None], []
    for sites in every.values():
        courses = [_found_in(posterior, covariance, site, selection.choices[0]) for site in sites]
        for i, (name, (rig, unit)) in enumerate(courses[0].absent().items()):
            numbers = [one.numbers()[name] for one in courses]
            values, half = np.array([t[0] for t in numbers]), INTERVAL * np.array([t[1] for t in numbers])
            between, deviation = _between(posterior, covariance, courses, i, name)
            onset = onset_of(values[order] - rig, between[np.ix_(order, order)], deviation, times)
            out.append(
                Trend(
                    joint=found.name, cause=sites[0].cause, part=sites[0].part, number=name, unit=unit, rig=rig,
                    logs=tuple(logs), begins=dates, values=tuple(values.tolist()),
                    intervals=tuple(zip((values - half).tolist(), (values + half).tolist(), strict=True)),
                    since=names[onset.since], since_interval=(names[onset.earliest], names[onset.latest]),
                    per_day=None if onset.rate is None else onset.rate[0],
                    per_day_interval=None if onset.rate is None else onset.rate[1:],
                )
            )  # fmt: skip
    return out


def _found_in(posterior: Posterior, covariance: Array, site: Site, choice: Choice) -> Found:
    """Return a cause of a set with its values."""
    g = _place(posterior, site)
    part = _unknowns(posterior, site)
    return Found(site, posterior.fit[g][1], covariance[part, part], choice, 0.0)


def _place(posterior: Posterior, site: Site) -> int:
    return next(g for g, (other, _) in enumerate(posterior.fit) if other.key == site.key)


def _unknowns(posterior: Posterior, site: Site) -> slice:
    g, first = _place(posterior, site), posterior.linear.first
    return slice(int(first[g]), int(first[g + 1]))


def _between(
    posterior: Posterior, covariance: Array, courses: Sequence[Found], number: int, name: str
) -> tuple[Array, float]:
    """Return the covariance of a number in all logs, shape (n, n), and how far it may be from the rig's before a log is seen."""
    slopes = [one.slopes()[number] for one in courses]
    parts = [_unknowns(posterior, one.site) for one in courses]
    between = np.array(
        [
            [a @ covariance[i, j] @ b for j, b in zip(parts, slopes, strict=True)]
            for i, a in zip(parts, slopes, strict=True)
        ]
    )
    # The part of a number that filters attenuate is alike in all logs.
    values = np.array([one.numbers()[name][0] for one in courses])
    between += catalogue()[courses[0].site.cause].exact ** 2 * np.outer(values, values)
    between += np.diag([one.blur(name) ** 2 for one in courses])
    variants = [posterior.linear.variants[_place(posterior, one.site)] for one in courses]
    return between, max(float(np.linalg.norm(a * v.deviation)) for a, v in zip(slopes, variants, strict=True))


def _date(begin: float) -> str:
    return datetime.fromtimestamp(begin, UTC).isoformat(timespec="seconds")


def _in_time(begins: Sequence[float | None]) -> tuple[list[int], Array | None]:
    """Return the logs in the order of their dates, and these in days; with fewer than three dates all logs as they are given."""
    dated = sorted((b, k) for k, b in enumerate(begins) if b is not None)
    if len({b for b, _ in dated}) < 3:
        return list(range(len(begins))), None
    first = dated[0][0]
    return [k for _, k in dated], np.array([b - first for b, _ in dated]) / timedelta(days=1).total_seconds()
