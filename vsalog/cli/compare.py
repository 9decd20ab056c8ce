"""`vsalog compare`: several estimators on one log, side by side."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli.pairs import pairs


@click.command(short_help="Several estimators on one log, side by side.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option(
    "-e",
    "--estimators",
    multiple=True,
    metavar="NAME,NAME…",
    help="Which; each may be tuned, e.g. residual-rls:modality=SENSOR,qr-rls:forgetting=0.98. All that the log allows when"
    " absent.",
)
@click.option(
    "--rig", metavar="FILE|PRESET", help="The rig; else the one in the log, LOG.rig.toml or rig.toml beside it."
)
@click.option("--joint", "joints", multiple=True, metavar="NAME", help="Compare this joint only; may be given again.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    callback=pairs,
    metavar="KEY=VALUE",
    help="Change the rig for this run, e.g. joint.elbow.motor.inertia='7.3 kg*m*mm'.",
)
@click.option(
    "--rate",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="HZ",
    help="Sample rate of a table that has no time column.",
)
@click.option(
    "--time",
    type=click.Choice(["auto", "header", "log", "publish"]),
    default="auto",
    show_default=True,
    help="Which clock to trust.",
)
@click.option(
    "--report", type=click.Path(path_type=Path), metavar="FILE", help="Write a page with figures, which opens offline."
)
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as one JSON document on stdout.")
def compare(
    logs: tuple[Path, ...],
    estimators: tuple[str, ...],
    rig: str | None,
    joints: tuple[str, ...],
    settings: dict[str, str],
    rate: float | None,
    time: str,
    report: Path | None,
    as_json: bool,
) -> None:
    """Run several estimators on the same LOG and print what each finds: stiffness, uncertainty, what the fit leaves over, and
    how far it agrees with the first; where the log holds a simulator's truth, how far from that.
    """
    from vsalog.comparison import compare as run
    from vsalog.job import Options
    from vsalog.reports.compare import print_comparison, print_json, write_comparison_page
    from vsalog.reports.estimate import Progress

    asked = [name for text in estimators for name in text.split(",") if name.strip()]
    with Progress() as progress:
        with progress.saying_when_compiling():
            found, runs = run(logs, Options(rig, joints, "auto", {}, settings, rate, time), asked, progress.say)
        if report is not None:
            progress.say("writing the report")
            write_comparison_page(report, found, runs)
    (print_json if as_json else print_comparison)(found)
