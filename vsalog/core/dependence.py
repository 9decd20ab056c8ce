"""What a residual depends on: a test on held-out blocks with a stated false-alarm rate.

Rows are cut into blocks of time. The coefficients of a shape (some columns) are fitted by least squares to all blocks but one
and its neighbours, and tested in that one: S = Σ_b (X_b β_{−b})ᵀ e_b, the inner product of the held-out residual and its
prediction. Correlation from one block to the next thus is no prediction (Burman, Chow and Nolan
1994). Controls, which may explain the residual as well, are partialled out of both first.

S is a quadratic form in the blocks' scores r_b = X_bᵀ e_b, S = Σ r_bᵀ G_{−b}⁻¹ r_b' over pairs that are no neighbours. As each
block is also in the fits for the others, its terms are not independent, and S over the root of their squares is
no Student's t: with k columns its standard deviation tends to √2, and at 0.001 ten columns alarm four times too often. So S is
compared with the same form in the scores of the shape's residual, u_b = X_bᵀ (e_b − X_b β_{−b}), with random signs
(wild bootstrap of clusters; Liu 1988, Cameron, Gelbach and Miller 2008). For normal signs that is Σ λ_i z_i², divided by
χ²_ν/ν with ν = B − 1 because u_b are few: Student's t² where X is one column. The tail is Kuonen's saddlepoint approximation.
Blocks of unequal variance make such tests conservative (Bakirov and Székely 2005, Ibragimov and Müller 2010). A residual
with a correlation longer than a block does not: blocks are joined until neighbouring scores are no more correlated than by
chance, and the remaining correlation widens S as in a long-run covariance of one lag, with a third of the degrees of freedom
(Priestley 1981, ch. 6.2). The fits for two neighbours share most of their blocks, and so most of their error. With k columns and
B independent blocks, the neighbours' scores would thus agree by √(k/B) standard errors: this part is subtracted. (A trend over
the whole log has no independent blocks: a test for one needs more than this.)

Of 20,000 logs whose rows follow a first-order autoregression of 0.7, in blocks of ten rows, 0.0110 alarm at 0.01 and 0.0015 at
0.001 with one column, 0.0041 and 0.0003 with eight.

Burman, Chow, Nolan, "A cross-validatory method for dependent data", Biometrika 81, 1994. Priestley, "Spectral Analysis and Time
Series", 1981.
Liu, "Bootstrap procedures under some non-i.i.d. models", Ann. Statist. 16, 1988. Cameron, Gelbach, Miller, "Bootstrap-based
improvements for inference with clustered errors", Rev. Econ. Stat. 90, 2008. Ibragimov, Müller, "t-statistic based correlation
and heterogeneity robust inference", J. Bus. Econ. Stat. 28, 2010. Bakirov, Székely, "Student's t-test for Gaussian scale
mixtures", Zap. Nauchn. Sem. POMI 328, 2005. Kuonen, "Saddlepoint approximations for distributions of quadratic forms in normal
variables", Biometrika 86, 1999. Chernozhukov et al., "Double/debiased machine learning", Econometrics J. 21, 2018 (cross-
fitting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

MOST_BLOCKS = 64
"""Blocks of time [1]: as many degrees of freedom make Student's distribution nearly normal; longer blocks share less noise."""

LEAST_BLOCKS = 8
"""Least number of blocks for a test [1]: of fewer, without their neighbours, only half are fitted to."""

INTERVALS = 24
"""Intervals of a curve of any shape [1], straight in each: it follows what swings six times over a range."""

REPORTED_SHARE = 0.05
"""Part of a residual's mean square [1] that a significant dependence explains at least to be reported."""


