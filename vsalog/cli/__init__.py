"""The command line: one thin module per command, heavy imports inside the commands."""

from __future__ import annotations

import sys

import rich_click as click

from vsalog._version import __version__
from vsalog.errors import VsalogError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="vsalog")
@click.option("--debug", is_flag=True, help="Show a traceback instead of one line when something goes wrong.")
def cli(debug: bool) -> None:
    """Stiffness, with honest uncertainty, from the recordings of compliant robot joints."""


def main() -> None:
    """Run the command line; what the input is to blame for ends in one line on stderr and exit code 2."""
    try:
        cli()
    except VsalogError as error:
        if "--debug" in sys.argv:
            raise
        click.echo(f"vsalog: {error}", err=True)
        sys.exit(2)
