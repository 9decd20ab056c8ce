"""Figures of the error: its distribution, and its dependence on deflection, set-point and speed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.notation import number
from vsalog.core.resolution import spread_over
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence
from vsalog.figures.characteristic import NODES, setpoint_label
from vsalog.figures.chart import Axes, Chart, Curve, strokes
from vsalog.figures.decimation import gaps_of
from vsalog.figures.equation_residuals import bins_for
from vsalog.figures.time_series import DEFLECTION, TIME
from vsalog.validation.document import Figure
from vsalog.validation.scores import bins_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ERROR = "error [N·m]"


def error_charts(joint: JointEvidence, part: TransmissionEvidence) -> list[Chart]:
    """Distribution and dependence of model − measured, of the samples inside the region where there are any."""
    if part.measured is None:
        return []
    error = part.predicted - part.measured
    known = np.isfinite(error)
    use = known & part.inside
    if not known.any():
        return []
    where = "that are excited" if joint.excited is not None else "inside the region"
    of = f"of the samples {where}"
    if not use.any():
        use, of = known, f"of all samples, none of them {where}"
    few = spread_over(np.flatnonzero(use))
    return [_distribution(error[use], of), _dependence(joint, part, few, error[few], of)]


def _distribution(error: Array, of: str) -> Chart:
    mean, std = float(error.mean()), float(error.std())
    few = spread_over(error)
    low, high = np.quantile(few, [0.001, 0.999])
    if high <= low:
        low, high = mean - 1e-12, mean + 1e-12
    density, edges = np.histogram(few, bins=bins_for(few.size), range=(float(low), float(high)))
    density = density / (few.size * (edges[1] - edges[0]))
    x = np.linspace(float(low), float(high), NODES)
    curves = [Curve("error", 0.5 * (edges[:-1] + edges[1:]), density, "error", "bars", width=np.diff(edges))]
    if std > 0.0:
        bell = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
        curves.append(Curve("normal of the same standard deviation", x, bell, "model"))
    shares = (np.arange(NODES) + 0.5) / NODES
    normal = special.ndtri(shares)
    quantiles = (
        Curve("", normal, mean + std * normal, "model"),
        Curve("", normal, np.quantile(few, shares), "error", "points"),
    )
    kurtosis = float(np.mean(((few - few.mean()) / few.std()) ** 4)) - 3.0 if few.std() > 0.0 else 0.0
    tails = "heavier than" if kurtosis > 1.0 else "lighter than" if kurtosis < -0.5 else "about as heavy as"
    quarter, three = (number(float(np.quantile(few, share))) for share in (0.25, 0.75))
    words = (
        f"The error {of}: mean {number(mean)} N·m, standard deviation {number(std)} N·m, half of it between {quarter} and"
        f" {three} N·m. On the right its quantiles over those of a normal distribution, a straight line if it is one; its tails"
        f" are {tails} a normal one's."
    )
    axes = (
        Axes("error, model − measured [N·m]", "density [1/(N·m)]", tuple(curves)),
        Axes("quantile of the normal distribution", "quantile of the error [N·m]", quantiles),
    )
    return Chart("error_distribution", "Distribution of the error", words, axes, side_by_side=True)


def _dependence(joint: JointEvidence, part: TransmissionEvidence, few: Indices, error: Array, of: str) -> Chart:
    """The error over each variable, both of some samples only."""
    panels: list[Axes] = []
    ranges: list[str] = []
    for name, label, x in _variables(joint, part, few):
        both = np.isfinite(x)
        if not both.any() or np.ptp(x[both]) == 0.0:
            continue
        bins = bins_of(error[both], x[both])
        middle = np.array([0.5 * (b.low + b.high) for b in bins])
        width = np.array([b.high - b.low for b in bins])
        rmse, bias = ([getattr(b, kind) for b in bins] for kind in ("rmse", "bias"))
        roots = np.array([figure.value for figure in rmse])
        labels = ("", "", "") if panels else ("root mean square", "mean", "their 95 % intervals")
        curves = (
            Curve(labels[0], middle, roots, "error", "bars", width=width),
            Curve(labels[1], middle, np.array([figure.value for figure in bias]), "measured", "marked"),
            _intervals(middle, rmse, labels[2]),
            _intervals(middle, bias, ""),
        )
        panels.append(Axes(label, ERROR, curves))
        ranges.append(f"over the {name} its root mean square is {number(roots.min())} to {number(roots.max())} N·m")
    words = f"The error {of}, in intervals with equally many samples: {'; '.join(ranges)}."
    return Chart("error_dependence", "What the error depends on", words, tuple(panels), side_by_side=True)


def _variables(joint: JointEvidence, part: TransmissionEvidence, few: Indices) -> Iterator[tuple[str, str, Array]]:
    """Yield what the error may depend on: name, axis label and values of some samples."""
    moves = np.isfinite(part.deflection).any()
    if moves:
        yield "deflection", DEFLECTION, part.deflection[few]
    if joint.setpoint is not None:
        yield "set-point", setpoint_label(joint), joint.setpoint[few]
    if moves:
        yield "speed of the deflection", "speed dφ/dt [rad/s]", _rate(joint.time, part.deflection, few)
    elif joint.setpoint is None:
        yield "time", TIME, joint.time[few]


def _intervals(x: Array, figures: Sequence[Figure], label: str) -> Curve:
    """Return 95 % intervals as upright lines."""
    low, high = (np.array([getattr(f, end) for f in figures], dtype=np.float64) for end in ("low", "high"))
    return Curve(label, np.repeat(x, 3), strokes(low, high), "model")


def _rate(time: Array, phi: Array, at: Indices) -> Array:
    """Differentiate at some of the samples, but not across gaps."""
    if time.size < 3:
        return np.full(at.shape, np.nan)
    at = np.clip(at, 1, time.size - 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = (phi[at + 1] - phi[at - 1]) / (time[at + 1] - time[at - 1])
    gaps = gaps_of(time)
    rate[np.isin(at, gaps) | np.isin(at, gaps + 1)] = np.nan
    return np.asarray(np.where(np.isfinite(rate), rate, np.nan))