@dataclass(frozen=True, slots=True)
class Association:
    """How a residual depends on a shape.

    Attributes
    ----------
    p_value : probability that a residual which does not depend on it agrees as much with its prediction
    share : of the residual's square, beyond the controls, that is predicted in held-out blocks; below 0 where
        the prediction makes it larger
    coefficients : shape (k,), of the whole log
    power : squares of the residual beyond the controls
    rank : directions that its columns have beyond the controls
    """

    p_value: float
    share: float
    coefficients: Array
    power: float
    rank: int


def hats(x: Array, knots: Array) -> Array:
    """Return functions of any shape: piecewise linear, 1 at one of ascending knots and 0 at the others, shape (R, k)."""
    at = np.clip(np.nan_to_num(x), knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, knots.size - 2)
    part, rows = (at - knots[left]) / (knots[left + 1] - knots[left]), np.arange(x.size)
    out = np.zeros((x.size, knots.size))
    out[rows, left], out[rows, left + 1] = 1.0 - part, part
    return out


def block_index(rows: int) -> Integers:
    """Return the block of each row, shape (R,), as many blocks as are allowed."""
    return np.arange(rows) * min(MOST_BLOCKS, max(rows, 1)) // max(rows, 1)


def block_moments(columns: Array, blocks: Integers) -> Array:
    """Return Σ z zᵀ of each block's rows, shape (B, K, K).

    Parameters
    ----------
    columns : shape (R, K), all finite; the residual is one of them
    blocks : shape (R,), not decreasing
    """
    edges = np.flatnonzero(np.diff(blocks, prepend=-1))
    return np.array([part.T @ part for part in np.split(columns, edges[1:])])


def association(
    moments: Array, shape: Sequence[int], controls: Sequence[int] = (), residual: int = -1, join: bool = True
) -> Association | None:
    """Return how the residual depends on a shape; None where there are too few blocks or the controls leave nothing.

    Parameters
    ----------
    moments : shape (B, K, K), of `block_moments`, in the order of time
    shape, controls : columns; controls are partialled out
    residual : its column
    join : whether blocks are joined until neighbours are no more correlated than by chance
    """
    while len(moments) >= LEAST_BLOCKS:
        found, alike = _held_out(moments, list(shape), list(controls), residual)
        if found is None or not join or alike <= 1.0 or len(moments) < 2 * LEAST_BLOCKS:
            return found
        moments = joined(moments)
    return None


def held_out_squares(
    moments: Array, shape: Sequence[int], controls: Sequence[int] = (), residual: int = -1
) -> float | None:
    """Return the squared residual of a shape, fitted to other blocks, beyond the controls; blocks of large variance count less.

    None where there are too few blocks or the controls leave nothing.
    """
    trial = _trial(moments, list(shape), list(controls), residual) if len(moments) >= LEAST_BLOCKS else None
    return None if trial is None else trial.left


def joined(moments: Array) -> Array:
    """Join each two neighbouring blocks."""
    return np.asarray(np.add.reduceat(moments, np.arange(0, len(moments) - len(moments) % 2, 2), axis=0))


def mean_above_zero(scores: Array) -> float:
    """Return the probability that the mean of independent scores, shape (B,), is so large by chance (Student)."""
    size = float(scores.std(ddof=1)) * float(np.sqrt(scores.size))
    return float(special.stdtr(scores.size - 1, -scores.sum() / size)) if size > 0.0 else float(scores.sum() <= 0.0)


def above_zero(scores: Array) -> float:
    """Return the p-value of independent scores, shape (B,), against a mean and a median of zero or less.

    The smaller one of Student's t-test and the sign test, times two (Bonferroni): the first detects a mean that few large
    scores make, the second a majority above zero when some scores are much larger than the others.
    """
    count = int(np.count_nonzero(scores > 0.0))
    signs = float(special.bdtrc(count - 1, scores.size, 0.5)) if count else 1.0
    return min(1.0, 2.0 * min(mean_above_zero(scores), signs))


