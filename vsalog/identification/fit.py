"""The fit of a joint's numbers to a log: output errors of its simulation in windows, the windows' beginnings free.

The beginnings are taken out by variable projection (Golub and Pereyra 2003, Inverse Problems 19), the rest is a least-squares fit
within bounds (Branch, Coleman and Li 1999, SIAM J. Sci. Comput. 21). Errors are weighed by their noise, or by what the fit leaves
where that is more, and by how many samples count as one. The covariance is that of the scores in batches (Newey and West 1987,
Econometrica 55, with a rectangular window): neither the noise's colour nor what the model lacks is presumed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from vsalog.core.errors import SimulationError
from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis.trajectory import bases_of, projected, weights_of
from vsalog.identification.unknowns import Unknown, as_felt, placed
from vsalog.residuals.windows import (
    WITHIN,
    Shot,
    Windows,
    begun,
    by_states,
    in_runs,
    in_windows,
    player_of,
    shoot,
)
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]


class Effort(NamedTuple):
    """How far a search goes.

    Attributes
    ----------
    rounds : fits with weights of their own: the first from the noise alone, the other from what the first leaves
    tolerance : relative change of the sum of squares, and of the unknowns, at which a fit ends: far below its uncertainty
    evaluations : simulations of the log after which a fit is given up
    drawn, followed : draws of the prior that are simulated where the rig leads far from the log, and those that are fitted
    windows : of the log for these
    """

    rounds: int = 2
    tolerance: float = 1e-4
    evaluations: int = 60
    drawn: int = 64
    followed: int = 3
    windows: int = 8


EFFORT = Effort()


@dataclass(frozen=True, slots=True)
class Fit:
    """A joint's numbers at their most probable values.

    Attributes
    ----------
    unknowns : p of them
    values : shape (p,), in prior deviations from the rig
    covariance : shape (p, p), in the same units
    information : shape (p, p), of the log alone
    batches : independent parts of the log that the covariance is told from
    windows, shot : the log, and its simulation
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    information: Array
    batches: int
    windows: Windows
    shot: Shot

    @property
    def interval(self) -> float:
        """Half-width of a 95 % interval, in standard deviations."""
        degrees = max(self.batches - len(self.unknowns), 1)
        return float(student.isf(0.5 * SIGNIFICANCE, degrees))


def fitted(joint: Any, unknowns: Sequence[Unknown], windows: Windows, start: Array | None = None) -> Fit:
    """Fit numbers of a joint to windows of a log.

    Parameters
    ----------
    joint : of the rig, as it is written
    unknowns : p of them
    windows : of the log
    start : shape (p,), to begin the search with; the rig when absent

    Raises
    ------
    SimulationError
        The joint cannot be simulated as the rig has it.
    """
    search = _Search(joint, tuple(unknowns), windows)
    return search.all_the_way(search.begin() if start is None else start)


def _misfit(shot: Shot, windows: Windows) -> float:
    return float(np.mean(shot.whitened(windows) ** 2))


class _Search:
    """The way to the values that fit best: from the rig, and where that ends far from the log, from draws of the prior."""

    def __init__(self, joint: Any, unknowns: tuple[Unknown, ...], windows: Windows) -> None:
        self.joint, self.unknowns, self.windows = joint, unknowns, windows
        self.low, self.high = np.array([u.bounds for u in unknowns]).reshape(-1, 2).T
        self.few = windows.part(in_runs(len(windows.spans), EFFORT.windows))

    def all_the_way(self, values: Array) -> Fit:
        """Fit all windows from some values, with weights that follow the fit."""
        return self._from(values, self.windows, EFFORT.rounds)

    def begin(self) -> Array:
        """Return where the search goes all the way from, found on a part of the windows."""
        fits = [self._from(np.zeros(len(self.unknowns)), self.few, 1)]
        if _misfit(fits[0].shot, self.few) > WITHIN:
            for values in self._best_draws():
                try:
                    fits.append(self._from(values, self.few, 1))
                except SimulationError:
                    continue
        return min(fits, key=lambda fit: _misfit(fit.shot, self.few)).values

    def _from(self, values: Array, windows: Windows, rounds: int) -> Fit:
        values = np.clip(values, self.low, self.high)
        objective = _Objective(self.joint, self.unknowns, windows, values)
        for _ in range(rounds):
            values = least_squares(
                objective.residual, values, objective.jacobian, (self.low, self.high), ftol=EFFORT.tolerance,
                xtol=EFFORT.tolerance, gtol=EFFORT.tolerance, max_nfev=EFFORT.evaluations,
            ).x  # fmt: skip
            objective.weigh(values)
        return objective.fit(values)

    def _best_draws(self) -> Array:
        states = player_of(as_felt(self.joint), self.windows.channels).measured_states()[self.few.spans[:, 0]]

        def misfit(values: Array) -> float:
            try:
                found = _misfit(shoot(as_felt(placed(self.joint, self.unknowns, values)), self.few, states), self.few)
            except SimulationError:
                return np.inf
            return found if np.isfinite(found) else np.inf

        draws = np.clip(
            np.random.default_rng(0).standard_normal((EFFORT.drawn, len(self.unknowns))), self.low, self.high
        )
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            return draws[np.argsort(list(pool.map(misfit, draws)), kind="stable")[: EFFORT.followed]]


