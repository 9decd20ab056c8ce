"""Options that several commands share: which rig, which joints, and how a log is read."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote, urlsplit

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.pairs import pairs
from vsalog.core.printable import named
from vsalog.writers.atomic import FILE_SUFFIXES


class LogPath(click.Path):
    """The path of a log, with a name; of a ``file://`` address, as file managers and browsers give it, the path in it."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if isinstance(value, str) and value.lower().startswith("file://"):
            value = unquote(urlsplit(value).path, errors="surrogateescape")
        return named(Path(os.fsdecode(super().convert(value, param, ctx))))


class FolderPath(click.Path):
    """The path of a folder for results."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        text = os.fspath(value)
        if text.lower().endswith(FILE_SUFFIXES) and not Path(text).is_dir():
            page = f"; --report {text} names the page" if text.lower().endswith((".htm", ".html")) else ""
            self.fail(f"'{text}' is a file's name; name a folder, '{text}/' for one of that name{page}", param, ctx)
        return super().convert(value, param, ctx)


Command = TypeVar("Command", bound=Callable[..., Any])

RIG = "The rig; else the one in the log, LOG.rig.toml or rig.toml next to it."
SET = "Change the rig for this run, e.g. joint.elbow.motor.inertia='7.3 kg*m*mm'."


def rig_options(verb: str, rig: str = RIG, settings: str = SET) -> Callable[[Command], Command]:
    """Return a decorator that adds --rig, --joint and --set, passed as `rig`, `joints` and `settings`.

    Parameters
    ----------
    verb : what is done to a joint
    rig, settings : help of --rig and --set
    """

    def decorate(command: Command) -> Command:
        for option in (
            click.option("--set", "settings", multiple=True, callback=pairs, metavar="KEY=VALUE", help=settings),
            click.option(
                "--joint",
                "joints",
                multiple=True,
                metavar="NAME",
                help=f"{verb} this joint only; may be repeated.",
                shell_complete=complete.joints,
            ),
            click.option(
                "--rig",
                metavar="FILE|PRESET",
                help=rig,
                shell_complete=complete.names(complete.presets, or_file=True),
            ),
        ):
            command = option(command)
        return command

    return decorate


def page_option(command: Command) -> Command:
    """Add --report to a command that writes a page anyway, passed as `page`."""
    return click.option(
        "--report",
        "page",
        type=click.Path(path_type=Path),
        metavar="FILE.html",
        help="Write the page to this file; default: into the folder of --output.",
    )(command)


def report_option(command: Command) -> Command:
    """Add --report to a command that writes no page unless asked, passed as `report`."""
    return click.option(
        "--report",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE.html",
        help="Write a page with figures, which opens offline.",
    )(command)


def force_option(command: Command) -> Command:
    """Add --force, passed as `force`."""
    return click.option("--force", is_flag=True, help="Overwrite existing files, whatever they contain.")(command)


def reading_options(command: Command) -> Command:
    """Add --rate, --time, --start and --end, passed under these names."""
    for option in (
        click.option("--end", metavar="TIME", help="Use the log up to this time only; as --start."),
        click.option(
            "--start",
            metavar="TIME",
            help="Use the log from this time on only: seconds from its beginning, a number with a unit such as '2 min', an ISO"
            " 8601 date (UTC where it has no zone), or a time since the epoch.",
        ),
        click.option(
            "--time",
            type=click.Choice(["auto", "header", "log", "publish"]),
            default="auto",
            show_default=True,
            help="Which clock to trust.",
        ),
        click.option(
            "--rate",
            type=click.FloatRange(min=0.0, min_open=True),
            metavar="HZ",
            help="Sample rate of a table that has no time column.",
        ),
    ):
        command = option(command)
    return command
