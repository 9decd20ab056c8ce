"""What an encoder's steps hide while a position rests, or turns round, within one of them.

A motion that crosses steps tells where it is between them: what rounding adds is there of either sign, and averages out. A
position that enters a step and leaves it where it came from is anywhere in it for as long as it stays. Of a joint that moves
from rest to rest that is most of the log, and what a fit leaves over shows nothing of it: through two rests a spring passes
exactly, however they are rounded. So each stay counts as one unknown error of the deflection, uniform over the step, that does
not change: with the stiffness σ its part of the score is σ Σ F over the stay, or of an integral's, σ T Σ_j G_j with
G_j = Σ_{k≥j} F_k.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.resolution import step_of
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import TransmissionView
from vsalog.estimators.region import lengths

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Steps:
    """A sensor's least step, and where one of its levels lies."""

    size: float
    level: float

    def cells(self, positions: Array) -> Array:
        """Number the steps that positions are in."""
        return np.round((positions - self.level) / self.size)


class Stay(NamedTuple):
    """The step that a sensor is in, NaN before the first, and for how many samples it has been."""

    cell: float
    samples: int


@dataclass(frozen=True, slots=True)
class Resting:
    """Which steps a block's positions are in, of q sensors that t deflections come from.

    Attributes
    ----------
    cells : shape (N, q)
    stays : shape (N, q), for how many samples each sensor has been in its step
    moves : shape (q, t), 1 where a sensor moves a deflection
    errors : shape (q,), standard deviation of a stay's error [rad]
    """

    cells: Array
    stays: NDArray[np.int64]
    moves: Array
    errors: Array

    def unseen(self, slopes: Array, longest: int) -> tuple[Array, Array]:
        """Return what is not known of functions of the deflections while these rest, variances of shape (N, t), and of their sum.

        Parameters
        ----------
        slopes : shape (N, t), derivative of each transmission's function by its deflection
        longest : samples for which a position that moves may be in one step
        """
        hidden = np.where(self.stays >= longest, self.errors**2, 0.0)
        together = _times(slopes, self.moves.T) ** 2 * hidden
        return slopes**2 * _times(hidden, self.moves), together.sum(axis=1)


def steps_of(signals: JointSignals, views: Sequence[TransmissionView]) -> dict[str, Steps]:
    """Return the steps of the sensors that deflections come from; those whose noise hides them have none."""
    found = {}
    for role in dict.fromkeys(role for view in views for role in view.deflection_roles(signals.roles)):
        values = signals.roles.get(role)
        size = None if values is None else step_of(values)
        if values is not None and size is not None:
            found[role] = Steps(size, float(values[np.argmax(np.isfinite(values))]))
    return found


def resting_in(
    steps: Mapping[str, Steps],
    fit: Mapping[str, Array],
    views: Sequence[TransmissionView],
    stays: dict[tuple[str, str], Stay],
) -> Resting | None:
    """Return where the filtered positions of a block are; None where no sensor has steps.

    Parameters
    ----------
    steps : of `steps_of`
    fit : role → shape (N,), filtered
    views : the transmissions of an equation
    stays : of each transmission's sensors so far; is brought up to date
    """
    roles = list(dict.fromkeys(r for view in views for r in view.deflection_roles(fit) if r in steps))
    if not roles:
        return None
    cells = np.column_stack([steps[role].cells(fit[role]) for role in roles])
    lasting = np.empty(cells.shape, dtype=np.int64)
    for i, role in enumerate(roles):
        cell, count = stays.get((views[0].name, role), Stay(np.nan, 0))
        same = cells[:, i] == np.append(cell, cells[:-1, i])
        # Of the first sample in a step nothing stays yet.
        lasting[:, i] = lengths(same, count)
        if len(cells):
            stays[views[0].name, role] = Stay(float(cells[-1, i]), int(lasting[-1, i]))
    moves = np.array([[float(role in view.deflection_roles(fit)) for view in views] for role in roles])
    return Resting(cells, lasting, moves, np.array([steps[role].size / 12.0**0.5 for role in roles]))


class RestState(NamedTuple):
    """Sums over stays, for n regressors and q sensors; a stay has a = Σ σ, d = Σ σ j and b = Σ σ S, or b = −Σ σ F.

    Attributes
    ----------
    now, way : shape (q,), the step a sensor is in, NaN before the first; and how it came: 1 upwards, −1 downwards, 0 not seen
    a, d, b : shapes (q,), (q,) and (q, n), of the stay in progress
    A, D, AB, DB, C : shapes (1,), (1,), (n,), (n,), (n, n), Σ a², Σ d², Σ a b, Σ d b and Σ b bᵀ of the stays before
    S, rows : shapes (n,) and (1,), Σ F of the run, where the equation is an integral
    done : shape (n, n), what has been found of the runs before
    """

    now: Array
    way: Array
    a: Array
    d: Array
    b: Array
    A: Array
    D: Array
    AB: Array
    DB: Array
    C: Array
    S: Array
    rows: Array
    done: Array


def rest_start(n: int, sensors: int) -> RestState:
    """Return the state before the first sample."""
    q = sensors
    return RestState(
        np.full(q, np.nan), np.zeros(q), np.zeros(q), np.zeros(q), np.zeros((q, n)), np.zeros(1), np.zeros(1),
        np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros(1), np.zeros((n, n)),
    )  # fmt: skip


