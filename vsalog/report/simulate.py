"""What `simulate` says: scenarios on stdout, what was written on stderr or as JSON."""

from __future__ import annotations

import json

from rich.console import Console
from rich.markup import escape

from vsalog.core.recording import Recording
from vsalog.core.units import shown
from vsalog.report.console import console_for_stdout
from vsalog.rig.load import Rig, presets
from vsalog.simulation.run import Job
from vsalog.simulation.scenario import built_in
from vsalog.simulation.scenario_generic import GENERIC


def print_scenarios() -> None:
    """List the presets and scenarios that come with vsalog."""
    console = console_for_stdout()
    for title, entries in (
        ("presets", {name: Rig.preset(name).name for name in presets()}),
        ("scenarios of the presets", built_in()),
        ("scenarios for any rig", GENERIC),
    ):
        console.print(title)
        width = max(map(len, entries))
        for name, text in entries.items():
            console.print(f"  {name.ljust(width)}  {text}", soft_wrap=True)


def say_written(job: Job, recording: Recording) -> None:
    """Say on stderr what was written, and what to do with it."""
    file = job.scenario.file
    joints = ", ".join(map(shown, job.rig.joints))
    log = shown(str(job.files.log))
    rig = "" if job.files.rig is None else f"; its rig: {shown(str(job.files.rig))}"
    Console(stderr=True).print(
        escape(
            f"{log}: {file.duration:g} s at {1.0 / file.period:g} Hz, {len(recording.channels)} channels of {joints};"
            f" {job.scenario.where}, seed {job.options.seed}{rig}"
        ),
        soft_wrap=True,
        highlight=False,
    )


def as_document(job: Job, recording: Recording) -> str:
    """Return what was written as JSON."""
    file = job.scenario.file
    return json.dumps(
        {
            "log": str(job.files.log),
            "format": job.files.format,
            "rig_file": None if job.files.rig is None else str(job.files.rig),
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
        },
        indent=2,
    )
