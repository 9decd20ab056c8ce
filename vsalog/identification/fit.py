"""The fit of a joint's numbers to a log: output errors of its simulation in windows, the windows' beginnings free.

The beginnings are eliminated by variable projection (Golub and Pereyra 2003, Inverse Problems 19), the rest is a least-squares
fit within bounds (Branch, Coleman and Li 1999, SIAM J. Sci. Comput. 21). Errors are weighted by their noise, or by the residual
where that is larger, and by how many samples count as one. The covariance is that of the scores in batches (Liang and Zeger 1986,
Biometrika 73): neither the noise's colour nor the model error is assumed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from vsalog.core.dependence import above_zero
from vsalog.core.errors import SimulationError
from vsalog.core.progress import counted
from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis.trajectory import bases_of, projected, weights_of
from vsalog.identification.beginning import by_equations
from vsalog.identification.lever import bound_by
from vsalog.identification.unknowns import Unknown, as_felt, felt
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
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import Lever
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]


class Effort(NamedTuple):
    """How far a search goes.

    Attributes
    ----------
    rounds : fits with weights of their own: the first from the noise alone, the other from the first's residual
    tolerance : reduction of half the sum of squares at which a fit ends; being off by a standard deviation adds 1/2
    search : relative reduction of the sum of squares at which a fit to a part of the windows ends: it chooses where to begin
    evaluations : simulations of the log after which a fit is given up
    drawn, followed : draws of the prior that are simulated where the rig leads far from the log, and those that are fitted
    windows : of the log for these
    """

    rounds: int = 2
    tolerance: float = 0.01
    search: float = 1e-3
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
    degrees : of freedom of its variances, shape (p,)
    information : shape (p, p), of the log alone
    windows, shot : the log, and its simulation
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    degrees: Array
    information: Array
    windows: Windows
    shot: Shot

    @property
    def misfit(self) -> float:
        """Mean square of its errors over their noise [1]."""
        return float(np.mean(self.shot.whitened(self.windows) ** 2))

    def above_zero(self, i: int) -> float:
        """Return the probability that a number whose least value is zero is found as large where it is zero."""
        least = self.unknowns[i].bounds[0]
        return float(student.sf((self.values[i] - least) / np.sqrt(self.covariance[i, i]), self.degrees[i]))

    @property
    def half_widths(self) -> Array:
        """Half-widths of 95 % intervals, shape (p,), in prior deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)) * student.isf(0.5 * SIGNIFICANCE, self.degrees))


def fitted(
    joint: Any, unknowns: Sequence[Unknown], windows: Windows, starts: Sequence[Array] = (), lever: Lever | None = None
) -> Fit:
    """Fit numbers of a joint to windows of a log.

    It is searched where the fit begins, and whether recorded inputs are linear in between or held from sample to sample.

    Parameters
    ----------
    joint : of the rig, as it is written
    unknowns : p of them
    windows : of the log
    starts : shape (p,) each, to begin with instead of the rig; the numbers by the joint's equations are tried, too
    lever : that bound the set-point of the windows, see `lever.bound_by`

    Raises
    ------
    SimulationError
        The joint cannot be simulated as the rig has it.
    """
    search = _Search(joint, tuple(unknowns), windows, lever)
    begin, other = search.begin(starts or [np.zeros(len(unknowns))]), search.otherwise_held()
    if other is not None and other.promises(begin.values, other.few) < search.promises(begin.values, search.few):
        held = other.tried(begin.values, other.few)
        if held is not None and held.misfit < begin.misfit:
            search, begin, other = other, held, search
    fit = search.all_the_way(search.searched(begin).values)
    # Few windows determine little of it, all of them nearly everything.
    if other is None or other.promises(fit.values, other.windows) >= search.promises(fit.values, search.windows):
        return fit
    there = other.all_the_way(fit.values)
    return there if there.misfit < fit.misfit else fit


