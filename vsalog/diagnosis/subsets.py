"""The best sets of causes of a linear-Gaussian model, each set scored by its closed-form marginal likelihood.

With unknowns u ~ N(0, 1/λ), information A and score vector b, a set γ has (George and McCulloch 1997, Statistica Sinica 7(2))

    −log p(data | γ) + const = ½ log det(I + Λ⁻¹ A_γγ) − ½ b_γᵀ (Λ + A_γγ)⁻¹ b_γ − ½ log det Λ_γ + Σ price_γ.

λ is 1, but for an unknown that is larger than that: its prior is as wide as it is (λ = 1/u², automatic relevance determination;
MacKay 1994, ASHRAE Transactions 100(2)), and so wide a prior is as improbable as it is wide: the third term. Together that is the
tail of a Cauchy distribution. So what is far out is as improbable as its logarithm, not as its square: a gross error, as a wrong
gear ratio, is one cause, and is not spread over several small ones. Of two that explain the same it is the one whose tolerance is
wider.

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

# Scores that differ by less are equal [natural units of log-probability]: rounding.
SAME_SCORE = 1e-6
# Sums may be added in any order: several terms at a time.
SUMS = {"reassoc", "contract"}
# So many of the best, as a coarse look ranks them, are looked at in full [1]: sets, what replaces a cause, experiments.
BEST = 6
# Largest set that is searched for two-for-one moves [groups], whose number grows with the square of its size: larger sets are on
# the way to smaller ones.
LARGEST_PAIRED = 16
# Information, in units of the prior's, below which a value that is far out may be held back by the prior and look near. Above
# it a prior as wide as the value gains less than two natural units of log-probability.
WEAK_INFORMATION = 1.0 / 3.0


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

    @property
    def arrays(self) -> tuple[Array, Array, Integers, Array, Array, Array]:
        """All but the conflicts, as compiled functions take them."""
        return self.information, self.score, self.first, self.price, self.low, self.high

    def unknowns(self, chosen: Flags) -> Integers:
        """Return the indices of the unknowns of a set of groups, shape (k,)."""
        return np.flatnonzero(np.repeat(chosen, np.diff(self.first)))

    def solution(self, chosen: Flags) -> Array:
        """Return the most probable values of all unknowns with a set of groups in, shape (p,), 0 for those that are out."""
        out = np.zeros(self.score.size)
        own = self.unknowns(chosen)
        if own.size:
            A, b = self.information[np.ix_(own, own)], self.score[own]
            _, _, prior, *_ = _posterior(chosen, *self.arrays)
            out[own] = within(np.diag(prior) + A, b, np.zeros(own.size), self.low[own], self.high[own])
        return out

    def scored(self, chosen: Flags) -> float:
        """Return the negative log marginal likelihood of a set, less that of the empty one."""
        return float(_score(chosen, *self.arrays))


def within(H: Array, pull: Array, now: Array, low: Array, high: Array) -> Array:
    """Return where ½ xᵀ H x − pullᵀ x, x from `now`, is least within bounds.

    What would leave them stays on them, and the others give way. Where H has no inverse, `now` stays as far as it may.
    """
    out, free = now.copy(), np.ones(now.size, dtype=np.bool_)
    while free.any():
        given = pull[free] - H[np.ix_(free, ~free)] @ (out - now)[~free]
        out[free] = now[free] + np.linalg.lstsq(H[np.ix_(free, free)], given, rcond=None)[0]
        beyond = free & ((out < low) | (out > high))
        if not beyond.any():
            break
        out[beyond] = np.clip(out, low, high)[beyond]
        free &= ~beyond
    return out


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
    begun = {best.chosen.tobytes()}
    for g in np.flatnonzero(~best.chosen):
        pinned = free.copy()
        pinned[g] = True
        there = _descended(candidates, _with(candidates, best.chosen, int(g)), pinned, free).chosen
        begun.add((best.chosen | pinned).tobytes())  # from there it leads back
        if there.tobytes() not in begun:
            begun.add(there.tobytes())
            _keep(found, _descended(candidates, there, free, free))
    return sorted(found.values(), key=lambda r: r.score)


def without(candidates: Candidates, best: Ranked, barred: Flags) -> Ranked:
    """Return the best set found that has none of some groups: what would replace them."""
    free = np.zeros(len(candidates), dtype=np.bool_)
    start = best.chosen & ~barred
    found = [_descended(candidates, s, free, barred) for s in (start, free)]
    instead = np.flatnonzero(~barred & ~start)
    scores = [candidates.scored(_with(candidates, start, int(g))) for g in instead]
    for k in np.argsort(scores)[:BEST]:
        pinned = free.copy()
        pinned[instead[k]] = True
        begin = _descended(candidates, _with(candidates, start, int(instead[k])), pinned, barred).chosen
        found.append(_descended(candidates, begin, free, barred))
    return min(found, key=lambda r: r.score)


def _with(candidates: Candidates, chosen: Flags, group: int) -> Flags:
    """Return a set with a group in it, without those that it excludes."""
    out = np.asarray(chosen & ~candidates.conflict[group])
    out[group] = True
    return out


def _everything(candidates: Candidates) -> Flags:
    """Return a set of all groups that can be in one set, the earlier ones first."""
    chosen = np.zeros(len(candidates), dtype=np.bool_)
    for g in range(len(candidates)):
        chosen[g] = not np.any(candidates.conflict[g] & chosen)
    return chosen


def _keep(found: dict[bytes, Ranked], ranked: Ranked) -> None:
    found.setdefault(ranked.chosen.tobytes(), ranked)


def _descended(candidates: Candidates, start: Flags, pinned: Flags, barred: Flags) -> Ranked:
    chosen = (start | pinned) & ~barred
    score = _descend(chosen, pinned, barred, candidates.conflict, SAME_SCORE, LARGEST_PAIRED, *candidates.arrays)
    return Ranked(chosen, float(score))


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _score(chosen: Flags, A: Array, b: Array, first: Integers, price: Array, low: Array, high: Array) -> float:
    """Return the negative log marginal likelihood; values beyond their bounds cost what it takes to pull them back."""
    return _posterior(chosen, A, b, first, price, low, high)[0]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _posterior(
    chosen: Flags, A: Array, b: Array, first: Integers, price: Array, low: Array, high: Array
) -> tuple[float, Integers, Array, Array, Array, Array]:
    """Return the score of a set, and its unknowns' indices; for the rest see `_evidence`."""
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
    own, score, bottom, top = np.empty((k, k)), np.empty(k), np.empty(k), np.empty(k)
    for i in range(k):
        score[i], bottom[i], top[i] = b[index[i]], low[index[i]], high[index[i]]
        for j in range(k):
            own[i, j] = A[index[i], index[j]]
    total, precision, L, x, cost = _evidence(own, score, bottom, top)
    return prices + total, index, precision, L, x, cost


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _evidence(A: Array, b: Array, low: Array, high: Array) -> tuple[float, Array, Array, Array, Array]:
    """Return the negative log evidence of k unknowns, and what their bounds cost.

    Between them: the precisions of their priors, the Cholesky factor of their information with these, and their means.
    """
    k, total = b.size, 0.0
    L, x, precision, cost = np.empty((k, k)), np.empty(k), np.ones(k), np.zeros(k)
    for again in range(2):
        total, far = 0.0, False
        for i in range(k):
            for j in range(k):
                L[i, j] = A[i, j]
            L[i, i] += precision[i]
        if not _factored(L, k, precision):
            return np.inf, precision, L, x, cost
        for i in range(k):
            total += np.log(L[i, i]) - np.log(precision[i])
            s = b[i]
            for m in range(i):
                s -= L[i, m] * x[m]
            x[i] = s / L[i, i]
            total -= 0.5 * x[i] * x[i]
        for i in range(k - 1, -1, -1):
            s = x[i]
            for m in range(i + 1, k):
                s -= L[m, i] * x[m]
            x[i] = s / L[i, i]
        if again:
            break
        for i in range(k):
            value = abs(x[i])
            if value <= 1.0 and A[i, i] < WEAK_INFORMATION:
                spread = _variance(L, k, i)
                value = _far_out(1.0 / spread - 1.0, value / spread)
            if value > 1.0:
                precision[i] = 1.0 / (value * value)
                far = True
        if not far:
            break
    for i in range(k):
        off = max(low[i] - x[i], x[i] - high[i], 0.0)
        if off > 0.0:
            cost[i] = 0.5 * off * off / _variance(L, k, i)
            total += cost[i]
    return total, precision, L, x, cost


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _far_out(A: float, b: float) -> float:
    """Return the width of one unknown's prior, 1 or its most likely value, whichever explains the log better.

    The prior holds back what a log determines far less sharply, and would not let it be seen to be far out.
    """
    if A <= 0.0 or b <= A:
        return 1.0
    value = b / A
    wide = 1.0 / (value * value)
    near = np.log(1.0 + A) - b * b / (1.0 + A)
    far = np.log((wide + A) / (wide * wide)) - b * b / (wide + A)
    return value if far < near else 1.0


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _evidence_of_one(A: float, b: float, low: float, high: float) -> float:
    """Return what `_evidence` does for one unknown, as most groups have: nothing is allocated."""
    precision = 1.0
    if abs(b) > 1.0 + A:
        precision = ((1.0 + A) / b) ** 2
    elif A < WEAK_INFORMATION:
        precision = 1.0 / _far_out(A, abs(b)) ** 2
    total = precision + A
    # See `_factored`.
    if 1.0 + A <= 1e-12 or total <= 1e-12 * precision:
        return np.inf
    x = b / total
    off = max(low - x, x - high, 0.0)
    return 0.5 * float(np.log(total / (precision * precision)) - b * x + off * off * total)


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _factored(L: Array, k: int, precision: Array) -> bool:
    """Put the Cholesky factor of the lower triangle of k rows in its place; return whether it has one."""
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


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _variance(L: Array, k: int, i: int) -> float:
    """Return element i of the diagonal of (L Lᵀ)⁻¹ of the first k rows."""
    column, total = np.zeros(k), 0.0
    for j in range(i, k):
        s = 1.0 if j == i else 0.0
        for m in range(i, j):
            s -= L[j, m] * column[m]
        column[j] = s / L[j, j]
        total += column[j] * column[j]
    return total


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _inverse_of(L: Array, k: int) -> Array:
    """Return (L Lᵀ)⁻¹ of the first k rows."""
    Z, out = np.zeros((k, k)), np.zeros((k, k))  # Z is the transpose of L⁻¹
    for j in range(k):
        Z[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, k):
            s = 0.0
            for m in range(j, i):
                s -= L[i, m] * Z[j, m]
            Z[j, i] = s / L[i, i]
    for i in range(k):
        for j in range(i + 1):
            s = 0.0
            for m in range(i, k):
                s += Z[i, m] * Z[j, m]
            out[i, j] = s
            out[j, i] = s
    return out


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _descend(
    chosen: Flags,
    pinned: Flags,
    barred: Flags,
    conflict: Flags,
    same: float,
    paired: int,
    A: Array,
    b: Array,
    first: Integers,
    price: Array,
    low: Array,
    high: Array,
) -> float:
    """Improve a set in place until no move helps; return its score.

    Every move is estimated with the precisions and bounds of the unknowns that stay as they are, by block elimination (the Schur
    complement); the best one is then scored exactly. Where that does not help, every addition and every drop is scored exactly:
    a bound that binds makes estimates wrong, and so does an unknown that is far out, whose prior moves with it.
    """
    count, p = price.size, b.size
    widest = 0
    for g in range(count):
        widest = max(widest, first[g + 1] - first[g])
    S, c = np.empty((p, widest)), np.empty(p)
    move = np.empty(3, dtype=np.int64)
    trial, best = np.empty_like(chosen), np.empty_like(chosen)
    where = np.empty(count, dtype=np.int64)
    clashes, barring = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    while True:
        now, index, precision, L, x, cost = _posterior(chosen, A, b, first, price, low, high)
        k = index.size
        M = _inverse_of(L, k)
        V, row = np.zeros((p, k)), np.empty(k)
        size, at = 0, 0
        for g in range(count):
            if chosen[g]:
                where[g] = at
                at += first[g + 1] - first[g]
                size += 1
        for h in range(count):
            if chosen[h] or barred[h]:
                continue
            clashes[h] = barring[h] = 0
            for o in range(count):
                if chosen[o] and conflict[h, o]:
                    clashes[h] += 1
                    barring[h] += pinned[o]
            for j in range(first[h], first[h + 1]):
                c[j] = b[j]
                for m in range(k):
                    row[m] = A[j, index[m]]
                    c[j] -= row[m] * x[m]
                for m in range(k):
                    s = 0.0
                    for i in range(k):
                        s += row[i] * M[m, i]
                    V[j, m] = s
            for j in range(first[h], first[h + 1]):
                for i in range(first[h], first[h + 1]):
                    s = A[j, i]
                    for m in range(k):
                        s -= V[j, m] * A[i, index[m]]
                    S[j, i - first[h]] = s
        R = np.empty(k, dtype=np.int64)
        doubtful = bool(np.any(cost > 0.0)) or bool(np.any(precision < 1.0)) or not np.isfinite(now)
        better, least = False, now - same
        # Exchanges, and two for one, only where nothing simpler helps.
        for exchanging in range(2):
            gained = np.inf
            for g in range(-1, count):
                if g >= 0 and (not chosen[g] or pinned[g]):
                    continue
                for g2 in range(g, count):
                    if g2 != g and (exchanging == 0 or g < 0 or size > paired or not chosen[g2] or pinned[g2]):
                        continue
                    if exchanging == 1 and g < 0:
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
                    if exchanging == 0 and g >= 0:
                        if out < gained:
                            gained = out
                            move[0], move[1], move[2] = g, g2, -1
                        continue
                    for h in range(count):
                        if chosen[h] or barred[h]:
                            continue
                        clashing = clashes[h]
                        if g >= 0:
                            clashing -= conflict[h, g] + (g2 != g and conflict[h, g2])
                        if barring[h] or (clashing and exchanging == 1):
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
                        if gain < gained:
                            gained = gain
                            move[0], move[1], move[2] = g, g2, h
            if now + gained < least:
                doubtful = True
                _copy(trial, chosen)
                g, g2, h = int(move[0]), int(move[1]), int(move[2])
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
                    _copy(best, trial)
            if better:
                break
        for h in range(count if doubtful and not better else 0):
            if pinned[h] or (barred[h] and not chosen[h]):
                continue
            _copy(trial, chosen)
            blocked = False
            if not chosen[h]:
                for o in range(count):
                    if conflict[h, o]:
                        blocked = blocked or (chosen[o] and pinned[o])
                        trial[o] = False
            if blocked:
                continue
            trial[h] = not chosen[h]
            s = _score(trial, A, b, first, price, low, high)
            if s < least:
                least, better = s, True
                _copy(best, trial)
        if not better:
            return now
        _copy(chosen, best)


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _copy(to: Flags, chosen: Flags) -> None:
    """Write a set into another's place; numba takes two seconds to compile how NumPy does that."""
    for g in range(chosen.size):
        to[g] = chosen[g]


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _listed(R: Integers, r: int, begin: int, size: int) -> int:
    for i in range(size):
        R[r + i] = begin + i
    return r + size


