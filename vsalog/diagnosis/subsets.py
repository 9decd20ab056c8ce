"""The best sets of causes of a linear-Gaussian model, each set scored by its closed-form marginal likelihood.

With unknowns u ~ N(0, 1/λ), information A and score vector b, a set γ has (George and McCulloch 1997, Statistica Sinica 7(2))

    −log p(data | γ) + const = ½ log det(I + Λ⁻¹ A_γγ) − ½ b_γᵀ (Λ + A_γγ)⁻¹ b_γ + Σ price_γ.

λ is 1, but for an unknown that is larger than that: its prior is as wide as it is (λ = 1/u², automatic relevance determination;
MacKay 1994, ASHRAE Transactions 100(2)). So what is far out is as improbable as its logarithm, not as its square: a gross
error, as a wrong gear ratio, is one cause, and is not spread over several small ones.

A set is improved by adding, dropping, exchanging and two-for-one moves until none helps. One start leads to a local optimum,
so the search begins from nothing and from everything, and from the best of those with each candidate pinned in turn, and then
released: that crosses the directions that the data leave open, which no single move does.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Scores that differ by less are equal: rounding, in natural units of log-probability.
SAME_SCORE = 1e-6
# So many groups are tried in the stead of one; a set of more groups than the second is not looked through for two-for-one moves,
# whose number grows with its square: sets of so many are on the way to smaller ones.
STEAD, PAIRED = 6, 16
# So many of the best moves by their estimates are scored exactly.
EXACTLY = 8


@dataclass(frozen=True, slots=True)
class Candidates:
    """Groups of unknowns that come into a set together.

    Attributes
    ----------
    information : A, shape (p, p), of unknowns in units of their prior deviation
    score : b, shape (p,)
    first : shape (G + 1,), where the unknowns of each group begin
    price : shape (G,), −log of the prior odds of each group
    conflict : shape (G, G), groups that cannot be in one set
    low, high : shape (p,), bounds of the unknowns
    """

    information: Array
    score: Array
    first: Integers
    price: Array
    conflict: Flags
    low: Array
    high: Array

    def __len__(self) -> int:
        return int(self.price.size)

    def unknowns(self, chosen: Flags) -> Integers:
        """Return the indices of the unknowns of a set of groups, shape (k,)."""
        return np.flatnonzero(np.repeat(chosen, np.diff(self.first)))

    def solution(self, chosen: Flags) -> Array:
        """Return the posterior mean of all unknowns with a set of groups in, shape (p,), 0 for those that are out."""
        out = np.zeros(self.score.size)
        own = self.unknowns(chosen)
        if own.size:
            A, b = self.information[np.ix_(own, own)], self.score[own]
            near = np.asarray(np.linalg.solve(np.eye(own.size) + A, b))
            out[own] = np.linalg.solve(np.diag(precisions(near)) + A, b)
        return out

    def scored(self, chosen: Flags) -> float:
        """Return the negative log marginal likelihood of a set, less that of the empty one."""
        return float(_score(chosen, self.information, self.score, self.first, self.price, self.low, self.high))


def precisions(unknowns: Array) -> Array:
    """Return λ of the unknowns' priors, shape (p,)."""
    return np.asarray(1.0 / np.maximum(np.square(unknowns), 1.0))


@dataclass(frozen=True, slots=True)
class Ranked:
    """A set that no move improves.

    Attributes
    ----------
    chosen : shape (G,)
    score : negative log marginal likelihood, less that of the empty set
    """

    chosen: Flags
    score: float


def best_sets(candidates: Candidates, starts: Iterable[Flags] = ()) -> list[Ranked]:
    """Return the locally best sets, the best first.

    Parameters
    ----------
    candidates : what may be in a set
    starts : further sets to begin from, each of shape (G,)
    """
    count = len(candidates)
    free = np.zeros(count, dtype=np.bool_)
    found = dict[bytes, Ranked]()
    for start in (free.copy(), *starts, _everything(candidates)):
        _keep(found, _descended(candidates, start, free, free))
    best = min(found.values(), key=lambda r: r.score)
    for g in np.flatnonzero(~best.chosen):
        pinned = free.copy()
        pinned[g] = True
        there = _descended(candidates, _with(candidates, best.chosen, int(g)), pinned, free).chosen
        _keep(found, _descended(candidates, there, free, free))
    return sorted(found.values(), key=lambda r: r.score)