def one_more_above(new: float, scores: Array) -> float:
    """Return the probability that one more of independent scores, shape (B,), is so large (Student's prediction interval)."""
    size = float(scores.std(ddof=1)) * float(np.sqrt(1.0 + 1.0 / scores.size))
    return (
        float(special.stdtr(scores.size - 1, (scores.mean() - new) / size)) if size > 0.0 else float(new <= scores[0])
    )


def squares_beyond(moments: Array, controls: Sequence[int], residual: int = -1) -> Array | None:
    """Return the squares that controls leave of each block, shape (B,); None where there are too few blocks."""
    return _beyond(moments, [], list(controls), residual)[2] if len(moments) >= LEAST_BLOCKS else None


def least_squares(moments: Array, columns: Sequence[int], residual: int = -1) -> Array:
    """Return the coefficients, shape (k,), of columns by the sum of some blocks' moments, shape (K, K)."""
    own = list(columns)
    return np.asarray(_inverse(moments[np.ix_(own, own)]) @ moments[own, residual])


class _Trial(NamedTuple):
    """Blocks' moments beyond the controls, X̃ᵀX̃ (B, k, k), X̃ᵀẽ (B, k) and ẽᵀẽ (B,); and the fit to the others for each.

    That is G_{−b}⁻¹ (B, k, k), and β_{−b} (B, k).
    """

    G: Array
    r: Array
    squares: Array
    inverses: Array
    fits: Array

    @property
    def left(self) -> float:
        """The squared residual after the others' prediction."""
        predicted = np.einsum("bij,bj->bi", self.G, self.fits)
        return float(self.squares.sum() + np.sum(self.fits * (predicted - 2.0 * self.r)))


def _trial(moments: Array, shape: list[int], controls: list[int], residual: int) -> _Trial | None:
    """Fit a shape for each block to those that are no neighbours of it; None where the controls leave nothing."""
    power = _beyond(moments, [], controls, residual)[2]
    if float(power.sum()) <= ROUNDING * float(moments[:, residual, residual].sum()):
        return None
    # A block of large variance does not dominate the others: random signs do not change such weights.
    weights = 2.0 * power.mean() / (power + power.mean())
    G, r, squares = _beyond(moments * weights[:, None, None], shape, controls, residual)
    near = _near(len(moments))
    inverses = _inverse(G.sum(axis=0) - np.tensordot(near, G, 1))
    return _Trial(G, r, squares, inverses, np.einsum("bij,bj->bi", inverses, r.sum(axis=0) - near @ r))


def _held_out(moments: Array, shape: list[int], controls: list[int], residual: int) -> tuple[Association | None, float]:
    """Return the association with these blocks, and the correlation of neighbouring blocks' scores over its standard error."""
    trial = _trial(moments, shape, controls, residual)
    if trial is None:
        return None, 0.0
    G, r, power, inverses, fits = trial
    squares = float(power.sum())
    predicted = np.einsum("bij,bj->bi", G, fits)
    left = r - predicted
    score = float(np.sum(fits * r))
    form = np.einsum("bi,bij->bj", left, inverses) @ left.T * ~_near(len(moments))
    inverse = _inverse(G.sum(axis=0))
    metric = left @ inverse @ left.T
    # Neighbours are fitted to nearly the same other blocks: what the errors of these fits share is no memory.
    errors = left @ np.swapaxes(G @ inverses, 1, 2) * ~_near(len(moments))[:, :, None]
    shared = np.sum(errors[:-1] @ inverse * errors[1:], axis=(1, 2))
    alike, wider, freedom = _memory(np.diagonal(metric, 1) - shared, float(np.trace(metric)))
    p = _tail(np.linalg.eigvalsh(0.5 * wider * (form + form.T)), score, freedom, squares)
    rank = int(np.linalg.matrix_rank(inverse, hermitian=True)) if inverse.any() else 0
    return Association(p, 1.0 - trial.left / squares, inverse @ r.sum(axis=0), squares, rank), alike