@njit(cache=True, error_model="numpy", fastmath=SUMS)
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
        gain += np.log(L[i, i]) + np.log(precision[R[i]]) - cost[R[i]]
        for j in range(r):
            y[i] += W[i, j] * x[R[j]]
        gain += 0.5 * y[i] * x[R[i]]
    return gain, W, y


@njit(cache=True, error_model="numpy", fastmath=SUMS)
def _with_group(
    begin: int, end: int, S: Array, c: Array, V: Array, R: Integers, r: int, W: Array, y: Array, low: Array, high: Array
) -> float:
    """Return what adding a group changes in the score once r unknowns are dropped, its price aside."""
    n = end - begin
    if n == 1:
        single, pull = S[begin, 0], c[begin]
        for m in range(r):
            pull += V[begin, R[m]] * y[m]
            for o in range(r):
                single += V[begin, R[m]] * W[m, o] * V[begin, R[o]]
        return _evidence_of_one(single, pull, low[begin], high[begin])
    own, score = np.empty((n, n)), np.empty(n)
    for i in range(n):
        score[i] = c[begin + i]
        for m in range(r):
            score[i] += V[begin + i, R[m]] * y[m]
        for j in range(n):
            own[i, j] = S[begin + i, j]
            for m in range(r):
                for o in range(r):
                    own[i, j] += V[begin + i, R[m]] * W[m, o] * V[begin + j, R[o]]
    return _evidence(own, score, low[begin:end], high[begin:end])[0]
