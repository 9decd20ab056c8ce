"""`vsalog simulate`: simulate a rig and write a log of any format."""

from __future__ import annotations

from pathlib import Path

import rich_click as click
from click import get_current_context
from click.core import ParameterSource

from vsalog.cli import complete
from vsalog.cli.options import force_option, report_option
from vsalog.cli.pairs import pairs
from vsalog.cli.quantity import positive

_seconds = positive("s", "a time longer than zero")


@click.command(short_help="Simulate a rig and write what its sensors record, as a log of any format.")
@click.argument(
    "rig", required=False, metavar="RIG|PRESET", shell_complete=complete.names(complete.presets, or_file=True)
)
@click.option(
    "--scenario",
    metavar="NAME|FILE",
    help="What drives the joints: a scenario's name or a TOML file; --list lists those that come with vsalog. Default: the"
    " preset's first experiment, or sines that suit the rig.",
    shell_complete=complete.names(complete.scenarios, or_file=True),
)
@click.option("--list", "listing", is_flag=True, help="List the scenarios and presets that come with vsalog.")
@click.option(
    "--duration", callback=_seconds, metavar="T", help="Duration, in seconds or with a unit; default: the scenario's."
)
@click.option(
    "--rate",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="HZ",
    help="Samples per second; default: the scenario's.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of all noise: equal seeds make equal files.",
)
@click.option(
    "--replay",
    metavar="LOG",
    help="Drive the rig with the inputs that LOG recorded, and write the simulated signals along with the measured ones. RIG may"
    " then be left out: LOG's own rig is used. --rate is that of a table without a time column.",
)
@click.option(
    "--window",
    callback=_seconds,
    metavar="T",
    help="With --replay: restart from the measured state every T, in seconds or with a unit.",
)
@click.option("--ideal", is_flag=True, help="Sensors without noise, quantisation, jitter and dropped samples.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    callback=pairs,
    metavar="KEY=VALUE",
    help="Change the simulated machine and the rig in the log, e.g. joint.elbow.motor.friction.coulomb='20 N·mm'.",
)
@click.option(
    "--actual",
    multiple=True,
    callback=pairs,
    metavar="KEY=VALUE",
    help="Change the simulated machine only, not the rig in the log, as where a model is wrong.",
)
@click.option("--truth", is_flag=True, help="Record the true motion, torques and stiffness too, under /truth.")
@click.option(
    "-o",
    "--output",
    metavar="PATH",
    help="File with suffix .mcap (ROS 2 messages), .bag (ROS 1), .csv or .parquet; without a suffix, or with a slash at the"
    " end, the folder of a ROS 2 bag. Default: NAME.mcap in the current folder.",
)
@report_option
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print what was written as one JSON document on stdout.")
def simulate(
    rig: str | None,
    scenario: str | None,
    listing: bool,
    duration: float | None,
    rate: float | None,
    seed: int,
    replay: str | None,
    window: float | None,
    ideal: bool,
    settings: dict[str, str],
    actual: dict[str, str],
    truth: bool,
    output: str | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Simulate RIG, a rig file or a preset, and write what its sensors record.

    The log carries its rig: MCAP and Parquet inside, the other formats as LOG.rig.toml next to it, where 'vsalog estimate
    LOG' finds it. With --replay it has topics /measured/ROLE and /simulated/ROLE, in SI.
    """
    from vsalog.report.simulate import scenarios_document, written_document, written_page
    from vsalog.report.terminal import console_for, print_data, print_document
    from vsalog.simulation.run import Options, prepare

    if listing:
        print_document(scenarios_document())
        return
    if replay is not None:
        _refuse_what_does_nothing(("scenario", "duration", "seed", "ideal", "truth"), "with --replay")
        _replay(rig, Path(replay), window, rate, settings, actual, output, report, force, as_json)
        return
    _refuse_what_does_nothing(("window",), "without --replay")
    if rig is None:
        raise click.UsageError("name a rig file or a preset; 'vsalog simulate --list' lists the presets")
    from vsalog.estimation.live import LiveEstimate
    from vsalog.report.html import page_of
    from vsalog.report.outputs import require_new
    from vsalog.report.progress import Progress
    from vsalog.writers.atomic import write_text

    options = Options(scenario, duration, rate, seed, ideal, settings, actual, truth, output)
    with Progress() as progress:
        job = prepare(rig, options)
        progress.replacing(require_new((job.files.log, report), force))
        progress.say(f"simulating {job.scenario.file.duration:g} s")
        with progress.saying_when_compiling():
            recording = job.run(LiveEstimate)
        progress.say(f"writing {job.files.log.name}")
        job.write(recording)
        document = written_document(job, recording)
        if report is not None:
            write_text(report, page_of(written_page(document, recording, job.rig.to_toml())))
    print_document(document, console_for("stderr"))
    if as_json:
        print_data(document)


def _refuse_what_does_nothing(options: tuple[str, ...], where: str) -> None:
    context = get_current_context()
    for option in options:
        if context.get_parameter_source(option) is not ParameterSource.DEFAULT:
            raise click.UsageError(f"--{option} does nothing {where}; leave it out")


def _replay(
    rig: str | None,
    log: Path,
    window: float | None,
    rate: float | None,
    settings: dict[str, str],
    actual: dict[str, str],
    output: str | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    from vsalog.report.html import page_of
    from vsalog.report.outputs import keep_inputs, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.simulate import replay_document, replay_page
    from vsalog.report.terminal import console_for, print_data, print_document
    from vsalog.simulation.replay_job import ReplayOptions, prepare_replay
    from vsalog.writers.atomic import write_text

    with Progress() as progress:
        progress.say(f"reading {log.name}")
        job = prepare_replay(rig, log, ReplayOptions(window, rate, settings, actual, output))
        if report is not None:
            keep_inputs([report], [log])
        progress.replacing((*require_new(job.files.log, force), *require_new(report, force, [log])))
        progress.say(f"replaying {log.name}")
        with progress.saying_when_compiling():
            joints = job.run()
        progress.say(f"writing {job.files.log.name}")
        recording = job.recording(joints)
        job.write(recording)
        document = replay_document(job, joints)
        if report is not None:
            write_text(report, page_of(replay_page(document, recording, job.rig_text(), log)))
    print_document(document, console_for("stderr"))
    if as_json:
        print_data(document)
