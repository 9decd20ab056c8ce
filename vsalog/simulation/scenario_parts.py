"""The parts of a scenario as functions of time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from vsalog.core.errors import ReadError, RigError, UnitError, did_you_mean
from vsalog.core.units import shown, si_factor
from vsalog.readers import open_reader, read
from vsalog.rig.decode import Path as KeyPath
from vsalog.rig.decode import key_path, refuse
from vsalog.simulation import inputs
from vsalog.simulation.inputs import Signal
from vsalog.simulation.scenario_schema import (
    Chirp,
    Constant,
    Csv,
    Multisine,
    Part,
    Parts,
    RestToRest,
    Sawtooth,
    Sine,
    SoftSquare,
    Square,
    Steps,
    Trapezoid,
)


def sum_of_parts(parts: Parts, unit: str, duration: float, folder: Path, path: KeyPath) -> Signal:
    """Return the sum of parts as a function of time.

    Parameters
    ----------
    parts : their values in SI
    unit : the SI unit of their role
    duration : of the scenario [s]
    folder : that the paths of files are relative to
    path : of the parts' key, for messages

    Raises
    ------
    RigError
        A file cannot be read or has no such column, or its unit does not fit; the message begins with the key.
    """
    signals = [_signal(part, unit, duration, folder, (*path, f"[{i}]")) for i, part in enumerate(parts)]
    return signals[0] if len(signals) == 1 else inputs.sum_of(*signals)


def _signal(part: Part, unit: str, duration: float, folder: Path, path: KeyPath) -> Signal:
    match part:
        case Constant(value=value):
            return inputs.constant(value)
        case Sine(amplitude=a, frequency=f, phase=phase, offset=offset):
            return inputs.sine(a, f, phase, offset)
        case Square(amplitude=a, frequency=f, phase=phase, duty=duty):
            return inputs.square(a, f, phase, duty)
        case SoftSquare(amplitude=a, frequency=f, softness=softness):
            return inputs.soft_square(a, 1.0 / f, softness)
        case Sawtooth(amplitude=a, frequency=f, phase=phase):
            return inputs.sawtooth(a, f, phase)
        case Steps(times=times, values=values, rise=rise):
            return inputs.steps(times, values, rise)
        case Chirp():
            chirp = inputs.linear_chirp if part.sweep == "linear" else inputs.logarithmic_chirp
            over = duration if part.duration is None else part.duration
            return chirp(part.amplitude, part.start_frequency, part.end_frequency, over, part.phase)
        case Multisine():
            return inputs.multisine(part.rms, _lines(part), part.seed if part.phases == "random" else None)
        case Trapezoid(amplitude=a, rise=rise, hold=hold, fall=fall, start=start, period=period):
            return inputs.trapezoid(a, rise, hold, fall, start, period)
        case RestToRest(amplitude=a, rise=rise, start=start):
            return inputs.rest_to_rest(a, rise, start)
        case Csv():
            return _column(part, unit, folder, path)


def _lines(part: Multisine) -> list[float]:
    """Return the frequencies of a multisine; a bound that is a multiple itself is taken along."""
    lowest = part.spacing if part.lowest_frequency is None else part.lowest_frequency
    first = max(1, math.ceil(lowest / part.spacing - 1e-9))
    last = math.floor(part.highest_frequency / part.spacing + 1e-9)
    return [k * part.spacing for k in range(first, last + 1)]


def _column(part: Csv, unit: str, folder: Path, path: KeyPath) -> Signal:
    file = folder / part.file
    try:
        recording = read(file, {part.column}, rate=part.rate)
        channel = recording.channels.get(part.column)
        if channel is None:
            known = open_reader(file, part.rate).catalogue()
            if part.column in known.unread:
                refuse((*path, "column"), f"'{shown(part.column)}' holds no numbers: {known.unread[part.column]}")
            hint = did_you_mean(part.column, known.channels)
            names = ", ".join(map(shown, list(known.channels)[:10])) or "none"
            there = hint or f"; it has {names}"
            refuse((*path, "column"), f"{shown(file.name)} has no column '{shown(part.column)}'{there}")
    except ReadError as error:
        raise RigError(f"{key_path((*path, 'file'))}: {error}") from error
    if recording.streams[channel.stream].time_source == "none":
        refuse((*path, "rate"), f"{shown(file.name)} has no time column: give the 'rate' of its samples")
    if not channel.values.size or not bool(np.isfinite(channel.values).all()):
        refuse((*path, "column"), f"'{shown(part.column)}' has rows without a number, or none at all")
    given = part.unit or channel.unit
    try:
        values = channel.values * (si_factor(given, unit) if given else 1.0)
    except UnitError as error:
        refuse((*path, "unit"), str(error))
    times = (channel.stamps - channel.stamps[0]) * 1e-9
    return inputs.table(times, values, held=part.interpolation == "held")
