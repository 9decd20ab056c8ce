"""The figures of signals over time: measured, simulated with the rig as it stands, and with the extended one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.evidence import JointEvidence, SignalEvidence
from vsalog.report.chart import Axes, Chart, Curve
from vsalog.report.decimation import around, decimated, gaps_of, one_after_the_other, pause_after, rms
from vsalog.report.diagnosis_quantities import signal_name, unit_of
from vsalog.report.quantities import number
from vsalog.report.time_series import TIME, span_words

Array = NDArray[np.float64]

BEFORE, AFTER, MEASURED = "simulated, rig as it stands", "simulated, extended rig", "measured"
BAND = "± 2 × noise floor"


@dataclass(frozen=True, slots=True)
class Stretch:
    """The samples of a joint that lie in windows.

    Attributes
    ----------
    time : shape (N,), as the log has it, runs one after the other [s]
    place : shape (N,), where they are drawn [s]
    ticks : of the axis of `place`; plotly's own when empty
    label : of that axis
    signals : role → signal, of shape (N,)
    """

    time: Array
    place: Array
    ticks: tuple[tuple[float, str], ...]
    label: str
    signals: Mapping[str, SignalEvidence]


def signal_charts(joint: JointEvidence, noise: Mapping[str, float], columns: int) -> list[Chart]:
    """Return the figures of a joint's signals.

    Parameters
    ----------
    joint : what is drawn
    noise : role → error that noise alone makes of its simulation
    columns : of pixels
    """
    stretch = in_windows(joint)
    if stretch.time.size < 2:
        return []
    charts = [_over_time(stretch, role, noise.get(role), columns) for role in stretch.signals]
    expanded = _expanded(stretch, noise, columns)
    return charts if expanded is None else [*charts, expanded]


def in_windows(joint: JointEvidence) -> Stretch:
    """Return the samples that windows hold, where they are drawn: with time between windows, side by side."""
    known = np.zeros(joint.time.size, dtype=np.bool_)
    for signal in joint.signals.values():
        known |= np.isfinite(signal.measured)
    whole = one_after_the_other(joint.time)
    time = whole[known]
    signals = {role: _part(signal, known) for role, signal in joint.signals.items()}
    gaps = gaps_of(time)
    if gaps.size == 0:
        return Stretch(time, time, (), TIME, signals)
    steps = np.diff(time, prepend=time[0])
    steps[gaps + 1] = 0.0
    steps[gaps + 1] = pause_after(np.cumsum(steps))
    place = np.cumsum(steps)
    ticks = tuple((float(place[k]), number(float(time[k]), 4)) for k in (0, *(gaps + 1)))
    return Stretch(time, place, ticks, "time [s], windows of the log side by side", signals)


def _part(signal: SignalEvidence, which: NDArray[np.bool_] | slice) -> SignalEvidence:
    before = None if signal.before is None else signal.before[which]
    after = None if signal.after is None else signal.after[which]
    if before is not None and after is not None and np.array_equal(before, after, equal_nan=True):
        after = None
    return SignalEvidence(signal.unit, signal.measured[which], before, after)


def _curves(place: Array, signal: SignalEvidence, columns: int, gaps: NDArray[np.int64]) -> list[Curve]:
    # What was measured lies under what explains it.
    curves = [Curve(MEASURED, *decimated(place, signal.measured, columns, gaps), "measured")]
    if signal.before is not None:
        curves.append(Curve(BEFORE, *decimated(place, signal.before, columns, gaps), "error"))
    if signal.after is not None:
        curves.append(Curve(AFTER, *decimated(place, signal.after, columns, gaps), "model", dashed=True))
    return curves


def _errors(
    place: Array, signal: SignalEvidence, noise: float | None, columns: int, gaps: NDArray[np.int64]
) -> list[Curve]:
    """Simulated − measured, over the noise floor."""
    curves = []
    for values, label, colour in ((signal.before, BEFORE, "error"), (signal.after, AFTER, "model")):
        if values is not None:
            error = values - signal.measured
            x, y = decimated(place, error, columns, gaps)
            curves.append(Curve(label, x, y, colour, dashed=label == AFTER))
    if curves and noise:
        ends, high = place[[0, -1]], 2.0 * noise
        outline = (np.r_[ends, ends[::-1]], np.array([high, high, -high, -high]))
        curves.insert(0, Curve(BAND, *outline, "truth", "area"))
    return curves


def _over_time(stretch: Stretch, role: str, noise: float | None, columns: int) -> Chart:
    """One signal, and how far the simulations are from it."""
    signal, gaps = stretch.signals[role], gaps_of(stretch.place)
    name, unit = signal_name(role), unit_of(signal.unit)
    bracket = f" [{unit.strip()}]" if unit else ""
    curves = tuple(_curves(stretch.place, signal, columns, gaps))
    axes = [Axes(stretch.label, f"{name}{bracket}", curves, x_ticks=stretch.ticks)]
    words = f"Measured: {span_words(signal.measured, unit.strip())}."
    errors = _errors(stretch.place, signal, noise, columns, gaps)
    if errors:
        errors = _labelled_once(errors, {c.label for c in curves})
        axes.append(Axes(stretch.label, f"error{bracket}", tuple(errors), x_ticks=stretch.ticks))
        kinds = (("rig as it stands", signal.before), ("extended rig", signal.after))
        said = [f"{number(rms(v - signal.measured))}{unit} with the {label}" for label, v in kinds if v is not None]
        words += f" Simulated − measured, root mean square: {', '.join(said)}"
        words += f"; noise alone makes {number(noise)}{unit}." if noise else "."
    words += " Each window of the simulation begins with the state that fits it best."
    return Chart("simulation", f"{name[:1].upper()}{name[1:]} over time", words, tuple(axes), linked=True)


def _expanded(stretch: Stretch, noise: Mapping[str, float], columns: int) -> Chart | None:
    """The errors of all signals around the place where the rig as it stands is furthest off, every sample of it."""
    worst = worst_place(stretch, noise)
    seen = None if worst is None else around(worst, stretch.time.size, columns)
    if worst is None or seen is None:
        return None
    time = stretch.time[seen]
    gaps, axes, shown = gaps_of(time), list[Axes](), set[str]()
    for role, whole in stretch.signals.items():
        unit = unit_of(whole.unit).strip()
        name = f"error of {signal_name(role)}"
        curves = _labelled_once(_errors(time, _part(whole, seen), noise.get(role), columns, gaps), shown)
        axes.append(Axes(TIME, f"{name} [{unit}]" if unit else name, tuple(curves)))
    words = (
        f"Simulated − measured for {number(float(time[-1] - time[0]))} s around t = {number(float(stretch.time[worst]), 4)} s,"
        " where the simulation with the rig as it stands is furthest off, in multiples of its noise."
    )
    # Not zoomed with the others: their axes may not be time.
    return Chart("simulation_expanded", "Where the simulation is worst", words, tuple(axes), linked=not stretch.ticks)


def _labelled_once(curves: list[Curve], shown: set[str]) -> list[Curve]:
    """Take the labels off that the legend has already, and note the others."""
    once = [replace(c, label="" if c.label in shown else c.label) for c in curves]
    shown |= {c.label for c in curves}
    return once


def worst_place(stretch: Stretch, noise: Mapping[str, float]) -> int | None:
    """Return the sample at which the simulations with the rig as it stands are furthest off; None where there are none."""
    total = np.zeros(stretch.time.size)
    for role, signal in stretch.signals.items():
        if signal.before is None:
            continue
        error = np.nan_to_num(signal.before - signal.measured)
        total += (error / (noise.get(role) or float(np.nanstd(signal.measured)) or 1.0)) ** 2
    return int(np.argmax(total)) if total.any() else None
