"""Figures of torque over deflection: characteristic curve or surface with the data on it, and its slices."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.model import JointModel, TransmissionModel
from vsalog.core.notation import number
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence
from vsalog.figures.chart import TWO_STD, Axes, Chart, Curve, Surface, outline, points, span_words
from vsalog.figures.decimation import FIGURE_COLUMNS, extent, scattered
from vsalog.figures.time_series import DEFLECTION, STIFFNESS, TORQUE, measured_name, outside_name

Array = NDArray[np.float64]

# Places per dimension at which a characteristic is evaluated: a surface has as many points as the longest line of a figure.
NODES = math.isqrt(4 * FIGURE_COLUMNS)


def characteristic_charts(joint: JointEvidence, name: str, part: TransmissionEvidence) -> Iterator[Chart]:
    """Yield torque over deflection, and where there is a set-point that moves the surface and its slices."""
    if not np.isfinite(part.deflection).any():
        return
    model, setpoint = joint.model, joint.setpoint
    fitted = None if model is None else next((t for t in model.transmission if t.name == name), None)
    moving = setpoint is not None and _span(setpoint) > 0.0
    yield _over_deflection(joint, part, fitted, moving)
    if setpoint is not None and moving and fitted is not None and len(fitted.region) > 2 and len(fitted.region[0]) > 1:
        yield _surface(joint, part, setpoint, fitted)
        yield _slices(joint, part, setpoint, fitted)


def stiffness_surface_chart(joint: JointEvidence, name: str, part: TransmissionEvidence) -> Chart | None:
    """Return the stiffness over deflection and set-point, by the model where it was fitted, else as the trace has it.

    None where there is no set-point, or it never moves.
    """
    if joint.setpoint is None or _span(joint.setpoint) <= 0.0 or not np.isfinite(part.deflection).any():
        return None
    fitted = None if joint.model is None else next((t for t in joint.model.transmission if t.name == name), None)
    if joint.model is not None and fitted is not None and len(fitted.region) > 2 and len(fitted.region[0]) > 1:
        P, setpoint, C = _grid(np.array(fitted.region))
        z, source = joint.model.stiffness(fitted.name, P.ravel(), C.ravel())[0].reshape(P.shape), "by the model"
    else:
        P, setpoint, z = _means(joint.setpoint, part)
        source = "means of the estimates"
    at = scattered(part.deflection, joint.setpoint)
    at = at[part.inside[at] & np.isfinite(part.stiffness[at])]
    data = np.column_stack([part.deflection[at], joint.setpoint[at], part.stiffness[at]])
    words = f"The stiffness ({source}) over deflection and set-point, {span_words(z.ravel(), 'N·m/rad')}, where it is excited"
    surface = Surface(P, setpoint, z, data, DEFLECTION, setpoint_label(joint), STIFFNESS, flat=True)
    return Chart("stiffness_surface", "Characteristic surface: stiffness", f"{words}.", surface=surface)


def _means(recorded: Array, part: TransmissionEvidence) -> tuple[Array, Array, Array]:
    """Return deflection (M, M), set-point (M,) and mean stiffness (M, M) of the excited samples, NaN in cells without one."""
    known = part.inside & np.isfinite(part.stiffness) & np.isfinite(part.deflection) & np.isfinite(recorded)
    phi, c = part.deflection[known], recorded[known]
    # As many cells as leave some samples to each: the histogram's rule of the cube root, in both dimensions.
    cells = max(2, min(NODES, round(phi.size ** (1 / 3))))
    count, low, high = np.histogram2d(c, phi, cells) if phi.size else (np.zeros((2, 2)), np.arange(3.0), np.arange(3.0))
    total = np.histogram2d(c, phi, [low, high], weights=part.stiffness[known])[0]
    middles = [0.5 * (edges[1:] + edges[:-1]) for edges in (low, high)]
    z = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    return np.tile(middles[1], (len(middles[0]), 1)), middles[0], z


def setpoint_label(joint: JointEvidence) -> str:
    """Return the set-point's axis label."""
    unit = joint.setpoint_unit if joint.setpoint_unit in ("m", "rad") else ""
    return f"set-point [{unit}]" if unit else "set-point"


def _data(part: TransmissionEvidence) -> tuple[Array, str]:
    return (part.predicted, "model") if part.measured is None else (part.measured, measured_name(part))


def _over_deflection(
    joint: JointEvidence, part: TransmissionEvidence, fitted: TransmissionModel | None, moving: bool
) -> Chart:
    torque, label = _data(part)
    shade = joint.setpoint if moving else None
    learnt = part.inside if joint.excited is not None else np.ones_like(part.inside)
    curves = [points(label, part.deflection[learnt], torque[learnt], shade=None if shade is None else shade[learnt])]
    if np.isfinite(torque[~learnt]).any():
        curves.insert(0, points(outside_name(joint), part.deflection[~learnt], torque[~learnt], "error"))
    words = f"Torque ({label}) over a deflection from {span_words(part.deflection, 'rad')}"
    if not moving and joint.model is not None and fitted is not None and fitted.region:
        ends = np.array([p[0] for p in fitted.region])
        phi = np.linspace(float(ends.min()), float(ends.max()), NODES)
        fixed = None if joint.setpoint is None else np.full(NODES, float(np.nanmedian(joint.setpoint)))
        for curve in _model_curves(joint.model, fitted.name, phi, fixed):
            curves = [curve, *curves] if curve.kind == "area" else [*curves, curve]
        words += ", and the model's characteristic with twice its standard deviation where it was fitted"
    if shade is not None:
        words += f"; the colour is the set-point, {span_words(shade, joint.setpoint_unit)}"
    axes = Axes(DEFLECTION, TORQUE, tuple(curves), shade_label="" if shade is None else setpoint_label(joint))
    return Chart("torque_over_deflection", "Torque over deflection", f"{words}.", (axes,))


