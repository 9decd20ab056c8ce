"""The equations of a joint, linearised in all numbers that the catalogue's causes change: the model that sets are sought in.

About the rig, r(δ) ≈ r₀ + J δ with one group of columns per cause and shape. The columns are made of noisy channels: what noise
alone adds to JᵀJ and Jᵀr is measured on channels with noise added again and subtracted (errors in variables; Fuller 1987,
Measurement Error Models, §2.2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING
from vsalog.core.progress import counted
from vsalog.diagnosis.causes.base import Parameter, Remainder, Setting, Site
from vsalog.diagnosis.priors import deviation_of
from vsalog.diagnosis.subsets import SAME_SCORE, Candidates
from vsalog.residuals.per_log import PerLog, each
from vsalog.residuals.sensing import earlier
from vsalog.residuals.system import BELL, System

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]
# Causes with the values of all their parameters.
Placed = Sequence[tuple[Site, Array]]

# Prior probability that a cause of the catalogue is present at a part [1]: a few of some dozens are.
PRESENT = 0.1


@dataclass(frozen=True, slots=True)
class Variant:
    """A cause with a shape to begin with; its other numbers change the equations in proportion.

    Attributes
    ----------
    site : of the catalogue
    base, moved : values of all parameters between which each column is a difference; `moved` has shape (k, parameters)
    free : indices of the parameters that are unknowns, k of them
    rig : value of each unknown when the cause is absent
    deviation : prior standard deviation of each unknown
    price : −log of its prior odds
    inside : whether it is in the fit that the equations are linearised about
    instead : cause and part of the fit in whose place it is looked at with the same strengths, as another shape of the same cause
        or a simpler one of its family; none where it is looked at with no strength
    """

    site: Site
    base: Array
    moved: Array
    free: tuple[int, ...]
    rig: Array
    deviation: Array
    price: float
    inside: bool
    instead: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class Unknowns:
    """The unknowns of a linear model, in units of their prior deviations, from the rig.

    Attributes
    ----------
    variants : the groups of unknowns
    first : shape (G + 1,), where each group begins
    now : shape (p,), δ of the fit that the equations are linearised about
    """

    variants: tuple[Variant, ...]
    first: Integers
    now: Array


@dataclass(frozen=True, slots=True)
class Linear(Unknowns):
    """r(δ) ≈ residual + columns · δ.

    Attributes
    ----------
    residual : shape (R, m), averaged equations of the rig, extrapolated from the fit
    columns : shape (R, m, p)
    noise_columns, noise_residual : shape (K, …), what further draws of noise add to them
    """

    residual: Array
    columns: Array
    noise_columns: Array
    noise_residual: Array

    @property
    def unknowns(self) -> Unknowns:
        """Return what is unknown, without the equations, which are large."""
        return Unknowns(self.variants, self.first, self.now)


def variants_of(
    sites: Sequence[Site], setting: Setting, left: Remainder | None, fit: Placed, stated: Mapping[str, float]
) -> list[Variant]:
    """Return the variants of all causes: those of the fit as they are, the others at each shape that their search begins with.

    Parameters
    ----------
    sites : of the catalogue
    setting : of the joint and its log
    left : the residual of the fit, for causes that look where to begin; none where all sites are in the fit
    fit : causes with their values
    stated : tolerances of the rig, see `priors`
    """
    known = {(site.key, len(site.parameters)): values for site, values in fit}
    out = []
    functions = sum(site.added is not None for site in sites)
    for site in sites:
        values = known.get((site.key, len(site.parameters)))
        deviation = np.array([_deviation(site, p, setting, stated) for p in site.parameters])
        if not deviation.all():
            continue  # the rig knows it exactly
        # What is in every set costs less than any log determines, as far as scores resolve sums of it.
        given = -0.25 * SAME_SCORE / float(np.finfo(np.float64).eps)
        price = given if site.given else float(np.log((1.0 - PRESENT) / PRESENT))
        if site.transient:
            # It may happen anywhere, and two bells are the shortest that averages show.
            price += float(np.log(max(setting.duration / (2.0 * BELL), 1.0)))
        if site.added is not None:
            price += float(np.log(functions))
        if values is not None:
            out.append(_inside(site, values, deviation, price))
            continue
        assert left is not None or site.starts is None
        starts = site.starts(left) if site.starts and left is not None else [site.start]
        price += float(np.log(max(len(starts), 1)))
        kin = next(((s, v) for s, v in fit if _stands_for(site, s)), None)
        if kin is not None:
            own = {p.name: v for p, v in zip(kin[0].parameters, kin[1], strict=True)}
            begun = {tuple(own.get(p.name, v) for p, v in zip(site.parameters, s, strict=True)) for s in starts}
            out += [
                replace(_outside(site, np.array(s), deviation, price), base=np.array(s), instead=kin[0].key)
                for s in sorted(begun)
            ]
            continue
        out += [_outside(site, np.array(start, dtype=np.float64), deviation, price) for start in starts]
    return out


def _stands_for(site: Site, other: Site) -> bool:
    """Return whether a cause is looked at with another's strengths: in another shape, or as the simpler one of a family."""
    strengths = {p.name for p in site.parameters if not p.shape}
    simpler = site.parts == other.parts and clash(site, other) and strengths <= {p.name for p in other.parameters}
    return site.key == other.key or simpler


