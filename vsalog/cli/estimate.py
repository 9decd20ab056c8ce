"""`vsalog estimate`: logs in, stiffness out."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import FolderPath, LogPath, force_option, reading_options, rig_options
from vsalog.cli.pairs import pairs
from vsalog.estimators.registry import methods


@click.command()
@click.argument("logs", nargs=-1, type=LogPath(), metavar="LOG...")
@rig_options(
    "Estimate",
    settings="Change the rig for this run, e.g. joint.elbow.motor.inertia='7.3 kg*m*mm'; setpoint=33mm fixes the set-point"
    " (one value, or one per log with commas between).",
)
@click.option(
    "-e",
    "--estimator",
    default="auto",
    show_default=True,
    metavar="NAME",
    help=f"{', '.join(methods())}, or auto: what the signals allow.",
    shell_complete=complete.names(complete.estimators),
)
@click.option(
    "--preset-tuning",
    type=click.Choice(["paper"]),
    help="Use the tuning values of the estimator's paper instead of those derived from the log; --tune overrides them.",
)
@click.option(
    "--tune", multiple=True, callback=pairs, metavar="NAME=VALUE", help="Tune the estimator, e.g. window=0.1."
)
@click.option(
    "--causal",
    is_flag=True,
    help="Estimate each sample from those before it, as in a control loop: filter=kinematic, and of the smoother the filter"
    " alone.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    metavar="PATH",
    help="The Parquet file, or a folder for the results, which is made if its name ends with a slash.",
)
@click.option(
    "--mcap",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the trace as an MCAP log too, for Foxglove or PlotJuggler; not for logs that are too long for memory.",
)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Write a page with figures too, which opens offline.",
)
@click.option(
    "--figures",
    type=FolderPath(),
    metavar="DIR",
    help="Write the figures as SVG, PNG and PDF too.",
)
@force_option
@reading_options
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path),
    metavar="PARQUET",
    help="Repeat the run that wrote this trace: its rig, its settings, and its logs, which must be unchanged.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as one JSON document on stdout.")
def estimate(
    logs: tuple[Path, ...],
    rig: str | None,
    joints: tuple[str, ...],
    estimator: str,
    preset_tuning: str | None,
    tune: dict[str, str],
    causal: bool,
    settings: dict[str, str],
    output: str | None,
    mcap: Path | None,
    report: Path | None,
    figures: Path | None,
    force: bool,
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    source: Path | None,
    as_json: bool,
) -> None:
    """Estimate the stiffness of every joint of a log, over time, with its uncertainty.

    Writes LOG.stiffness.parquet (one row per sample and transmission) and LOG.model.toml (the fitted model) to the current
    folder. Several logs make one model and one trace, whose column `run` names the log of each row.

    Earlier results of the same logs are replaced; other files are overwritten with --force only.
    """
    from vsalog.estimation.job import Options, prepare
    from vsalog.estimation.joint import tuning
    from vsalog.report.estimate import estimate_document, write_estimate
    from vsalog.report.outputs import Outputs, inputs_of, keep_inputs, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out

    tune = tuning(preset_tuning, tune, causal)
    options = Options(rig, joints, estimator, tune, settings, rate, time, start, end)
    if source is not None:
        from vsalog.estimation.repeat import repeated

        if options != Options():
            raise click.UsageError(
                "--from repeats a run as it was: rig, joints, estimator, tuning and settings come from it"
            )
        logs, options = repeated(source, logs)
    elif not logs:
        raise click.UsageError("name a log, or a trace with --from")
    outputs = Outputs.named(logs, output, mcap, report, figures)
    inputs = [*inputs_of(logs, rig), *([source] if source is not None else [])]
    written = [path for path in (outputs.trace, outputs.model, mcap, report) if path is not None]
    keep_inputs(written, inputs)
    replaced = require_new([*written, figures], force, logs)
    if figures is not None:
        from vsalog.figures.paper import check_matplotlib

        check_matplotlib()
    with Progress(replaced) as progress:
        job = prepare(logs, options, progress.say)
        with progress.saying_when_compiling():
            estimates = write_estimate(job, outputs, progress=progress.say)
    print_out(estimate_document(job, estimates, outputs), as_json)
