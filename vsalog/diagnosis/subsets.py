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
        chosen, pinned, barred, c.information, c.score, c.first, c.price, c.conflict, c.low, c.high, SAME_SCORE, PAIRED
    )
    return Ranked(chosen, float(score))


@njit(cache=True, error_model="numpy")
def _score(chosen: Flags, A: Array, b: Array, first: Integers, price: Array, low: Array, high: Array) -> float:
    """Return the negative log marginal likelihood; values beyond their bounds cost what it takes to pull them back."""
    k, total = 0, 0.0
    for g in range(price.size):
        if chosen[g]:
            k += first[g + 1] - first[g]
            total += price[g]
    if k == 0:
        return 0.0
    index = np.empty(k, dtype=np.int64)
    k = 0
    for g in range(price.size):
        if chosen[g]:
            for j in range(first[g], first[g + 1]):
                index[k] = j
                k += 1
    L, y, x, precision = np.empty((k, k)), np.empty(k), np.empty(k), np.ones(k)
    prices = total
    for again in range(2):
        total = prices
        for i in range(k):
            for j in range(i + 1):
                s = A[index[i], index[j]]
                if i == j:
                    s += precision[i]
                for m in range(j):
                    s -= L[i, m] * L[j, m]
                if i == j:
                    if s <= 1e-12 * precision[i]:
                        return np.inf
                    L[i, i] = np.sqrt(s)
                    total += np.log(L[i, i]) - 0.5 * np.log(precision[i])
                else:
                    L[i, j] = s / L[j, j]
            s = b[index[i]]
            for m in range(i):
                s -= L[i, m] * y[m]
            y[i] = s / L[i, i]
            total -= 0.5 * y[i] * y[i]
        for i in range(k - 1, -1, -1):
            s = y[i]
            for m in range(i + 1, k):
                s -= L[m, i] * x[m]
            x[i] = s / L[i, i]
        far = False
        for i in range(k):
            if abs(x[i]) > 1.0:
                precision[i] = 1.0 / (x[i] * x[i])
                far = True
        if again or not far:
            break
    for i in range(k):
        off = max(low[index[i]] - x[i], x[i] - high[index[i]], 0.0)
        if off > 0.0:
            # The variance of this value: |L⁻¹ e_i|².
            variance = 0.0
            z = np.zeros(k)
            for r in range(i, k):
                s = 1.0 if r == i else 0.0
                for m in range(i, r):
                    s -= L[r, m] * z[m]
                z[r] = s / L[r, r]
                variance += z[r] * z[r]
            total += 0.5 * off * off / variance
    return total


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
) -> float:
    """Improve a set in place until no move helps; return its score."""
    count = price.size
    now = _score(chosen, A, b, first, price, low, high)
    trial = np.empty_like(chosen)
    best = np.empty_like(chosen)
    while True:
        least = now - same
        better = False
        for g in range(count):
            if chosen[g]:
                if pinned[g]:
                    continue
                trial[:] = chosen
                trial[g] = False
            else:
                if barred[g]:
                    continue
                trial[:] = chosen
                trial[g] = True
                blocked = False
                for h in range(count):
                    if conflict[g, h] and trial[h]:
                        blocked = blocked or pinned[h]
                        trial[h] = False
                if blocked:
                    continue
            s = _score(trial, A, b, first, price, low, high)
            if s < least:
                least, better = s, True
                best[:] = trial
        if not better:
            # Exchanges, and two for one, only where nothing simpler helps.
            size = 0
            for g in range(count):
                size += chosen[g]
            for g in range(count):
                if not chosen[g] or pinned[g]:
                    continue
                for g2 in range(g, count):
                    if not chosen[g2] or pinned[g2] or (g2 != g and size > paired):
                        continue
                    for h in range(count):
                        if chosen[h] or barred[h]:
                            continue
                        trial[:] = chosen
                        trial[g] = False
                        trial[g2] = False
                        trial[h] = True
                        blocked = False
                        for o in range(count):
                            if conflict[h, o] and trial[o]:
                                blocked = True
                        if blocked:
                            continue
                        s = _score(trial, A, b, first, price, low, high)
                        if s < least:
                            least, better = s, True
                            best[:] = trial
        if not better:
            return now
        chosen[:] = best
        now = least