class _Objective:
    """What a fit makes small: weighed errors, what beginnings make up for taken off, and how far unknowns are from the rig."""

    def __init__(self, joint: Any, unknowns: tuple[Unknown, ...], windows: Windows, start: Array) -> None:
        self.joint, self.unknowns, self.windows = joint, unknowns, windows
        self.at, self.shot = start.copy(), begun(self._placed(start), windows)
        self.near, self.slopes = self.shot, by_states(self._placed(start), windows, self.shot)
        # First by the noise alone, and no more surely than the whole misfit lets it be.
        rows = in_windows(self.shot, windows)
        self.weights = np.full(rows.shape[1], 1.0 / max(float(np.sqrt(np.mean(rows**2))), 1.0))

    def weigh(self, values: Array) -> None:
        """Take weights from the simulation of some values."""
        self.weights = weights_of(self._begun(values), self.windows)

    def residual(self, values: Array) -> Array:
        """Return the weighed errors, and the unknowns, shape (n + p,); no step goes where nothing can be simulated."""
        try:
            return np.concatenate([self._rows(values).ravel(), values])
        except SimulationError:
            return np.full(self.weights.size * len(self.windows.spans) + values.size, 1.0 / np.finfo(np.float64).eps)

    def jacobian(self, values: Array) -> Array:
        """Return what the unknowns change in it, shape (n + p, p)."""
        self.near = self._begun(values)
        self.slopes = by_states(self._placed(values), self.windows, self.near)
        return np.concatenate([self._columns(values).reshape(-1, values.size), np.eye(values.size)])

    def fit(self, values: Array) -> Fit:
        """Return the fit with these values."""
        J = self.jacobian(values)[: -values.size].reshape(len(self.windows.spans), -1, values.size)
        information = np.einsum("wli,wlj->ij", J, J)
        scores, batches = _batched(J * self._rows(values)[..., None], len(self.windows.roles))
        inverse = np.linalg.inv(information + np.eye(values.size))
        covariance = inverse @ (scores.T @ scores + np.eye(values.size)) @ inverse
        return Fit(self.unknowns, values, covariance, information, batches, self.windows, self.near)

    def _placed(self, values: Array) -> Any:
        return as_felt(placed(self.joint, self.unknowns, values))

    def _begun(self, values: Array) -> Shot:
        if not np.array_equal(values, self.at):
            self.shot = begun(self._placed(values), self.windows, near=self.near, slopes=self.slopes)
            self.at = values.copy()
        return self.shot

    def _rows(self, values: Array) -> Array:
        rows = projected(bases_of(self.slopes), in_windows(self._begun(values), self.windows))
        if not np.isfinite(rows).all():
            raise SimulationError("the simulation leaves what the model describes")
        return np.asarray(rows * self.weights)

    def _columns(self, values: Array) -> Array:
        """Return what the unknowns change in the weighed errors, shape (W, L · roles, p)."""
        here = in_windows(self.near, self.windows)

        def changed(i: int) -> Array:
            there, step = values.copy(), self.unknowns[i].step(float(values[i]))
            there[i] += step
            try:
                moved = shoot(self._placed(there), self.windows, self.near.states)
            except SimulationError:
                return np.zeros_like(here)
            return np.nan_to_num((in_windows(moved, self.windows) - here) / step)

        # Compiled simulations leave the interpreter to one another.
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            columns = np.stack(list(pool.map(changed, range(values.size))), axis=-1)
        return np.asarray(projected(bases_of(self.slopes), columns) * self.weights[None, :, None])


def _batched(scores: Array, roles: int) -> tuple[Array, int]:
    """Return the sums of the scores, shape (W, L · roles, p), in enough batches of equal length, and how many there are.

    A window is a batch where there are enough of them; else windows are cut.
    """
    windows, rows, p = scores.shape
    length = rows // roles
    by_time = scores.reshape(windows, roles, length, p).sum(axis=1)
    cuts = max(1, -(-ENOUGH_BATCHES // windows))
    edges = np.linspace(0, length, cuts + 1).round().astype(np.int64)[:-1]
    sums = np.add.reduceat(by_time, edges, axis=1).reshape(-1, p)
    return sums, len(sums)
