"""Weights of a filter and of its own derivatives, all of which keep the same part of every frequency.

The derivatives of a polynomial that Savitzky and Golay fit to a window are not those of the fitted value at the window's centre
as the window moves on: the higher, the more they attenuate a motion that is fast for the window. At one swing per window a
polynomial of degree 5 leaves 98 % of a position, 99 % of its first derivative and 93 % of its third, and where one is divided by
the other the quotient is off by 6 %. Here the fit has weights (1 − x²)ᵐ, with which samples enter and leave the window so
smoothly that the fitted value can be differentiated itself: one and the same filter for all orders. (Weights: Cleveland, JASA
74(368), 1979; derivatives by those of the kernel: Gasser and Müller, 1984.)
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from vsalog.core.errors import FilterError
from vsalog.filters.savitzky_golay import Polynomials

Array = NDArray[np.float64]


def derivative_weights(window: int, degree: int, derivatives: int, period: float) -> Array:
    """Weights that turn a window of samples into the smoothed signal's value and derivatives at the window's centre.

    Parameters
    ----------
    window : number of samples, odd
    degree : of polynomials that pass the filter as they are, and their derivatives, less than `window`
    derivatives : highest derivative wanted
    period : sample time T [s]

    Returns
    -------
    shape (derivatives + 1, window); row s gives the s-th derivative [unit/s^s]

    Raises
    ------
    FilterError
        The degree does not fit the window, or the period is not positive.
    """
    if window % 2 == 0 or degree < 0 or degree >= window:
        raise FilterError(
            f"Savitzky–Golay: a polynomial of degree {degree} needs an odd window of at least {degree + 1} samples, not {window}"
        )
    if not period > 0.0:
        raise FilterError(f"Savitzky–Golay: the period must be positive, not {period}")
    beyond, x, bell, root = _bell(window, derivatives)
    q, r = np.linalg.qr(root[:, None] * legendre.legvander(x, degree))
    identity = np.eye(degree + 1)
    kernel = legendre.legmul(bell, np.linalg.solve(r, np.linalg.solve(r.T, legendre.legval(0.0, identity))))
    weights = np.empty((derivatives + 1, window))
    for s in range(derivatives + 1):
        row = (-1.0) ** s * legendre.legval(x, legendre.legder(kernel, s))
        # A sum over samples is no integral: the missing part of a polynomial's derivative is added.
        wanted = legendre.legval(0.0, legendre.legder(identity, s, axis=0)) * np.ones(degree + 1)
        missing = np.linalg.solve(r.T, wanted) - q.T @ (row / root)
        weights[s] = (row + root * (q @ missing)) / (beyond * period) ** s
    return weights


def derivative_polynomials(window: int, degree: int, derivatives: int) -> Polynomials:
    """Return the polynomials that `derivative_weights` fits to a window; parameters as there."""
    _, x, _, root = _bell(window, derivatives)
    return Polynomials(np.linalg.qr(root[:, None] * legendre.legvander(x, degree))[0], root)


def _bell(window: int, derivatives: int) -> tuple[int, Array, Array, Array]:
    """Return the bell: samples from its centre to its end, their places, its Legendre coefficients, its root at the samples."""
    # The bell is zero one sample beyond either end.
    beyond = window // 2 + 1
    x: Array = np.arange(-(window // 2), beyond, dtype=np.float64) / beyond
    bell: Array = np.asarray(legendre.poly2leg(np.polynomial.polynomial.polypow([1.0, 0.0, -1.0], derivatives + 2)))
    return beyond, x, bell, np.asarray(np.sqrt(legendre.legval(x, bell)))
