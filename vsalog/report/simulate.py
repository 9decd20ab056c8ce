"""Documents of `simulate`: scenarios, what was written, and the error of a replay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from vsalog._version import __version__
from vsalog.core.recording import Recording
from vsalog.core.units import shown
from vsalog.estimation.job import sha256
from vsalog.figures.chart import Chart
from vsalog.figures.recorded import recorded_chart
from vsalog.report.document import Document, Figures, Section, Table, Words, provenance
from vsalog.rig.load import Rig, presets
from vsalog.simulation.replay_job import MEASURED, SIMULATED, JointReplay, ReplayJob, position_of, unit_of
from vsalog.simulation.run import Job
from vsalog.simulation.scenario import built_in
from vsalog.simulation.scenario_generic import GENERIC
from vsalog.writers.recording_files import LogFiles


def scenarios_document() -> Document:
    """Return the presets and scenarios that come with vsalog."""
    known = {
        "presets": {name: Rig.preset(name).name for name in presets()},
        "scenarios of the presets": built_in(),
        "scenarios for any rig": GENERIC,
    }
    sections = (Section(title, (Table("", ("", ""), tuple(lines.items()), texts=2),)) for title, lines in known.items())
    return Document("Scenarios", "What can be simulated", tuple(sections))


def written_document(job: Job, recording: Recording, written: bool = True) -> Document:
    """Return what was simulated, and where it was written, if it was."""
    file = job.scenario.file
    begin, end = _where(job.files, written)
    words = (
        f"{begin}{file.duration:g} s at {1.0 / file.period:g} Hz, {len(recording.channels)} channels of"
        f" {', '.join(map(shown, job.rig.joints))}; {job.scenario.where}, seed {job.options.seed}{end}"
    )
    data = _file_data(job.files, written) | {
        "rig": job.rig.name,
        "scenario": file.name,
        "duration": file.duration,
        "rate": 1.0 / file.period,
        "seed": job.options.seed,
        "ideal": job.options.ideal,
        "samples": job.samples,
        "joints": list(job.rig.joints),
        "channels": [
            {"name": c.name, "unit": c.unit, "stream": c.stream, "samples": int(c.stamps.size)}
            for c in recording.channels.values()
        ],
    }
    return Document(f"Simulation of {shown(job.rig.where)}", "", (Words(words),), data)


def written_page(document: Document, recording: Recording, rig: str) -> Document:
    """Return the page of a simulation: what the command prints, its channels over time, and the rig as TOML."""
    chart = recorded_chart("Channels over time", recording, list(recording.channels.items()))
    return _page(document, [chart], [], rig)


def replay_page(document: Document, recording: Recording, rig: str, log: Path) -> Document:
    """Return the page of a replay: what the command prints, each signal as measured and simulated, and the rig as TOML."""
    charts = []
    for name, channel in recording.channels.items():
        simulated = name.replace(MEASURED, SIMULATED, 1)
        if name.startswith(MEASURED) and simulated in recording.channels:
            pair = [("measured", channel), ("simulated", recording.channels[simulated])]
            charts.append(recorded_chart(name.removeprefix(MEASURED).removesuffix(".data"), recording, pair))
    return _page(document, charts, [(f"log {log.name}", f"SHA-256 {sha256(log)}")], rig)


def _page(document: Document, charts: Sequence[Chart], read: Sequence[tuple[str, str]], rig: str) -> Document:
    origin = provenance([*read, ("vsalog", __version__)], rig)
    return replace(document, items=(*document.items, Figures(tuple(charts), "time"), origin))


def _where(files: LogFiles, written: bool) -> tuple[str, str]:
    """Return the beginning and end of a line with the paths of the log and its rig; nothing where none were written."""
    rig = "" if files.rig is None else f"; its rig: {shown(str(files.rig))}"
    return (f"{shown(str(files.log))}: ", rig) if written else ("", "")


def _file_data(files: LogFiles, written: bool) -> dict[str, object]:
    return {
        "log": str(files.log) if written else None,
        "format": files.format if written else None,
        "rig_file": None if files.rig is None or not written else str(files.rig),
    }


def replay_document(job: ReplayJob, joints: Mapping[str, JointReplay], written: bool = True) -> Document:
    """Return what was replayed, what drove it, its error, and where it was written, if it was."""
    begin, end = _where(job.files, written)
    lines = [Words(f"{begin}{shown(job.log.name)} replayed{end}")]
    for name, joint in joints.items():
        drives = ", ".join(_drive(role, how) for role, how in joint.driven.items()) or "nothing"
        begun = "once" if joint.restarts == 1 else f"{joint.restarts} times"
        lines.append(Words(f"  {shown(name)}: driven by {drives}; started {begun} from the measured state"))
        lines += [Words(f"    {role}: {_off(joint, role)}") for role in joint.compared()]
    lines += [Words(f"  {shown(name)}: left out: it {why}") for name, why in job.left_out.items()]
    data = _file_data(job.files, written) | {
        "rig": job.rig.name,
        "replayed": str(job.log),
        "window": job.options.window,
        "joints": {
            name: {
                "samples": len(joint.signals),
                "driven": dict(joint.driven),
                "restarts": joint.restarts,
                "rms_error": {role: joint.error(role)[0] for role in joint.compared()},
                "spread": {role: joint.error(role)[1] for role in joint.compared()},
            }
            for name, joint in joints.items()
        },
        "left_out": dict(job.left_out),
    }
    return Document(f"Replay of {shown(job.log.name)}", "", tuple(lines), data)


def _drive(role: str, how: str) -> str:
    return role if how == "torque" else f"the measured {position_of(role)}"


def _off(joint: JointReplay, role: str) -> str:
    rms, spread = joint.error(role)
    share = f", {100.0 * rms / spread:.2g} % of its standard deviation" if spread > 0.0 else ""
    return f"RMS error {rms:.3g} {unit_of(role)}{share}"