def without(candidates: Candidates, best: Ranked, barred: Flags) -> Ranked:
    """Return the best set found that has none of some groups: what would stand in their place."""
    free = np.zeros(len(candidates), dtype=np.bool_)
    start = best.chosen & ~barred
    found = [_descended(candidates, s, free, barred) for s in (start, free)]
    instead = np.flatnonzero(~barred & ~start)
    scores = [candidates.scored(_with(candidates, start, int(g))) for g in instead]
    for k in np.argsort(scores)[:STEAD]:
        pinned = free.copy()
        pinned[instead[k]] = True
        begin = _descended(candidates, _with(candidates, start, int(instead[k])), pinned, barred).chosen
        found.append(_descended(candidates, begin, free, barred))
    return min(found, key=lambda r: r.score)


def _with(candidates: Candidates, chosen: Flags, group: int) -> Flags:
    """Return a set with a group in it, without what that cannot stand with."""
    out = np.asarray(chosen & ~candidates.conflict[group])
    out[group] = True
    return out


def _everything(candidates: Candidates) -> Flags:
    """Return a set of all groups that can stand together, the earlier ones first."""
    chosen = np.zeros(len(candidates), dtype=np.bool_)
    for g in range(len(candidates)):
        chosen[g] = not np.any(candidates.conflict[g] & chosen)
    return chosen


def _keep(found: dict[bytes, Ranked], ranked: Ranked) -> None:
    found.setdefault(ranked.chosen.tobytes(), ranked)


def _descended(candidates: Candidates, start: Flags, pinned: Flags, barred: Flags) -> Ranked:
    c = candidates
    chosen = (start | pinned) & ~barred
    score = _descend(
        chosen,
        pinned,
        barred,
        c.information,
        c.score,
        c.first,
        c.price,
        c.conflict,
        c.low,
        c.high,
        SAME_SCORE,
        PAIRED,
        EXACTLY,
    )
    return Ranked(chosen, float(score))


@njit(cache=True, error_model="numpy")
def _score(chosen: Flags, A: Array, b: Array, first: Integers, price: Array, low: Array, high: Array) -> float:
    """Return the negative log marginal likelihood; values beyond their bounds cost what it takes to pull them back."""
    return _posterior(chosen, A, b, first, price, low, high)[0]


@njit(cache=True, error_model="numpy")
def _posterior(
    chosen: Flags, A: Array, b: Array, first: Integers, price: Array, low: Array, high: Array
) -> tuple[float, Integers, Array, Array, Array, Array]:
    """Return the score of a set; and its unknowns' indices, precisions, covariance and means, and what their bounds cost."""
    k, prices = 0, 0.0
    for g in range(price.size):
        if chosen[g]:
            k += first[g + 1] - first[g]
            prices += price[g]
    index = np.empty(k, dtype=np.int64)
    k = 0
    for g in range(price.size):
        if chosen[g]:
            for j in range(first[g], first[g + 1]):
                index[k] = j
                k += 1
    L, x, precision, cost = np.zeros((k, k)), np.empty(k), np.ones(k), np.zeros(k)
    total = prices
    for again in range(2):
        total = prices
        for i in range(k):
            for j in range(i + 1):
                L[i, j] = A[index[i], index[j]]
            L[i, i] += precision[i]
        if not _factored(L, k, precision):
            return np.inf, index, precision, L, x, cost
        for i in range(k):
            total += np.log(L[i, i]) - 0.5 * np.log(precision[i])
            s = b[index[i]]
            for m in range(i):
                s -= L[i, m] * x[m]
            x[i] = s / L[i, i]
            total -= 0.5 * x[i] * x[i]
        for i in range(k - 1, -1, -1):
            s = x[i]
            for m in range(i + 1, k):
                s -= L[m, i] * x[m]
            x[i] = s / L[i, i]
        far = False
        if again:
            break
        for i in range(k):
            if abs(x[i]) > 1.0:
                precision[i] = 1.0 / (x[i] * x[i])
                far = True
        if not far:
            break
    covariance = _inverse_of(L, k)
    for i in range(k):
        off = max(low[index[i]] - x[i], x[i] - high[index[i]], 0.0)
        cost[i] = 0.5 * off * off / covariance[i, i]
        total += cost[i]
    return total, index, precision, covariance, x, cost


