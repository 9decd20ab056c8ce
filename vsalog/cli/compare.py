"""`vsalog compare`: several estimators on one log, side by side."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import LogPath, force_option, reading_options, report_option, rig_options


@click.command(short_help="Several estimators on one log, side by side.")
@click.argument("logs", nargs=-1, required=True, type=LogPath(), metavar="LOG...")
@click.option(
    "-e",
    "--estimators",
    multiple=True,
    metavar="NAME,NAME…",
    help="The estimators; each may be tuned, e.g. residual-rls:modality=SENSOR,qr-rls:forgetting=0.98, or qr-rls:preset=paper"
    " for the values of its paper. Those that the log does not allow are left out, with the reason. Default: all that it"
    " allows.",
    shell_complete=complete.names(complete.estimators, listed=True),
)
@rig_options("Compare")
@reading_options
@report_option
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as one JSON document on stdout.")
def compare(
    logs: tuple[Path, ...],
    estimators: tuple[str, ...],
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Run several estimators on the same LOG and print the stiffness, uncertainty and residual of each, its agreement with
    the first and, where the log contains a simulator's truth, its error.
    """
    from vsalog.cli.faults import bug, debugging
    from vsalog.comparison.run import compare as run
    from vsalog.estimation.job import Options
    from vsalog.report.compare import comparison_document, worded
    from vsalog.report.html import page_of
    from vsalog.report.outputs import inputs_of, keep_inputs, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import console_for, print_out
    from vsalog.writers.atomic import write_text

    asked = [name for text in estimators for name in text.split(",") if name.strip()]
    if estimators and not asked:
        raise click.BadParameter(f"'{estimators[0]}' names no estimator", param_hint="-e")
    if report is not None:
        keep_inputs([report], inputs_of(logs, rig))
    replaced = require_new(report, force, logs)
    with Progress(replaced) as progress:
        with progress.saying_when_compiling():
            options = Options(rig, joints, "auto", {}, settings, rate, time, start, end)
            found, runs, references = run(logs, options, asked, progress.say, keep_going=not debugging())
        found = worded(found)
        if report is not None:
            progress.say("writing the report")
            write_text(report, page_of(comparison_document(found, runs, references)))
    print_out(comparison_document(found), as_json)
    if report is None and not as_json:
        console_for("stderr").print("--report FILE.html draws them in one plot")
    if found.failed:
        click.echo(bug(", ".join(f"{name}: {fault}" for name, fault in found.failed.items())), err=True)
        raise SystemExit(1)
