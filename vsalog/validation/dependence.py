"""What an error depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.correlation import effective_samples
from vsalog.validation.document import Dependence
from vsalog.validation.scores import bins_of
from vsalog.validation.signatures import Signature, signatures

Array = NDArray[np.float64]

# A dependence is told when it explains this part of the error's mean square and is not chance.
LEAST_SHARE, LARGEST_P = 0.05, 1e-3
# Errors this much smaller than the torque's spread are not worth a cause.
NEGLIGIBLE = 2e-3
# Samples that tell a dependence; of a longer log only as many are looked at.
ENOUGH = 50_000
# Times the filter's own correlation, beyond which nothing of it is left.
APART = 3.0
# Causes that are told one after the other, each of what the ones before have left.
MOST_CAUSES = 3
# Two explanations are told apart when their Bayesian information criteria differ by this (Kass and Raftery 1995: strong).
TOLD_APART = 6.0
# A sensor's steps are what an error is made of when they alone would make this part of its mean square.
STEPS_ALONE = 0.5
# Blocks of a log whose means have to rise or fall with time, by Kendall's measure, before a drift is believed.
BLOCKS, MONOTONE = 8, 0.7
# Effects have one or two parameters; their shapes are right to first order, which leaves this part of the mean square open.
PHYSICAL, SECOND_ORDER = 2, 0.01
# The finding that each kind is.
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
# A measured torque that is less than so many times the predicted one has another sign.
SWAPPED = -0.2
# Shares of the error that are left over are no less than rounding makes them.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class _Fit:
    """A signature beside those chosen before: what it leaves of the mean square, and its freedom."""

    signature: Signature
    left: float
    freedom: int
    coefficients: Array


def thinned(use: NDArray[np.bool_]) -> tuple[NDArray[np.int64], int]:
    """Return which samples of those in use to look at, as indices, and of how many each is one."""
    rows = np.flatnonzero(use)
    thin = max(1, rows.size // ENOUGH)
    return rows[::thin], thin


def dependences(
    error: Array,
    predicted: Array,
    variables: Mapping[str, Array],
    smoothing: float = 1.0,
    step: float | None = None,
    thin: int = 1,
) -> tuple[Dependence, ...]:
    """Return what the error depends on, in the order in which it explains most of what is left; `itself` comes last.

    Parameters
    ----------
    error : prediction − reference, shape (N,)
    predicted : the torque that was predicted
    variables : as many as there are, shape (N,) each: ``deflection``, ``setpoint``, ``velocity``, ``loading`` (its sign),
        ``time``, ``stiffness`` (predicted), `POSITIONS` of link and motors, ``velocity of`` each of these, ``loop …`` (`loops`)
    smoothing : for how many samples the filter that both went through makes even white noise stay alike
    step : the least step of the torque sensor [N·m]; None where it has none
    thin : of how many samples of the log each that is given is one
    """
    keep = np.isfinite(error) & np.isfinite(predicted)
    for x in variables.values():
        keep &= np.isfinite(x)
    e, torque = error[keep], predicted[keep]
    if e.size < 50:
        return ()
    power = float(np.mean(e**2))
    spread = float(np.std(torque - e))
    if power <= (NEGLIGIBLE * spread) ** 2 or power == 0.0:
        return ()
    if step is not None and step**2 / 12.0 >= STEPS_ALONE * power:
        return (_steps(step, power),)
    at = {name: x[keep] for name, x in variables.items()}
    told, rest = _causes(e, torque, at, power)
    last = _itself(rest, power, smoothing / thin, thin)
    if last is not None and last.share >= LEAST_SHARE and last.p_value <= LARGEST_P:
        told.append(last)
    return tuple(told)


def gain_of(error: Array, predicted: Array) -> float | None:
    """Return how many times the predicted torque is measured, by least squares; None where it is not clearly other than one."""
    keep = np.isfinite(error) & np.isfinite(predicted)
    e, torque = error[keep], predicted[keep]
    if e.size < 50 or np.ptp(torque) == 0.0:
        return None
    x = torque - torque.mean()
    slope = float(x @ e) / float(x @ x)
    share = slope**2 * float(x @ x) / max(float(e @ e), 1e-300)
    left = e - e.mean() - slope * x
    clear = share >= LEAST_SHARE and _p(share, 1, effective_samples(left)) <= LARGEST_P
    return 1.0 - slope if clear else None


def _causes(e: Array, torque: Array, at: Mapping[str, Array], power: float) -> tuple[list[Dependence], Array]:
    """Choose signatures one by one; return what they say and what they leave of the error."""
    offered = signatures(torque, at)
    told: list[Dependence] = []
    chosen: list[Signature] = []
    rest, left = e, power
    while len(chosen) < MOST_CAUSES:
        open_to = [s for s in offered if s.on not in {c.on for c in chosen}]
        open_to = [s for s in open_to if not _over_time(s) or _has_a_trend(rest, s)]
        fits = _fits(chosen, open_to, e, power)
        if not fits:
            break
        richest = min(fits, key=lambda f: f.left)
        independent = effective_samples(_left_by(e, [*chosen, richest.signature]))
        best = min(fits, key=lambda f: _criterion(f, independent))
        if best.freedom > PHYSICAL:
            best = _simpler(best, fits, chosen, e, power, left, independent)
        after = _left_by(e, [*chosen, best.signature])
        share = (left - best.left) / power
        # How many samples are independent, what the next cause would leave tells: a rest that it explains is no noise.
        more = _fits([*chosen, best.signature], [s for s in open_to if s.on != best.signature.on], e, power)
        noise = after if not more else _left_by(e, [*chosen, best.signature, min(more, key=lambda f: f.left).signature])
        p = _p((left - best.left) / left, best.freedom, effective_samples(noise)) * len(offered)
        if share < LEAST_SHARE or p > LARGEST_P:
            break
        others = _others(best, fits, effective_samples(after))
        told.append(_said(best, others, share, min(p, 1.0), e, torque, at))
        chosen.append(best.signature)
        rest, left = after, best.left
    return told, rest


def _fits(chosen: Sequence[Signature], offered: Sequence[Signature], e: Array, power: float) -> list[_Fit]:
    """Fit each signature beside the chosen ones by least squares, from the sums of products of all columns."""
    before = sum(s.columns.shape[1] for s in chosen)
    columns = np.concatenate([s.columns for s in (*chosen, *offered)], axis=1)
    size = np.sqrt(np.mean(columns**2, axis=0))
    columns = columns / np.where(size > 0.0, size, 1.0)
    gram, right = columns.T @ columns / e.size, columns.T @ e / e.size
    out, first = [], before
    for s in offered:
        own = np.arange(first, first + s.columns.shape[1])
        first = int(own[-1]) + 1
        use = np.append(np.arange(before), own)
        found = np.linalg.lstsq(gram[np.ix_(use, use)], right[use], rcond=1e-10)
        solution, rank = found[0], int(found[2])
        left = max(power - float(right[use] @ solution), ROUNDING * power)
        out.append(_Fit(s, left, max(rank - before, 1), solution[before:] / np.where(size[own] > 0.0, size[own], 1.0)))
    return out


def _left_by(e: Array, chosen: Sequence[Signature]) -> Array:
    columns = np.concatenate([s.columns for s in chosen], axis=1)
    return np.asarray(e - columns @ np.linalg.lstsq(columns, e, rcond=1e-10)[0])


def _criterion(fit: _Fit, independent: float) -> float:
    """Bayesian information criterion, with as many samples as are independent."""
    return independent * float(np.log(fit.left)) + fit.freedom * float(np.log(max(independent, 2.0)))


def _simpler(
    curve: _Fit, fits: Sequence[_Fit], chosen: Sequence[Signature], e: Array, power: float, before: float, independent: float
) -> _Fit:  # fmt: skip
    """Prefer to a curve of any shape a physical effect that is right to first order, or the stronger of two that fit better."""
    physical = [f for f in fits if f.freedom <= PHYSICAL]
    if not physical:
        return curve
    one = min(physical, key=lambda f: f.left)
    if one.left - curve.left <= SECOND_ORDER * before:
        return one
    others = [f.signature for f in physical if f.signature.on != one.signature.on]
    pairs = _fits([*chosen, one.signature], others, e, power) if others else []
    both = min((_criterion(f, independent) for f in pairs), default=np.inf) + one.freedom * np.log(
        max(independent, 2.0)
    )
    return one if both < _criterion(curve, independent) else curve


def _others(best: _Fit, fits: Sequence[_Fit], independent: float) -> list[str]:
    """Return the kinds of causes that explain the error as well as the best."""
    least = _criterion(best, independent)
    near = [f for f in fits if _criterion(f, independent) < least + TOLD_APART]
    near.sort(key=lambda f: _criterion(f, independent))
    return [on for on in dict.fromkeys(f.signature.on for f in near) if on != best.signature.on]


def _said(
    best: _Fit, others: Sequence[str], share: float, p: float, e: Array, torque: Array, at: Mapping[str, Array]
) -> Dependence:
    on = best.signature.on
    one = float(best.coefficients[0]) if best.coefficients.size == 1 else None
    code, evidence = _finding(on, one, best, e)
    x = torque if on == "torque" else at.get(on)
    return Dependence(
        on=on,
        share=share,
        p_value=p,
        slope=one if on in ("torque", "velocity") else None,
        code=code,
        evidence=evidence,
        bins=() if x is None else bins_of(e, x),
        not_told_from=tuple(others),
    )


def _finding(on: str, one: float | None, best: _Fit, e: Array) -> tuple[str, dict[str, float]]:
    """Return the code of what an error depends on, and its numbers; `one` is the coefficient of the only column."""
    if on == "offset" and one is not None:
        return CODES[on], {"offset": one}
    if on == "torque" and one is not None:
        gain = 1.0 - one  # measured = gain · predicted
        return "error.sign" if gain < SWAPPED else CODES[on], {"gain": gain}
    if on in ("direction", "loading"):
        positive = best.signature.columns[:, 0] > 0.0
        apart = float(e[positive].mean() - e[~positive].mean()) if positive.any() and not positive.all() else 0.0
        return CODES[on], {"apart": abs(apart)}
    return CODES[on], {}


def _over_time(signature: Signature) -> bool:
    return signature.on.endswith("time")


def _has_a_trend(rest: Array, signature: Signature) -> bool:
    """Tell whether what is left, block by block, rises or falls in the signature's own measure: a drift is no oscillation."""
    size = rest.size // BLOCKS
    base = signature.columns[:, 0]
    means = []
    for i in range(BLOCKS):
        part = slice(i * size, (i + 1) * size)
        norm = float(base[part] @ base[part])
        means.append(float(base[part] @ rest[part]) / norm if norm > 0.0 else 0.0)
    # Kendall's measure: pairs of blocks that rise less those that fall, of all pairs.
    rising = np.sign(np.subtract.outer(means, means))[np.tril_indices(BLOCKS, -1)]
    return abs(float(rising.mean())) >= MONOTONE