def _deviation(site: Site, parameter: Parameter, setting: Setting, stated: Mapping[str, float]) -> float:
    """Return a parameter's prior deviation; a shape may be as far off as one step of a fit may go."""
    if not site.named:
        return 1.0
    if not parameter.shape:
        return deviation_of(site, parameter, setting, stated)
    return parameter.reach if np.isfinite(parameter.reach) else parameter.high - parameter.low


def _inside(site: Site, values: Array, deviation: Array, price: float) -> Variant:
    """Return a cause of the fit: all of its numbers are unknowns, and its shape is held near where it is."""
    moved = np.repeat(values[None, :], values.size, axis=0)
    rig = values.copy()
    for i, p in enumerate(site.parameters):
        moved[i, i] += -p.step if values[i] + p.step > p.high else p.step
        if not p.shape:
            rig[i] = p.start
    return Variant(site, values, moved, tuple(range(values.size)), rig, deviation, price, True)


def _outside(site: Site, start: Array, deviation: Array, price: float) -> Variant:
    """Return a cause that is not in the fit, with its shape as it begins: its strengths are the unknowns."""
    free = tuple(i for i, p in enumerate(site.parameters) if not p.shape)
    rig = np.array([p.start for p in site.parameters])
    base = np.where([p.shape for p in site.parameters], start, rig)
    moved = np.repeat(base[None, :], len(free), axis=0)
    for k, i in enumerate(free):
        step = site.parameters[i].step
        # Where a strength begins is far enough for an effect with corners, as a gap.
        moved[k, i] = start[i] if abs(start[i] - base[i]) > step else base[i] + step
    own = list(free)
    return Variant(site, base, moved, free, rig[own], deviation[own], price, False)


def linearised(
    system: System, joint: Any, fit: Placed, variants: Sequence[Variant], here: Array | None = None
) -> Linear:
    """Linearise the equations about a fit.

    Parameters
    ----------
    system : of the log
    joint : of the rig
    fit : causes with their values
    variants : see `variants_of`
    here : the equations of the fit, where they are known; see `formed_of`
    """
    whole = system.whole_delays(placed(joint, fit))

    def formed(causes: Placed) -> Array:
        return formed_of(system, joint, causes, whole)

    here = formed(fit) if here is None else here
    columns, first, now = columns_of(joint, fit, variants, here, formed, lambda site: site.added)
    residual = here - columns @ now
    columns[1:] -= columns[0]
    return Linear(tuple(variants), first, now, residual[0], columns[0], columns[1:], residual[1:] - residual[0])


def columns_of(
    joint: Any,
    fit: Placed,
    variants: Sequence[Variant],
    here: Array,
    formed: Callable[[Placed], Array],
    added: Callable[[Site], Any],
    each: Callable[..., Iterable[Any]] = map,
) -> tuple[Array, Integers, Array]:
    """Return what all unknowns change in a log, where each group of them begins, and their values in the fit.

    Parameters
    ----------
    joint : of the rig
    fit : causes with their values
    variants : see `variants_of`
    here : shape (…), of the fit
    formed : causes → shape (…); what is not finite cannot be formed: it changes nothing, and is not chosen for it
    added : unknown function → what it adds, shape (…, k)
    each : maps the variants

    Returns
    -------
    Shapes (…, p), (G + 1,) and (p,)
    """
    as_fitted = placed(joint, fit)

    def made(variant: Variant) -> Array:
        if variant.site.added is not None:
            return np.asarray(added(variant.site))
        without = set_in(fit, variant.site, variant.base)
        if variant.instead:
            return formed(without) - here
        # A cause that is absent mostly leaves the joint as it is.
        base = here if variant.inside or placed(joint, without) == as_fitted else formed(without)
        out = np.zeros((*here.shape, len(variant.free)))
        for k, i in enumerate(variant.free):
            by = (variant.moved[k, i] - variant.base[i]) / variant.deviation[k]
            there = (formed(set_in(fit, variant.site, variant.moved[k])) - base) / by
            if np.isfinite(there).all():
                out[..., k] = there
        return out

    first = np.concatenate([[0], np.cumsum([len(v.free) for v in variants])]).astype(np.int64)
    columns, now, changes = np.empty((*here.shape, int(first[-1]))), np.zeros(int(first[-1])), dict[int, Array]()
    found = zip(variants, each(made, variants), strict=True)
    for g, (variant, own) in enumerate(counted("equations", found, len(variants))):
        if variant.instead:
            changes[g] = own
            continue
        columns[..., first[g] : first[g + 1]] = own
        if variant.inside:
            now[first[g] : first[g + 1]] = (variant.base[list(variant.free)] - variant.rig) / variant.deviation
    for g, change in changes.items():
        columns[..., first[g] : first[g + 1]] = _exchanged(variants, first, columns, now, g, change)
    return columns, first, now


