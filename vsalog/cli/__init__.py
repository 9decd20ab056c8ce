"""The command line: one thin module per command, heavy imports inside the commands."""

from __future__ import annotations

import sys

import rich_click as click

from vsalog._version import __version__
from vsalog.cli.estimate import estimate
from vsalog.cli.init import init
from vsalog.cli.inspect import inspect
from vsalog.errors import VsalogError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="vsalog")
@click.option("--debug", is_flag=True, help="Show a traceback instead of one line when something goes wrong.")
def cli(debug: bool) -> None:
    """Stiffness, with honest uncertainty, from the recordings of compliant robot joints."""


cli.add_command(estimate)
cli.add_command(init)
cli.add_command(inspect)


def main() -> None:
    """Run the command line: exit code 2 and one line on stderr where the input is to blame, 1 for a bug of ours."""
    try:
        cli()
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        if isinstance(error, VsalogError):
            click.echo(f"vsalog: {error}", err=True)
            sys.exit(2)
        click.echo(
            f"vsalog: this is a bug in vsalog, not in your log: {type(error).__name__}: {error}\n"
            "Please report it with what 'vsalog --debug …' prints.",
            err=True,
        )
        sys.exit(1)
