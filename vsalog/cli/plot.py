"""`vsalog plot`: figures of a log's or a trace's stiffness, on the screen or in a file for a paper."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import rich_click as click
from click.core import ParameterSource

from vsalog.cli.estimate import estimate
from vsalog.cli.options import LogPath, reading_options, rig_options

if TYPE_CHECKING:
    from vsalog.estimation.job import Options
    from vsalog.report.progress import Progress

KINDS = (
    "stiffness", "torque-over-deflection", "stiffness-surface", "torque", "torque-expanded", "slices", "surface",
    "error-distribution", "error-dependence", "convergence",
)  # fmt: skip
ESTIMATE = ("estimator", "preset_tuning", "tune", "causal")


@click.command(short_help="Plot the stiffness of a log or a trace: on the screen, or as PDF, SVG or PNG for a paper.")
@click.argument("logs", nargs=-1, required=True, type=LogPath(), metavar="LOG...|TRACE")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the figure to this file; the suffix sets the format: .pdf, .svg or .png. Several figures get their kind in"
    " their names: FILE_stiffness.pdf. Default: on the screen.",
)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(KINDS),
    metavar="KIND",
    default=KINDS[:1],
    show_default=True,
    help="What is drawn; may be repeated. stiffness: over time, with its band; torque-over-deflection: data and"
    " characteristic; stiffness-surface: over deflection and set-point, where there is one; as on the page of"
    f" 'estimate --report': {', '.join(KINDS[3:])}.",
)
@click.option(
    "--style",
    type=click.Choice(["column", "page", "screen"]),
    help="Size: a paper's column, 3.5 in wide with text of 8 pt; its page, 7.16 in with 9 pt; a screen. Default: a column in"
    " files.",
)
@click.option(
    "--transmission",
    "transmissions",
    multiple=True,
    metavar="NAME",
    help="Draw this one only: 1, 2 or total; may be repeated. Default: the device's figure, or one per transmission.",
)
@click.option("--force", is_flag=True, help="Overwrite existing files.")
@rig_options("Plot")
@reading_options
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as one JSON document on stdout.")
@click.pass_context
def plot(
    context: click.Context,
    logs: tuple[Path, ...],
    output: Path | None,
    kinds: tuple[str, ...],
    style: str | None,
    transmissions: tuple[str, ...],
    force: bool,
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    estimator: str,
    preset_tuning: str | None,
    tune: dict[str, str],
    causal: bool,
    as_json: bool,
) -> None:
    """Plot the results of 'vsalog estimate': of a TRACE, its LOG.stiffness.parquet, or of a LOG, which is estimated first.

    The fitted curve and its band are those of LOG.model.toml next to the TRACE, if it is of the same run. Only the figures are
    written.
    """
    from vsalog.core.errors import ReadError
    from vsalog.estimation.job import Options
    from vsalog.estimation.joint import tuning
    from vsalog.figures.paper import SIZES, check_matplotlib
    from vsalog.figures.screen import require_screen, show
    from vsalog.figures.trace_file import TraceFile
    from vsalog.readers.own_files import is_trace
    from vsalog.readers.remote import is_address
    from vsalog.report.outputs import inputs_of, keep_inputs, require_new
    from vsalog.report.plot import check_format, figures_of, paths_of, plots_document, write_plots
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out

    if missing := [log for log in logs if not log.exists() and not is_address(log)]:
        raise ReadError("there is no such file", missing[0])
    if output is None:
        require_screen()
    else:
        check_format(output)
        check_matplotlib("a figure")
        keep_inputs([output], inputs_of(logs, rig))
        if len(kinds) == 1:
            require_new(output, force)
    size = SIZES[style or ("screen" if output is None else "column")]
    names = [kind.replace("-", "_") for kind in dict.fromkeys(kinds)]
    with TemporaryDirectory(prefix="vsalog-") as folder, Progress() as progress:
        if any(map(is_trace, logs)):
            _refuse_what_a_trace_has(context, logs)
            trace = TraceFile.of(logs[0])
        else:
            tune = tuning(preset_tuning, tune, causal)
            options = Options(rig, joints, estimator, tune, settings, rate, time, start, end)
            trace, joints = TraceFile.of(_estimated(logs, options, Path(folder), progress)), ()
        progress.say("drawing")
        figures = figures_of(trace, names, joints, transmissions)
        if output is not None:
            paths = paths_of(output, figures)
            keep_inputs(paths, inputs_of(logs, rig))
            for path in paths:
                require_new(path, force)
            write_plots(paths, figures, size)
    if output is None:
        show([(one.title, one.chart) for one in figures], size)
        paths = []
    print_out(plots_document(figures, paths), as_json)


# A log is estimated as `estimate` does, by its own options.
plot.params += [option for option in estimate.params if option.name in ESTIMATE]


def _refuse_what_a_trace_has(context: click.Context, logs: tuple[Path, ...]) -> None:
    if len(logs) > 1:
        raise click.UsageError("name one TRACE, or LOGs")
    for option in context.command.params:
        given = context.get_parameter_source(option.name or "") is not ParameterSource.DEFAULT
        if option.name in (*ESTIMATE, "rig", "settings", "rate", "time", "start", "end") and given:
            raise click.UsageError(
                f"{option.opts[-1]} does nothing with a TRACE, which is estimated already; leave it out"
            )


def _estimated(logs: tuple[Path, ...], options: Options, folder: Path, progress: Progress) -> Path:
    """Estimate logs into a folder, and return the trace's file."""
    from vsalog.estimation.job import prepare
    from vsalog.report.estimate import write_estimate
    from vsalog.report.outputs import Outputs
    from vsalog.report.terminal import print_findings

    job = prepare(logs, options, progress.say)
    outputs = Outputs(folder / "log.stiffness.parquet", folder / "log.model.toml")
    with progress.saying_when_compiling():
        estimates = write_estimate(job, outputs, progress=progress.say)
    print_findings([*job.findings, *(finding for e in estimates for finding in e.findings)])
    return outputs.trace
