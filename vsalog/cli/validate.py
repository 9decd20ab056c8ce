"""`vsalog validate`: test a frozen model on a second experiment."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import rich_click as click

from vsalog.cli.options import FolderPath, LogPath, force_option, page_option, reading_options, rig_options


class Percent(click.FloatRange):
    """A finite number: a threshold of nan would be met by nothing, one of inf by everything."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number, or fail."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is no threshold: give a number in per cent", param, ctx)
        return number


def _in_order(model: Path, logs: tuple[Path, ...]) -> tuple[Path, tuple[Path, ...], bool]:
    """Return the model and the logs, and whether they were given the other way round."""
    from vsalog.core.errors import ReadError
    from vsalog.core.model import ModelFile

    there = [path for path in logs if path.suffix == ".toml"]
    if model.suffix == ".toml" or len(there) != 1:
        return model, logs, False
    try:
        ModelFile.load(there[0])
    except (ReadError, RecursionError):
        return model, logs, False
    return there[0], (model, *(path for path in logs if path is not there[0])), True


@click.command(short_help="Test a fitted model on other experiments.")
@click.argument("model", type=click.Path(path_type=Path), metavar="MODEL")
@click.argument("logs", nargs=-1, required=True, type=LogPath(), metavar="LOG...")
@rig_options(
    "Judge",
    "The rig; default: the log's own, else the one in the model file.",
    "Change the rig for this run, e.g. joint.elbow.signals.torque_sensor.offset='1.2 N·m'.",
)
@reading_options
@click.option(
    "--modalities/--no-modalities",
    default=None,
    help="Estimate the logs by MODEL, SENSOR and RESIDUAL too, side by side; default: for logs of up to 300 000 samples.",
)
@click.option(
    "--max-nrmse",
    type=Percent(min=0.0),
    metavar="%",
    help="Exit with 3 when the torque's error is larger, as a share of its span.",
)
@click.option(
    "--max-msrep",
    type=Percent(min=0.0),
    metavar="%",
    help="Exit with 3 when the mean square relative error of the torque is larger.",
)
@click.option(
    "-o",
    "--output",
    type=FolderPath(),
    metavar="DIR",
    help="Folder for report.json and report.html; default: the current one.",
)
@click.option("--figures", type=FolderPath(), metavar="DIR", help="Write the figures as SVG, PNG and PDF too.")
@page_option
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON document on stdout.")
@click.pass_context
def validate(
    context: click.Context,
    model: Path,
    logs: tuple[Path, ...],
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    modalities: bool | None,
    max_nrmse: float | None,
    max_msrep: float | None,
    output: Path | None,
    figures: Path | None,
    page: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Test MODEL, a LOG.model.toml that 'vsalog estimate' wrote, on other experiments: the LOGs.

    The model is frozen. Its flexibility torque is compared with the torque sensor; where there is none, with the residual of
    the motor equation. Its stiffness is compared with a simulator's truth in the log, else with the rig's nominal one. Samples
    outside the region that the model was fitted in are judged separately. Writes report.json and report.html.
    """
    from vsalog.figures.paper import check_matplotlib
    from vsalog.report.outputs import inputs_of, keep_inputs, report_paths, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out
    from vsalog.report.validate import report_document, write_validation
    from vsalog.validation.run import Options

    if figures is not None:
        check_matplotlib()
    model, logs, swapped = _in_order(model, logs)
    options = Options(rig, joints, settings, rate, time, modalities, max_nrmse, max_msrep, start, end)
    written = report_paths(output, "report", page)
    keep_inputs(written, [model, *inputs_of(logs, rig)])
    replaced = require_new([*written, figures], force, logs)
    with Progress(replaced) as progress, progress.saying_when_compiling():
        if swapped:
            progress.note(f"{model} is the model, and is tested on {', '.join(map(str, logs))}")
        report, files = write_validation(model, logs, options, output, figures, progress.say, page)
    print_out(report_document(report, files), as_json)
    if any(not threshold.met for threshold in report.thresholds):
        context.exit(3)
