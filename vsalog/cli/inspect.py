"""`vsalog inspect`: what is in a log."""

from __future__ import annotations

from pathlib import Path

import rich_click as click


@click.command(short_help="Show what is in a log, what is wrong with it, and which signal is probably what.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option("--rate", type=float, metavar="HZ", help="Sample rate of a table that has no time column.")
@click.option(
    "--time",
    type=click.Choice(["auto", "header", "log", "publish"]),
    default="auto",
    show_default=True,
    help="Which clock to use; auto takes header stamps unless they are missing, zero or implausible.",
)
def inspect(logs: tuple[Path, ...], as_json: bool, rate: float | None, time: str) -> None:
    """Show what is in each LOG: streams and their clocks, channels with unit, range, step and noise, and probable roles.

    Step is the least significant step of a channel, noise the standard deviation of its white noise. Roles are guesses
    from names, units and the numbers; `vsalog init` turns them into a rig file.
    """
    import msgspec

    from vsalog.readers import read
    from vsalog.reports.inspect import console_for_stdout, print_report
    from vsalog.reports.inspect_data import Inspection, inspect_recording
    from vsalog.rig.guess import guess_roles

    # All logs are read before anything is printed: an unreadable one must not leave half an answer.
    reports = []
    for log in logs:
        recording = read(log, time=time, rate=rate)
        reports.append(inspect_recording(recording, guess_roles(recording)))
    if as_json:
        document = msgspec.json.format(msgspec.json.encode(Inspection(tuple(reports))), indent=2)
        click.echo(document.decode())
        return
    console = console_for_stdout()
    for i, report in enumerate(reports):
        if i:
            console.print()
        print_report(report, console)
