"""What an error depends on.

The signatures of causes (`signatures.py`) are selected one after the other: the one that, fitted to other blocks of the log,
leaves the smallest residual of the error, and the simplest of those whose residual is no larger than by chance. Then each has to
explain something in addition to the others (`core/dependence.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART
from vsalog.core.correlation import CORRELATION_TIMES, effective_samples
from vsalog.core.dependence import (
    LEAST_BLOCKS,
    REPORTED_SHARE,
    Association,
    association,
    block_index,
    block_moments,
    held_out_squares,
    least_squares,
    mean_above_zero,
)
from vsalog.core.resolution import ROUNDED
from vsalog.core.significance import FALSE_ALARM, INTERVAL
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.validation.document import Dependence
from vsalog.validation.scores import bins_of
from vsalog.validation.signatures import Signature, signatures

Array = NDArray[np.float64]

# The finding of each kind.
CODES = {
    "offset": "error.offset",
    "torque": "error.gain",
    "zero": "error.deflection_zero",
    "side": "error.asymmetry",
    "gap": "error.backlash",
    "deflection": "error.spring_shape",
    "position": "error.position",
    "setpoint": "error.setpoint",
    "velocity": "error.velocity",
    "late": "error.late_encoder",
    "direction": "error.friction",
    "loading": "error.loading",
    "time": "error.drift_of_torque",
    "zero over time": "error.drift_of_encoder",
    "gain over time": "error.drift_of_gain",
}


@dataclass(frozen=True, slots=True)
class _Cause:
    """A signature, its columns among the moments, and the kinds of causes that explain the error as well."""

    signature: Signature
    columns: tuple[int, ...]
    others: tuple[str, ...] = ()


def thinned(use: NDArray[np.bool_]) -> tuple[NDArray[np.int64], int]:
    """Return indices of the samples to use, and the number of samples that each represents."""
    rows = np.flatnonzero(use)
    thin = max(1, rows.size // PART)
    return rows[::thin], thin


def dependences(
    error: Array,
    predicted: Array,
    variables: Mapping[str, Array],
    smoothing: float = 1.0,
    step: float | None = None,
    thin: int = 1,
) -> tuple[Dependence, ...]:
    """Return what the error depends on, in the order of the share that each explains of the residual; `itself` comes last.

    Parameters
    ----------
    error : prediction − reference, shape (N,)
    predicted : the torque that was predicted
    variables : as many as there are, shape (N,) each: ``deflection``, ``setpoint``, ``velocity``, ``loading`` (its sign),
        ``time``, ``stiffness`` (predicted), `POSITIONS` of link and motors, ``velocity of`` each of these, ``loop …`` (`loops`)
    smoothing : correlation length of white noise after their common filter [samples]
    step : the least step of the torque sensor [N·m]; None where it has none
    thin : number of samples of the log that each given one represents
    """
    keep = np.isfinite(error) & np.isfinite(predicted)
    for x in variables.values():
        keep &= np.isfinite(x)
    e, torque = error[keep], predicted[keep]
    if e.size < LEAST_BLOCKS:
        return ()
    power = float(np.mean(e**2))
    if power <= (NEGLIGIBLE_SHARE * float(np.std(torque - e))) ** 2:
        return ()
    steps = 0.0 if step is None else (ROUNDED * step) ** 2
    if step is not None and steps >= power - steps:
        # The sensor's quantisation is most of the error.
        return (_steps(step, power),)
    at = {name: x[keep] for name, x in variables.items()}
    dependences, rest = _causes(e, torque, at, power)
    last = _itself(rest, power, smoothing / thin, thin)
    if last is not None and last.share >= REPORTED_SHARE and last.p_value <= FALSE_ALARM:
        dependences.append(last)
    return tuple(dependences)


def gain_of(error: Array, predicted: Array) -> float | None:
    """Return how many times the predicted torque is measured, by least squares; None where it is not clearly other than one."""
    keep = np.isfinite(error) & np.isfinite(predicted)
    found = _on_torque(error[keep], predicted[keep])
    if found is None or found.share < REPORTED_SHARE or found.p_value > FALSE_ALARM:
        return None
    return 1.0 - float(found.coefficients[0])


def _follows(values: Array, torque: Array) -> bool:
    found = _on_torque(values, torque)
    return found is not None and found.p_value <= FALSE_ALARM


def _on_torque(values: Array, torque: Array) -> Association | None:
    """Return how values depend on a torque, beyond their mean."""
    moments = block_moments(np.column_stack((np.ones_like(torque), torque, values)), block_index(torque.size))
    return association(moments, [1], [0])


def _causes(e: Array, torque: Array, at: Mapping[str, Array], power: float) -> tuple[list[Dependence], Array]:
    """Return the parts of an error that signatures explain, and the residual."""
    offered = _offered(signatures(torque, at))
    columns = np.concatenate([c.signature.columns for c in offered], axis=1)
    moments = block_moments(np.column_stack((columns, e)), block_index(e.size))
    chosen: list[_Cause] = []
    rest = e
    while True:
        open_to = [c for c in offered if c.signature.on not in {other.signature.on for other in chosen}]
        open_to = [c for c in open_to if not _over_time(c.signature) or _has_a_trend(rest, c.signature)]
        best = _best(moments, chosen, open_to)
        if best is None or _left(moments, chosen) - _left(moments, [*chosen, best]) < REPORTED_SHARE * power * e.size:
            break
        chosen.append(best)
        rest = e - columns[:, _all(chosen)] @ least_squares(moments.sum(axis=0), _all(chosen))
    p_values = [0.0]
    while chosen:
        # In addition to the others: their residual is no noise.
        p_values = [_p(moments, c, [other for other in chosen if other is not c]) * len(offered) for c in chosen]
        if max(p_values) <= FALSE_ALARM:
            break
        del chosen[int(np.argmax(p_values))]
    dependences: list[Dependence] = []
    for k, cause in enumerate(chosen):
        share = (_left(moments, chosen[:k]) - _left(moments, chosen[: k + 1])) / (power * e.size)
        coefficients = least_squares(moments.sum(axis=0), _all(chosen[: k + 1]))[-len(cause.columns) :]
        dependences.append(_said(cause, coefficients, share, p_values[k], e, torque, at))
    return dependences, e - columns[:, _all(chosen)] @ least_squares(moments.sum(axis=0), _all(chosen))


def _offered(found: Sequence[Signature]) -> list[_Cause]:
    """Give each signature its columns."""
    ends = np.cumsum([s.columns.shape[1] for s in found]).tolist()
    return [_Cause(s, tuple(range(end - s.columns.shape[1], end))) for s, end in zip(found, ends, strict=True)]


def _all(causes: Sequence[_Cause]) -> list[int]:
    return [column for cause in causes for column in cause.columns]


def _left(moments: Array, causes: Sequence[_Cause]) -> float:
    """Return the squared residual of the error after causes."""
    whole, own = moments.sum(axis=0), _all(causes)
    return float(whole[-1, -1] - whole[own, -1] @ least_squares(whole, own))


def _p(moments: Array, cause: _Cause, others: Sequence[_Cause]) -> float:
    """Return the probability that a cause explains so much in addition to others by chance."""
    found = association(moments, cause.columns, _all(others))
    return 1.0 if found is None else found.p_value


def _best(moments: Array, chosen: Sequence[_Cause], open_to: Sequence[_Cause]) -> _Cause | None:
    """Return the cause with the smallest residual in blocks that it was not fitted to; the simplest of several."""
    controls, left = _all(chosen), dict[int, float]()
    for k, cause in enumerate(open_to):
        squares = held_out_squares(moments, cause.columns, controls)
        if squares is None:
            return None
        left[k] = squares
    if not left:
        return None

    def as_well(least: _Cause) -> list[_Cause]:
        """Return the causes that encompass this one (Mizon and Richard 1986), the simplest first."""
        found = [k for k, c in enumerate(open_to) if _p(moments, least, [*chosen, c]) > FALSE_ALARM]
        return [open_to[k] for k in sorted(found, key=lambda k: (len(open_to[k].columns), left[k]))]

    best = as_well(open_to[min(left, key=lambda k: left[k])])[0]
    if best.signature.any_shape:
        physical = [k for k, c in enumerate(open_to) if not c.signature.any_shape]
        best = _simpler(moments, chosen, best, [open_to[k] for k in sorted(physical, key=lambda k: left[k])])
    kinds = dict.fromkeys(c.signature.on for c in as_well(best) if len(c.columns) <= len(best.columns))
    return replace(best, others=tuple(on for on in kinds if on != best.signature.on))


def _simpler(moments: Array, chosen: Sequence[_Cause], curve: _Cause, physical: Sequence[_Cause]) -> _Cause:
    """Prefer to a curve of any shape a physical effect that is right to first order, or the stronger of two equally good ones.

    Parameters
    ----------
    physical : the one with the smallest residual first
    """
    if not physical:
        return curve
    one, before = physical[0], _left(moments, chosen)
    if _left(moments, [*chosen, one]) - _left(moments, [*chosen, curve]) <= NEGLIGIBLE_SHARE * before:
        return one
    others = [c for c in physical if c.signature.on != one.signature.on]
    return one if any(_p(moments, curve, [*chosen, one, c]) > FALSE_ALARM for c in others) else curve


def _said(
    cause: _Cause, coefficients: Array, share: float, p: float, e: Array, torque: Array, at: Mapping[str, Array]
) -> Dependence:
    on = cause.signature.on
    one = float(coefficients[0]) if coefficients.size == 1 else None
    code, evidence = _finding(cause.signature, one, e, torque)
    x = torque if on == "torque" else at.get(on)
    return Dependence(
        on=on,
        share=share,
        p_value=p,
        slope=one if on in ("torque", "velocity") else None,
        code=code,
        evidence=evidence,
        bins=() if x is None else bins_of(e, x),
        not_told_from=cause.others,
    )


def _finding(signature: Signature, one: float | None, e: Array, torque: Array) -> tuple[str, dict[str, float]]:
    """Return the code of what an error depends on, and its numbers; `one` is the coefficient of the only column."""
    on = signature.on
    if on == "offset" and one is not None:
        return CODES[on], {"offset": one}
    if on == "torque" and one is not None:
        gain = 1.0 - one  # measured = gain · predicted
        return "error.sign" if gain < 0.0 and _follows(torque - e, torque) else CODES[on], {"gain": gain}
    if on in ("direction", "loading"):
        positive = signature.columns[:, 0] > 0.0
        apart = float(e[positive].mean() - e[~positive].mean()) if positive.any() and not positive.all() else 0.0
        return CODES[on], {"apart": abs(apart)}
    return CODES[on], {}


def _over_time(signature: Signature) -> bool:
    return signature.on.endswith("time")


def _has_a_trend(rest: Array, signature: Signature) -> bool:
    """Return whether the residual, block by block, rises or falls in the signature's own measure: a drift is no oscillation."""
    n, size = LEAST_BLOCKS, rest.size // LEAST_BLOCKS
    base, left = (x[: n * size].reshape(n, size) for x in (signature.columns[:, 0], rest))
    norms = np.sum(base**2, axis=1)
    means = np.divide(np.sum(base * left, axis=1), norms, out=np.zeros(n), where=norms > 0.0)
    # Pairs of blocks that rise less those that fall, of all pairs; by chance 0, with the variance of Kendall (1938).
    rising = float(np.sign(np.subtract.outer(means, means))[np.tril_indices(n, -1)].mean())
    return abs(rising) >= INTERVAL * float(np.sqrt(2 * (2 * n + 5) / (9 * n * (n - 1))))


def _steps(step: float, power: float) -> Dependence:
    share = min((ROUNDED * step) ** 2 / power, 1.0)
    return Dependence(
        on="resolution", share=share, p_value=0.0, slope=None, code="error.resolution", evidence={"step": step}
    )


def _itself(rest: Array, power: float, smoothing: float, thin: int) -> Dependence | None:
    # Farther apart than the filter reaches: correlation there is not from the filter.
    left = (rest - rest.mean())[:: max(1, int(np.ceil(CORRELATION_TIMES * smoothing)))]
    if left.size <= LEAST_BLOCKS:
        return None
    variance = float(left @ left)
    if variance <= 0.0:
        return None
    products = left[1:] * left[:-1]
    rho = float(products.sum()) / variance
    share = max(rho, 0.0) ** 2 * variance / left.size / power
    alike = thin * rest.size / effective_samples(rest)
    p = mean_above_zero(np.bincount(block_index(products.size), products).astype(np.float64))
    return Dependence(
        on="itself", share=share, p_value=p, slope=rho, code="error.not_white", evidence={"samples_alike": alike}
    )