def begun_with(joint: Any, unknowns: Sequence[Unknown], windows: Windows, lever: Lever | None = None) -> Fit:
    """Fit numbers of a joint to a few windows of a log, where a fit to all may begin; parameters and errors as of `fitted`."""
    return _Search(joint, tuple(unknowns), windows, lever).begin([np.zeros(len(unknowns))])


def refitted(joint: Any, fit: Fit, windows: Windows, lever: Lever | None = None) -> Fit:
    """Fit the numbers of a fit to other windows, from its values; parameters and errors as of `fitted`."""
    return _Search(joint, fit.unknowns, windows, lever).all_the_way(fit.values)


def absence(joint: Any, fit: Fit, others: Sequence[Unknown], lever: Lever | None = None) -> Array:
    """Return the probability that a log of a joint without an effect speaks as much for it, of each: shape (k,).

    A score test: the slope of the log-likelihood with the effect's size at zero, less what the fitted numbers explain of it (Rao
    1948, Proc. Cambridge Phil. Soc. 44), in independent parts of the log.

    Parameters
    ----------
    joint, lever : as of `fitted`
    fit : of the joint without the effects
    others : k numbers at their least values, which are zero effects

    Raises
    ------
    SimulationError
        The joint cannot be simulated.
    """
    p = len(fit.unknowns)
    values = np.concatenate([fit.values, np.zeros(len(others))])
    objective = _Objective(joint, (*fit.unknowns, *others), fit.windows, values, lever)
    objective.weigh(values)
    J = objective.jacobian(values)[: -values.size]
    own = J[:, :p] / np.maximum(np.linalg.norm(J[:, :p], axis=0), np.finfo(np.float64).tiny)
    beyond = J[:, p:] - own @ np.linalg.lstsq(own, J[:, p:], rcond=None)[0]
    beyond = beyond.reshape(len(fit.windows.spans), -1, len(others))
    scores = _Batches.of(beyond, objective.residual(values)[: len(J)], len(fit.windows.roles)).scores
    return np.array([above_zero(-score) for score in scores.T])


