"""Writes docs/reference/cli from the commands' own help texts: ``python -m docs.make_cli``."""

from collections.abc import Iterator
from pathlib import Path

import click

from vsalog.cli import cli
from vsalog.cli.help import EXAMPLES, grouped

FOLDER = Path(__file__).parent / "reference" / "cli"
EXIT_CODES = """\
0: done. 2: the input or the command line is at fault; one line on stderr says what, where and what to do, with the rig that
was used, and nothing was written. 3: done, but a threshold that was asked for was missed (`validate --max-nrmse`,
`diagnose --fail-on-cause`, `--fail-on-unchecked`). 130, 143: interrupted, terminated. 141: the reader of the output closed it,
as `head` does. 1: a bug in vsalog; `vsalog --debug …` shows a traceback.

Findings do not change the code, not even those that invalidate a joint: the results are written, and none of their rows counts
as excited. Scripts read `severity` of the findings that `--json` prints."""

COMPLETION = """\
Shells complete commands, options and their values: estimators, presets, scenarios, causes, the papers' items, files, and
the joints of the rig or the log that the line names. Add one line to your shell's start-up file:

| shell | file | line |
| --- | --- | --- |
| bash ≥ 4.4 | `~/.bashrc` | `eval "$(_VSALOG_COMPLETE=bash_source vsalog)"` |
| zsh | `~/.zshrc` | `eval "$(_VSALOG_COMPLETE=zsh_source vsalog)"` |
| fish | `~/.config/fish/completions/vsalog.fish` | `_VSALOG_COMPLETE=fish_source vsalog \\| source` |

`vsalog diagnose exp1.mcap --differs link.` and the tab key then list the causes of a link."""


def context_of(command: click.Command, name: str = "") -> click.Context:
    """Return the context that a command's help is written in."""
    return click.Context(command, info_name=f"vsalog {name}".strip(), help_option_names=["-h", "--help"])


def options_of(command: click.Command) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Yield the groups of a command's options, and of each option how it is written and what it does."""
    context = context_of(command)
    there = {param.opts[-1]: param for param in command.get_params(context)}
    for group, names in grouped(command).items():
        records = [there[name].get_help_record(context) for name in names]
        yield group, [record for record in records if record is not None]


def help_text(name: str, command: click.Command) -> str:
    """Return a command's help as plain text."""
    context, formatter = context_of(command, name), click.HelpFormatter(width=100)
    click.Command.format_usage(command, context, formatter)
    click.Command.format_help_text(command, context, formatter)
    for group, records in options_of(command):
        with formatter.section(group):
            formatter.write_dl(records)
    examples = "".join(f"  {line}\n" for line in EXAMPLES.get(name, ()))
    return f"{formatter.getvalue()}\nExamples:\n{examples}"


def page(name: str, command: click.Command) -> str:
    """Return a command's help as a page."""
    return f"# vsalog {name}\n\n```text\n{help_text(name, command).rstrip()}\n```\n"


def index() -> str:
    """Return the list of commands, the exit codes and how shells complete."""
    parts = ["# Command line", "", "Written by `python -m docs.make_cli` from the help texts.", ""]
    parts += ["Manual pages of the same texts: `make man`, then `man build/man/vsalog-estimate.1`.", ""]
    parts += ["| command | does |", "| --- | --- |"]
    parts += [f"| [{name}]({name}.md) | {command.get_short_help_str(200)} |" for name, command in cli.commands.items()]
    parts += ["", "## Exit codes", "", EXIT_CODES, ""]
    parts += [
        "Where there is more than one, the others are done all the same: `batch` and `inspect` end with 2 where some of the logs",
        "failed, `compare` with 1 where a bug ended one of the estimators.",
        "",
    ]
    parts += ["## Shell completion", "", COMPLETION, ""]
    return "\n".join([*parts, "```{toctree}", ":hidden:", "", *cli.commands, "```", ""])


def pages() -> dict[str, str]:
    """Return the reference of the command line: name of a page → Markdown."""
    return {"index": index(), **{name: page(name, command) for name, command in cli.commands.items()}}


if __name__ == "__main__":
    for stem, text in pages().items():
        (FOLDER / f"{stem}.md").write_text(text, encoding="utf-8")
