"""`vsalog init`: a rig file for a log."""

from __future__ import annotations

import math
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import LogPath, reading_options

if TYPE_CHECKING:
    from vsalog.core.recording import Recording
    from vsalog.rig.guess_gaps import Gap
    from vsalog.rig.guess_types import Guess


@click.command(short_help="Write a rig file with the guesses filled in and the gaps marked.")
@click.argument("log", type=LogPath())
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file, not to stdout."
)
@click.option("--force", is_flag=True, help="Overwrite the output file if it is there.")
@click.option(
    "--ask",
    is_flag=True,
    help="Ask on the terminal for what no log contains: counts per turn, side of the gear, gear ratio, torque constant, signs.",
)
@click.option(
    "--preset",
    metavar="NAME",
    help="Start from this preset and take only the channels from the log.",
    shell_complete=complete.names(complete.presets),
)
@reading_options
def init(
    log: Path,
    output: Path | None,
    force: bool,
    ask: bool,
    preset: str | None,
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
) -> None:
    """Guess a rig file for LOG: which joints it holds and which channel plays which role.

    Each guess comes with its confidence and reason; what the log does not contain becomes a comment to fill in, or a question
    with --ask. The result loads as it is, and init names the command that can use it: `vsalog init exp1.mcap > rig.toml`, check
    it, then `vsalog estimate exp1.mcap`. Encoders in counts are refused until the counts per turn are known.
    """
    from vsalog.core.errors import RigError
    from vsalog.core.printable import command
    from vsalog.readers import read
    from vsalog.report.inspect import init_document
    from vsalog.report.outputs import keep_inputs, require_new
    from vsalog.report.terminal import console_for, print_document, print_findings
    from vsalog.report.verbosity import Verbosity, verbosity
    from vsalog.rig.guess import LEAST_CHANNELS, guess_roles, or_unknown
    from vsalog.rig.load import Rig, preset_text
    from vsalog.rig.template import channels_lacking, preset_template, rig_template
    from vsalog.writers.atomic import write_text

    if ask and preset is not None:
        raise click.UsageError("--ask fills the gaps of a guess, and a preset has none: leave one of them out")
    if ask and not sys.stdin.isatty():
        raise click.UsageError(
            "--ask needs a terminal, and stdin is none: leave it out, and fill the gaps in the rig file"
        )
    require_new(output, force)
    if output is not None:
        keep_inputs([output], [log, *(log.iterdir() if log.is_dir() else ())])
    if preset is not None:
        preset_text(preset)  # a mistyped name is reported before a long log is read
    recording = read(log, None, time, rate, start, end)
    guess = guess_roles(recording)
    guess = or_unknown(guess, recording) if preset is None else guess
    if preset is None and not guess.joints:
        raise RigError(
            f"{log.name}: no channel looks like a joint's position or deflection, and fewer than {LEAST_CHANNELS} move;"
            f" '{command('inspect', log)}' lists them"
        )
    guess, answers = _ask(guess, recording) if ask else (guess, {})
    text = rig_template(recording, guess, answers) if preset is None else preset_template(recording, guess, preset)
    rig = Rig.from_toml(text, "the guessed rig")  # what is handed over must load
    lacking = [] if preset is None else list(channels_lacking(rig, recording))
    if output is None:
        click.echo(text, nl=False)
    else:
        write_text(output, text)
    given = {"--rate": rate, "--time": None if time == "auto" else time, "--start": start, "--end": end}
    reading = [str(word) for option, value in given.items() if value is not None for word in (option, value)]
    document = init_document(guess, log, output, answers, preset, lacking, reading)
    if verbosity() == Verbosity.QUIET:
        print_findings([*guess.findings, *(finding for joint in guess.joints for finding in joint.findings)])
    else:
        print_document(document, console_for("stderr"))


def _ask(guess: Guess, recording: Recording) -> tuple[Guess, dict[str, dict[str, str]]]:
    """Ask for what a guess lacks; return what it is with the answers, and those per joint and key as TOML writes them.

    Each answer may settle the next question: with all scales known the numbers show the signs.
    """
    from msgspec.structs import replace

    from vsalog.core.printable import printable
    from vsalog.report.inspect import question_of
    from vsalog.rig.guess_answers import with_answers
    from vsalog.rig.guess_gaps import gaps_of
    from vsalog.rig.template import named_joints

    answers: dict[str, dict[str, str]] = {}
    joints = []
    for name, joint in named_joints(guess):
        known = answers[name] = {}
        asked: set[str] = set()
        now = joint
        while (gap := next((gap for gap in gaps_of(now, known) if gap.key not in asked), None)) is not None:
            shown = "" if gap.guess is None else f"{gap.guess:g}"
            answer = click.prompt(
                printable(question_of(name, gap)),
                default=shown,
                show_default=bool(shown),
                value_proc=partial(_value, gap),
                err=True,
            )
            asked.add(gap.key)
            if answer:
                known[gap.key] = answer
                now = with_answers(joint, recording, known)
        joints.append(now)
    return replace(guess, joints=tuple(joints)), answers


def _value(gap: Gap, text: str) -> str:
    """Return an answer as TOML writes it, "" for none."""
    from vsalog.core.errors import UnitError
    from vsalog.rig.template import toml_string
    from vsalog.rig.uncertain import parse_stated

    text = text.strip()
    if not text:
        return ""
    if gap.choices:
        bare = {choice.strip('"'): choice for choice in gap.choices}
        if text not in bare:
            raise click.UsageError(f"enter {' or '.join(bare)}, or nothing if it is not known")
        return bare[text]
    try:
        value = float(text)
        written = repr(value).removesuffix(".0")
    except ValueError:
        try:
            value = parse_stated(text).to(gap.unit) if gap.unit else math.nan
        except UnitError as error:
            raise click.UsageError(str(error)) from error
        written = toml_string(text)
    least = 1.0 if gap.key.endswith("counts_per_turn") else sys.float_info.min
    if not least <= value < math.inf:
        raise click.UsageError("enter a positive number, or nothing if it is not known")
    return written