class _Search:
    """The way to the values that fit best: from the rig, and where that ends far from the log, from draws of the prior."""

    def __init__(self, joint: Any, unknowns: tuple[Unknown, ...], windows: Windows, lever: Lever | None) -> None:
        self.joint, self.unknowns, self.windows, self.lever = joint, unknowns, windows, lever
        self.low, self.high = np.array([u.bounds for u in unknowns]).reshape(-1, 2).T
        self.few = windows.part(in_runs(len(windows.spans), EFFORT.windows))

    def all_the_way(self, values: Array) -> Fit:
        """Fit all windows from some values, with weights that follow the fit."""
        return self._from(values, self.windows, EFFORT.rounds)

    def otherwise_held(self) -> _Search | None:
        """Return the same search with inputs that are held from sample to sample, or not; none where only commands act."""
        driving = player_of(as_felt(self.joint), self.windows.channels).driving()
        if not set(driving) - set(COMMANDS):
            return None
        return _Search(self.joint, self.unknowns, replace(self.windows, hold=not self.windows.hold), self.lever)

    def begin(self, starts: Sequence[Array]) -> Fit:
        """Fit a part of the windows from some values and from those by the equations: the fit that is best.

        Where simulations of different friction or inertia are far from the log, each has optima of its own.
        """
        first, *others = starts
        fits = [self._from(first, self.few, 1)]
        if fits[0].misfit > WITHIN:
            found = by_equations(self.joint, self.unknowns, self.windows.channels)
            others += [] if found is None else [found.values]
            fits += [fit for values in others if (fit := self.tried(values, self.few)) is not None]
        return min(fits, key=lambda fit: fit.misfit)

    def tried(self, values: Array, windows: Windows) -> Fit | None:
        """Fit windows once from some values; none where they cannot be simulated."""
        try:
            return self._from(values, windows, 1)
        except SimulationError:
            return None

    def promises(self, values: Array, windows: Windows) -> float:
        """Return the squares of the errors after a step from some values, as its slopes predict them."""
        try:
            return _Objective(self.joint, self.unknowns, windows, values, self.lever).promised(values)
        except SimulationError:
            return np.inf

    def searched(self, begin: Fit) -> Fit:
        """Return a fit to a part of the windows; where one is far from the log, the best of others, from draws of the prior."""
        fits = [begin]
        if begin.misfit > WITHIN:
            for values in self._best_draws():
                fits += [fit for fit in (self.tried(values, self.few),) if fit is not None]
        return min(fits, key=lambda fit: fit.misfit)

    def _from(self, values: Array, windows: Windows, rounds: int) -> Fit:
        values = np.clip(values, self.low, self.high)
        objective = _Objective(self.joint, self.unknowns, windows, values, self.lever)
        tolerance = EFFORT.search if windows is self.few else EFFORT.tolerance / objective.cost_of_noise
        for _ in counted("fit", range(rounds)):
            values = objective.least(values, tolerance)
            # The search stays inside its bounds by less than counts.
            for bound in (self.low, self.high):
                values = np.where(np.isclose(values, bound), bound, values)
            objective.weigh(values)
        return objective.fit(values)

    def _best_draws(self) -> Array:
        states = player_of(as_felt(self.joint), self.windows.channels).measured_states()[self.few.spans[:, 0]]

        def misfit(values: Array) -> float:
            try:
                joint = felt(self.joint, self.unknowns, values)
                shot = shoot(joint, bound_by(self.lever, self.few, joint), states)
            except SimulationError:
                return np.inf
            found = float(np.mean(shot.whitened(self.few) ** 2))
            return found if np.isfinite(found) else np.inf

        draws = np.clip(
            np.random.default_rng(0).standard_normal((EFFORT.drawn, len(self.unknowns))), self.low, self.high
        )
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            return draws[np.argsort(list(pool.map(misfit, draws)), kind="stable")[: EFFORT.followed]]


class _SettledError(Exception):
    """No step predicts a gain: carries the values, shape (p,)."""

    def __init__(self, values: Array) -> None:
        self.values = values.copy()


