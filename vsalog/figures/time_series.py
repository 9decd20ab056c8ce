"""Figures over time: torque, its expanded view, stiffness by one or several estimators, convergence of parameters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.notation import number, term_name, unit_text
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence
from vsalog.figures.chart import TWO_STD, Axes, Chart, Curve, OverTime, span_words
from vsalog.figures.decimation import FIGURE_COLUMNS, around, extent, rms, spans

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Evidence = TypeVar("Evidence", JointEvidence, TransmissionEvidence)

TIME = "time [s]"
TORQUE, STIFFNESS, DEFLECTION = "torque [N·m]", "stiffness [N·m/rad]", "deflection φ [rad]"
MEASURED = {
    "sensor": "torque sensor",
    "residual": "residual of the motor equation",
    "nominal": "nominal model of the rig",
    "model": "nominal model of the rig",
    "integrated": "motor equation",
    "combined": "torque from sensor, motor or link",
    "external": "link equation",
    "states": "estimated states",
    "truth": "simulator's truth",
}


def measured_name(part: TransmissionEvidence) -> str:
    """Return the reference of the torque, in words."""
    return MEASURED.get(part.measured_by, "measured")


def torque_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart:
    """Torque measured against predicted over time, and their difference."""
    axes = [_torque_axes(joint, part, columns)]
    words = f"The model's torque runs from {span_words(part.predicted, 'N·m')}"
    if part.measured is not None:
        error = part.predicted - part.measured
        curve = OverTime(joint.time, columns).line("model − measured", error, "error")
        axes.append(Axes(TIME, "error [N·m]", (curve,), axes[0].spans))
        low, high, root = extent(error)
        words += (
            f"; the {measured_name(part)} from {span_words(part.measured, 'N·m')}. They differ by {number(root)} N·m"
            f" (root mean square), at most by {number(max(abs(low), abs(high)))} N·m"
        )
    return Chart("torque", "Torque over time", f"{words}.{_share_words(joint, part)}", tuple(axes), linked=True)


def expanded_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart | None:
    """The stretch around the largest error, every sample of it; none without a measurement, or where all is drawn anyway."""
    if part.measured is None:
        return None
    error = np.abs(part.predicted - part.measured)
    known = np.isfinite(error)
    judged = known & part.inside if (known & part.inside).any() else known
    worst = int(np.argmax(np.where(judged, error, -1.0)))
    seen = around(worst, joint.time.size, columns)
    if seen is None or not known.any():
        return None
    axes = _torque_axes(cut(joint, seen), cut(part, seen), columns)
    time = joint.time[seen]
    words = (
        f"{number(float(time[-1] - time[0]))} s around t = {number(float(joint.time[worst]), 4)} s, where the error is largest"
        f" ({number(float(error[worst]))} N·m)."
    )
    return Chart("torque_expanded", "Torque, expanded view", words, (axes,))


def cut(evidence: Evidence, seen: slice) -> Evidence:
    """Return evidence of some of the samples."""
    whole: dict[str, Any] = {f.name: getattr(evidence, f.name) for f in fields(evidence)}
    part: dict[str, Any] = {name: v[seen] if isinstance(v, np.ndarray) else v for name, v in whole.items()}
    return type(evidence)(**part)


def stiffness_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart:
    """Stiffness with twice its standard deviation, and the truth where there is one."""
    over, known = OverTime(joint.time, columns), np.isfinite(part.stiffness)
    everywhere = np.count_nonzero(known)
    known = known & part.inside if (known & part.inside).any() else known
    sigma, std = part.stiffness[known], part.stiffness_std[known]
    shown = _near(part.stiffness, sigma, 0.4)
    area = over.band(TWO_STD, shown - 2.0 * part.stiffness_std, shown + 2.0 * part.stiffness_std)
    if sigma.size:
        # Initially the band is as wide as the prior: it must not determine the scale.
        area = replace(area, y=np.clip(area.y, *_around(sigma, 0.4)))
    curves = [area, over.line("stiffness", shown)]
    where = ", where the model was fitted," if joint.excited is None and sigma.size < everywhere else ""
    words = f"The stiffness runs{where} from {span_words(sigma, 'N·m/rad')}"
    has_std = bool(np.isfinite(std).any())
    if has_std:
        words += f", with a standard deviation of {number(float(np.nanmedian(std)))} N·m/rad (median)"
    if part.true_stiffness is not None:
        curves.append(over.line("true stiffness", part.true_stiffness, "truth", dashed=True))
        error = (part.stiffness - part.true_stiffness)[known]
        words += (
            f". The true one runs from {span_words(part.true_stiffness[known], 'N·m/rad')}; the difference is"
            f" {number(rms(error))} N·m/rad (root mean square)"
        )
        if has_std:
            covered = 100.0 * float((np.abs(error) <= 2.0 * std).mean())
            words += f", and the band contains the truth for {number(covered)} % of the time"
    y_range = _stiffness_range(part, known)
    axes = Axes(TIME, STIFFNESS, tuple(curves), *_shaded(joint, part, columns), y_range=y_range)
    return Chart("stiffness", "Stiffness over time", f"{words}.{_share_words(joint, part)}", (axes,))


def _stiffness_range(part: TransmissionEvidence, known: Flags) -> tuple[float, float] | None:
    """Return the stiffness, and the truth, where it is known, with 98 % of its band there; None where it is one number.

    Elsewhere the band is as wide as the prior, which would make the stiffness a flat line.
    """
    band = np.concatenate([part.stiffness[known] + s * 2.0 * part.stiffness_std[known] for s in (-1.0, 1.0)])
    band = band[np.isfinite(band)]
    shown = [part.stiffness[known], np.quantile(band, (0.01, 0.99)) if band.size else band]
    if part.true_stiffness is not None:
        shown.append(part.true_stiffness[known])
    low, high, _ = extent(np.concatenate(shown))
    room = 0.05 * (high - low)  # matplotlib's own margin
    return (low - room, high + room) if low < high else None


def with_deviation(chart: Chart, joint: JointEvidence, part: TransmissionEvidence, lines: float) -> Chart:
    """Return a stiffness's figure with its standard deviation below, where its band is too narrow to be seen.

    Parameters
    ----------
    chart : of `stiffness_chart`
    joint, part : what it draws
    lines : that fit above one another into the axes
    """
    known = np.isfinite(part.stiffness) & np.isfinite(part.stiffness_std)
    known = known & part.inside if (known & part.inside).any() else known
    if not known.any() or 4.0 * float(np.median(part.stiffness_std[known])) * lines > np.ptp(part.stiffness[known]):
        return chart
    std = np.where(known, part.stiffness_std, np.nan)
    curve = OverTime(joint.time, FIGURE_COLUMNS).line("standard deviation", std, "error")
    return replace(chart, axes=(*chart.axes, Axes(TIME, "std [N·m/rad]", (curve,), chart.axes[0].spans)), linked=True)


def stiffnesses_chart(title: str, lines: Iterable[tuple[str, str, Array, Array]], columns: int) -> Chart:
    """One stiffness by several estimators.

    Parameters
    ----------
    title : of the transmission
    lines : name, colour, time and stiffness [N·m/rad] of each, the last two of shape (N,); the truth is dashed
    columns : of pixels
    """
    curves, ranges = [], []
    for label, colour, time, values in lines:
        is_true = colour == "truth"
        curves.append(OverTime(time, columns).line(label, values, colour, dashed=is_true))
        ranges.append(f"{'the truth' if is_true else label} {span_words(values, 'N·m/rad')}")
    words = f"{title}: the stiffness by every estimator, where it is excited: {'; '.join(ranges)}."
    return Chart("stiffness", "Stiffness by all estimators", words, (Axes(TIME, STIFFNESS, tuple(curves)),))


def convergence_charts(joint: JointEvidence, columns: int) -> list[Chart]:
    """An estimate's parameters over time; those of the same unit in one pair of axes."""
    over = OverTime(joint.time, columns)
    several = len({parameter.transmission for parameter in joint.convergence}) > 1
    groups: dict[str, list[Curve]] = {}
    last_values: dict[str, list[str]] = {}
    for parameter in joint.convergence:
        values, unit = joint.convergence[parameter], unit_text(parameter.unit)
        label = f"{parameter.transmission}: {term_name(parameter.name)}" if several else term_name(parameter.name)
        known = values[np.isfinite(values)]
        if known.size:
            curves = groups.setdefault(unit, [])
            curves.append(over.line(label, _near(values, known[known.size // 20 :]), str(len(curves))))
            last_values.setdefault(unit, []).append(f"{label} {number(float(known[-1]))} {unit}".strip())
    if not groups:
        return []
    axes = tuple(Axes(TIME, f"parameter [{unit}]", tuple(curves)) for unit, curves in groups.items())
    last = ", ".join(text for texts in last_values.values() for text in texts)
    words = f"The estimator's parameters over time; at the end: {last}."
    return [Chart("convergence", "Convergence of the parameters", words, axes, linked=True)]


def _around(known: Array, share: float) -> tuple[float, float]:
    """Return the range of the known values, wider by this share of it on either side; all numbers where none is known."""
    low, high, _ = extent(known)
    if low > high:
        return -np.inf, np.inf
    room = share * max(high - low, 0.5 * max(abs(low), abs(high)))
    return low - room, high + room


def _near(values: Array, known: Array, share: float = 1.0) -> Array:
    """Leave out values far outside the known range: the first guesses of a recursion."""
    low, high = _around(known, share)
    return np.where((values >= low) & (values <= high), values, np.nan)


def _torque_axes(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Axes:
    over, curves = OverTime(joint.time, columns), []
    if np.isfinite(part.predicted_std).any():
        half = 2.0 * part.predicted_std
        curves.append(over.band(TWO_STD, part.predicted - half, part.predicted + half))
    if part.measured is not None:
        curves.append(over.line(measured_name(part), part.measured, "measured"))
    curves.append(over.line("model", part.predicted, dashed=True))
    return Axes(TIME, TORQUE, tuple(curves), *_shaded(joint, part, columns))


def _shaded(
    joint: JointEvidence, part: TransmissionEvidence, columns: int
) -> tuple[tuple[tuple[float, float], ...], str]:
    """Return stretches that excite no estimate, or where the model extrapolates, and their name; unknown samples are none."""
    out = ~part.inside & np.isfinite(part.stiffness)
    return tuple(spans(joint.time, out, min(columns, 200))), outside_name(joint)


def outside_name(joint: JointEvidence) -> str:
    """Return the name of samples that are not excited, or outside the region that a model was fitted in."""
    return "outside the model's region" if joint.excited is None else "not excited so far"


def _share_words(joint: JointEvidence, part: TransmissionEvidence) -> str:
    known = np.isfinite(part.stiffness)
    share = float((~part.inside)[known].mean()) if known.any() else 0.0
    return f" Shaded: {outside_name(joint)}, {number(100.0 * share)} % of the time." if share > 0.0 else ""
