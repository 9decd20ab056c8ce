"""`vsalog inspect`: the contents of a log."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli.options import LogPath, force_option, reading_options, report_option


@click.command(short_help="Show the contents of a log, its faults, and the probable role of each signal.")
@click.argument("logs", nargs=-1, required=True, type=LogPath(), metavar="LOG...")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document on stdout.")
@click.option(
    "--head",
    type=click.IntRange(0, 10_000),
    default=0,
    metavar="N",
    help="Show the first N samples of each stream too.",
)
@click.option("--full", is_flag=True, help="Read all of a large log; default: a sample of it.")
@click.option(
    "--repair",
    "repaired",
    type=click.Path(path_type=Path),
    metavar="OUT.mcap",
    help="Write what can be read of LOG into this file, never LOG itself: a sound MCAP file with index and checksums. Messages,"
    " definitions and times are kept bit for bit, of MCAP files metadata and attachments too; columns of a table become topics.",
)
@report_option
@force_option
@reading_options
def inspect(
    logs: tuple[Path, ...],
    as_json: bool,
    head: int,
    full: bool,
    repaired: Path | None,
    report: Path | None,
    force: bool,
    rate: float | None,
    time: str,
    start: str | None,
    end: str | None,
) -> None:
    """Show what is in each LOG: streams and their clocks, channels with unit, range, step and noise, and probable roles.

    Step is the least significant step of a channel, noise the standard deviation of its white noise. Roles are guesses
    from names, units and the numbers; `vsalog init` turns them into a rig file. Notes list what was damaged or odd.

    Of logs above 64 MB a sample is read: stretches from beginning to end, some 32 MB. --full reads all; so do
    --start and --end, since a part may be too short for a sample.

    Of several logs, one that cannot be read is reported on stderr, in JSON under "unreadable"; the others are shown, and
    the exit code is 2.
    """
    from msgspec.structs import replace

    from vsalog.core.printable import printable
    from vsalog.inspection.run import Options
    from vsalog.inspection.run import inspect as run
    from vsalog.report.html import page_of
    from vsalog.report.inspect import inspection_document, inspection_page, repair_words
    from vsalog.report.outputs import inputs_of, keep_inputs, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out
    from vsalog.writers.atomic import write_text

    if repaired is not None and len(logs) > 1:
        raise click.UsageError("--repair writes one file: name one LOG")
    if repaired is not None and not (start is None and end is None):
        raise click.UsageError("--repair writes the whole log: leave out --start and --end")
    keep_inputs([path for path in (repaired, report) if path is not None], inputs_of(logs))
    replaced = (*require_new(repaired, force), *require_new(report, force, logs))
    options = Options(head, full, rate, time, start, end)
    # All logs are read before anything is printed, so that no error appears between the others.
    with Progress(replaced) as progress:
        found = run(logs, options, progress.say)
        if repaired is not None:
            from vsalog.writers.repair import repair

            progress.say(f"writing {repaired.name}")
            written = repair(logs[0], repaired, rate)
            found = replace(found, repaired=written)
        if report is not None:
            progress.say("writing the report")
            write_text(report, page_of(inspection_page(found, options)))
    if found.repaired is not None:
        click.echo(printable(repair_words(found.repaired)), err=True)
    print_out(inspection_document(found), as_json)
    for one in found.unreadable:
        click.echo(f"vsalog: {printable(one.error)}", err=True)
    if found.unreadable:
        raise SystemExit(2)