class _Objective:
    """What a fit minimises: weighted errors without the effect of beginnings, and how far unknowns are from the rig."""

    def __init__(
        self, joint: Any, unknowns: tuple[Unknown, ...], windows: Windows, start: Array, lever: Lever | None
    ) -> None:
        self.joint, self.unknowns, self.windows, self.lever = joint, unknowns, windows, lever
        self.at, self.shot = start.copy(), begun(*self._placed(start))
        self.near, self.slopes = self.shot, by_states(*self._placed(start), self.shot)
        # First by the noise alone, and no more certain than the whole misfit allows.
        rows, self.central = in_windows(self.shot, self._placed(start)[1]), False
        self.low, self.high = np.array([u.bounds for u in unknowns]).reshape(-1, 2).T
        self.weights = np.full(rows.shape[1], 1.0 / max(float(np.sqrt(np.mean(rows**2))), 1.0))

    def weigh(self, values: Array) -> None:
        """Take weights from the simulation of some values.

        From there on derivatives are those of parabolas: their errors in directions of numbers that compensate each other
        must be far below the prior.
        """
        self.weights, self.central = weights_of(self._begun(values), self._placed(values)[1]), True

    @property
    def cost_of_noise(self) -> float:
        """Half the residual sum of squares where the weights are right, or more."""
        return 0.5 * len(self.windows.spans) * self.weights.size

    def least(self, values: Array, tolerance: float) -> Array:
        """Return the values that make it least, from some: a step predicts a gain below a part of it, or gained less."""

        def jacobian(values: Array) -> Array:
            next(evaluations, None)
            J, rows = self.jacobian(values), self.residual(values)
            slope = J.T @ rows
            held = (np.isclose(values, self.low) & (slope > 0.0)) | (np.isclose(values, self.high) & (slope < 0.0))
            if _reached(J[:, ~held], rows) < tolerance * np.square(rows).sum():
                raise _SettledError(values)
            return J

        evaluations = counted("fit", range(EFFORT.evaluations), at_most=True)
        # The interior method makes no progress from a bound; that of an active set does.
        at_bound = np.any(np.isclose(values, self.low) | np.isclose(values, self.high))
        try:
            # With errors of the simulation's own, steps without a predicted gain are shortened again and again.
            return np.asarray(
                least_squares(
                    self.residual, values, jacobian, (self.low, self.high), "dogbox" if at_bound else "trf", x_scale="jac",
                    ftol=tolerance, xtol=None, gtol=None, max_nfev=EFFORT.evaluations,
                ).x
            )  # fmt: skip
        except _SettledError as there:
            return there.values
        finally:
            evaluations.close()

    def residual(self, values: Array) -> Array:
        """Return the weighted errors, and the unknowns, shape (n + p,); no step goes where nothing can be simulated."""
        try:
            return np.concatenate([self._rows(values).ravel(), values])
        except SimulationError:
            return np.full(self.weights.size * len(self.windows.spans) + values.size, 1.0 / np.finfo(np.float64).eps)

    def jacobian(self, values: Array) -> Array:
        """Return its Jacobian, shape (n + p, p)."""
        self.near = self._begun(values)
        self.slopes = by_states(*self._placed(values), self.near)
        return np.concatenate([self._columns(values).reshape(-1, values.size), np.eye(values.size)])

    def promised(self, values: Array) -> float:
        """Return the sum of the errors' squares after a step that the slopes predict, not weighted."""
        J, rows = self.jacobian(values), self.residual(values)
        return float((np.square(rows).sum() - _reached(J, rows)) / self.weights[0] ** 2)

    def fit(self, values: Array) -> Fit:
        """Return the fit with these values."""
        J = self.jacobian(values)[: -values.size].reshape(len(self.windows.spans), -1, values.size)
        parts = _Batches.of(J, self._rows(values), len(self.windows.roles))
        return Fit(
            self.unknowns,
            values,
            parts.covariance,
            parts.degrees,
            np.einsum("wli,wlj->ij", J, J),
            self.windows,
            self.near,
        )

    def _placed(self, values: Array) -> tuple[Any, Windows]:
        joint = felt(self.joint, self.unknowns, values)
        return joint, bound_by(self.lever, self.windows, joint)

    def _begun(self, values: Array) -> Shot:
        if not np.array_equal(values, self.at):
            self.shot = begun(*self._placed(values), near=self.near, slopes=self.slopes)
            self.at = values.copy()
        return self.shot

    def _rows(self, values: Array) -> Array:
        rows = projected(bases_of(self.slopes), in_windows(self._begun(values), self._placed(values)[1]))
        if not np.isfinite(rows).all():
            raise SimulationError("the simulation leaves the range of the model")
        return np.asarray(rows * self.weights)

    def _columns(self, values: Array) -> Array:
        """Return the Jacobian of the weighted errors, shape (W, L · roles, p)."""
        here, free = in_windows(self.near, self._placed(values)[1]), self.unknowns

        def moved(i: int, step: float) -> Array | None:
            there = values.copy()
            there[i] += step
            other, windows = self._placed(there)
            try:
                return in_windows(shoot(other, windows, self.near.states), windows)
            except SimulationError:
                return None

        def changed(i: int) -> Array:
            step = free[i].step(float(values[i]))
            after, before = moved(i, step), None
            if self.central and self.low[i] <= values[i] - step <= self.high[i]:
                before = moved(i, -step)
            if after is None:
                return np.zeros_like(here)
            return np.nan_to_num((after - here) / step if before is None else (after - before) / (2.0 * step))

        # Compiled simulations leave the interpreter to one another.
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            columns = np.stack(list(pool.map(changed, range(values.size))), axis=-1)
        return np.asarray(projected(bases_of(self.slopes), columns) * self.weights[None, :, None])


