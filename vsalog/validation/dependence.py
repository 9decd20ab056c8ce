"""What an error depends on, and what that means in plain words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from vsalog.validation.document import Dependence
from vsalog.validation.scores import binned, bins_of, effective_samples

Array = NDArray[np.float64]

# A dependence is told when it explains this part of the error's mean square and is not chance.
LEAST_SHARE, LARGEST_P = 0.05, 1e-3
# Errors this much smaller than the torque's spread are not worth a cause.
NEGLIGIBLE = 2e-3
# Of an effect that has the sign of a sinusoidal velocity a straight line explains 8/π² = 0.81; of one that grows with it, all.
STRAIGHT = 0.9
# Samples that tell a dependence; of a longer log only as many are looked at.
ENOUGH = 200_000
# Times the filter's own correlation, beyond which nothing of it is left.
APART = 3.0


def dependences(
    error: Array, predicted: Array, variables: Mapping[str, Array], smoothing: float = 1.0
) -> tuple[Dependence, ...]:
    """Return what the error depends on, strongest first.

    Parameters
    ----------
    error : prediction − reference, shape (N,)
    predicted : the torque that was predicted
    variables : ``deflection``, ``setpoint``, ``velocity``, ``loading`` (±1), ``time``: shape (N,) each, as many as there are
    smoothing : for how many samples the filter that both went through makes even white noise stay alike
    """
    keep = np.isfinite(error) & np.isfinite(predicted)
    for x in variables.values():
        keep &= np.isfinite(x)
    thin = max(1, int(np.count_nonzero(keep)) // ENOUGH)
    e, torque = error[keep][::thin], predicted[keep][::thin]
    if e.size < 50:
        return ()
    power = float(np.mean(e**2))
    spread = float(np.std(torque - e))
    if power <= (NEGLIGIBLE * spread) ** 2 or power == 0.0:
        return ()
    found = [_offset(e, power), _gain(e, torque, power)]
    for name, x in variables.items():
        at = x[keep][::thin]
        if np.ptp(at) > 0.0:
            found += _over(name, at, e, torque, power)
    found.append(_itself(e, power, smoothing / thin, thin))
    told = [d for d in found if d is not None and d.share >= LEAST_SHARE and d.p_value <= LARGEST_P]
    return tuple(sorted(told, key=lambda d: (d.on == "itself", -d.share)))


def _offset(e: Array, power: float) -> Dependence:
    bias, std = float(e.mean()), float(e.std())
    independent = effective_samples(e)
    t = abs(bias) / max(std / np.sqrt(independent), 1e-300)
    words = (
        f"the prediction is {abs(bias):.3g} N·m too {'high' if bias > 0 else 'low'} on average: the torque sensor or an"
        " encoder has an offset, or a constant torque is missing"
    )
    p = 2.0 * float(stats.t.sf(t, max(independent - 1.0, 1.0)))
    return Dependence(on="offset", share=bias**2 / power, p_value=p, slope=None, words=words)


def _gain(e: Array, torque: Array, power: float) -> Dependence | None:
    x = torque - torque.mean()
    variance = float(x @ x)
    if variance <= 0.0:
        return None
    slope = float(x @ e) / variance
    share = slope**2 * variance / e.size / power
    gain = 1.0 - slope  # measured = gain · predicted
    if gain < -0.2:
        words = f"the measured torque is {gain:.2f} times the predicted one: a sign is swapped, of torque or deflection"
    else:
        more = "larger" if gain > 1.0 else "smaller"
        words = (
            f"the error grows with the torque: what is measured is {abs(gain - 1.0):.1%} {more} than predicted. The spring"
            f" is {'stiffer' if gain > 1.0 else 'softer'} than in the model, a gear ratio or a unit is wrong, or the torque"
            " sensor's gain is"
        )
    p = _p(share, 1, e - e.mean() - slope * x)
    return Dependence(on="torque", share=share, p_value=p, slope=slope, words=words, bins=bins_of(e, torque))


WORDS = {
    "deflection": "the error depends on the deflection: the spring's shape is not the model's (nonlinearity, asymmetry,"
    " backlash)",
    "setpoint": "the error depends on the set-point: its zero or scale is off (lever arm, secondary motor's encoder), or the"
    " model has too few powers of it",
    "velocity": "the error grows with the velocity of the deflection: damping in the transmission, or a sensor that is late",
    "direction": "the error has the sign of the velocity: friction or hysteresis is missing",
    "loading": "the error differs between loading and unloading: the transmission has hysteresis (a loop)",
    "time": "the error changes over time: a sensor drifts, or the stiffness does",
}


def _over(name: str, x: Array, e: Array, torque: Array, power: float) -> list[Dependence]:
    """Return what a variable explains beyond offset and gain."""
    rest = e - _explained_by(torque, e)
    out = []
    if name == "loading":
        out.append(_two_sided("loading", x > 0.0, rest, power))
    else:
        slope, centre = float(np.polyfit(x, rest, 1)[0]), float(x.mean())
        edges, index = binned(x)
        # A straight line, or a curve of any shape: whichever is less likely by chance.
        fits = [(slope * (x - centre), 1), (_group_means(index, rest), max(len(edges) - 2, 1))]
        told = [(float(np.mean(fit**2)) / power, freedom, rest - fit) for fit, freedom in fits]
        p, share = min((_p(share, freedom, left), -share) for share, freedom, left in told)
        out.append(Dependence(on=name, share=-share, p_value=p, slope=slope, words=WORDS[name], bins=bins_of(e, x)))
        if name == "velocity" and told[0][0] < STRAIGHT * told[1][0]:
            # No straight line: the error jumps with the velocity's sign rather than growing with the velocity.
            out = [_two_sided("direction", x > 0.0, rest, power)]
    return out


def _explained_by(torque: Array, e: Array) -> Array:
    x = np.stack([np.ones_like(torque), torque - torque.mean()], axis=1)
    if np.ptp(torque) == 0.0:
        return np.full_like(e, e.mean())
    return np.asarray(x @ np.linalg.lstsq(x, e, rcond=None)[0])


def _two_sided(name: str, positive: NDArray[np.bool_], e: Array, power: float) -> Dependence:
    means = _group_means(positive.astype(np.int64), e)
    share = float(np.mean(means**2)) / power
    step = float(e[positive].mean() - e[~positive].mean()) if positive.any() and not positive.all() else 0.0
    words = f"{WORDS[name]}; the two sides are {abs(step):.3g} N·m apart"
    return Dependence(on=name, share=share, p_value=_p(share, 1, e - means), slope=None, words=words)


def _group_means(index: NDArray[np.int64], e: Array) -> Array:
    """Return for each sample the mean of its group, less the mean of all."""
    counts = np.bincount(index)
    sums = np.bincount(index, e)
    means = np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0)
    return np.asarray(means[index] - e.mean())


def _itself(e: Array, power: float, smoothing: float, thin: int) -> Dependence | None:
    # Further apart than the filter reaches: what is alike there, the filter has not made so.
    left = (e - e.mean())[:: max(1, int(np.ceil(APART * smoothing)))]
    if left.size < 20:
        return None
    variance = float(left @ left)
    if variance <= 0.0:
        return None
    rho = float(left[1:] @ left[:-1]) / variance
    words = (
        f"the error is not white: it stays alike for about {thin * e.size / effective_samples(e):.0f} samples, so something is"
        " missing in the model, not only noise"
    )
    z = abs(rho) * np.sqrt(left.size)
    share = max(rho, 0.0) ** 2 * variance / left.size / power
    return Dependence(on="itself", share=share, p_value=2.0 * float(stats.norm.sf(z)), slope=rho, words=words)


def _p(share: float, freedom: int, left: Array) -> float:
    """Return the probability that chance explains such a share, by the F distribution.

    What is left over tells how many samples are independent: the error itself may be one slow drift.
    """
    spare = max(effective_samples(left) - freedom - 1.0, 1.0)
    f = max(share, 0.0) / freedom / max((1.0 - share) / spare, 1e-300)
    return float(stats.f.sf(f, freedom, spare))
