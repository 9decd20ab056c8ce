"""Figures of recorded or simulated channels over time, those of one unit in one pair of axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsalog.core.notation import axis_label, unit_of
from vsalog.core.recording import Channel, Recording
from vsalog.figures.chart import Axes, Chart, Curve, OverTime, span_words
from vsalog.figures.decimation import FIGURE_COLUMNS
from vsalog.figures.time_series import TIME


def recorded_chart(title: str, recording: Recording, named: Sequence[tuple[str, Channel]]) -> Chart:
    """Return channels over the time from the recording's first sample on.

    Parameters
    ----------
    title : a few words
    recording : whose channels they are
    named : pairs of a name and its channel
    """
    begin = min((int(c.stamps[0]) for c in recording.channels.values() if c.stamps.size), default=0)
    groups: dict[str, list[Curve]] = {}
    parts = []
    for name, channel in named:
        curves, unit = groups.setdefault(channel.unit or "", []), channel.unit or ""
        over = OverTime(np.asarray((channel.stamps - begin) * 1e-9, np.float64), FIGURE_COLUMNS)
        values = np.asarray(channel.values, np.float64)
        curves.append(over.line(name, values, str(len(curves))))
        parts.append(f"{name} {span_words(values, unit_of(unit).strip())}")
    axes = tuple(Axes(TIME, axis_label("as recorded", unit), tuple(curves)) for unit, curves in groups.items())
    return Chart("recorded", title, f"{'; '.join(parts)}.", axes, linked=True)
