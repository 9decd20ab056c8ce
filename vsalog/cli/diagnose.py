"""`vsalog diagnose`: the simulation's errors, their causes, the extended rig, the gain."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import FolderPath, LogPath, force_option, page_option, reading_options, rig_options


@click.command(short_help="Find the causes of the simulation's errors, extend the rig, and measure the gain.")
@click.argument("logs", nargs=-1, required=True, type=LogPath(), metavar="LOG...")
@click.option(
    "--holdout",
    "holdouts",
    multiple=True,
    type=LogPath(),
    metavar="LOG",
    help="Another log of the same machine: the gain is measured on it; may be repeated. Default: windows of LOG itself.",
)
@click.option(
    "--differs",
    multiple=True,
    metavar="CAUSE",
    help="Of several logs: this cause, such as link.payload, may have its own value in each; may be repeated. Others have"
    " one value in all of them.",
    shell_complete=complete.names(complete.causes),
)
@rig_options("Diagnose")
@reading_options
@click.option(
    "--fail-on-cause",
    is_flag=True,
    help="Exit with 3 when the log is not consistent with the rig: a cause was found, or something is unexplained.",
)
@click.option(
    "--fail-on-unchecked",
    is_flag=True,
    help="Exit with 3 when no error was found but not everything could be checked: verdict 'consistent as far as checked'.",
)
@click.option(
    "--suggest",
    is_flag=True,
    help="Propose the most informative experiment, as next.scenario.toml: a scenario for 'vsalog simulate'.",
)
@click.option(
    "-o",
    "--output",
    type=FolderPath(),
    metavar="DIR",
    help="Folder for diagnosis.json, diagnosis.html and extended.rig.toml; default: the current one.",
)
@page_option
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print the diagnosis as one JSON document on stdout.")
@click.pass_context
def diagnose(
    context: click.Context,
    logs: tuple[Path, ...],
    holdouts: tuple[Path, ...],
    differs: tuple[str, ...],
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    fail_on_cause: bool,
    fail_on_unchecked: bool,
    suggest: bool,
    output: Path | None,
    page: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Compare the rig's simulation with LOG, name the causes of its errors, extend the rig, and measure the gain.

    Several logs of one machine are explained together: a cause has one value in all of them, except those named by --differs,
    such as a payload or a friction that grows over months.

    Writes diagnosis.json, diagnosis.html and, where causes were found, extended.rig.toml: an ordinary rig to simulate, estimate
    and validate with. With --suggest also next.scenario.toml, which 'vsalog simulate RIG --scenario' runs.
    """
    from vsalog.diagnosis.run import Options
    from vsalog.report.diagnose import diagnosis_document, extra_paths, write_diagnosis
    from vsalog.report.outputs import inputs_of, keep_inputs, report_paths, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out

    options = Options(rig, joints, settings, rate, time, suggest, start, end, differs)
    extended, experiment = extra_paths(output)
    written = [*report_paths(output, "diagnosis", page), extended, *([experiment] if suggest else [])]
    keep_inputs(written, inputs_of([*logs, *holdouts], rig))
    replaced = require_new(written, force, logs)
    with Progress(replaced) as progress, progress.saying_when_compiling():
        diagnosis, files = write_diagnosis(logs, holdouts, options, output, progress.say, page)
    print_out(diagnosis_document(diagnosis, files), as_json)
    verdict = diagnosis.verdict
    unchecked = verdict == "consistent as far as checked"
    if (fail_on_unchecked and unchecked) or (fail_on_cause and not unchecked and verdict != "consistent"):
        context.exit(3)
