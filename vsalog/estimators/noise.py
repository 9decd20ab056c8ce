"""The noise in what a fit leaves over, octave by octave, and what it makes of the unknowns.

Least squares err by P Σ F e: the sum of the regressors times the noise, the *score*. Left-over torques are not white: filters
smooth them, an encoder's noise differentiated twice lies far above the motion, a torque's noise integrated wanders, and a model
that does not fit leaves a slow pattern. Counting samples as if they were independent is wrong by factors either way. So
regressors and left-overs go through one orthonormal wavelet transform, and in each octave of frequency the variance of the
left-overs meets the energy of the regressors there:

    cov(Σ F e) = Σ_octaves v W Wᵀ

Wavelet coefficients of coloured noise are nearly uncorrelated, which is what makes the sum right (Fadili and Bullmore, "Wavelet-
generalized least squares", NeuroImage 15, 2002; Daubechies' wavelet with four vanishing moments). Left-overs are *recursive
residuals*, the innovations over their own standard deviation for noise of variance one: a fit does not make them smaller
(Brown, Durbin, Evans, J. R. Stat. Soc. B 37(2), 1975).

Where the equation is an integral its noise wanders, and no octave is the last one: there its increments are looked at, with
sums of the regressors in their place (summation by parts), less each run's mean, which its integration constant takes up. A fit
follows the wandering, so that what it leaves over changes more, slowly, than the noise does. In the slow octaves increments
therefore have a fit of their own too, to which they are nearly white; it leaves more over where a velocity changes by little more
than its own noise. The smaller of the two counts.

No octave has what never changes, as an offset that the basis cannot follow: the mean of the left-overs meets the sum of the
regressors.

That takes noise for the same throughout; for noise that comes and goes see `uneven.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.estimators.uneven import SURELY, Stretches, add_product, end_box, stretches_start, uneven

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Samples that are summed first, at least: nothing moves within so few. Octaves that are looked at; samples between two looks.
BOX, OCTAVES, EVERY = 4, 14, 64
# Samples without which nothing is said.
SAMPLES = 256
# An octave's variance is expected to go on as those before it did, half as steeply, within these factors; the expectation counts
# as so many coefficients. A logarithm of a variance of few is too small by one over their number, and what is divided by it
# has the tails, and so the variance, of Student's t: two more.
FALL, RISE, EXPECTED, TAILS = np.log(1.0 / 8.0), np.log(2.0), 8.0, 3.0
# No power of the frequency is beyond this: what was differentiated twice has 4.
STEEPEST = 4.0
# A variance of nothing at all, whose logarithm is still a number.
NOTHING = 1e-300

# Scaling filter of Daubechies' wavelet with four vanishing moments (Ten Lectures on Wavelets, table 6.1).
_LOW = np.array([
    0.230377813308855, 0.714846570552542, 0.630880767929590, -0.027983769416984,
    -0.187034811718881, 0.030841381835987, 0.032883011666983, -0.010597401784997,
])  # fmt: skip
_HIGH = _LOW[::-1] * np.array([1.0, -1.0] * 4)
_TAPS = _LOW.size

# From this octave on increments have a fit of their own.
SLOW = 4

# In `sums`: samples in the box, last left-over, samples, Σ e, Σ e², boxes, Σ box², samples in the increment,
# samples in a whole box.
_FILLED, _LAST, _SAMPLES, _SUM, _SQUARES, _BOXES, _BOXED, _SINCE, _BOX = range(9)


class NoiseState(NamedTuple):
    """What has been seen of regressors and left-overs, for n unknowns.

    Attributes
    ----------
    sums : numbers, see above
    box : shape (n + 1,), sum of the box that fills: regressors and left-over
    mark : shape (n + 1,), regressors and y where the increment began, for an integral
    Rp : shape (n, n + 1), triangular factor and data vector of the fit to slow increments
    total : shape (n,), sum of the regressors; of the run's where the equation is an integral
    rings, seen : shapes (OCTAVES, 8, n + 2) and (OCTAVES,), the last inputs of each octave's filters (regressors, left-overs, and
        those of the fit to increments), and how many there were
    heard : shape (OCTAVES, 3), number of coefficients, squares of both left-overs'
    energy, closed : shape (OCTAVES + 1, n, n), of the regressors' coefficients, and of all boxes; of this run and of those before
    M : shape (n, n), covariance of the score for even noise; NaN while not known
    stretches : products of the regressors' and the left-overs' coefficients
    uneven : shape (n, n), covariance of the score for uneven noise; zero while not known
    """

    sums: Array
    box: Array
    mark: Array
    Rp: Array
    total: Array
    rings: Array
    seen: Integers
    heard: Array
    energy: Array
    closed: Array
    M: Array
    stretches: Stretches
    uneven: Array

    @property
    def samples(self) -> float:
        """Number of left-overs seen."""
        return float(self.sums[_SAMPLES])

    def copied(self) -> NoiseState:
        """Return an independent copy."""
        return NoiseState._make(a.copied() if isinstance(a, Stretches) else a.copy() for a in self)


def noise_start(size: int, box: int = BOX) -> NoiseState:
    """Return the state before the first sample, for n = `size` unknowns and so many samples in a box."""
    n, rows = size, OCTAVES + 1
    return NoiseState(
        sums=np.append(np.zeros(_BOX), float(box)),
        box=np.zeros(n + 1),
        mark=np.zeros(n + 1),
        Rp=np.zeros((n, n + 1)),
        total=np.zeros(n),
        rings=np.zeros((OCTAVES, _TAPS, n + 2)),
        seen=np.zeros(OCTAVES, dtype=np.int64),
        heard=np.zeros((OCTAVES, 3)),
        energy=np.zeros((rows, n, n)),
        closed=np.zeros((rows, n, n)),
        M=np.full((n, n), np.nan),
        stretches=stretches_start(n),
        uneven=np.zeros((n, n)),
    )


def noise_block(
    state: NoiseState,
    F: Array,
    y: Array,
    left: Array,
    use: Flags,
    fresh: Flags,
    T: Array,
    integral: bool,
    forgetting: float,
    least: float = SAMPLES,
) -> tuple[NoiseState, Array]:
    """Observe what a fit leaves over, and say what it makes of functionals of the unknowns.

    Parameters
    ----------
    state : of `noise_start` or a previous call
    F, y : shapes (N, n) and (N,), regressors and what they shall add up to
    left : shape (N,), recursive residuals
    use : shape (N,), samples that were learnt from
    fresh : shape (N,), samples at which an integral, and its constant, the first unknown, begin anew
    T : shape (N, q, n), P E of functionals E
    integral : whether the equation is an integral
    forgetting : λ; a sample's part in P was discounted by λ² a step
    least : samples without which nothing is said

    Returns
    -------
    state, and shape (N, q): variances Tᵀ cov(Σ F e) T; NaN while not known
    """
    new, variances = state.copied(), np.empty(T.shape[:2])
    _run(new, F, y, left, use, fresh, T, integral, forgetting**2, least, variances)
    return new, variances


def noise_now(state: NoiseState, integral: bool, least: float = SAMPLES) -> tuple[Array, Array, float]:
    """Return the covariance of the score for even and for uneven noise, shape (n, n), and the variance of a single left-over.

    NaN while not known; of fewer than `least` samples nothing is. `integral` as for `noise_block`.
    """
    new = state.copied()
    if state.samples >= least:
        _look(new, integral)
    samples, squares = state.sums[[_SAMPLES, _SQUARES]]
    return new.M, new.uneven, float(squares / samples) if samples else float("nan")


@njit(cache=True, error_model="numpy")
def _run(
    s: NoiseState,
    F: Array,
    y: Array,
    left: Array,
    use: Flags,
    fresh: Flags,
    T: Array,
    integral: bool,
    discount: float,
    least: float,
    out: Array,
) -> None:
    count, asked, n = T.shape
    sums, scratch = s.sums, np.empty((3, n + 2))
    kept = discount ** (2.0 * sums[_BOX])
    for k in range(count):
        if use[k] and not np.isnan(left[k]):
            begins = integral and (fresh[k] or sums[_SAMPLES] == 0.0)
            if begins:
                _close(s, F[k], y[k])
            _fill(s, F[k], left[k], integral, begins, discount)
            if sums[_FILLED] == sums[_BOX]:
                sums[_FILLED] = 0.0
                _transform(s, F[k], y[k], integral, kept, scratch)
            if sums[_SAMPLES] % EVERY == 0.0 and sums[_SAMPLES] >= least:
                _look(s, integral)
        for m in range(asked):
            variance, other = _form(s.M, T[k, m]), _form(s.uneven, T[k, m])
            # Below zero is what rounding makes of what nothing tells.
            if variance >= 0.0:
                out[k, m] = other if other > SURELY * variance else variance
            else:
                out[k, m] = np.nan


@njit(cache=True, error_model="numpy")
def _form(M: Array, t: Array) -> float:
    """Return tᵀ M t."""
    total = 0.0
    for i in range(t.shape[0]):
        row = 0.0
        for j in range(t.shape[0]):
            row += M[i, j] * t[j]
        total += t[i] * row
    return total


@njit(cache=True, error_model="numpy")
def _fill(s: NoiseState, F: Array, left: float, integral: bool, begins: bool, discount: float) -> None:
    """Put a sample into the box."""
    n, sums, total, step = F.shape[0], s.sums, s.total, left
    if integral:
        step = 0.0 if begins else left - sums[_LAST]
        sums[_LAST] = left
        sums[_SINCE] += 1.0
    for i in range(n):
        total[i] = discount * total[i] + F[i]
        s.box[i] += total[i] if integral else F[i]
    s.box[n] += step
    sums[_FILLED] += 1.0
    sums[_SAMPLES] += 1.0
    sums[_SUM] += left
    sums[_SQUARES] += left * left


@njit(cache=True, error_model="numpy")
def _increment(s: NoiseState, F: Array, y: float, kept: float, row: Array) -> float:
    """Rotate what changed since the last call into the fit to increments, and return its recursive residual."""
    n, Rp, size = F.shape[0], s.Rp, np.sqrt(s.sums[_SINCE])
    s.sums[_SINCE] = 0.0
    for i in range(n):
        row[i] = (F[i] - s.mark[i]) / size
        s.mark[i] = F[i]
    row[n] = (y - s.mark[n]) / size
    s.mark[n] = y
    for i in range(n):
        for j in range(i, n + 1):
            Rp[i, j] *= np.sqrt(kept)
        if row[i] == 0.0:  # as the constant's
            continue
        h = np.hypot(Rp[i, i], row[i])
        cos, sin = Rp[i, i] / h, row[i] / h
        for j in range(i, n + 1):
            a, b = Rp[i, j], row[j]
            Rp[i, j] = cos * a + sin * b
            row[j] = cos * b - sin * a
    return float(row[n])


@njit(cache=True, error_model="numpy")
def _transform(s: NoiseState, F: Array, y: float, integral: bool, kept: float, scratch: Array) -> None:
    """Hand a full box on, from octave to octave; it is empty then."""
    n = s.total.shape[0]
    value, detail = scratch[0], scratch[1]
    value[n + 1] = 0.0
    for i in range(n + 1):
        value[i] = s.box[i] / np.sqrt(s.sums[_BOX])
        s.box[i] = 0.0
    if kept != 1.0:
        _scale(s.energy, kept)
        _scale(s.closed, kept)
    s.sums[_BOXES] += 1.0
    s.sums[_BOXED] += value[n] ** 2
    _add(value, s.energy, OCTAVES)
    end_box(s.stretches, kept)
    for octave in range(OCTAVES):
        last = s.seen[octave]
        if octave == SLOW and integral:
            value[n + 1] = _increment(s, F, y, kept ** (2**SLOW), scratch[2])
        for i in range(n + 2):
            s.rings[octave, last % _TAPS, i] = value[i]
        s.seen[octave] += 1
        if last + 1 < _TAPS or (last + 1) % 2:
            return
        for i in range(n + 2):
            low, high = 0.0, 0.0
            for tap in range(_TAPS):
                x = s.rings[octave, (last + 1 + tap) % _TAPS, i]
                low += _LOW[tap] * x
                high += _HIGH[tap] * x
            value[i], detail[i] = low, high
        s.heard[octave, 0] += 1.0
        s.heard[octave, 1] += detail[n] ** 2
        s.heard[octave, 2] += detail[n + 1] ** 2
        _add(detail, s.energy, octave)
        add_product(s.stretches, detail, detail[n])


@njit(cache=True, error_model="numpy")
def _add(x: Array, energy: Array, octave: int) -> None:
    """Add x xᵀ of the regressors."""
    for i in range(energy.shape[1]):
        for j in range(energy.shape[1]):
            energy[octave, i, j] += x[i] * x[j]


@njit(cache=True, error_model="numpy")
def _scale(energy: Array, kept: float) -> None:
    """Forget a part."""
    for octave in range(OCTAVES + 1):
        for i in range(energy.shape[1]):
            for j in range(energy.shape[1]):
                energy[octave, i, j] *= kept


@njit(cache=True, error_model="numpy")
def _close(s: NoiseState, F: Array, y: float) -> None:
    """End a run, and begin the next: the noise of an integral does not go on into it."""
    n = s.total.shape[0]
    for octave in range(OCTAVES + 1):
        for i in range(n):
            for j in range(n):
                if s.total[0] != 0.0:
                    s.closed[octave, i, j] += _centred(s.energy, s.total, octave, i, j)
        for i in range(n):
            for j in range(n):
                s.energy[octave, i, j] = 0.0
    for octave in range(OCTAVES):
        s.seen[octave] = 0
    for i in range(n):
        s.total[i] = s.box[i] = 0.0
        s.mark[i] = F[i]
    s.box[n] = s.sums[_FILLED] = s.sums[_SINCE] = 0.0
    s.mark[n] = y


@njit(cache=True, error_model="numpy")
def _centred(energy: Array, total: Array, octave: int, i: int, j: int) -> float:
    """Return an energy of sums of regressors less their mean; the first, which is one, counts the samples."""
    a, b = total[i] / total[0], total[j] / total[0]
    off = a * energy[octave, 0, j] + b * energy[octave, i, 0]
    return float(energy[octave, i, j] - off + a * b * energy[octave, 0, 0])


@njit(cache=True, error_model="numpy")
def _spectrum(s: NoiseState, integral: bool) -> Array:
    """Return the variance of the left-overs in each octave and beyond the last, shape (OCTAVES + 1,)."""
    v = np.empty(OCTAVES + 1)
    last, slope = np.log(max(s.sums[_BOXED] / s.sums[_BOXES], NOTHING)), 0.0
    for octave in range(OCTAVES + 1):
        now = last + 0.5 * slope
        if octave < OCTAVES and s.heard[octave, 1] > 0.0:
            count, squares = s.heard[octave, 0], s.heard[octave, 1]
            if integral and octave >= SLOW:
                squares = max(min(squares, s.heard[octave, 2]), NOTHING)
            now = (count * np.log(squares / count) + TAILS + EXPECTED * now) / (count + EXPECTED)
        slope = min(max(now - last, FALL), RISE) if octave else 0.0
        last = now
        v[octave] = np.exp(now)
    # Regressors fall with frequency: what they have in an octave lies at its lower edge, where noise that goes with f^p, as the
    # octave below tells, has (p + 1)/(2^(p + 1) − 1) of its mean over the octave.
    for octave in range(OCTAVES):
        p = min(max(np.log2(v[octave] / v[octave + 1]), -STEEPEST), STEEPEST)
        v[octave] *= (p + 1.0) / np.expm1((p + 1.0) * np.log(2.0)) if p != -1.0 else 1.0 / np.log(2.0)
    return v


@njit(cache=True, error_model="numpy")
def _look(s: NoiseState, integral: bool) -> None:
    """Put together what is known of the score."""
    uneven(s.stretches, s.uneven)
    v, n = _spectrum(s, integral), s.total.shape[0]
    mean = 0.0 if integral else s.sums[_SUM] / s.sums[_SAMPLES]
    for i in range(n):
        for j in range(n):
            found = mean * mean * s.total[i] * s.total[j]
            for octave in range(OCTAVES + 1):
                # What is in no octave lies beyond the last.
                share = v[octave] if octave == OCTAVES else v[octave] - v[OCTAVES]
                own = s.energy[octave, i, j]
                if integral:
                    own = _centred(s.energy, s.total, octave, i, j) + s.closed[octave, i, j]
                found += share * own
            s.M[i, j] = found
