"""The long-run (HAC) covariance of a fit's score: the effect of coloured and non-stationary residuals on the unknowns.

Least squares err by P Σ F e: the sum of the regressors times the noise, the *score*. Residuals are not white: filters smooth
them, an encoder's noise differentiated twice is far above the motion, a torque's noise integrated is a random walk, and a
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
have a fit of their own too, to which they are nearly white; its residual is larger where a velocity changes by little more than
its own noise. The smaller of the two counts.

No octave contains a constant, such as an offset that the basis cannot follow: the mean of the residuals meets the sum of the
regressors.

That assumes stationary noise. Where noise comes together with the motion, as the error of too few samples in a jerk between long
rests, its average over the rests does not describe it. So the products of coefficients, the residuals' times the regressors', are
also summed batch by batch. Batches that are longer than noise lasts are independent, and the squares of their sums add up to
the score's covariance, however the noise changes from one to the next. That is less certain, for it rests on the few batches in
which much happens: it counts where it is more than chance would make of stationary noise (White, Econometrica 48(4), 1980; of
batches: Liang and Zeger, Biometrika 73(1), 1986). Products of wavelets' coefficients, unlike those of samples, have no ends of
batches in them, at which noise that was differentiated would seem larger than it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.significance import FALSE_ALARM, variance_ratio

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Samples summed to one value before the wavelet transform, at least: no joint moves within so few. Number of octaves, and of
# batch lengths, each twice the one before.
BOX, OCTAVES = 4, 14
# Prior of an octave's log variance, extrapolated from the octaves before it with half their slope: its weight in wavelet
# coefficients. And the correction of an estimate from few coefficients, in coefficients: the mean of a logarithm is too small by
# one over their number, and a ratio to an estimated variance has the larger variance of Student's t, two more.
COEFFICIENTS_OF_EXPECTATION, COEFFICIENTS_OF_TAILS = 8.0, 3.0
# No power of the frequency is beyond this [1]: what was differentiated twice has 4. And no variance is expected to rise towards
# slow octaves by a higher power than this [1]: flicker noise has 1.
STEEPEST_POWER, STEEPEST_RISE = 4.0, 1.0
# Batches, or coefficients of an octave, that give a variance to 25 %.
ENOUGH_BATCHES = 32
# Ratio of the batches' variance to that of stationary noise, from which on noise is not stationary.
CLEARLY_NONSTATIONARY = variance_ratio(FALSE_ALARM, ENOUGH_BATCHES)

# Scaling filter of Daubechies' wavelet with four vanishing moments (Ten Lectures on Wavelets, table 6.1).
_LOW = np.array([
    0.230377813308855, 0.714846570552542, 0.630880767929590, -0.027983769416984,
    -0.187034811718881, 0.030841381835987, 0.032883011666983, -0.010597401784997,
])  # fmt: skip
_HIGH = _LOW[::-1] * np.array([1.0, -1.0] * 4)
_TAPS = _LOW.size

# From this octave on increments have a fit of their own.
SLOW_OCTAVE = 4


def samples_until_known() -> int:
    """Return the number of samples from which on a covariance is given: the fastest octave has a coefficient every two boxes."""
    return 2 * BOX * ENOUGH_BATCHES


def look_interval() -> int:
    """Return the samples between two updates of the covariance: the slow octaves have a new coefficient as often."""
    return BOX << SLOW_OCTAVE


FEWEST_SAMPLES = samples_until_known()


class Sum(IntEnum):
    """In `sums`: samples in the box, last residual, samples, Σ e, Σ e², boxes, Σ box², samples in the increment, in a box."""

    FILLED, LAST, SAMPLES, TOTAL, SQUARES, BOXES, BOXED, SINCE, BOX = range(9)


class Vector(IntEnum):
    """Rows of `vectors`.

    Sum of the box that fills, regressors and residual; regressors and y where the increment began, for an integral; sum of
    the regressors, of the run's where the equation is an integral; and four for the loops: an octave's input, its output, what
    changed, and the mean of the run's sums of regressors where the equation is an integral.
    """

    IN_BOX, MARK, TOTAL, VALUE, DETAIL, ROW, MEAN = range(7)


class Octave(IntEnum):
    """Columns of `octaves`, the last row of which is for the rest beyond.

    Inputs of its filters; coefficients; squares of the residuals' and of the fit's to increments; variance found.
    """

    SEEN, COUNT, OF_FIT, OF_INCREMENTS, VARIANCE = range(5)


class Run(IntEnum):
    """In `energy`: of this run, and of those before it."""

    THIS, CLOSED = range(2)


class Noise(IntEnum):
    """In `found`: for stationary noise, and for non-stationary noise."""

    STATIONARY, NONSTATIONARY = range(2)


class LongRunState(NamedTuple):
    """The statistics of regressors and residuals, for n unknowns. A few large arrays, for each costs time to compile.

    Attributes
    ----------
    sums, vectors : shapes (9,) and (7, n + 2), see `Sum` and `Vector`
    Rp : shape (n, n + 1), triangular factor and data vector of the fit to slow increments
    octaves : shape (OCTAVES + 1, 5), see `Octave`
    rings : shape (OCTAVES, 8, n + 2), the last inputs of each octave's filters: regressors and both residuals
    energy : shape (2, OCTAVES + 1, n, n), of the regressors' coefficients, and of all boxes
    scores : shape (OCTAVES, n + 1), of the batches in progress, and how many are complete
    products : shape (OCTAVES, n, n), the sums of the squares of those
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
    """Return the state before the first sample, for n = `size` unknowns and `box` samples in a box."""
    n = size
    return LongRunState(
        sums=np.append(np.zeros(Sum.BOX), float(box)),
        vectors=np.zeros((len(Vector), n + 2)),
        Rp=np.zeros((n, n + 1)),
        octaves=np.zeros((OCTAVES + 1, len(Octave))),
        rings=np.zeros((OCTAVES, _TAPS, n + 2)),
        energy=np.zeros((2, OCTAVES + 1, n, n)),
        scores=np.zeros((OCTAVES, n + 1)),
        products=np.zeros((OCTAVES, n, n)),
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
    """Observe the residuals of a fit, and return their effect on functionals of the unknowns.

    Parameters
    ----------
    state : of `long_run_start` or a previous call
    F, y : shapes (N, n) and (N,), regressors and what they shall add up to
    residual : shape (N,), recursive residuals
    use : shape (N,), samples that were used
    fresh : shape (N,), samples at which an integral, and its constant, the first unknown, begin again
    T : shape (N, q, n), P E of functionals E
    integral : whether the equation is an integral
    forgetting : λ; a sample's part in P was discounted by λ² a step
    least : samples below which nothing is reported

    Returns
    -------
    state, and shape (N, q): variances Tᵀ cov(Σ F e) T; NaN while not known
    """
    new, variances = state.copied(), np.empty(T.shape[:2])
    told, since = _observe(new, F, y, residual, use, fresh, integral, forgetting**2, least)
    _variances(T, told, since, CLEARLY_NONSTATIONARY, np.empty((4 + T.shape[2], look_interval())), variances)
    return new, variances


def long_run_covariance(
    state: LongRunState, integral: bool, least: float = FEWEST_SAMPLES
) -> tuple[Array, Array, float]:
    """Return the score's covariance for stationary and for non-stationary noise, shape (n, n), and a residual's variance.

    NaN while not known; of fewer than `least` samples nothing is. `integral` as for `long_run_block`.
    """
    new = state.copied()
    if state.samples >= least:
        none, n = np.empty(0), state.Rp.shape[0]
        flags = np.empty(0, dtype=np.bool_)
        _observe(new, np.empty((0, n)), none, none, flags, flags, integral, 1.0, least, look=True)
    samples, squares = state.sums[[Sum.SAMPLES, Sum.SQUARES]]
    return (
        new.found[Noise.STATIONARY],
        new.found[Noise.NONSTATIONARY],
        float(squares / samples) if samples else float("nan"),
    )


def _observe(
    state: LongRunState, F: Array, y: Array, residual: Array, use: Flags, fresh: Flags, integral: bool, discount: float,
    least: float, look: bool = False,
) -> tuple[Array, NDArray[np.int64]]:  # fmt: skip
    """Change the state as `long_run_block` does, and look once more at the end where asked to.

    Returns the covariance of the score at the beginning and at each look, shape (looks + 1, 2, n, n), and from which sample on.
    """
    most = F.shape[0] // look_interval() + 3
    told, since = np.empty((most, *state.found.shape)), np.zeros(most, dtype=np.int64)
    told[0] = state.found
    kept = float(discount ** (2.0 * state.sums[Sum.BOX]))
    run = _loop(integral, discount != 1.0)
    looks = run(F, y, residual, use, fresh, discount, kept, float(least), look, told, since, *state[:-1])
    state.found[:] = told[looks]
    return told[: looks + 1], since[: looks + 1]


@compiled
def _variances(T: Array, told: Array, since: NDArray[np.int64], clearly: float, work: Array, out: Array) -> None:
    """Fill `out` with Tᵀ M T of the M that was known last: many samples side by side, of which each has its own sum."""
    n, stationary, changing, stationary_row, changing_row = T.shape[2], work[0], work[1], work[2], work[3]
    for look in range(since.size):
        end = since[look + 1] if look + 1 < since.size else out.shape[0]
        for begin in range(since[look], end, stationary.size):
            width = min(end - begin, stationary.size)
            for m in range(out.shape[1]):
                for r in range(width):
                    stationary[r] = changing[r] = 0.0
                    for i in range(n):
                        work[4 + i, r] = T[begin + r, m, i]
                for i in range(n):
                    for r in range(width):
                        stationary_row[r] = changing_row[r] = 0.0
                    for j in range(i, n):
                        # Elements off the diagonal count twice.
                        a, b = told[look, Noise.STATIONARY, i, j], told[look, Noise.NONSTATIONARY, i, j]
                        times = 1.0 if j == i else 2.0
                        for r in range(width):
                            stationary_row[r] += times * a * work[4 + j, r]
                            changing_row[r] += times * b * work[4 + j, r]
                    for r in range(width):
                        stationary[r] += stationary_row[r] * work[4 + i, r]
                        changing[r] += changing_row[r] * work[4 + i, r]
                for r in range(width):
                    # Rounding makes a variance without data negative.
                    variance = stationary[r] if stationary[r] >= 0.0 else math.nan
                    out[begin + r, m] = changing[r] if changing[r] > clearly * variance else variance


@cache
def _loop(integral: bool, forgets: bool) -> Callable[..., int]:
    """Return the loop over samples, compiled for what it is used for: the rest is left out."""

    @compiled
    def run(
        F: Array, y: Array, residual: Array, use: Flags, fresh: Flags, discount: float, kept: float, least: float, look: bool,
        told: Array, since: NDArray[np.int64], sums: Array, vectors: Array, Rp: Array, octaves: Array, rings: Array,
        energy: Array, scores: Array, products: Array,
    ) -> int:  # fmt: skip
        """Go through a block; returns how often was looked. One function, since what it called would be compiled twice."""
        count, n = F.shape
        in_box, mark, total = vectors[Vector.IN_BOX], vectors[Vector.MARK], vectors[Vector.TOTAL]
        value, detail = vectors[Vector.VALUE], vectors[Vector.DETAIL]
        row, mean = vectors[Vector.ROW], vectors[Vector.MEAN]
        this, closed = energy[Run.THIS], energy[Run.CLOSED]
        looks = 0
        # In place of a variance of zero, which has no logarithm.
        nothing = np.finfo(np.float64).tiny
        # As `look_interval`, which compiled code cannot call.
        every = BOX << SLOW_OCTAVE
        fall, rise = -STEEPEST_POWER * math.log(2.0), STEEPEST_RISE * math.log(2.0)
        for k in range(count + 1):
            due = look and k == count
            if k < count and use[k] and not math.isnan(residual[k]):
                step = residual[k]
                if integral:
                    step -= sums[Sum.LAST]
                    if fresh[k] or sums[Sum.SAMPLES] == 0.0:
                        # A run ends, and the next begins: the noise of an integral does not go on into it.
                        step = 0.0
                        # Regressors are summed up, less their mean; the first, which is one, counts the samples.
                        for i in range(n):
                            mean[i] = total[i] / total[0] if total[0] != 0.0 else 0.0
                        for octave in range(this.shape[0]):
                            for i in range(n):
                                for j in range(n):
                                    a, b = mean[i], mean[j]
                                    off = a * this[octave, 0, j] + b * this[octave, i, 0]
                                    off -= a * b * this[octave, 0, 0]
                                    closed[octave, i, j] += this[octave, i, j] - off
                            for i in range(n):
                                for j in range(n):
                                    this[octave, i, j] = 0.0
                        for octave in range(rings.shape[0]):
                            octaves[octave, Octave.SEEN] = 0.0
                        for i in range(n):
                            total[i] = in_box[i] = 0.0
                            mark[i] = F[k, i]
                        in_box[n] = sums[Sum.FILLED] = sums[Sum.SINCE] = 0.0
                        mark[n] = y[k]
                    sums[Sum.LAST] = residual[k]
                    sums[Sum.SINCE] += 1.0
                for i in range(n):
                    total[i] = discount * total[i] + F[k, i]
                    in_box[i] += total[i] if integral else F[k, i]
                in_box[n] += step
                sums[Sum.FILLED] += 1.0
                sums[Sum.SAMPLES] += 1.0
                sums[Sum.TOTAL] += residual[k]
                sums[Sum.SQUARES] += residual[k] * residual[k]
                if sums[Sum.FILLED] == sums[Sum.BOX]:
                    # The box is full: the batches end that end with it; earlier data count less in those that follow.
                    sums[Sum.FILLED] = 0.0
                    boxes = int(scores[0, n]) + 1
                    for length in range(scores.shape[0]):
                        if boxes % (1 << length):
                            break
                        scores[length, n] += 1.0
                        for i in range(n):
                            for j in range(n):
                                products[length, i, j] += scores[length, i] * scores[length, j]
                        for i in range(n):
                            if length + 1 < scores.shape[0]:
                                scores[length + 1, i] += scores[length, i]
                            scores[length, i] = 0.0
                    if forgets:
                        for length in range(scores.shape[0]):
                            for i in range(n):
                                scores[length, i] *= math.sqrt(kept)
                                for j in range(n):
                                    products[length, i, j] *= kept
                        for octave in range(this.shape[0]):
                            for i in range(n):
                                for j in range(n):
                                    this[octave, i, j] *= kept
                                    closed[octave, i, j] *= kept
                    # It is passed on from octave to octave, and empty then.
                    for i in range(n + 1):
                        value[i] = in_box[i] / math.sqrt(sums[Sum.BOX])
                        in_box[i] = 0.0
                    value[n + 1] = 0.0
                    sums[Sum.BOXES] += 1.0
                    sums[Sum.BOXED] += value[n] ** 2
                    for i in range(n):
                        for j in range(n):
                            this[OCTAVES, i, j] += value[i] * value[j]
                    for octave in range(rings.shape[0]):
                        seen = int(octaves[octave, Octave.SEEN]) + 1
                        octaves[octave, Octave.SEEN] += 1.0
                        if octave == SLOW_OCTAVE and integral:
                            # The change since the last time is rotated into the fit to increments, and leaves its residual.
                            size = math.sqrt(sums[Sum.SINCE])
                            sums[Sum.SINCE] = 0.0
                            for i in range(n + 1):
                                now = F[k, i] if i < n else y[k]
                                row[i] = (now - mark[i]) / size
                                mark[i] = now
                            for i in range(n):
                                for j in range(i, n + 1):
                                    Rp[i, j] *= kept ** (1 << (SLOW_OCTAVE - 1))
                                x = row[i]
                                if x == 0.0:  # as the constant's
                                    continue
                                h = math.sqrt(Rp[i, i] * Rp[i, i] + x * x)
                                cos, sin = Rp[i, i] / h, x / h
                                for j in range(i, n + 1):
                                    a, b = Rp[i, j], row[j]
                                    Rp[i, j] = cos * a + sin * b
                                    row[j] = cos * b - sin * a
                            value[n + 1] = row[n]
                        for i in range(n + 2):
                            rings[octave, (seen - 1) % _TAPS, i] = value[i]
                            value[i] = detail[i] = 0.0
                        if seen < _TAPS or seen % 2:
                            break
                        for tap in range(rings.shape[1]):
                            at, low, high = (seen + tap) % _TAPS, _LOW[tap], _HIGH[tap]
                            for i in range(n + 2):
                                value[i] += low * rings[octave, at, i]
                                detail[i] += high * rings[octave, at, i]
                        octaves[octave, Octave.COUNT] += 1.0
                        octaves[octave, Octave.OF_FIT] += detail[n] ** 2
                        octaves[octave, Octave.OF_INCREMENTS] += detail[n + 1] ** 2
                        for i in range(n):
                            scores[0, i] += detail[n] * detail[i]
                            for j in range(n):
                                this[octave, i, j] += detail[i] * detail[j]
                due = int(sums[Sum.SAMPLES]) % every == 0 and sums[Sum.SAMPLES] >= least
            if due:
                # The score's covariance is assembled.
                enough = -1
                for length in range(scores.shape[0]):
                    if scores[length, n] >= ENOUGH_BATCHES:
                        enough = length
                # The variance of the residuals in each octave and beyond the last.
                last, slope = math.log(max(sums[Sum.BOXED] / sums[Sum.BOXES], nothing)), 0.0
                for octave in range(this.shape[0]):
                    now = last + 0.5 * slope
                    if octaves[octave, Octave.OF_FIT] > 0.0:
                        coefficients, squares = octaves[octave, Octave.COUNT], octaves[octave, Octave.OF_FIT]
                        if integral and octave >= SLOW_OCTAVE:
                            squares = max(min(squares, octaves[octave, Octave.OF_INCREMENTS]), nothing)
                        of_octave = coefficients * math.log(squares / coefficients)
                        now = (of_octave + COEFFICIENTS_OF_TAILS + COEFFICIENTS_OF_EXPECTATION * now) / (
                            coefficients + COEFFICIENTS_OF_EXPECTATION
                        )
                    slope = min(max(now - last, fall), rise) if octave else 0.0
                    last = now
                    octaves[octave, Octave.VARIANCE] = math.exp(now)
                # Regressors fall with frequency: their energy in an octave is at its lower edge, where noise that goes with
                # f^p, as in the octave below, has (p + 1)/(2^(p + 1) − 1) of its mean over the octave.
                beyond = octaves[OCTAVES, Octave.VARIANCE]
                for octave in range(rings.shape[0]):
                    power = math.log2(octaves[octave, Octave.VARIANCE] / octaves[octave + 1, Octave.VARIANCE])
                    p = min(max(power, -STEEPEST_POWER), STEEPEST_POWER) + 1.0
                    part = p / math.expm1(p * math.log(2.0)) if p != 0.0 else 1.0 / math.log(2.0)
                    # The rest is beyond the last octave.
                    octaves[octave, Octave.VARIANCE] = octaves[octave, Octave.VARIANCE] * part - beyond
                level = 0.0 if integral else sums[Sum.TOTAL] / sums[Sum.SAMPLES]
                looks += 1
                since[looks] = k
                for i in range(n):
                    if integral:
                        mean[i] = total[i] / total[0]
                    for j in range(n):
                        told[looks, Noise.NONSTATIONARY, i, j] = products[enough, i, j] if enough >= 0 else 0.0
                        told[looks, Noise.STATIONARY, i, j] = level * total[i] * (level * total[j])
                for octave in range(this.shape[0]):
                    share = octaves[octave, Octave.VARIANCE]
                    for i in range(n):
                        for j in range(n):
                            own = this[octave, i, j]
                            if integral:
                                a, b = mean[i], mean[j]
                                off = a * this[octave, 0, j] + b * this[octave, i, 0]
                                off -= a * b * this[octave, 0, 0]
                                own += closed[octave, i, j] - off
                            told[looks, Noise.STATIONARY, i, j] += share * own

        return looks

    return run