def _memory(products: Array, squares: float) -> tuple[float, float, float]:
    """Return the correlation that B neighbouring scores' products, shape (B − 1,), show relative to their squares' sum.

    Returns
    -------
    The correlation of neighbours over its standard error; the factor by which it raises the variance of the scores' sum; and the
    degrees of freedom of that variance, a third where two neighbours count in it.
    """
    shared, chance = float(products.sum()), float(np.sqrt(np.sum(products**2)))
    if shared <= ROUNDING * squares:
        return 0.0, 1.0, float(products.size)
    return shared / chance, 1.0 + 2.0 * shared / squares, products.size / 3.0


def _near(blocks: int) -> Flags:
    """Return which blocks are one another or neighbours, shape (B, B)."""
    return np.abs(np.subtract.outer(np.arange(blocks), np.arange(blocks))) <= 1


def _beyond(moments: Array, shape: list[int], controls: list[int], residual: int) -> tuple[Array, Array, Array]:
    """Partial the controls out: return X̃ᵀX̃ (B, k, k), X̃ᵀẽ (B, k) and ẽᵀẽ (B,) of each block."""
    use = [*controls, *shape, residual]
    part = moments[:, use][:, :, use]
    if controls:
        c, total = len(controls), part.sum(axis=0)
        W = np.eye(len(use))[:, c:]
        W[:c] = -_inverse(total[:c, :c]) @ total[:c, c:]
        part = W.T @ part @ W
        # The controls' own directions are rounding errors now.
        nothing = np.diagonal(part.sum(axis=0))[:-1] <= ROUNDING * np.diagonal(total)[c:-1]
        part[:, np.append(nothing, False)] = 0.0
        part[:, :, np.append(nothing, False)] = 0.0
    return part[:, :-1, :-1], part[:, :-1, -1], part[:, -1, -1]


def _inverse(gram: Array) -> Array:
    """Return the pseudo-inverses of matrices of squares, shape (…, k, k), of columns of equal size."""
    size = np.sqrt(np.maximum(np.diagonal(gram, axis1=-2, axis2=-1), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    scale = size[..., :, None] * size[..., None, :]
    return np.asarray(np.linalg.pinv(gram / scale, rcond=ROUNDING, hermitian=True) / scale)


def _tail(eigenvalues: Array, score: float, freedom: float, scale: float) -> float:
    """Return P(Σ λ_i z_i² > score · χ²_ν / ν) by a saddlepoint, for eigenvalues that sum to 0 (Kuonen 1999).

    Parameters
    ----------
    eigenvalues : λ_i
    score : of the held-out blocks
    freedom : ν
    scale : below this times `ROUNDING` a score is none
    """
    if score <= ROUNDING * scale:
        return 1.0
    weights = np.append(eigenvalues, -score / freedom)
    counts = np.append(np.ones(eigenvalues.size), freedom)
    largest = float(eigenvalues.max())
    if largest <= ROUNDING * score:
        return 0.0
    weights = weights / largest

    def slope(x: float) -> float:
        return float(np.sum(counts * weights / (1.0 - 2.0 * weights * x)))

    # At ½ the largest weight's term is infinite.
    high = 0.5 * (1.0 - 1e-13)
    if slope(high) <= 0.0:
        return 0.0
    # The slope rises. Halving needs no scipy.optimize, whose import would take a tenth of a short log's time.
    low = 0.0
    for _ in range(np.finfo(np.float64).nmant):
        x = 0.5 * (low + high)
        low, high = (x, high) if slope(x) < 0.0 else (low, x)
    terms = 1.0 - 2.0 * weights * x
    w = np.sqrt(max(float(np.sum(counts * np.log(terms))), 0.0))
    v = x * np.sqrt(2.0 * float(np.sum(counts * (weights / terms) ** 2)))
    # Near the mean w and v vanish, and the tail is a half.
    return float(special.ndtr(-w - np.log(v / w) / w)) if w > 1e-3 else 0.5