@njit(cache=True, error_model="numpy")
def _factored(L: Array, k: int, precision: Array) -> bool:
    """Put the Cholesky factor of the lower triangle of k rows in its place; tell whether it has one."""
    for i in range(k):
        for j in range(i + 1):
            s = L[i, j]
            for m in range(j):
                s -= L[i, m] * L[j, m]
            if i > j:
                L[i, j] = s / L[j, j]
            elif s > 1e-12 * precision[i]:
                L[i, i] = np.sqrt(s)
            else:
                return False
    return True


@njit(cache=True, error_model="numpy")
def _inverse_of(L: Array, k: int) -> Array:
    """Return (L Lᵀ)⁻¹ of the first k rows."""
    Z, out = np.zeros((k, k)), np.zeros((k, k))
    for j in range(k):
        Z[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, k):
            s = 0.0
            for m in range(j, i):
                s -= L[i, m] * Z[m, j]
            Z[i, j] = s / L[i, i]
    for i in range(k):
        for j in range(i + 1):
            s = 0.0
            for m in range(i, k):
                s += Z[m, i] * Z[m, j]
            out[i, j] = s
            out[j, i] = s
    return out


@njit(cache=True, error_model="numpy")
def _descend(
    chosen: Flags,
    pinned: Flags,
    barred: Flags,
    A: Array,
    b: Array,
    first: Integers,
    price: Array,
    conflict: Flags,
    low: Array,
    high: Array,
    same: float,
    paired: int,
    exactly: int,
) -> float:
    """Improve a set in place until no move helps; return its score.

    Every move is first scored with the precisions and bounds of the unknowns that stay as they are, by block elimination (the
    Schur complement); the best few of them are then scored exactly.
    """
    count, p = price.size, b.size
    widest = 0
    for g in range(count):
        widest = max(widest, first[g + 1] - first[g])
    S, c = np.empty((p, widest)), np.empty(p)
    gains, moves = np.empty(exactly), np.empty((exactly, 3), dtype=np.int64)
    trial, best = np.empty_like(chosen), np.empty_like(chosen)
    where = np.empty(count, dtype=np.int64)
    while True:
        now, index, precision, M, x, cost = _posterior(chosen, A, b, first, price, low, high)
        k = index.size
        V = np.zeros((p, k))
        size, at = 0, 0
        for g in range(count):
            if chosen[g]:
                where[g] = at
                at += first[g + 1] - first[g]
                size += 1
        for h in range(count):
            if chosen[h] or barred[h]:
                continue
            for j in range(first[h], first[h + 1]):
                c[j] = b[j]
                for m in range(k):
                    c[j] -= A[j, index[m]] * x[m]
                    s = 0.0
                    for i in range(k):
                        s += A[j, index[i]] * M[i, m]
                    V[j, m] = s
            for j in range(first[h], first[h + 1]):
                for i in range(first[h], first[h + 1]):
                    s = A[j, i]
                    for m in range(k):
                        s -= V[j, m] * A[i, index[m]]
                    S[j, i - first[h]] = s
        R = np.empty(k, dtype=np.int64)
        better, least = False, now - same
        # Exchanges, and two for one, only where nothing simpler helps.
        for complex_moves in range(2):
            gains[:] = np.inf
            for g in range(-1, count):
                if g >= 0 and (not chosen[g] or pinned[g]):
                    continue
                for g2 in range(g, count):
                    if g2 != g and (complex_moves == 0 or g < 0 or size > paired or not chosen[g2] or pinned[g2]):
                        continue
                    if complex_moves == 1 and g < 0:
                        continue
                    r = 0
                    if g >= 0:
                        r = _listed(R, r, where[g], first[g + 1] - first[g])
                    if g2 != g:
                        r = _listed(R, r, where[g2], first[g2 + 1] - first[g2])
                    out, W, y = _without(M, x, precision, cost, R, r)
                    if g >= 0:
                        out -= price[g]
                    if g2 != g:
                        out -= price[g2]
                    if complex_moves == 0 and g >= 0:
                        _remember(gains, moves, out, g, g2, -1)
                        continue
                    for h in range(count):
                        if chosen[h] or barred[h]:
                            continue
                        clashing, blocked = 0, False
                        for o in range(count):
                            if conflict[h, o] and chosen[o] and o != g and o != g2:
                                clashing += 1
                                blocked = blocked or pinned[o]
                        if blocked or (clashing and complex_moves == 1):
                            continue
                        if clashing:
                            for o in range(count):
                                if conflict[h, o] and chosen[o]:
                                    r = _listed(R, r, where[o], first[o + 1] - first[o])
                            gone, W2, y2 = _without(M, x, precision, cost, R, r)
                            for o in range(count):
                                if conflict[h, o] and chosen[o]:
                                    gone -= price[o]
                            gain = (
                                gone + price[h] + _with_group(first[h], first[h + 1], S, c, V, R, r, W2, y2, low, high)
                            )
                            r = 0
                        else:
                            gain = out + price[h] + _with_group(first[h], first[h + 1], S, c, V, R, r, W, y, low, high)
                        _remember(gains, moves, gain, g, g2, h)
            for m in range(exactly):
                if not gains[m] < np.inf:
                    break
                trial[:] = chosen
                g, g2, h = moves[m]
                if g >= 0:
                    trial[g] = False
                    trial[g2] = False
                if h >= 0:
                    for o in range(count):
                        if conflict[h, o]:
                            trial[o] = False
                    trial[h] = True
                s = _score(trial, A, b, first, price, low, high)
                if s < least:
                    least, better = s, True
                    best[:] = trial
            if better:
                break
        if not better:
            return now
        chosen[:] = best