def with_unknowns(
    variants: Iterable[Variant], unknowns: Array, limited: bool = False
) -> tuple[tuple[Site, Array], ...]:
    """Return causes with the values of their unknowns, within bounds; limited, no farther than one step may go."""
    out, j = [], 0
    for variant in variants:
        values = variant.base.copy()
        for k, i in enumerate(variant.free):
            p = variant.site.parameters[i]
            step = variant.rig[k] + unknowns[j] * variant.deviation[k] - values[i]
            values[i] = np.clip(values[i] + (np.clip(step, -p.reach, p.reach) if limited else step), p.low, p.high)
            j += 1
        out.append((variant.site, values))
    return tuple(out)


def carried(linear: Linear, fit: Placed, here: Array) -> Linear:
    """Return a linear model of a set's own causes at other values of theirs, with the same columns.

    Parameters
    ----------
    linear : about other values
    fit : the causes with their values
    here : the equations of the fit, see `formed_of`
    """
    variants, now = [], []
    for v, (_, values) in zip(linear.variants, fit, strict=True):
        rig = np.where([p.shape for p in v.site.parameters], values, v.rig)
        variants.append(replace(v, base=values, moved=values + (v.moved - v.base), rig=rig))
        now.append((values - rig) / v.deviation)
    away = np.concatenate(now)
    residual = here - np.concatenate([linear.columns[None], linear.columns + linear.noise_columns]) @ away
    return replace(
        linear, variants=tuple(variants), residual=residual[0], noise_residual=residual[1:] - residual[0], now=away
    )


def _exchanged(
    variants: Sequence[Variant], first: Integers, columns: Array, now: Array, group: int, change: Array
) -> Array:
    """Return the columns of a cause in the place of one of the fit, such that it makes the change with the fit's strengths.

    Parameters
    ----------
    variants, first, columns, now : see `Linear`; the columns of the fit's own causes are known
    group : index of the variant
    change : shape (…), what it changes in place of the one of the fit
    """
    variant = variants[group]
    g = next(i for i, v in enumerate(variants) if v.inside and v.site.key == variant.instead)
    own = variants[g]
    at = {own.site.parameters[i].name: int(first[g]) + k for k, i in enumerate(own.free)}
    places = [at.get(variant.site.parameters[i].name) for i in variant.free]
    out = np.stack([np.zeros_like(change) if j is None else columns[..., j] for j in places], axis=-1)
    strengths = np.array([0.0 if j is None else now[j] for j in places])
    strongest = int(np.argmax(np.abs(strengths)))
    if strengths[strongest] == 0.0 or not np.isfinite(change).all():
        return np.zeros_like(out)
    # What only the other has goes with it.
    gone = [j for j in at.values() if j not in places]
    out[..., strongest] += (change + columns[..., gone] @ now[gone]) / strengths[strongest]
    return np.asarray(out)


@dataclass(frozen=True, slots=True)
class Corrected:
    """Normal equations of a linear model, corrected for the noise in its columns.

    With b = −Jᵀr and A = JᵀJ less the noise's own share of both, b is about A δ with covariance V = JᵀJ: noise in the columns
    makes b uncertain though it has no information on δ. So the information is A V⁻¹ A and the score A V⁻¹ b (Söderström 2007,
    Automatica 43(6), generalised instrumental variables): those of the columns J V⁻¹ A, which are what columns without noise are
    expected to be (regression calibration, Carroll et al. 2006, Measurement Error in Nonlinear Models, §4).

    Attributes
    ----------
    columns : shape (n, p), J
    gradients : shape (n, p), what each row adds to b
    calibration : shape (p, p), V⁻¹ A
    """

    columns: Array
    gradients: Array
    calibration: Array


