"""Options of every command, before or after its name: how much is printed on stderr."""

from __future__ import annotations

from typing import Any

import rich_click as click

from vsalog.report.verbosity import Verbosity, ask, verbosity


def _asked(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        asked = Verbosity.QUIET if parameter.name == "quiet" else Verbosity.VERBOSE
        if verbosity() not in (Verbosity.NORMAL, asked):
            raise click.UsageError("--quiet and --verbose contradict each other: leave one of them out")
        ask(asked)


def message_options() -> list[click.RichOption]:
    """Return --quiet, --verbose and --debug, which pass nothing to a command."""
    flags: dict[str, Any] = {"is_flag": True, "expose_value": False}
    return [
        click.RichOption(
            ["-q", "--quiet"], callback=_asked, help="No progress and no notes: warnings and errors only.", **flags
        ),
        click.RichOption(
            ["-v", "--verbose"],
            callback=_asked,
            help="Print how long each step takes, and where the rig was found.",
            **flags,
        ),
        click.RichOption(["--debug"], help="Show a traceback instead of one line when something goes wrong.", **flags),
    ]


class Commands(click.RichGroup):
    """The group of all commands, each of which takes the options of messages, too."""

    def add_command(self, cmd: click.Command, name: str | None = None, *args: Any, **named: Any) -> None:
        """Register a command."""
        cmd.params.extend(message_options())
        super().add_command(cmd, name, *args, **named)
