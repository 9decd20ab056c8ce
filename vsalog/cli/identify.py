"""`vsalog identify`: the rig's parameters, fitted to a log."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli.options import FolderPath, LogPath, force_option, reading_options, rig_options


@click.command(short_help="Fit the rig's parameters to a log, with intervals, and report which of them it determines.")
@click.argument("log", type=LogPath(), metavar="LOG")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("identified.rig.toml"),
    show_default=True,
    help="File for the rig with the identified parameters.",
)
@force_option
@click.option(
    "--holdout",
    "holdouts",
    multiple=True,
    type=LogPath(),
    metavar="LOG",
    help="Another log of the same machine, to judge the fit by; may be repeated. Default: the last third of LOG, with a fit to"
    " the rest.",
)
@click.option(
    "--free",
    multiple=True,
    metavar="KEY",
    help="Fit this parameter too, though the rig leaves it at its default: a key below the joint, as link.gravity_torque, or a"
    " pattern as 'motor.friction.*'; may be repeated.",
)
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    metavar="KEY",
    help="Keep the rig's value of this parameter, or of those that match this pattern.",
)
@rig_options("Identify")
@reading_options
@click.option("--report", type=click.Path(path_type=Path), metavar="FILE", help="Write a page, which opens offline.")
@click.option(
    "--figures",
    type=FolderPath(),
    metavar="DIR",
    help="Draw the numbers with their intervals, as SVG, PNG and PDF.",
)
@click.option("--json", "as_json", is_flag=True, help="Print what was found as one JSON document on stdout.")
def identify(
    log: Path,
    output: Path,
    force: bool,
    holdouts: tuple[Path, ...],
    free: tuple[str, ...],
    fixed: tuple[str, ...],
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    report: Path | None,
    figures: Path | None,
    as_json: bool,
) -> None:
    """Fit the rig's parameters, such as inertias, damping, friction, springs and a drive's gains, to LOG by simulation.

    Prints each with its 95 % interval and whether the log determines it alone, only in combination with others, or not at all,
    and the simulation's error on data that were not fitted. A parameter that the rig states with a tolerance stays near it;
    others may be off by ten times what is usual for their kind. Damping that the rig does not give is fitted too, and dry
    friction where the log shows any. Writes the rig with the fitted values: after `vsalog identify exp1.mcap`, `vsalog diagnose
    exp2.mcap --rig identified.rig.toml` searches for causes.
    """
    from vsalog.figures.paper import check_matplotlib, write_figures
    from vsalog.identification.run import Options
    from vsalog.identification.run import identify as run
    from vsalog.report.html import page_of
    from vsalog.report.identify import identification_charts, identification_document
    from vsalog.report.outputs import inputs_of, keep_inputs, require_new, sealed
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out
    from vsalog.writers.atomic import check_path, together, write_text

    written = [output, *([] if report is None else [report])]
    keep_inputs(written, inputs_of([log, *holdouts], rig))
    for path in written:
        check_path(path)
    replaced = require_new([*written, figures], force, [log])
    if figures is not None:
        check_matplotlib()
    options = Options(rig, joints, settings, rate, time, start, end, free, fixed)
    with Progress(replaced) as progress, progress.saying_when_compiling():
        found, identified = run(log, holdouts, options, progress.say)
    document = identification_document(found, {"rig": str(output)})
    with together():
        write_text(output, sealed(identified.to_toml(), [found.log_sha256]))
        if report is not None:
            write_text(report, page_of(document))
        if figures is not None:
            drawn = {joint: {"": [chart]} for joint, chart in identification_charts(found).items()}
            write_figures(figures, [drawn])
    print_out(document, as_json)
