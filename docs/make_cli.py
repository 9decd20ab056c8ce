"""Writes docs/reference/cli from the commands' own help texts: ``python docs/make_cli.py``."""

from pathlib import Path

import click

from vsalog.cli import cli

FOLDER = Path(__file__).parent / "reference" / "cli"
EXIT_CODES = """## Exit codes

0: done. 2: the input or the command line is at fault; one line on stderr says what, where and what to do, and
nothing was written. 3: done, but a threshold that was asked for was missed (`validate --max-nrmse`,
`diagnose --fail-on-cause`, `--fail-on-unchecked`). 1: a bug in vsalog; `vsalog --debug …` shows a traceback.

Where there is more than one, the others are done all the same: `batch` and `inspect` end with 2 where some of the logs
failed, `compare` with 1 where a bug ended one of the estimators.
"""


def page(name: str, command: click.Command) -> str:
    """Return a command's help as a page."""
    plain = click.Command(name, params=command.params, help=command.help, epilog=command.epilog)
    context = click.Context(plain, info_name=f"vsalog {name}", terminal_width=100, max_content_width=100)
    return f"# vsalog {name}\n\n```text\n{plain.get_help(context)}\n```\n"


def index() -> str:
    """Return the list of commands and the exit codes."""
    parts = ["# Command line", "", "Written by `python docs/make_cli.py` from the help texts.", ""]
    parts += ["| command | does |", "| --- | --- |"]
    parts += [f"| [{name}]({name}.md) | {command.get_short_help_str(200)} |" for name, command in cli.commands.items()]
    parts += ["", EXIT_CODES, "```{toctree}", ":hidden:", "", *cli.commands, "```", ""]
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """Return the reference of the command line: name of a page → Markdown."""
    return {"index": index(), **{name: page(name, command) for name, command in cli.commands.items()}}


if __name__ == "__main__":
    for stem, text in pages().items():
        (FOLDER / f"{stem}.md").write_text(text, encoding="utf-8")