def rest_block(
    state: RestState | None, F: Array, use: Flags, fresh: Flags, slopes: Array, unknowns: Array, directions: Array,
    resting: Resting, period: float | None, discount: float,
) -> tuple[RestState, Array]:  # fmt: skip
    """Go on with the sums; return what the steps make of functionals after each row.

    Parameters
    ----------
    state : None before the first
    F : shape (N, n), regressors
    use, fresh : shape (N,), rows that are learnt from, and where an integral begins anew
    slopes : shape (N, t, n), ∂F/∂φ of each transmission
    unknowns : shape (N, n)
    directions : shape (N, m, n), P times the functionals
    period : of an integral [s]; None where the equation is none
    discount : λ², by which the weight of all rows before falls with each

    Returns
    -------
    state, and variances, shape (N, m)
    """
    new = rest_start(F.shape[1], resting.errors.size) if state is None else RestState(*(x.copy() for x in state))
    stiffness = (slopes * unknowns[:, None]).sum(axis=2)
    # Before anything is known of σ nothing is known of its part either.
    errors = np.nan_to_num(_times(stiffness, resting.moves.T) * resting.errors * (period or 1.0))
    made = np.zeros(directions.shape[:2])
    _run(F, use, fresh, resting.cells, errors, directions, period is not None, discount, *new, made)
    return new, made


def rest_covariance(state: RestState | None) -> Array | float:
    """Return the covariance of the score, shape (n, n); 0 where there are no steps."""
    if state is None:
        return 0.0
    crossed = np.outer(state.S, state.AB)
    staying = state.a[:, None] * state.S - state.b
    M = state.done + state.A[0] * np.outer(state.S, state.S) - crossed - crossed.T + state.C + staying.T @ staying
    return np.asarray(M)


def _times(a: Array, b: Array) -> Array:
    """Return a b, shape (N, m), with sums in the same order for every N, so that a log's cut into blocks changes no bit."""
    return np.asarray((a[:, :, None] * b).sum(axis=1))


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    F: Array, use: Flags, fresh: Flags, cells: Array, errors: Array, directions: Array, integral: bool, discount: float,
    now: Array, way: Array, a: Array, d: Array, b: Array, A: Array, D: Array, AB: Array, DB: Array, C: Array, S: Array,
    rows: Array, done: Array, made: Array,
) -> None:  # fmt: skip
    n, q = S.size, now.size
    for k in range(F.shape[0]):
        if integral and fresh[k] and rows[0] > 0.0:
            for r in range(q):
                _leave(r, a, d, b, A, D, AB, DB, C)
                now[r] = np.nan
            _finish_run(A, D, AB, DB, C, S, rows, done)
        if use[k]:
            for r in range(q):
                if cells[k, r] != now[r]:
                    on = 1.0 if cells[k, r] > now[r] else -1.0
                    # Through a step and out on the other side everything averages out.
                    if on != way[r]:
                        _leave(r, a, d, b, A, D, AB, DB, C)
                    way[r] = 0.0 if np.isnan(now[r]) else on
                    now[r], a[r], d[r] = cells[k, r], 0.0, 0.0
                    for i in range(n):
                        b[r, i] = 0.0
                error = errors[k, r]
                if integral:
                    a[r] += error
                    d[r] += error * rows[0]
                for i in range(n):
                    b[r, i] = discount * (b[r, i] + error * S[i]) if integral else discount * b[r, i] - error * F[k, i]
            for i in range(n):
                AB[i] *= discount
                DB[i] *= discount
                for j in range(n):
                    C[i, j] *= discount * discount
                    done[i, j] *= discount * discount
                if integral:
                    S[i] = discount * S[i] + F[k, i]
            rows[0] += 1.0
        for m in range(directions.shape[1]):
            summed = crossed = total = 0.0
            for i in range(n):
                summed += S[i] * directions[k, m, i]
                crossed += AB[i] * directions[k, m, i]
                along = 0.0
                for j in range(n):
                    along += (C[i, j] + done[i, j]) * directions[k, m, j]
                total += directions[k, m, i] * along
            total += summed * (A[0] * summed - 2.0 * crossed)
            for r in range(q):
                staying = a[r] * summed
                for i in range(n):
                    staying -= b[r, i] * directions[k, m, i]
                total += staying * staying
            made[k, m] = max(total, 0.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _leave(r: int, a: Array, d: Array, b: Array, A: Array, D: Array, AB: Array, DB: Array, C: Array) -> None:
    """Add a stay to those before, and begin the next."""
    A[0] += a[r] * a[r]
    D[0] += d[r] * d[r]
    for i in range(AB.size):
        AB[i] += a[r] * b[r, i]
        DB[i] += d[r] * b[r, i]
        for j in range(AB.size):
            C[i, j] += b[r, i] * b[r, j]
    a[r], d[r] = 0.0, 0.0
    for i in range(AB.size):
        b[r, i] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def _finish_run(A: Array, D: Array, AB: Array, DB: Array, C: Array, S: Array, rows: Array, done: Array) -> None:
    """Add a run to those before, less its own constant, which nobody asks for any more: G_j less its mean is S j/N − S_j."""
    n, count = S.size, rows[0]
    for i in range(1, n):
        for j in range(1, n):
            x, y = S[i] / count, S[j] / count
            done[i, j] += D[0] * x * y - x * DB[j] - DB[i] * y + C[i, j]
    A[0], D[0], rows[0] = 0.0, 0.0, 0.0
    AB[:], DB[:], C[:, :], S[:] = 0.0, 0.0, 0.0, 0.0
