"""The residual of an observer that averages a stiffness, in the torque's rate, and how far the stiffness is from its average.

Σ̇ − K̂ φ̇ is the sensors' noise, and φ̇ times what the stiffness differs by from K̂. Its mean square measures it where the
deflection moves fast, in the middle of a swing. At a swing's ends hardly anything moves, and there a spring that hardens differs
most: so the residual is fitted by a polynomial of φ too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from numpy.typing import NDArray

from vsalog.core.correlation import effective_samples
from vsalog.core.significance import INTERVAL
from vsalog.estimators.torque_rates import Rates
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]

# Degree of the polynomial, and the number of independent samples that each of its terms needs [1].
COURSE_DEGREE, SAMPLES_PER_TERM = 4, 3


@dataclass(frozen=True, slots=True)
class Course:
    """K(φ) − K̂ as a polynomial, in Legendre's.

    Attributes
    ----------
    middle, half : of the range of φ [rad]
    terms : shape (n,) [N·m/rad]
    spread : a root of the terms' covariance, shape (n, n) [N·m/rad]
    """

    middle: float
    half: float
    terms: Array
    spread: Array

    def at(self, phi: Array) -> Array:
        """Return K(φ) − K̂ at deflections φ, shape (N,) [N·m/rad]."""
        return np.asarray(legval(self._place(phi), self.terms))

    def square(self, phi: Array) -> Array:
        """Return the mean square of K(φ) − K̂, shape (N,) [N²·m²/rad²]: its size, and how well it is known."""
        return np.asarray(self.at(phi) ** 2 + self._variance(phi))

    def significant(self, phi: Array) -> Array:
        """Return the part of the square of K(φ) − K̂ that exceeds its noise, shape (N,) [N²·m²/rad²]."""
        return np.asarray(np.maximum(self.at(phi) ** 2 - INTERVAL**2 * self._variance(phi), 0.0))

    def _variance(self, phi: Array) -> Array:
        return np.asarray((legval(self._place(phi), self.spread) ** 2).sum(axis=0))

    def _place(self, phi: Array) -> Array:
        return np.clip((phi - self.middle) / self.half, -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class AveragingError:
    """The residual of one transmission.

    Attributes
    ----------
    alike : for how many samples the observer's inputs are correlated, at least 1
    within : how much the stiffness differs from the observer's average of it [N·m/rad], root mean square: the residual but
        for noise, over the deflection's rate; or, where that is more, how the residual grows with the rate, which needs
        no noise to be known
    course : how it differs along the deflection; None where the deflection does not determine it
    drift : how much it changes from one sample to the next [N·m/rad], by what it changes over many
    sharper : the course that a shorter window shows, which smooths less away of a swing's ends; None where none was looked at
    """

    alike: float = 1.0
    within: float = 0.0
    course: Course | None = None
    drift: float = 0.0
    sharper: Course | None = None

    def square(self, phi: Array) -> Array:
        """Return the mean square by which the stiffness differs at deflections φ, shape (N,) [N²·m²/rad²]."""
        square = np.full(phi.shape, self.within**2)
        if self.course is not None:
            square = np.fmax(square, self.course.square(phi))
        return square if self.sharper is None else np.fmax(square, self.sharper.significant(phi))


def averaging_error(
    phi: Array, known: Rates, found: Array, noise: float, lag: int = 0, memory: int | None = None
) -> AveragingError:
    """Analyse the residual of an observer's predictions of the torque's rate.

    Parameters
    ----------
    phi : shape (N,), deflection [rad]
    known : rates that are all finite
    found : shape (N,), the stiffness observed [N·m/rad], NaN before it is
    noise : noise of Σ̇ − K φ̇ from the sensors, one standard deviation [N·m/s]
    lag : samples over which a change of the stiffness is looked at; none with 0
    memory : samples that the observer remembers; all where absent
    """
    if found.size < 2 or not known.deflection.any():
        return AveragingError()
    left = np.nan_to_num(known.torque - found * known.deflection)
    score = left * np.sign(known.deflection)
    whole = max(1.0, left.size / effective_samples(score))
    alike = whole if memory is None else max(1.0, _alike(score, memory))
    power = known.deflection**2
    more = (float(np.mean(left**2)) - noise**2) / float(np.mean(power))
    within = float(np.sqrt(max(0.0, more, _growth(left**2, power))))
    return AveragingError(alike, within, _course(phi, known.deflection, left, whole), _drift(found, lag))


def _alike(left: Array, memory: int) -> float:
    """Return how many times the variance of sums over an observer's memory is that of as many independent samples.

    Within a longer time than the memory noise that a filter differentiated averages out; the observer does not wait for that.
    """
    length = int(np.clip(memory, 1, max(1, left.size // ENOUGH_BATCHES)))
    power = float(np.mean(left**2))
    sums = left[: left.size // length * length].reshape(-1, length).sum(axis=1)
    return float(np.mean(sums**2)) / (length * power) if power > 0.0 else 1.0


def _growth(left: Array, power: Array) -> float:
    """Return how much a squared residual grows with the rate's power, less its uncertainty."""
    spread = float(np.var(power))
    if spread == 0.0:
        return 0.0
    off = power - power.mean()
    slope = float(np.mean((left - left.mean()) * off)) / spread
    rest = (left - left.mean() - slope * off) * off
    return slope - INTERVAL * float(np.std(rest) / spread / np.sqrt(effective_samples(rest)))


def _drift(found: Array, lag: int) -> float:
    """Return the root mean square of how much a stiffness changes over a lag, or half of what there is, by the sample."""
    lag = min(lag, found.size // 2)
    change = found[lag:] - found[: found.size - lag]
    change = change[np.isfinite(change)]
    return float(np.sqrt(np.mean(change**2))) / lag if lag and change.size else 0.0


def _course(phi: Array, speed: Array, left: Array, alike: float) -> Course | None:
    """Fit the residual by φ̇ times a polynomial of φ, of as many terms as there are independent samples for."""
    half = 0.5 * float(np.ptp(phi))
    if not half > 0.0:
        return None
    middle = float(phi.min()) + half
    degree = int(np.clip(left.size / (alike * SAMPLES_PER_TERM) - 1.0, 0, COURSE_DEGREE))
    moved = legvander((phi - middle) / half, degree) * speed[:, None]
    powers, axes = np.linalg.eigh(moved.T @ moved)
    powers[powers <= powers.size * np.finfo(float).eps * powers[-1]] = np.inf
    root = axes / np.sqrt(powers)
    terms = root @ (root.T @ (moved.T @ left))
    noise = float(np.mean((left - moved @ terms) ** 2))
    return Course(middle, half, terms, np.asarray(root * np.sqrt(noise * alike)))
