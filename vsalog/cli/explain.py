"""`vsalog explain`: the texts on findings and causes."""

from __future__ import annotations

import rich_click as click

from vsalog.cli import complete


@click.command(short_help="Explain the code of a finding, or a cause: what it says, and what to do about it.")
@click.argument(
    "names",
    nargs=-1,
    metavar="CODE|CAUSE...",
    shell_complete=complete.names(lambda: [*complete.causes(), *complete.codes()]),
)
@click.option("--list", "listing", is_flag=True, help="List all codes and causes.")
@click.option("--json", "as_json", is_flag=True, help="Print the explanations as one JSON document on stdout.")
def explain(names: tuple[str, ...], listing: bool, as_json: bool) -> None:
    """Explain findings by their CODE, as JSON and messages have it, and causes of a simulation's error by their names.

    In the texts, ⟨value⟩ and other names stand for numbers that a log gives.
    """
    from vsalog.report.explain import explain_document, names_document
    from vsalog.report.terminal import print_document, print_out

    if listing:
        print_document(names_document())
        return
    if not names:
        raise click.UsageError("name a finding's code or a cause; 'vsalog explain --list' lists them")
    print_out(explain_document(names), as_json)
