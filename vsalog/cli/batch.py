"""`vsalog batch`: many logs in, one data set out."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import reading_options, rig_options
from vsalog.cli.pairs import pairs
from vsalog.cli.validate import Percent

if TYPE_CHECKING:
    from vsalog.batch.records import Settings

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def shard(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Return (i, n) of i/n; a click callback."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", value)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"'{value}' is not i/n with i from 1 to n", context, parameter)
    return int(match[1]), int(match[2])


def parse_size(text: str) -> int:
    """Read a size such as 4GB, 512 MiB or 3e9.

    Raises
    ------
    BatchError
        It is no size, or too small for a single worker.
    """
    from vsalog.batch.memory import BASE
    from vsalog.core.errors import BatchError
    from vsalog.core.printable import size_text

    match = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]?i?)b?\s*", text, re.IGNORECASE)
    size = 0.0
    if match is not None:
        with suppress(ValueError):
            size = float(match[1]) * _UNITS.get(match[2].lower(), 0)
    if not 0.0 < size < 1e18:
        raise BatchError(f"--memory: '{text}' is no size; write 4GB or 512MiB")
    if size < BASE:
        raise BatchError(
            f"--memory: {text} is too little: a single worker takes {size_text(BASE)} before it opens a log"
        )
    return int(size)


def settings_of(
    do: str, rig: str | None, model: Path | None, report: bool = False, fail_on_cause: bool = False, **options: Any
) -> Settings:
    """Return the settings, with rig and model read, so that workers need no access to these files.

    Parameters
    ----------
    do : the command that is run
    rig : file or preset; None where each log's own is searched for
    model : of `validate`
    report, fail_on_cause : as in `Settings`
    options : of the command

    Raises
    ------
    VsalogError
        A file cannot be read, or is not what it should be.
    """
    from vsalog.batch.records import Settings
    from vsalog.core.documents import read_text
    from vsalog.core.errors import ReadError
    from vsalog.rig import Rig

    loaded = None if rig is None else Rig.load(rig)
    text = None if model is None else read_text(model, "model file", ReadError, most=None)
    return Settings(
        do=do,  # type: ignore[arg-type]
        rig=None if loaded is None else loaded.to_toml(),
        rig_name="" if loaded is None else loaded.where,
        model=text,
        model_name="" if model is None else model.name.encode("utf-8", "replace").decode(),
        # Options at their defaults do not make it a different batch.
        options={name: value for name, value in options.items() if value not in (None, (), {}, "auto")},
        report=report,
        fail_on_cause=fail_on_cause,
    )


@click.command(
    short_help="Estimate, validate or diagnose many logs: resumable, on one machine or many, into one data set."
)
@click.argument("logs", nargs=-1, required=True, metavar="LOGS...")
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="DIR|URL",
    help="Folder of the batch, or s3://bucket/… and whatever else fsspec opens.",
)
@click.option(
    "--do",
    type=click.Choice(["estimate", "validate", "diagnose"]),
    default="estimate",
    show_default=True,
    help="The command to run on each log.",
)
@rig_options("Use", "The rig of all logs; else each log's own: in it, LOG.rig.toml or rig.toml next to it.")
@click.option(
    "-e",
    "--estimator",
    metavar="NAME",
    help="estimate: the estimator, as for 'vsalog estimate'; default: auto.",
    shell_complete=complete.names(complete.estimators),
)
@click.option("--preset-tuning", type=click.Choice(["paper"]), help="estimate: begin with the values of the paper.")
@click.option("--tune", multiple=True, callback=pairs, metavar="NAME=VALUE", help="estimate: tune the estimator.")
@click.option("--report", is_flag=True, help="estimate: write a page with figures for each log (1.5 MB each), too.")
@click.option("--model", type=click.Path(path_type=Path), metavar="MODEL", help="validate: the model to judge.")
@click.option("--modalities/--no-modalities", default=None, help="validate: estimate by each modality, too.")
@click.option("--max-nrmse", type=Percent(min=0.0), metavar="%", help="validate: exit with 3 when a log's is larger.")
@click.option("--max-msrep", type=Percent(min=0.0), metavar="%", help="validate: exit with 3 when a log's is larger.")
@click.option("--fail-on-cause", is_flag=True, help="diagnose: exit with 3 when a log is not consistent with its rig.")
@reading_options
@click.option("--resume", is_flag=True, help="Continue the batch in the folder: finished logs are not processed again.")
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; default: the cores.")
@click.option(
    "--memory", metavar="SIZE", help="Memory for all of them together, e.g. 8GB; default: most of the free memory."
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Stop working on a log after this time; it counts as failed.",
)
@click.option("--scheduler", metavar="tcp://…", help="Run on the Dask cluster of this scheduler; needs vsalog[dask].")
@click.option("--shard", callback=shard, metavar="i/n", help="Do the i-th of n shares only, e.g. in a job array.")
@click.option("--json", "as_json", is_flag=True, help="Print the outcome as one JSON document on stdout.")
@click.pass_context
def batch(
    context: click.Context,
    logs: tuple[str, ...],
    output: str,
    do: str,
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    estimator: str | None,
    preset_tuning: str | None,
    tune: dict[str, str],
    report: bool,
    model: Path | None,
    modalities: bool | None,
    max_nrmse: float | None,
    max_msrep: float | None,
    fail_on_cause: bool,
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
    resume: bool,
    jobs: int | None,
    memory: str | None,
    timeout: float | None,
    scheduler: str | None,
    shard: tuple[int, int] | None,
    as_json: bool,
) -> None:
    """Run estimate, validate or diagnose over many LOGS, and write one data set.

    LOGS are files, folders, patterns in quotes ('logs/**/*.mcap'), s3://… addresses, @FILE for a list of these, or - for a list
    on stdin. Writes DIR/traces (Parquet, partitioned by device, date and log), DIR/models, DIR/reports, and at the end
    DIR/summary.parquet (a row per log and joint) and DIR/index.html. A log that fails is recorded with the reason, the others
    continue, and the exit code is 2. A run that was killed continues with --resume.
    """
    from vsalog.batch.run import Asked, run_batch
    from vsalog.core.printable import plural
    from vsalog.report.batch import failure_words, outcome_document
    from vsalog.report.progress import BatchProgress
    from vsalog.report.terminal import print_out

    given = {
        "--estimator": (estimator is not None, "estimate"),
        "--preset-tuning": (preset_tuning is not None, "estimate"),
        "--tune": (bool(tune), "estimate"),
        "--report": (report, "estimate"),
        "--model": (model is not None, "validate"),
        "--modalities": (modalities is not None, "validate"),
        "--max-nrmse": (max_nrmse is not None, "validate"),
        "--max-msrep": (max_msrep is not None, "validate"),
        "--fail-on-cause": (fail_on_cause, "diagnose"),
    }
    for option, (there, command) in given.items():
        if there and command != do:
            raise click.UsageError(f"{option} is for --do {command}, not for {do}")
    if do == "validate" and model is None:
        raise click.UsageError("--do validate needs --model MODEL, a LOG.model.toml that 'vsalog estimate' wrote")
    if scheduler is not None and (jobs or memory or timeout):
        raise click.UsageError(
            "--jobs, --memory and --timeout apply to this machine; the cluster of --scheduler sets its own"
        )
    preset = {} if preset_tuning is None else {"preset": preset_tuning}
    own: dict[str, dict[str, Any]] = {
        "estimate": {"estimator": estimator or "auto", "tune": preset | tune},
        "validate": {"modalities": modalities, "max_nrmse": max_nrmse, "max_msrep": max_msrep},
        "diagnose": {},
    }
    options = {"joints": joints, "set": settings, "rate": rate, "time": time, "start": start, "end": end} | own[do]
    asked = Asked(
        logs=logs,
        out=output,
        settings=settings_of(do, rig, model, report, fail_on_cause, **options),
        resume=resume,
        shard=shard,
        jobs=jobs,
        memory=None if memory is None else parse_size(memory),
        timeout=timeout,
        scheduler=scheduler,
    )
    with BatchProgress() as shown:
        try:
            outcome = run_batch(asked, shown)
        except KeyboardInterrupt:
            if not shown.begun:
                raise
            shown.say(
                f"vsalog: interrupted; {plural(shown.done, 'log')} finished; continue with the same command and --resume"
            )
            context.exit(130)
        # For a batch that is refused, only the reason is printed.
        shown.note(f"rig: {asked.settings.rig_name}" if rig else "rig: each log's own")
    found = outcome.document()
    print_out(outcome_document(found), as_json)
    if failed := failure_words(found):
        click.echo(failed, err=True)
    context.exit(outcome.code)