def _reached(J: Array, rows: Array) -> float:
    """Return by how much a linear fit reduces the sum of squares of errors."""
    return float(np.square(np.linalg.qr(J)[0].T @ rows).sum())


@dataclass(frozen=True, slots=True)
class _Batches:
    """Independent parts of a log: of each Σ JᵀJ, shape (B, p, p), and the score Σ Jᵀr, shape (B, p).

    A fit follows each part's errors, the more the fewer parts determine an unknown: scores are scaled back by
    each part's share (CR2 of Bell and McCaffrey 2002, Survey Methodology 28), and a variance has the degrees of freedom that its
    expectation and variance under white errors give (Satterthwaite).
    """

    informations: Array
    scores: Array

    @classmethod
    def of(cls, J: Array, rows: Array, roles: int) -> _Batches:
        """Cut Jacobian, shape (W, L · roles, p), and errors; a window is a batch where there are enough, else windows are cut."""
        windows, _, p = J.shape
        by_time = J.reshape(windows, roles, -1, p)
        errors = rows.reshape(windows, roles, -1)
        cuts = max(1, -(-ENOUGH_BATCHES // windows))
        parts = list(zip(*(np.array_split(x, cuts, axis=2) for x in (by_time, errors)), strict=True))
        informations = np.concatenate([np.einsum("wrli,wrlj->wij", j, j) for j, _ in parts])
        return cls(informations, np.concatenate([np.einsum("wrli,wrl->wi", j, e) for j, e in parts]))

    @property
    def root(self) -> Array:
        """R with R Rᵀ = A⁻¹, of the information A of the log and of the prior, which is one, shape (p, p)."""
        A = self.informations.sum(axis=0) + np.eye(self.scores.shape[1])
        size = np.sqrt(np.diag(A))
        eigenvalues, vectors = np.linalg.eigh(A / np.outer(size, size))
        # Where rounding hides the information on a direction, only the prior's counts.
        known = eigenvalues > size.size * np.finfo(np.float64).eps * eigenvalues[-1]
        spread = np.sqrt(np.where(known, eigenvalues, 1.0 / np.max(size) ** 2))
        return np.asarray(vectors / size[:, None] / spread)

    @property
    def parts(self) -> tuple[Array, Array]:
        """Each batch's share M of the information, and (1 − M)^−½, where all of it is one: shape (B, p, p) each."""
        R = self.root
        shares = R.T @ self.informations @ R
        leverages, vectors = np.linalg.eigh(shares)
        by = 1.0 / np.sqrt(np.maximum(1.0 - leverages, np.finfo(np.float64).eps ** 0.5))
        return shares, (vectors * by[:, None, :]) @ vectors.transpose(0, 2, 1)

    @property
    def covariance(self) -> Array:
        """Of the unknowns, shape (p, p)."""
        R = self.root
        scores = np.einsum("bij,bj->bi", self.parts[1], self.scores @ R)
        return np.asarray(R @ (scores.T @ scores + R.T @ R) @ R.T)

    @property
    def degrees(self) -> Array:
        """Degrees of freedom of the variances, shape (p,)."""
        R, (shares, enlarged) = self.root, self.parts
        inverse = R @ R.T
        by = np.einsum("ki,bij->bkj", R, enlarged)
        through = np.einsum("bki,bij->kbj", by, shares)
        own = np.einsum("kbi,bki->kb", through, by)
        Q = -through @ through.transpose(0, 2, 1)
        Q[:, np.arange(own.shape[1]), np.arange(own.shape[1])] += own
        # The prior's part is certain.
        total = np.trace(Q, axis1=1, axis2=2) + np.sum(inverse**2, axis=1)
        return np.asarray(total**2 / np.maximum(np.sum(Q**2, axis=(1, 2)), np.finfo(np.float64).tiny))
