"""`vsalog warm`: compile the numerical loops ahead."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

if TYPE_CHECKING:
    from vsalog.report.outputs import Outputs

COMMANDS = ("simulate", "estimate", "validate", "diagnose", "compare")
"""Commands with their own loops; the first two provide a log and a model of it."""

# Joints with springs of any kind have the same loops; muscles have more.
RIGS = {"sea": COMMANDS, "pam": ("simulate", "estimate", "compare")}


@click.command(short_help="Compile the numerical loops ahead of the first run.")
@click.argument("commands", nargs=-1, type=click.Choice(COMMANDS), metavar="[COMMAND]...")
@click.option(
    "--preset",
    "presets",
    multiple=True,
    type=click.Choice(list(RIGS)),
    help="Compile what joints like this preset's need: with springs, or with pneumatic muscles; may be repeated. Both when"
    " absent.",
)
def warm(commands: tuple[str, ...], presets: tuple[str, ...]) -> None:
    """Compile what COMMANDs need, all of them when none is named, so that their first run is as fast as any other.

    Numerical loops are compiled for the processor that runs them, once, and kept in a cache; after an update those that changed
    are compiled again. This runs the commands on short simulated logs in a temporary folder. It takes one to two minutes.
    """
    from tempfile import TemporaryDirectory

    from vsalog.core.progress import counted
    from vsalog.report.compiling import where_loops_are
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import console_for

    rigs = {rig: own for rig, own in RIGS.items() if rig in presets or not presets}
    for command in commands:
        if not any(command in own for own in rigs.values()):
            raise click.UsageError(f"nothing is compiled ahead for '{command}' of joints like {', '.join(rigs)}")
    # The later commands need a log, and validate a model.
    needed = {"simulate": ("simulate",), "validate": COMMANDS[:2]}
    asked = {name for command in commands or COMMANDS for name in (command, *needed.get(command, COMMANDS[:1]))}
    with (
        Progress(rigs=False) as progress,
        TemporaryDirectory(prefix="vsalog-") as folder,
        progress.saying_when_compiling(),
    ):
        steps = [(rig, name) for rig, own in rigs.items() for name in own if name in asked]
        runs = {rig: _Runs(rig, Path(folder)) for rig in RIGS}
        for rig, name in counted("warm", steps):
            progress.say(f"{name}: a short log of the preset {rig}")
            getattr(runs[rig], name)()
    loops, kept = progress.loops, f"kept in {where_loops_are()}"
    summary = (
        "every loop was compiled already" if loops is None else f"compiled {loops.count} loops in {loops.seconds:.0f} s"
    )
    console_for("stderr").print(f"{summary}, {kept}", soft_wrap=True)


class _Runs:
    """The commands, run on a short log of one rig."""

    DURATION = 3.0  # [s]: enough for every filter, and for causes to be searched

    def __init__(self, rig: str, folder: Path) -> None:
        self.rig, self.folder, self.log = rig, folder, folder / f"{rig}.mcap"

    @property
    def outputs(self) -> Outputs:
        from vsalog.report.outputs import Outputs

        return Outputs.named([self.log], str(self.folder), None)

    def simulate(self) -> None:
        from vsalog.estimation.live import LiveEstimate
        from vsalog.simulation.run import Options, prepare

        job = prepare(self.rig, Options(duration=self.DURATION, output=str(self.log)))
        job.write(job.run(LiveEstimate))

    def estimate(self) -> None:
        from vsalog.estimation.job import Options, prepare
        from vsalog.report.estimate import write_estimate

        write_estimate(prepare([self.log], Options()), self.outputs)

    def validate(self) -> None:
        from vsalog.validation.run import Options, validate

        validate(self.outputs.model, [self.log], Options(modalities=True))

    def diagnose(self) -> None:
        from vsalog.diagnosis.run import Options, diagnose

        # Without an error no cause would be fitted.
        diagnose([self.log], None, Options(set={f"joint.{self.rig}.link.inertia": "1 kg*m^2"}))

    def compare(self) -> None:
        from vsalog.comparison.run import compare
        from vsalog.estimation.job import Options

        compare([self.log], Options(), [])
