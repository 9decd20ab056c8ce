"""Writes manual pages from the commands' own help texts: ``python -m docs.make_man FOLDER``, as `make man` does."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click

from docs.make_cli import EXIT_CODES, context_of, options_of
from vsalog import __version__
from vsalog.cli import cli
from vsalog.cli.help import EXAMPLES


def roff(text: str) -> str:
    """Return text of one or more lines as roff prints it, in ASCII."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    text = "".join(c if c.isascii() else f"\\[u{ord(c):04X}]" for c in text)
    return "\n".join(f"\\&{line}" if line[:1] in (".", "'") else line for line in text.splitlines())


def paragraphs(text: str) -> Iterator[str]:
    """Yield a help text's paragraphs, filled and without the marks of click."""
    for paragraph in re.split(r"\n\s*\n", text.replace("\b", "")):
        yield roff(" ".join(paragraph.split()))


def page(name: str, command: click.Command) -> str:
    """Return the manual page of a command; of the group for an empty name."""
    title = f"vsalog-{name}" if name else "vsalog"
    called = f"vsalog {name}".strip()
    usage = " ".join(command.collect_usage_pieces(context_of(command)))
    lines = [f'.TH {title.upper()} 1 "" "vsalog {__version__}" "vsalog manual"']
    lines += [".SH NAME", f"{roff(title)} \\- {roff(command.get_short_help_str(200).rstrip('.'))}"]
    lines += [".SH SYNOPSIS", f".B {roff(called)}", roff(usage), ".SH DESCRIPTION"]
    for i, paragraph in enumerate(paragraphs(command.help or "")):
        lines += [".PP"] * (i > 0) + [paragraph]
    if isinstance(command, click.Group):
        lines.append(".SH COMMANDS")
        for one, sub in command.commands.items():
            lines += [".TP", f".BR {roff(f'vsalog-{one}')} (1)", roff(sub.get_short_help_str(200))]
    lines.append(".SH OPTIONS")
    for group, records in options_of(command):
        lines.append(f".SS {group}")
        for written, said in records:
            lines += [".TP", f".B {roff(written)}", roff(said)]
    lines += [".SH EXAMPLES", ".nf", *(roff(line) for line in EXAMPLES.get(name, ())), ".fi"]
    lines += [".SH EXIT STATUS", *paragraphs(EXIT_CODES.replace("`", ""))]
    others = ["vsalog"] if name else [f"vsalog-{one}" for one in cli.commands]
    lines += [".SH SEE ALSO", ", ".join(f"{roff(other)}(1)" for other in others)]
    return "\n".join(lines) + "\n"


def write_pages(folder: Path) -> list[Path]:
    """Write the pages of all commands into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, command in {"": cli, **cli.commands}.items():
        path = folder / (f"vsalog-{name}.1" if name else "vsalog.1")
        path.write_text(page(name, command), encoding="utf-8")
        written.append(path)
    return written


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
