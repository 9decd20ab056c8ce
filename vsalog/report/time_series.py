"""The figures of a report over time, out of the evidence: torque, its expanded view, stiffness, convergence."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from vsalog.report.chart import Axes, Chart, Curve
from vsalog.report.decimation import around, band, decimated, extent, gaps_of, rms, spans
from vsalog.report.quantities import number
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TIME = "time [s]"
TORQUE, STIFFNESS, DEFLECTION = "torque [N·m]", "stiffness [N·m/rad]", "deflection φ [rad]"
MEASURED = {
    "sensor": "torque sensor",
    "residual": "residual of the motor equation",
    "nominal": "nominal model of the rig",
    "model": "nominal model of the rig",
    "integrated": "motor equation",
    "truth": "simulator's truth",
}


def measured_name(part: TransmissionEvidence) -> str:
    """Return what the torque was held against, in words."""
    return MEASURED.get(part.measured_by, "measured")


def span_words(values: Array, unit: str) -> str:
    """Return the range of values in words; where there is none, that."""
    low, high, _ = extent(values)
    if low > high:
        return "nothing that is known"
    return f"{number(low)} to {number(high)} {unit}".rstrip()


def torque_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart:
    """Torque measured against predicted over time, and their difference."""
    gaps = gaps_of(joint.time)
    curves = list(_torques(joint.time, part, columns, gaps))
    words = f"The model's torque runs from {span_words(part.predicted, 'N·m')}"
    axes = [Axes(TIME, TORQUE, tuple(curves), _shaded(joint, part, columns), _shade_words(joint))]
    if part.measured is not None:
        error = part.predicted - part.measured
        x, y = decimated(joint.time, error, columns, gaps)
        axes.append(Axes(TIME, "error [N·m]", (Curve("model − measured", x, y, "error"),), axes[0].spans))
        words += (
            f"; the {measured_name(part)} from {span_words(part.measured, 'N·m')}. They differ by"
            f" {number(rms(error))} N·m (root mean square), at most by {number(_largest(error))} N·m"
        )
    return Chart("torque", "Torque over time", f"{words}.{_share_words(joint, part)}", tuple(axes), linked=True)


def expanded_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart | None:
    """The stretch around the largest error, every sample of it."""
    if part.measured is None:
        return None
    error = np.abs(part.predicted - part.measured)
    judged = np.isfinite(error) & part.inside
    if not judged.any():
        judged = np.isfinite(error)
    if not judged.any():
        return None
    worst = int(np.argmax(np.where(judged, error, -1.0)))
    seen = around(worst, joint.time.size, columns)
    if seen is None:
        return None
    time = joint.time[seen]
    cut = TransmissionEvidence(
        part.deflection[seen], part.predicted[seen], part.predicted_std[seen], part.measured[seen], part.measured_by,
        part.stiffness[seen], part.stiffness_std[seen], None, part.inside[seen],
    )  # fmt: skip
    small = JointEvidence(
        joint.joint, time, None, "", {}, None, {}, None if joint.excited is None else joint.excited[seen]
    )
    curves = tuple(_torques(time, cut, columns, gaps_of(time)))
    words = (
        f"{number(float(time[-1] - time[0]))} s around t = {number(float(joint.time[worst]), 4)} s, where the error is largest"
        f" ({number(float(error[worst]))} N·m)."
    )
    axes = Axes(TIME, TORQUE, curves, _shaded(small, cut, columns), _shade_words(joint))
    return Chart("torque_expanded", "Torque, expanded view", words, (axes,))


def stiffness_chart(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> Chart:
    """Stiffness with twice its standard deviation, and the truth where there is one."""
    gaps = gaps_of(joint.time)
    known = _excited(part)
    sigma = part.stiffness[known]
    shown = _within(part.stiffness, sigma, 0.4)
    within = 2.0 * part.stiffness_std
    x, y = band(joint.time, shown - within, shown + within, columns, gaps)
    if sigma.size:
        # Before anything is known the band is as wide as the prior: it must not squeeze the rest.
        least, most = float(sigma.min()), float(sigma.max())
        room = 0.4 * max(most - least, 0.5 * max(abs(least), abs(most)))
        y = np.clip(y, least - room, most + room)
    curves = [
        Curve("± 2 standard deviations", x, y, "model", "area"),
        Curve("stiffness", *decimated(joint.time, shown, columns, gaps), "model"),
    ]
    where = (
        ", where the model was fitted,"
        if joint.excited is None and sigma.size < np.isfinite(part.stiffness).sum()
        else ""
    )
    words = f"The stiffness runs{where} from {span_words(sigma, 'N·m/rad')}"
    std = part.stiffness_std[known]
    if np.isfinite(std).any():
        words += f", with a standard deviation of {number(float(np.nanmedian(std)))} N·m/rad (median)"
    if part.true_stiffness is not None:
        curves.append(
            Curve("true stiffness", *decimated(joint.time, part.true_stiffness, columns, gaps), "truth", dashed=True)
        )
        error = (part.stiffness - part.true_stiffness)[known]
        covered = np.abs(error) <= 2.0 * std
        words += (
            f". The true one runs from {span_words(part.true_stiffness[known], 'N·m/rad')}; the difference is"
            f" {number(rms(error))} N·m/rad (root mean square)"
        )
        if np.isfinite(std).any():
            words += f", and the band holds the truth for {number(100.0 * float(covered.mean()))} % of the time"
    axes = Axes(TIME, STIFFNESS, tuple(curves), _shaded(joint, part, columns), _shade_words(joint))
    return Chart("stiffness", "Stiffness over time", f"{words}.{_share_words(joint, part)}", (axes,))


def convergence_charts(joint: JointEvidence, columns: int) -> list[Chart]:
    """An estimate's parameters over time; those of the same unit (the text in brackets) in one pair of axes."""
    gaps = gaps_of(joint.time)
    groups: dict[str, list[tuple[float, str, Array, Array]]] = {}
    for name in joint.convergence:
        values = joint.convergence[name]
        label, unit = _split(name)
        known = values[np.isfinite(values)]
        if known.size:
            settled = known[known.size // 20 :]
            curve = decimated(joint.time, _within(values, settled), columns, gaps)
            groups.setdefault(unit, []).append((float(known[-1]), label, *curve))
    axes, said = [], []
    for unit, found in groups.items():
        curves = tuple(Curve(label, x, y, str(i)) for i, (_, label, x, y) in enumerate(found))
        axes.append(Axes(TIME, f"parameter [{unit}]", curves))
        said += [f"{label} {number(last)} {unit}".strip() for last, label, _, _ in found]
    if not axes:
        return []
    words = f"The estimator's parameters while it learns; at the end: {', '.join(said)}."
    return [Chart("convergence", "Convergence of the parameters", words, tuple(axes), linked=True)]


def _split(name: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", name)
    return (found[1], found[2]) if found else (name, "")


def _within(values: Array, known: Array, share: float = 1.0) -> Array:
    """Leave out what lies far off the range of what is known: the first guesses of a recursion."""
    low, high, _ = extent(known)
    if low > high:
        return values
    room = share * max(high - low, 0.5 * max(abs(low), abs(high)))
    return np.where((values >= low - room) & (values <= high + room), values, np.nan)


def _torques(time: Array, part: TransmissionEvidence, columns: int, gaps: NDArray[np.int64]) -> list[Curve]:
    curves = []
    if np.isfinite(part.predicted_std).any():
        low, high = part.predicted - 2.0 * part.predicted_std, part.predicted + 2.0 * part.predicted_std
        curves.append(Curve("± 2 standard deviations", *band(time, low, high, columns, gaps), "model", "area"))
    if part.measured is not None:
        curves.append(Curve(measured_name(part), *decimated(time, part.measured, columns, gaps), "measured"))
    curves.append(Curve("model", *decimated(time, part.predicted, columns, gaps), "model", dashed=True))
    return curves


def _excited(part: TransmissionEvidence) -> Flags:
    known = np.isfinite(part.stiffness)
    return known & part.inside if bool((known & part.inside).any()) else known


def _shaded(joint: JointEvidence, part: TransmissionEvidence, columns: int) -> tuple[tuple[float, float], ...]:
    """Stretches that excite no estimate, or that the model extrapolates into; unknown samples are neither."""
    out = ~part.inside & np.isfinite(part.stiffness)
    return tuple(spans(joint.time, out, min(columns, 200))) if joint.time.size else ()


def _shade_words(joint: JointEvidence) -> str:
    return "outside the model's region" if joint.excited is None else "not excited so far"


def _share_words(joint: JointEvidence, part: TransmissionEvidence) -> str:
    known = np.isfinite(part.stiffness)
    share = float((~part.inside)[known].mean()) if known.any() else 0.0
    if share == 0.0:
        return ""
    return f" Shaded: {_shade_words(joint)}, {number(100.0 * share)} % of the time."


def _largest(values: Array) -> float:
    low, high, _ = extent(values)
    return max(abs(low), abs(high)) if low <= high else float("nan")
