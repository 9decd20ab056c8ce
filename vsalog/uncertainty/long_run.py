"""The long-run (HAC) covariance of a fit's score: what coloured and uneven residuals make of the unknowns.

Least squares err by P Σ F e: the sum of the regressors times the noise, the *score*. Residuals are not white: filters smooth
them, an encoder's noise differentiated twice lies far above the motion, a torque's noise integrated is a random walk, and a
model that does not fit leaves a slow pattern. Counting samples as if they were independent is wrong by factors either way. So
regressors and residuals go through one orthonormal wavelet transform, and in each octave of frequency the variance of the
residuals meets the energy of the regressors there:

    cov(Σ F e) = Σ_octaves v W Wᵀ

Wavelet coefficients of coloured noise are nearly uncorrelated, which is what makes the sum right (Fadili and Bullmore, "Wavelet-
generalized least squares", NeuroImage 15, 2002; Daubechies' wavelet with four vanishing moments). Residuals are *recursive*, the
innovations over their own standard deviation for noise of variance one: a fit does not make them smaller
(Brown, Durbin, Evans, J. R. Stat. Soc. B 37(2), 1975).

Where the equation is an integral its noise is a random walk, and no octave is the last one: there its increments are looked at,
with sums of the regressors in their place (summation by parts), less each run's mean, which its integration constant takes up.
A fit follows the walk, so that its residual changes more, slowly, than the noise does. In the slow octaves increments therefore
have a fit of their own too, to which they are nearly white; it leaves more where a velocity changes by little more than its own
noise. The smaller of the two counts.

No octave has what never changes, as an offset that the basis cannot follow: the mean of the residuals meets the sum of the
regressors.

That takes noise for stationary. Where it comes together with the motion, as what too few samples make of a jerk between long
rests, its mean over the rests tells little of it. So the products of coefficients, the residuals' times the regressors', are
also summed batch by batch. Batches that are longer than noise lasts are independent, and the squares of their sums add up to
the score's covariance, however the noise changes from one to the next. That is less certain, for it rests on the few batches in
which much happens: it counts where it is more than chance would make of stationary noise (White, Econometrica 48(4), 1980; of
batches: Liang and Zeger, Biometrika 73(1), 1986). Products of wavelets' coefficients, unlike those of samples, have no ends of
batches in them, at which noise that was differentiated would seem larger than it is.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Samples that are summed first, at least: nothing moves within so few. Octaves that are looked at; samples between two looks.
BOX, OCTAVES, EVERY = 4, 14, 64
# Samples without which nothing is said.
FEWEST_SAMPLES = 256
# An octave's variance is expected to go on as those before it did, half as steeply, within these factors; the expectation counts
# as so many coefficients. A logarithm of a variance of few is too small by one over their number, and what is divided by it
# has the tails, and so the variance, of Student's t: two more.
STEEPEST_FALL, STEEPEST_RISE, EXPECTED, TAILS = np.log(1.0 / 8.0), np.log(2.0), 8.0, 3.0
# No power of the frequency is beyond this: what was differentiated twice has 4.
STEEPEST_POWER = 4.0
# A variance of nothing at all, whose logarithm is still a number.
NO_VARIANCE = 1e-300
# Batches in boxes: their lengths, each twice the one before; how many are enough; and by how much more of a variance the batches
# have to make than stationary noise would. The variance of 32 batches is off by 25 %, so that chance makes four times that.
BATCH_LENGTHS, ENOUGH_BATCHES, SURELY_UNEVEN = 20, 32, 2.0

# Scaling filter of Daubechies' wavelet with four vanishing moments (Ten Lectures on Wavelets, table 6.1).
_LOW = np.array([
    0.230377813308855, 0.714846570552542, 0.630880767929590, -0.027983769416984,
    -0.187034811718881, 0.030841381835987, 0.032883011666983, -0.010597401784997,
])  # fmt: skip
_HIGH = _LOW[::-1] * np.array([1.0, -1.0] * 4)
_TAPS = _LOW.size

# From this octave on increments have a fit of their own.
SLOW_OCTAVE = 4


class Sum(IntEnum):
    """In `sums`: samples in the box, last residual, samples, Σ e, Σ e², boxes, Σ box², samples in the increment, in a box."""

    FILLED, LAST, SAMPLES, TOTAL, SQUARES, BOXES, BOXED, SINCE, BOX = range(9)


class Vector(IntEnum):
    """Rows of `vectors`.

    Sum of the box that fills, regressors and residual; regressors and y where the increment began, for an integral; sum of
    the regressors, of the run's where the equation is an integral; and three for the loops.
    """

    IN_BOX, MARK, TOTAL, VALUE, DETAIL, ROW = range(6)


class Octave(IntEnum):
    """Columns of `octaves`: inputs of its filters; coefficients; squares of the residuals' and of the fit's to increments."""

    SEEN, COUNT, OF_FIT, OF_INCREMENTS = range(4)


class Run(IntEnum):
    """In `energy`: of this run, and of those before it."""

    THIS, CLOSED = range(2)


class Noise(IntEnum):
    """In `found`: for stationary noise, and for uneven noise."""

    STATIONARY, UNEVEN = range(2)


class LongRunState(NamedTuple):
    """What has been seen of regressors and residuals, for n unknowns. A few large arrays, for each costs time to compile.

    Attributes
    ----------
    sums, vectors : shapes (9,) and (6, n + 2), see `Sum` and `Vector`
    Rp : shape (n, n + 1), triangular factor and data vector of the fit to slow increments
    octaves : shape (OCTAVES, 4), see `Octave`
    rings : shape (OCTAVES, 8, n + 2), the last inputs of each octave's filters: regressors and both residuals
    energy : shape (2, OCTAVES + 1, n, n), of the regressors' coefficients, and of all boxes
    scores : shape (BATCH_LENGTHS, n + 1), of the batches in progress, and how many are complete
    products : shape (BATCH_LENGTHS, n, n), the sums of the squares of those
    found : shape (2, n, n), covariance of the score; NaN and zero while not known
    """

    sums: Array
    vectors: Array
    Rp: Array
    octaves: Array
    rings: Array
    energy: Array
    scores: Array
    products: Array
    found: Array

    @property
    def samples(self) -> float:
        """Number of residuals seen."""
        return float(self.sums[Sum.SAMPLES])

    def copied(self) -> LongRunState:
        """Return an independent copy."""
        return LongRunState(*(part.copy() for part in self))


def long_run_start(size: int, box: int = BOX) -> LongRunState:
    """Return the state before the first sample, for n = `size` unknowns and so many samples in a box."""
    n = size
    return LongRunState(
        sums=np.append(np.zeros(Sum.BOX), float(box)),
        vectors=np.zeros((6, n + 2)),
        Rp=np.zeros((n, n + 1)),
        octaves=np.zeros((OCTAVES, 4)),
        rings=np.zeros((OCTAVES, _TAPS, n + 2)),
        energy=np.zeros((2, OCTAVES + 1, n, n)),
        scores=np.zeros((BATCH_LENGTHS, n + 1)),
        products=np.zeros((BATCH_LENGTHS, n, n)),
        found=np.stack((np.full((n, n), np.nan), np.zeros((n, n)))),
    )


def long_run_block(
    state: LongRunState,
    F: Array,
    y: Array,
    residual: Array,
    use: Flags,
    fresh: Flags,
    T: Array,
    integral: bool,
    forgetting: float,
    least: float = FEWEST_SAMPLES,
) -> tuple[LongRunState, Array]:
    """Observe the residuals of a fit, and return what they make of functionals of the unknowns.

    Parameters
    ----------
    state : of `long_run_start` or a previous call
    F, y : shapes (N, n) and (N,), regressors and what they shall add up to
    residual : shape (N,), recursive residuals
    use : shape (N,), samples that were learnt from
    fresh : shape (N,), samples at which an integral, and its constant, the first unknown, begin again
    T : shape (N, q, n), P E of functionals E
    integral : whether the equation is an integral
    forgetting : λ; a sample's part in P was discounted by λ² a step
    least : samples without which nothing is said

    Returns
    -------
    state, and shape (N, q): variances Tᵀ cov(Σ F e) T; NaN while not known
    """
    new, variances = state.copied(), np.empty(T.shape[:2])
    _run(F, y, residual, use, fresh, T, integral, forgetting**2, least, variances, *new)
    return new, variances


def long_run_covariance(
    state: LongRunState, integral: bool, least: float = FEWEST_SAMPLES
) -> tuple[Array, Array, float]:
    """Return the covariance of the score for stationary and for uneven noise, shape (n, n), and the variance of a residual.

    NaN while not known; of fewer than `least` samples nothing is. `integral` as for `long_run_block`.
    """
    new = state.copied()
    if state.samples >= least:
        _look(integral, new.sums, new.vectors, new.octaves, new.energy, new.scores, new.products, new.found)
    samples, squares = state.sums[[Sum.SAMPLES, Sum.SQUARES]]
    return new.found[Noise.STATIONARY], new.found[Noise.UNEVEN], float(squares / samples) if samples else float("nan")


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    F: Array, y: Array, residual: Array, use: Flags, fresh: Flags, T: Array, integral: bool, discount: float, least: float,
    out: Array, sums: Array, vectors: Array, Rp: Array, octaves: Array, rings: Array, energy: Array, scores: Array,
    products: Array, found: Array,
) -> None:  # fmt: skip
    count, asked, n = T.shape
    kept = discount ** (2.0 * sums[Sum.BOX])
    for k in range(count):
        e = residual[k]
        if use[k] and not np.isnan(e):
            step = e
            if integral:
                step = e - sums[Sum.LAST]
                if fresh[k] or sums[Sum.SAMPLES] == 0.0:
                    _close(F, y, k, sums, vectors, octaves, energy)
                    step = 0.0
                sums[Sum.LAST] = e
                sums[Sum.SINCE] += 1.0
            for i in range(n):
                vectors[Vector.TOTAL, i] = discount * vectors[Vector.TOTAL, i] + F[k, i]
                vectors[Vector.IN_BOX, i] += vectors[Vector.TOTAL, i] if integral else F[k, i]
            vectors[Vector.IN_BOX, n] += step
            sums[Sum.FILLED] += 1.0
            sums[Sum.SAMPLES] += 1.0
            sums[Sum.TOTAL] += e
            sums[Sum.SQUARES] += e * e
            if sums[Sum.FILLED] == sums[Sum.BOX]:
                sums[Sum.FILLED] = 0.0
                _end_batches(kept, scores, products)
                _transform(F, y, k, integral, kept, sums, vectors, Rp, octaves, rings, energy, scores)
            if sums[Sum.SAMPLES] % EVERY == 0.0 and sums[Sum.SAMPLES] >= least:
                _look(integral, sums, vectors, octaves, energy, scores, products, found)
        for m in range(asked):
            variance, other = 0.0, 0.0
            for i in range(n):
                a, b = 0.0, 0.0
                for j in range(n):
                    a += found[Noise.STATIONARY, i, j] * T[k, m, j]
                    b += found[Noise.UNEVEN, i, j] * T[k, m, j]
                variance += a * T[k, m, i]
                other += b * T[k, m, i]
            # Below zero is what rounding makes of what nothing tells.
            if not variance >= 0.0:
                variance = np.nan
            out[k, m] = other if other > SURELY_UNEVEN * variance else variance


@njit(cache=True, error_model="numpy", nogil=True)
def _transform(
    F: Array, y: Array, k: int, integral: bool, kept: float, sums: Array, vectors: Array, Rp: Array, octaves: Array, rings: Array,
    energy: Array, scores: Array,
) -> None:  # fmt: skip
    """Hand a full box on, from octave to octave; it is empty then."""
    n = F.shape[1]
    vectors[Vector.VALUE, n + 1] = 0.0
    for i in range(n + 1):
        vectors[Vector.VALUE, i] = vectors[Vector.IN_BOX, i] / np.sqrt(sums[Sum.BOX])
        vectors[Vector.IN_BOX, i] = 0.0
    if kept != 1.0:
        for octave in range(OCTAVES + 1):
            for i in range(n):
                for j in range(n):
                    energy[Run.THIS, octave, i, j] *= kept
                    energy[Run.CLOSED, octave, i, j] *= kept
    sums[Sum.BOXES] += 1.0
    sums[Sum.BOXED] += vectors[Vector.VALUE, n] ** 2
    for i in range(n):
        for j in range(n):
            energy[Run.THIS, OCTAVES, i, j] += vectors[Vector.VALUE, i] * vectors[Vector.VALUE, j]
    for octave in range(OCTAVES):
        last = int(octaves[octave, Octave.SEEN])
        if octave == SLOW_OCTAVE and integral:
            vectors[Vector.VALUE, n + 1] = _increment(F, y, k, kept ** (2**SLOW_OCTAVE), sums, vectors, Rp)
        for i in range(n + 2):
            rings[octave, last % _TAPS, i] = vectors[Vector.VALUE, i]
        octaves[octave, Octave.SEEN] += 1.0
        if last + 1 < _TAPS or (last + 1) % 2:
            return
        for i in range(n + 2):
            low, high = 0.0, 0.0
            for tap in range(_TAPS):
                x = rings[octave, (last + 1 + tap) % _TAPS, i]
                low += _LOW[tap] * x
                high += _HIGH[tap] * x
            vectors[Vector.VALUE, i], vectors[Vector.DETAIL, i] = low, high
        octaves[octave, Octave.COUNT] += 1.0
        octaves[octave, Octave.OF_FIT] += vectors[Vector.DETAIL, n] ** 2
        octaves[octave, Octave.OF_INCREMENTS] += vectors[Vector.DETAIL, n + 1] ** 2
        for i in range(n):
            scores[0, i] += vectors[Vector.DETAIL, n] * vectors[Vector.DETAIL, i]
            for j in range(n):
                energy[Run.THIS, octave, i, j] += vectors[Vector.DETAIL, i] * vectors[Vector.DETAIL, j]


@njit(cache=True, error_model="numpy", nogil=True)
def _end_batches(kept: float, scores: Array, products: Array) -> None:
    """End the batches that end with a box; in the next one what was before counts `kept` of what it did, squared."""
    n = products.shape[1]
    boxes = int(scores[0, n]) + 1
    for length in range(BATCH_LENGTHS):
        if boxes % (1 << length):
            break
        scores[length, n] += 1.0
        for i in range(n):
            for j in range(n):
                products[length, i, j] += scores[length, i] * scores[length, j]
        for i in range(n):
            if length + 1 < BATCH_LENGTHS:
                scores[length + 1, i] += scores[length, i]
            scores[length, i] = 0.0
    if kept != 1.0:
        for length in range(BATCH_LENGTHS):
            for i in range(n):
                scores[length, i] *= np.sqrt(kept)
                for j in range(n):
                    products[length, i, j] *= kept


@njit(cache=True, error_model="numpy", nogil=True)
def _increment(F: Array, y: Array, k: int, kept: float, sums: Array, vectors: Array, Rp: Array) -> float:
    """Rotate what changed since the last call into the fit to increments, and return its recursive residual."""
    n, size = F.shape[1], np.sqrt(sums[Sum.SINCE])
    sums[Sum.SINCE] = 0.0
    for i in range(n + 1):
        now = F[k, i] if i < n else y[k]
        vectors[Vector.ROW, i] = (now - vectors[Vector.MARK, i]) / size
        vectors[Vector.MARK, i] = now
    for i in range(n):
        for j in range(i, n + 1):
            Rp[i, j] *= np.sqrt(kept)
        x = vectors[Vector.ROW, i]
        if x == 0.0:  # as the constant's
            continue
        h = np.hypot(Rp[i, i], x)
        cos, sin = Rp[i, i] / h, x / h
        for j in range(i, n + 1):
            a, b = Rp[i, j], vectors[Vector.ROW, j]
            Rp[i, j] = cos * a + sin * b
            vectors[Vector.ROW, j] = cos * b - sin * a
    return float(vectors[Vector.ROW, n])


@njit(cache=True, error_model="numpy", nogil=True)
def _close(F: Array, y: Array, k: int, sums: Array, vectors: Array, octaves: Array, energy: Array) -> None:
    """End a run, and begin the next: the noise of an integral does not go on into it."""
    n = F.shape[1]
    for octave in range(OCTAVES + 1):
        if vectors[Vector.TOTAL, 0] != 0.0:
            for i in range(n):
                for j in range(n):
                    energy[Run.CLOSED, octave, i, j] += _centred(energy, vectors, octave, i, j)
        for i in range(n):
            for j in range(n):
                energy[Run.THIS, octave, i, j] = 0.0
    for octave in range(OCTAVES):
        octaves[octave, Octave.SEEN] = 0.0
    for i in range(n):
        vectors[Vector.TOTAL, i] = vectors[Vector.IN_BOX, i] = 0.0
        vectors[Vector.MARK, i] = F[k, i]
    vectors[Vector.IN_BOX, n] = sums[Sum.FILLED] = sums[Sum.SINCE] = 0.0
    vectors[Vector.MARK, n] = y[k]


@njit(cache=True, error_model="numpy", nogil=True)
def _centred(energy: Array, vectors: Array, octave: int, i: int, j: int) -> float:
    """Return an energy of sums of regressors less their mean; the first, which is one, counts the samples."""
    a, b = vectors[Vector.TOTAL, i] / vectors[Vector.TOTAL, 0], vectors[Vector.TOTAL, j] / vectors[Vector.TOTAL, 0]
    off = a * energy[Run.THIS, octave, 0, j] + b * energy[Run.THIS, octave, i, 0]
    return float(energy[Run.THIS, octave, i, j] - off + a * b * energy[Run.THIS, octave, 0, 0])


@njit(cache=True, error_model="numpy", nogil=True)
def _look(
    integral: bool,
    sums: Array,
    vectors: Array,
    octaves: Array,
    energy: Array,
    scores: Array,
    products: Array,
    found: Array,
) -> None:
    """Put together what is known of the score."""
    n, v = products.shape[1], np.empty(OCTAVES + 1)
    enough = -1
    for length in range(BATCH_LENGTHS):
        if scores[length, n] >= ENOUGH_BATCHES:
            enough = length
    # The variance of the residuals in each octave and beyond the last.
    last, slope = np.log(max(sums[Sum.BOXED] / sums[Sum.BOXES], NO_VARIANCE)), 0.0
    for octave in range(OCTAVES + 1):
        now = last + 0.5 * slope
        if octave < OCTAVES and octaves[octave, Octave.OF_FIT] > 0.0:
            count, squares = octaves[octave, Octave.COUNT], octaves[octave, Octave.OF_FIT]
            if integral and octave >= SLOW_OCTAVE:
                squares = max(min(squares, octaves[octave, Octave.OF_INCREMENTS]), NO_VARIANCE)
            now = (count * np.log(squares / count) + TAILS + EXPECTED * now) / (count + EXPECTED)
        slope = min(max(now - last, STEEPEST_FALL), STEEPEST_RISE) if octave else 0.0
        last = now
        v[octave] = np.exp(now)
    # Regressors fall with frequency: what they have in an octave lies at its lower edge, where noise that goes with f^p, as the
    # octave below tells, has (p + 1)/(2^(p + 1) − 1) of its mean over the octave.
    for octave in range(OCTAVES):
        p = min(max(np.log2(v[octave] / v[octave + 1]), -STEEPEST_POWER), STEEPEST_POWER)
        v[octave] *= (p + 1.0) / np.expm1((p + 1.0) * np.log(2.0)) if p != -1.0 else 1.0 / np.log(2.0)
    mean = 0.0 if integral else sums[Sum.TOTAL] / sums[Sum.SAMPLES]
    for i in range(n):
        for j in range(n):
            found[Noise.UNEVEN, i, j] = products[enough, i, j] if enough >= 0 else 0.0
            covariance = mean * mean * vectors[Vector.TOTAL, i] * vectors[Vector.TOTAL, j]
            for octave in range(OCTAVES + 1):
                # What is in no octave lies beyond the last.
                share = v[octave] if octave == OCTAVES else v[octave] - v[OCTAVES]
                own = energy[Run.THIS, octave, i, j]
                if integral:
                    own = _centred(energy, vectors, octave, i, j) + energy[Run.CLOSED, octave, i, j]
                covariance += share * own
            found[Noise.STATIONARY, i, j] = covariance