def _steps(step: float, power: float) -> Dependence:
    share = min(step**2 / 12.0 / power, 1.0)
    return Dependence(
        on="resolution", share=share, p_value=0.0, slope=None, code="error.resolution", evidence={"step": step}
    )


def _itself(rest: Array, power: float, smoothing: float, thin: int) -> Dependence | None:
    # Further apart than the filter reaches: what is alike there, the filter has not made so.
    left = (rest - rest.mean())[:: max(1, int(np.ceil(APART * smoothing)))]
    if left.size < 20:
        return None
    variance = float(left @ left)
    if variance <= 0.0:
        return None
    rho = float(left[1:] @ left[:-1]) / variance
    z = abs(rho) * np.sqrt(left.size)
    share = max(rho, 0.0) ** 2 * variance / left.size / power
    alike = thin * rest.size / effective_samples(rest)
    p = 2.0 * float(special.ndtr(-z))
    return Dependence(
        on="itself", share=share, p_value=p, slope=rho, code="error.not_white", evidence={"samples_alike": alike}
    )


def _p(share: float, freedom: int, independent: float) -> float:
    """Return the probability that chance explains such a share, by the F distribution.

    `independent` is of what is left over: the error itself may be one slow drift.
    """
    spare = max(independent - freedom - 1.0, 1.0)
    f = max(share, 0.0) / freedom / max((1.0 - share) / spare, 1e-300)
    return float(special.fdtrc(freedom, spare, f))
