"""Writes docs/cli.md from the commands' own help texts: ``python docs/make_cli.py``."""

from pathlib import Path

import click

from vsalog.cli import cli


def reference() -> str:
    """Return the command line's reference as Markdown."""
    parts = ["# Command line", "", "Written by `python docs/make_cli.py` from the help texts.", ""]
    for name, command in cli.commands.items():
        plain = click.Command(name, params=command.params, help=command.help, epilog=command.epilog)
        context = click.Context(plain, info_name=f"vsalog {name}", terminal_width=100, max_content_width=100)
        parts += [f"## vsalog {name}", "", "```text", plain.get_help(context), "```", ""]
    parts += [
        "## Exit codes",
        "",
        "0: done. 2: the input or the command line is at fault; one line on stderr says what, where and what to do, and",
        "nothing was written. 3: done, but a threshold that was asked for was missed (`validate --max-nrmse`,",
        "`diagnose --fail-on-cause`, `--fail-on-unchecked`). 1: a bug in vsalog; `vsalog --debug …` shows a traceback.",
        "",
        "Where there is more than one, the others are done all the same: `batch` and `inspect` end with 2 where some of the logs",
        "failed, `compare` with 1 where a bug ended one of the estimators.",
        "",
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    Path(__file__).with_name("cli.md").write_text(reference(), encoding="utf-8")
