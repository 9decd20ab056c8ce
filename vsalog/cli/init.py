"""`vsalog init`: a rig file for a log."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli.options import LogPath, reading_options


@click.command(short_help="Write a rig file with the guesses filled in and the gaps marked.")
@click.argument("log", type=LogPath())
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file, not to stdout."
)
@click.option("--force", is_flag=True, help="Overwrite the output file if it is there.")
@click.option("--preset", metavar="NAME", help="Start from this preset and take only the channels from the log.")
@reading_options
def init(
    log: Path,
    output: Path | None,
    force: bool,
    preset: str | None,
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
) -> None:
    """Guess a rig file for LOG: which joints it holds and which channel plays which role.

    Each guess stands with its confidence and why; what the log does not tell stands as a comment to fill in. The result
    loads as it is: `vsalog init exp1.mcap > rig.toml`, look it over, then `vsalog estimate exp1.mcap`.
    """
    from vsalog.core.errors import RigError
    from vsalog.readers import read
    from vsalog.report.inspect import init_document
    from vsalog.report.outputs import keep_inputs, require_new
    from vsalog.report.terminal import console_for, print_document
    from vsalog.rig.guess import guess_roles
    from vsalog.rig.load import Rig, preset_text
    from vsalog.rig.template import preset_template, rig_template
    from vsalog.writers.atomic import write_text

    require_new(output, force)
    if output is not None:
        keep_inputs([output], [log, *(log.iterdir() if log.is_dir() else ())])
    if preset is not None:
        preset_text(preset)  # a name mistyped is reported before a long log is read
    recording = read(log, None, time, rate, start, end)
    guess = guess_roles(recording)
    if preset is None and not guess.joints:
        raise RigError(
            f"{log.name}: no channel looks like a joint's position or deflection; 'vsalog inspect {log.name}' lists them,"
            " and 'vsalog init --preset NAME' writes a rig to fill in by hand"
        )
    text = rig_template(recording, guess) if preset is None else preset_template(recording, guess, preset)
    Rig.from_toml(text, "the guessed rig")  # what is handed over must load
    if output is None:
        click.echo(text, nl=False)
    else:
        write_text(output, text)
    print_document(init_document(guess, log.name, output), console_for("stderr"))
