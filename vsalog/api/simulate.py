"""`vsalog.simulate`: a simulated rig."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa

from vsalog.api.results import Results, texts, warned
from vsalog.core.errors import SimulationError
from vsalog.core.finding import Finding
from vsalog.core.recording import Channel, Recording
from vsalog.core.units import positive_quantity
from vsalog.estimation.live import LiveEstimate
from vsalog.figures.recorded import recorded_chart
from vsalog.report.document import Document
from vsalog.report.plot import Drawn
from vsalog.report.simulate import replay_document, written_document
from vsalog.rig import Rig
from vsalog.simulation.replay_job import ReplayOptions, prepare_replay
from vsalog.simulation.run import Options, prepare


class Simulation(Results):
    """The recording of a simulated rig's sensors, or a rig's simulation with a log's inputs."""

    def __init__(self, recording: Recording, document: Document, log: Path | None) -> None:
        self._recording, self._said, self._log = recording, document, log

    @property
    def data(self) -> Mapping[str, object]:
        """What ``vsalog simulate --json`` prints."""
        data: Mapping[str, object] = self._said.data
        return data

    @property
    def recording(self) -> Recording:
        """What was recorded, with its rig: `vsalog.estimate` takes it as it takes a log."""
        return self._recording

    @property
    def log(self) -> Path | None:
        """The file that was written; None where none was requested."""
        return self._log

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings."""
        return self._recording.findings

    def _document(self) -> Document:
        return self._said

    def _figures(self) -> Iterator[Drawn]:
        yield Drawn(recorded_chart("As recorded", self._recording, list(self._recording.channels.items())))

    def to_arrow(self) -> pa.Table:
        """Return the recording: a row per stamp, a column per channel, null where a channel has no sample."""
        channels = self._recording.channels
        stamps = np.unique(np.concatenate([c.stamps for c in channels.values()])) if channels else np.zeros(0, np.int64)
        columns = {"stamp": pa.array(stamps)}
        for name, channel in channels.items():
            values = np.full(stamps.size, np.nan)
            there = np.zeros(stamps.size, np.bool_)
            at = np.searchsorted(stamps, channel.stamps)
            values[at], there[at] = channel.values, True
            columns[name] = pa.array(values, mask=~there)
        units = [pa.field(n, c.type, metadata={"unit": _unit(channels.get(n))}) for n, c in columns.items()]
        return pa.Table.from_arrays(list(columns.values()), schema=pa.schema(units))


def _unit(channel: Channel | None) -> str:
    return "ns" if channel is None else channel.unit or ""


def simulate(
    rig: Rig | str | Path | None = None,
    *,
    scenario: str | Path | None = None,
    duration: float | str | None = None,
    rate: float | None = None,
    seed: int = 0,
    replay: str | Path | None = None,
    window: float | str | None = None,
    ideal: bool = False,
    set: Mapping[str, object] | None = None,
    actual: Mapping[str, object] | None = None,
    truth: bool = False,
    output: str | Path | None = None,
) -> Simulation:
    """Simulate a rig, as ``vsalog simulate`` does; a log is written only where `output` names one.

    Parameters
    ----------
    rig : a rig, its file or a preset's name; with `replay` the log's own when absent
    scenario : what drives the joints: a scenario's name or file; the preset's first, or sines that suit the rig, when absent
    duration : [s], or with a unit; the scenario's when absent
    rate : [Hz]; the scenario's when absent; with `replay`, of a table without a time column
    seed : of all noise
    replay : a log whose inputs drive the rig
    window : with `replay`: restart from the measured state every so often, [s] or with a unit
    ideal : sensors without noise, quantisation, jitter and dropped samples
    set : changes to the simulated machine and to the rig in the log
    actual : changes to the simulated machine only
    truth : record the true motion, torques and stiffness too
    output : the log's file, whose suffix sets the format

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    file = None if output is None else str(output)
    if replay is not None:
        if scenario is not None or duration is not None or seed or ideal or truth:
            raise SimulationError("scenario, duration, seed, ideal and truth do nothing with replay; leave them out")
        return _replay(rig, Path(replay), ReplayOptions(_seconds(window), rate, texts(set), texts(actual), file))
    if rig is None:
        raise SimulationError("name a rig, its file or a preset, or a log to replay")
    if window is not None:
        raise SimulationError("window does nothing without replay; leave it out")
    played = None if scenario is None else str(scenario)
    options = Options(played, _seconds(duration), rate, seed, ideal, texts(set), texts(actual), truth, file)
    job = prepare(rig, options)
    recording = job.run(LiveEstimate)
    if output is not None:
        job.write(recording)
    log = None if output is None else job.files.log
    return warned(Simulation(job.with_rig(recording), written_document(job, recording, log is not None), log))


def _replay(rig: Rig | str | Path | None, log: Path, options: ReplayOptions) -> Simulation:
    job = prepare_replay(rig, log, options)
    joints = job.run()
    recording = job.recording(joints)
    if options.output is not None:
        job.write(recording)
    written = None if options.output is None else job.files.log
    return warned(Simulation(job.with_rig(recording), replay_document(job, joints, written is not None), written))


def _seconds(value: float | str | None) -> float | None:
    return None if value is None else positive_quantity(value, "s", "a time longer than zero")