def corrected(linear: Linear, system: System, chosen: NDArray[np.bool_] | slice = slice(None)) -> Corrected:
    """Return the normal equations of some unknowns, all by default, under a system's weights."""
    J, r = whitened_columns(linear.columns, system)[:, chosen], system.white(linear.residual).ravel()
    V, gradients, count = J.T @ J, -J * r[:, None], len(linear.noise_columns)
    noise = np.zeros_like(V)
    for columns, residual in zip(linear.noise_columns, linear.noise_residual, strict=True):
        Jn, rn = whitened_columns(columns, system)[:, chosen], system.white(residual).ravel()
        noise += Jn.T @ Jn / count
        gradients += Jn * rn[:, None] / count
    # In units of columns and noise together nothing is large: a column may be no more than rounding where its noise is not.
    size = np.sqrt(np.diag(V + noise))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh((V + noise) * np.outer(scale, scale))
    # Columns are differences of equations: what is smaller is rounding.
    kept = values > ROUNDING * max(values.max(initial=0.0), 1e-300)
    W = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    share, own = np.linalg.eigh(W.T @ V @ W)  # of the columns in both
    # What is not noise is between none and all of the columns.
    more = share > 0.5
    part = np.minimum(2.0 - 1.0 / share[more], 1.0)
    X = W @ own[:, more] / np.sqrt(share[more])  # Xᵀ V X = 1, Xᵀ A X = part
    return Corrected(J, gradients, (X * part) @ (V @ X).T)


def candidates_of(linear: Linear, system: System) -> Candidates:
    """Return the groups of a linear model for the search, under a system's weights."""
    found = corrected(linear, system)
    calibrated = found.columns @ found.calibration
    information, score = calibrated.T @ calibrated, found.calibration.T @ found.gradients.sum(axis=0)
    variants, first = linear.variants, linear.first
    bounds = [
        (p.low - v.rig[k], p.high - v.rig[k]) / v.deviation[k]
        for v in variants
        for k, p in enumerate(v.site.parameters[i] for i in v.free)
    ]
    low, high = np.array(bounds).reshape(-1, 2).T
    price = np.array([v.price for v in variants])
    conflict = np.array([[clash(a.site, b.site) for b in variants] for a in variants], dtype=np.bool_).reshape(
        len(variants), len(variants)
    )
    np.fill_diagonal(conflict, False)
    return Candidates(information, score, first, price, conflict, low, high)


def whitened_columns(columns: Array, system: System) -> Array:
    """Return columns, shape (R, m, p), divided by their noise, shape (n, p)."""
    out = np.zeros_like(columns)
    for pattern, whitener in system.whiteners.items():
        own = system.pattern == pattern
        out[own] = whitener @ columns[own]
    return out.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])


def formed_of(system: System, joint: Any, fit: Placed, whole: Mapping[str, int] | None = None) -> Array:
    """Return the averaged equations of a system and of each copy that carries noise once more, shape (1 + K, R, m).

    Causes and unknown functions are put in. Noise is the same whenever it comes, so what it adds is looked at without the whole
    samples of delays. Otherwise two fits would differ by other draws of it: some parts in a hundred of their deviance.

    Parameters
    ----------
    system, joint, fit : of the log
    whole : of the delays, see `sensing.whole_delays`; those of the fit when absent
    """
    there = placed(joint, fit)
    here = system.averaged(there)
    whole = system.whole_delays(there) if whole is None else whole
    if whole:
        near = each(there, lambda one: earlier(one, whole, system.channels.period))
        base = system.averaged(near)
        rows = np.stack([here, *(here + copy.averaged(near) - base for copy in system.noisy)])
    else:
        rows = np.stack([here, *(copy.averaged(there) for copy in system.noisy)])
    for site, values in fit:
        if site.added is not None:
            rows += site.added @ values
    return rows


def placed(joint: Any, fit: Placed) -> Any:
    """Return a joint with causes put in: a joint for each log where one of them differs from log to log."""
    for site, values in fit:
        if site.log is None:
            joint = site.apply(joint, values.tolist())
    count = next((site.log[1] for site, _ in fit if site.log is not None), 0)
    if not count:
        return joint
    joints = [joint] * count
    for site, values in fit:
        if site.log is not None:
            joints[site.log[0]] = site.apply(joints[site.log[0]], values.tolist())
    return PerLog(tuple(joints))


def set_in(fit: Placed, site: Site, values: Array) -> Placed:
    """Return a fit with a cause in it, in the place of those that it excludes."""
    if any(s.key == site.key for s, _ in fit):
        return [(site, values) if s.key == site.key else (s, v) for s, v in fit]
    return [*((s, v) for s, v in fit if not clash(s, site)), (site, values)]


def clash(one: Site, other: Site) -> bool:
    """Return whether two causes cannot be in one set: variants of one, or members of a family at one part."""
    if not one.parts & other.parts or (one.log is not None and other.log is not None and one.log != other.log):
        return False
    return one.cause == other.cause or other.cause in one.excludes or one.cause in other.excludes
