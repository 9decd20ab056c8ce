"""`vsalog reproduce`: the papers' numbers next to ours."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import FolderPath, force_option


@click.command(short_help="Print the papers' numbers next to ours.")
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=complete.names(complete.reproducible))
@click.option("--list", "listing", is_flag=True, help="List what can be reproduced.")
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="Write the tables as a page, which opens offline.",
)
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print the rows as one JSON document on stdout.")
@click.option(
    "--plots",
    type=FolderPath(),
    metavar="DIR",
    help="Write figures like the papers' into this folder, as SVG.",
)
def reproduce(
    names: tuple[str, ...], listing: bool, report: Path | None, force: bool, as_json: bool, plots: Path | None
) -> None:
    """Simulate what the papers simulate, estimate as they do, and print their numbers next to ours.

    NAME is an item of --list, or a paper's name for all of its items; default: everything. Ours are medians over several noise
    seeds. Each row states the conditions, what was chosen where the paper leaves it open, and the reason where ours is worse.
    """
    from vsalog.figures.paper import prepare_folder, write_reproduced
    from vsalog.report.html import page_of
    from vsalog.report.outputs import require_new
    from vsalog.report.progress import BatchProgress
    from vsalog.report.reproduce import items_document, rows_document
    from vsalog.report.terminal import print_document, print_out
    from vsalog.reproduce.catalogue import select
    from vsalog.reproduce.measure import Study
    from vsalog.writers.atomic import check_path, write_text

    if listing:
        print_document(items_document())
        return
    items = select(names)
    require_new((plots, report), force)
    if report is not None:
        check_path(report)
    if plots is not None:
        prepare_folder(plots, "--plots")
    with BatchProgress("item") as progress:
        progress.begin([item.work for item in items])
        study, results = Study(say=progress.now), {}
        with progress.saying_when_compiling():
            for item in items:
                results[item.name] = item.run(study)
                progress.add(item.work, kept=False, failure="")
        figures = []
        if plots is not None:
            progress.now("drawing")
            figures = write_reproduced(plots, [f for r in results.values() for f in r.figures])
    rows = {name: result.rows for name, result in results.items()}
    document = rows_document(items, rows, study.seeds, figures)
    if report is not None:
        write_text(report, page_of(document))
    print_out(document, as_json)
