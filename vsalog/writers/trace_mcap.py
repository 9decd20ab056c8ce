"""Writes a trace as a log, for programs that plot logs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vsalog.core.trace import Trace
from vsalog.writers.recording_mcap import write_topics_mcap
from vsalog.writers.recording_topics import Topic, scalar_topic


def write_trace_mcap(traces: Sequence[Trace], path: Path, provenance: dict[str, str]) -> None:
    """Write traces as a log: per joint and transmission one Float64 topic per column that varies over time.

    Raises
    ------
    WriteError
        The stamps do not fit into a ROS log.
    """
    topics: list[Topic] = []
    for joint in dict.fromkeys(t.joint for t in traces):
        whole = Trace.concatenate([t for t in traces if t.joint == joint])
        order = np.argsort(whole.stamps, kind="stable")
        first = np.append(True, np.diff(whole.stamps[order]) > 0)
        rows = order[first]
        for name, columns in whole.transmissions.items():
            for column, values in columns.items():
                if not column.startswith("coefficient_"):
                    topic = "/".join(
                        ("/vsalog", _token(joint), f"transmission_{name}" if name != "total" else name, column)
                    )
                    topics.append(scalar_topic(topic, whole.stamps[rows], np.asarray(values[rows], np.float64)))
    write_topics_mcap(topics, path, metadata={"vsalog.provenance": provenance})


def _token(name: str) -> str:
    """Return a name as ROS allows it in a topic."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
