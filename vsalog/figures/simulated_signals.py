"""Figures of signals over time: measured, simulated with the original rig, and with the extended one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.notation import axis_label, number, signal_name, unit_of
from vsalog.diagnosis.evidence import JointEvidence, SignalEvidence
from vsalog.figures.chart import Axes, Chart, Curve, OverTime, outline, span_words
from vsalog.figures.decimation import around, gaps_of, one_after_the_other, pause_after, rms
from vsalog.figures.time_series import TIME

Array = NDArray[np.float64]

BEFORE, AFTER = "simulated, original rig", "simulated, extended rig"


@dataclass(frozen=True, slots=True)
class Stretch:
    """The samples of a joint inside the windows.

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
    joint : the evidence to draw
    noise : role → noise floor of its simulation
    columns : of pixels
    """
    stretch = in_windows(joint)
    if stretch.time.size < 2:
        return []
    over = OverTime(stretch.place, columns)
    charts = [_over_time(stretch, role, noise.get(role), over) for role in stretch.signals]
    expanded = _expanded(stretch, noise, columns)
    return charts if expanded is None else [*charts, expanded]


def in_windows(joint: JointEvidence) -> Stretch:
    """Return the samples of the windows and their places: with time between windows, or side by side."""
    known = np.zeros(joint.time.size, dtype=np.bool_)
    for signal in joint.signals.values():
        known |= np.isfinite(signal.measured)
    time = one_after_the_other(joint.time)[known]
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
    """Return some of the samples; a rig that was not extended appears once."""
    before, after = (None if v is None else v[which] for v in (signal.before, signal.after))
    if before is not None and after is not None and np.array_equal(before, after, equal_nan=True):
        after = None
    return SignalEvidence(signal.unit, signal.measured[which], before, after)


def _simulated(over: OverTime, signal: SignalEvidence, less: Array | float = 0.0) -> list[Curve]:
    """Return the simulations, less something."""
    kinds = ((BEFORE, signal.before, "error"), (AFTER, signal.after, "model"))
    return [over.line(name, v - less, c, dashed=name == AFTER) for name, v, c in kinds if v is not None]


def _errors(over: OverTime, signal: SignalEvidence, noise: float | None, shown: set[str]) -> tuple[Curve, ...]:
    """Return simulated − measured over the noise floor; without the labels that are `shown`, which gets the others."""
    curves = _simulated(over, signal, signal.measured)
    if curves and noise:
        curves.insert(0, outline("± 2 × noise floor", over.time[[0, -1]], -2.0 * noise, 2.0 * noise, "truth"))
    once = tuple(replace(c, label="" if c.label in shown else c.label) for c in curves)
    shown |= {c.label for c in curves}
    return once


def _over_time(stretch: Stretch, role: str, noise: float | None, over: OverTime) -> Chart:
    """One signal, and the errors of the simulations."""
    signal, name = stretch.signals[role], signal_name(role)
    unit = unit_of(signal.unit)
    # The measurement is drawn below the simulations.
    curves = (over.line("measured", signal.measured, "measured"), *_simulated(over, signal))
    axes = [Axes(stretch.label, axis_label(name, signal.unit), curves, x_ticks=stretch.ticks)]
    words = f"Measured: {span_words(signal.measured, unit.strip())}."
    errors = _errors(over, signal, noise, {c.label for c in curves})
    if errors:
        axes.append(Axes(stretch.label, axis_label("error", signal.unit), errors, x_ticks=stretch.ticks))
        kinds = (("original rig", signal.before), ("extended rig", signal.after))
        rms_words = [
            f"{number(rms(v - signal.measured))}{unit} with the {label}" for label, v in kinds if v is not None
        ]
        words += f" Simulated − measured, root mean square: {', '.join(rms_words)}"
        words += f"; the noise floor is {number(noise)}{unit}." if noise else "."
    words += " Each window of the simulation begins with the state that fits it best."
    return Chart("simulation", f"{name[:1].upper()}{name[1:]} over time", words, tuple(axes), linked=True)


def _expanded(stretch: Stretch, noise: Mapping[str, float], columns: int) -> Chart | None:
    """The errors of all signals around the largest error of the original rig, every sample of it."""
    worst = worst_place(stretch, noise)
    seen = None if worst is None else around(worst, stretch.time.size, columns)
    if worst is None or seen is None:
        return None
    over, shown = OverTime(stretch.time[seen], columns), set[str]()
    axes = tuple(
        Axes(
            TIME,
            axis_label(f"error of {signal_name(role)}", whole.unit),
            _errors(over, _part(whole, seen), noise.get(role), shown),
        )
        for role, whole in stretch.signals.items()
    )
    words = (
        f"Simulated − measured for {number(float(over.time[-1] - over.time[0]))} s around"
        f" t = {number(float(stretch.time[worst]), 4)} s,"
        " where the error of the simulation with the original rig is largest, in multiples of its noise."
    )
    # Not zoomed with the others: their axes may not be time.
    return Chart("simulation_expanded", "Largest error of the simulation", words, axes, linked=not stretch.ticks)


def worst_place(stretch: Stretch, noise: Mapping[str, float]) -> int | None:
    """Return the sample of the largest error with the original rig; None where there are none."""
    total = np.zeros(stretch.time.size)
    for role, signal in stretch.signals.items():
        if signal.before is None:
            continue
        error = np.nan_to_num(signal.before - signal.measured)
        total += (error / (noise.get(role) or float(np.nanstd(signal.measured)) or 1.0)) ** 2
    return int(np.argmax(total)) if total.any() else None