@njit(cache=True, error_model="numpy")
def _listed(R: Integers, r: int, begin: int, size: int) -> int:
    for i in range(size):
        R[r + i] = begin + i
    return r + size


@njit(cache=True, error_model="numpy")
def _remember(gains: Array, moves: Integers, gain: float, g: int, g2: int, h: int) -> None:
    """Put a move among the best ones, the best first."""
    m = gains.size - 1
    if not gain < gains[m]:
        return
    while m > 0 and gain < gains[m - 1]:
        gains[m] = gains[m - 1]
        moves[m] = moves[m - 1]
        m -= 1
    gains[m] = gain
    moves[m, 0], moves[m, 1], moves[m, 2] = g, g2, h


@njit(cache=True, error_model="numpy")
def _without(M: Array, x: Array, precision: Array, cost: Array, R: Integers, r: int) -> tuple[float, Array, Array]:
    """Return what dropping r unknowns changes in the score, the inverse of their covariance, and that times their means."""
    L, ones = np.empty((r, r)), np.full(r, 1e-300)
    for i in range(r):
        for j in range(i + 1):
            L[i, j] = M[R[i], R[j]]
    y = np.zeros(r)
    if not _factored(L, r, ones):
        return np.inf, L, y
    W, gain = _inverse_of(L, r), 0.0
    for i in range(r):
        gain += np.log(L[i, i]) + 0.5 * np.log(precision[R[i]]) - cost[R[i]]
        for j in range(r):
            y[i] += W[i, j] * x[R[j]]
        gain += 0.5 * y[i] * x[R[i]]
    return gain, W, y


@njit(cache=True, error_model="numpy")
def _with_group(
    begin: int, end: int, S: Array, c: Array, V: Array, R: Integers, r: int, W: Array, y: Array, low: Array, high: Array
) -> float:
    """Return what adding a group changes in the score once r unknowns are dropped, its price aside."""
    n = end - begin
    own, L, rhs, u, precision = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n), np.ones(n)
    for i in range(n):
        rhs[i] = c[begin + i]
        for m in range(r):
            rhs[i] += V[begin + i, R[m]] * y[m]
        for j in range(n):
            own[i, j] = S[begin + i, j]
            for m in range(r):
                for o in range(r):
                    own[i, j] += V[begin + i, R[m]] * W[m, o] * V[begin + j, R[o]]
    gain = 0.0
    for again in range(2):
        gain = 0.0
        L[:] = own
        for i in range(n):
            L[i, i] += precision[i]
        if not _factored(L, n, precision):
            return np.inf
        for i in range(n):
            gain += np.log(L[i, i]) - 0.5 * np.log(precision[i])
            s = rhs[i]
            for m in range(i):
                s -= L[i, m] * u[m]
            u[i] = s / L[i, i]
            gain -= 0.5 * u[i] * u[i]
        for i in range(n - 1, -1, -1):
            s = u[i]
            for m in range(i + 1, n):
                s -= L[m, i] * u[m]
            u[i] = s / L[i, i]
        far = False
        if again:
            break
        for i in range(n):
            if abs(u[i]) > 1.0:
                precision[i] = 1.0 / (u[i] * u[i])
                far = True
        if not far:
            break
    covariance = _inverse_of(L, n)
    for i in range(n):
        off = max(low[begin + i] - u[i], u[i] - high[begin + i], 0.0)
        gain += 0.5 * off * off / covariance[i, i]
    return gain
