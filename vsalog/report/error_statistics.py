"""The figures of the error: how it is distributed, and what it is over deflection, set-point and speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.resolution import spread_over
from vsalog.report.characteristic import NODES, setpoint_label
from vsalog.report.chart import Axes, Chart, Curve
from vsalog.report.decimation import gaps_of
from vsalog.report.equation_residuals import bins_for
from vsalog.report.quantities import number
from vsalog.report.time_series import DEFLECTION
from vsalog.validation.document import Figure
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence
from vsalog.validation.scores import bins_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ERROR = "error [N·m]"


def error_charts(joint: JointEvidence, part: TransmissionEvidence) -> list[Chart]:
    """Distribution and dependence of model − measured, of the samples inside the region where there are any."""
    if part.measured is None:
        return []
    error = part.predicted - part.measured
    known = np.isfinite(error)
    inside = known & part.inside
    where = "that are excited" if joint.excited is not None else "inside the region"
    if not known.any():
        return []
    use, of = (inside, f"of the samples {where}") if inside.any() else (known, f"of all samples, none of them {where}")
    return [_distribution(error[use], of), _dependence(joint, part, error, use, of)]


def _distribution(error: Array, of: str) -> Chart:
    mean, std = float(error.mean()), float(error.std())
    few = spread_over(error)
    low, high = np.quantile(few, [0.001, 0.999])
    if high <= low:
        low, high = mean - 1e-12, mean + 1e-12
    counts, edges = np.histogram(few, bins=bins_for(few.size), range=(float(low), float(high)))
    density = counts / (few.size * (edges[1] - edges[0]))
    x = np.linspace(float(low), float(high), NODES)
    shares = (np.arange(NODES) + 0.5) / NODES
    normal = special.ndtri(shares)
    bars = Curve("error", 0.5 * (edges[:-1] + edges[1:]), density, "error", "bars", width=np.diff(edges))
    curves = [bars]
    if std > 0.0:
        curves.append(
            Curve(
                "normal of the same spread",
                x,
                np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2.0 * np.pi)),
                "model",
            )
        )
    quantiles = (
        Curve("", normal, mean + std * normal, "model"),
        Curve("", normal, np.quantile(few, shares), "error", "points"),
    )
    kurtosis = float(np.mean(((few - few.mean()) / few.std()) ** 4)) - 3.0 if few.std() > 0.0 else 0.0
    tails = "heavier than" if kurtosis > 1.0 else "lighter than" if kurtosis < -0.5 else "about as heavy as"
    words = (
        f"The error {of}: mean {number(mean)} N·m, standard deviation {number(std)} N·m, half of them between"
        f" {number(float(np.quantile(few, 0.25)))} and {number(float(np.quantile(few, 0.75)))} N·m. On the right its"
        f" quantiles over those of a normal distribution, a straight line if it is one; its tails are {tails} a normal one's."
    )
    axes = (
        Axes("error, model − measured [N·m]", "density [1/(N·m)]", tuple(curves)),
        Axes("quantile of the normal distribution", "quantile of the error [N·m]", quantiles),
    )
    return Chart("error_distribution", "Distribution of the error", words, axes, side_by_side=True)


def _dependence(joint: JointEvidence, part: TransmissionEvidence, error: Array, use: Flags, of: str) -> Chart:
    few = np.flatnonzero(use)
    few = spread_over(few)
    error = error[few]
    variables: list[tuple[str, str, Array]] = []
    if np.isfinite(part.deflection).any():
        variables.append(("deflection", DEFLECTION, part.deflection[few]))
        variables.append(("speed of the deflection", "speed dφ/dt [rad/s]", _rate(joint.time, part.deflection, few)))
    if joint.setpoint is not None:
        variables.insert(1, ("set-point", setpoint_label(joint), joint.setpoint[few]))
    if not variables:
        variables.append(("time", "time [s]", joint.time[few]))
    panels: list[Axes] = []
    said: list[str] = []
    for name, label, x in variables:
        both = np.isfinite(x)
        if not both.any() or np.ptp(x[both]) == 0.0:
            continue
        bins = bins_of(error[both], x[both])
        middle = np.array([0.5 * (b.low + b.high) for b in bins])
        width = np.array([b.high - b.low for b in bins])
        rmse, bias = np.array([b.rmse.value for b in bins]), np.array([b.bias.value for b in bins])
        first = not panels
        panels.append(
            Axes(
                label,
                ERROR,
                (
                    Curve("root mean square" if first else "", middle, rmse, "error", "bars", width=width),
                    Curve("mean" if first else "", middle, bias, "measured", "marked"),
                    _whiskers(middle, [b.rmse for b in bins], "their 95 % intervals" if first else ""),
                    _whiskers(middle, [b.bias for b in bins], ""),
                ),
            )
        )
        said.append(f"over the {name} its root mean square is {number(rmse.min())} to {number(rmse.max())} N·m")
    words = f"The error {of}, in intervals that hold equally many of them: {'; '.join(said)}."
    return Chart("error_dependence", "What the error depends on", words, tuple(panels), side_by_side=True)


def _whiskers(x: Array, figures: Sequence[Figure], label: str) -> Curve:
    """Return 95 % intervals as upright lines with NaN between them."""
    ends = np.array([(f.low, f.high, np.nan) for f in figures], dtype=np.float64)
    return Curve(label, np.repeat(x, 3), ends.ravel(), "model")


def _rate(time: Array, phi: Array, at: NDArray[np.int64]) -> Array:
    """Differentiate at some of the samples, but not across gaps."""
    if time.size < 3:
        return np.full(at.shape, np.nan)
    at = np.clip(at, 1, time.size - 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = (phi[at + 1] - phi[at - 1]) / (time[at + 1] - time[at - 1])
    gaps = gaps_of(time)
    rate[np.isin(at, gaps) | np.isin(at, gaps + 1)] = np.nan
    return np.asarray(np.where(np.isfinite(rate), rate, np.nan))