def _model_curves(model: JointModel, name: str, phi: Array, setpoint: Array | None) -> list[Curve]:
    """The model with its band, once per branch where loading and unloading differ."""
    at = setpoint if model.basis.has_setpoint else None
    curves = []
    branches = ((True, "model, loading"), (False, "model, unloading")) if model.basis.branches else ((True, "model"),)
    for i, (loading, label) in enumerate(branches):
        torque, std = model.flexibility_torque(name, phi, at, np.full(phi.shape, loading))
        curves.append(outline(TWO_STD if i == 0 else "", phi, torque - 2 * std, torque + 2 * std))
        curves.append(Curve(label, phi, torque, "model", dashed=not loading))
    return curves


def _surface(joint: JointEvidence, part: TransmissionEvidence, recorded: Array, fitted: TransmissionModel) -> Chart:
    assert joint.model is not None
    torque, label = _data(part)
    region = np.array(fitted.region)
    P, setpoint, C = _grid(region)
    z = joint.model.flexibility_torque(fitted.name, P.ravel(), C.ravel())[0].reshape(P.shape)
    # One sample per cell of (φ, set-point): the data must cover the surface as the log does.
    at = scattered(part.deflection, recorded)
    at = at[np.isfinite(torque[at])]
    data = np.column_stack([part.deflection[at], recorded[at], torque[at]])
    words = (
        f"The model's torque over deflection ({span_words(region[:, 0], 'rad')}) and set-point"
        f" ({span_words(region[:, 1], joint.setpoint_unit)}), {span_words(z.ravel(), 'N·m')}, inside the region it was fitted in;"
        f" points are the log's data ({label})."
    )
    surface = Surface(P, setpoint, z, data, DEFLECTION, setpoint_label(joint), TORQUE)
    return Chart("surface", "Characteristic surface", words, surface=surface)


def _grid(region: Array) -> tuple[Array, Array, Array]:
    """Return deflection (M, M), set-point (M,) and set-point (M, M) that fill a region of vertices (φ, set-point)."""
    setpoint = np.linspace(region[:, 1].min(), region[:, 1].max(), NODES)
    # Each row of the grid reaches from edge to edge of the region, which keeps its outline smooth.
    P = np.array([np.linspace(*_reach(region, float(c)), NODES) for c in setpoint])
    return P, setpoint, np.repeat(setpoint[:, None], NODES, axis=1)


def _slices(joint: JointEvidence, part: TransmissionEvidence, setpoint: Array, fitted: TransmissionModel) -> Chart:
    """The surface at three set-points, with the data that was recorded near each."""
    model, (torque, label), region = joint.model, _data(part), np.array(fitted.region)
    assert model is not None
    known = np.isfinite(torque) & np.isfinite(part.deflection) & np.isfinite(setpoint)
    # Where there are data: a set-point that is switched between values has none in between.
    values = setpoint[known] if known.any() else region[:, 1]
    width = _span(setpoint) / (NODES - 1)  # up to the surface's next lines
    panels: list[Axes] = []
    slopes: list[str] = []
    unit = f" {joint.setpoint_unit}".rstrip()
    for c in _apart(values):
        ends = _reach(region, c)
        if ends[0] == ends[1]:
            continue
        near = known & (np.abs(setpoint - c) <= width)
        phi = np.linspace(*ends, NODES)
        curves = _model_curves(model, fitted.name, phi, np.full(NODES, c))
        curves.insert(1, points(label, part.deflection[near], torque[near]))
        if panels:
            curves = [replace(curve, label="") for curve in curves]
        # The label is on the axis: the slice's name must not cover the data.
        panels.append(Axes(f"φ [rad] at {number(c)}{unit}", TORQUE, tuple(curves)))
        stiffness = float(model.stiffness(fitted.name, [float(np.mean(phi))], [c])[0][0])
        slopes.append(f"{number(stiffness)} N·m/rad at {number(c)}{unit}")
    words = f"Slices of the surface at fixed set-points, with data from within {number(width, 2)}{unit}"
    if slopes:
        words += f". Slope in the middle: {', '.join(slopes)}"
    return Chart("slices", "Slices of the surface", f"{words}.", tuple(panels), side_by_side=True)


def _apart(values: Array) -> list[float]:
    """Return three set-points that occur, spread evenly over their range as far as they do."""
    wanted = values.min() + np.array([0.1, 0.5, 0.9]) * np.ptp(values)
    return [float(c) for c in np.unique([values[np.abs(values - w).argmin()] for w in wanted])]


def _reach(region: Array, c: float) -> tuple[float, float]:
    """Return least and greatest deflection of a region, a convex polygon, at a set-point within it."""
    met = []
    for (x0, c0), (x1, c1) in zip(region, np.roll(region, -1, axis=0), strict=True):
        if min(c0, c1) <= c <= max(c0, c1):
            met += [x0, x1] if c0 == c1 else [x0 + (c - c0) / (c1 - c0) * (x1 - x0)]
    return (float(min(met)), float(max(met))) if met else (0.0, 0.0)


def _span(values: Array) -> float:
    low, high, _ = extent(values)
    return max(high - low, 0.0)
