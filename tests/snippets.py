"""The commands and Python lines of a Markdown page, in the order in which a reader meets them.

A page says in comments what its snippets need and which of them are not run:

    <!-- files: exp1.mcap=sample_logs/vsa2_exp1.mcap -->      copies of samples, before the first snippet
    <!-- before: vsalog simulate sea -o exp1.mcap -->         a command that is run before what follows
    <!-- needs: mujoco -->                                    the next block is run where this package is installed
    <!-- not run: REASON -->                                  the next block is not run
    <!-- not run "vsalog reproduce": REASON -->               commands of the page that begin so
    <!-- slow "vsalog plan": REASON -->                       these are run with all cases only
"""

import os
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from markdown_it import MarkdownIt

COMMENT = re.compile(r"<!--\s*(files|before|needs|slow|not run)(?: \"([^\"]+)\")?:\s*(.*?)\s*-->", re.DOTALL)
WORD = re.compile(r"""(?:[^\s'"]|'[^']*'|"[^"]*")+""")
NAMED = re.compile(r"`([\w./-]+\.toml)`[^`]*:$")


@dataclass
class Page:
    """What a page has: files to copy, and steps `(kind, text)` with the kinds command, python and (name of a) file."""

    files: dict[str, str] = field(default_factory=dict)
    steps: list[tuple[str, str]] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    slow: tuple[str, ...] = ()

    def quick(self) -> list[tuple[str, str]]:
        """Return the steps without the slow ones."""
        return [(kind, text) for kind, text in self.steps if not text.startswith(self.slow or " ")]

    def commands(self) -> Iterator[str]:
        """Yield every command, also those that are not run."""
        return (text for kind, text in (*self.steps, *self.left_out) if kind == "command")


def read(path: Path) -> Page:
    """Return the snippets of a page."""
    text = path.read_text(encoding="utf-8")
    page, skip, named = Page(), "", ""
    page.slow = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "slow")
    refused = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "not run" and start)
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        if token.type == "html_block":
            for kind, start, rest in COMMENT.findall(token.content):
                if kind == "files":
                    page.files |= dict(pair.split("=") for pair in rest.split())
                elif kind == "before":
                    page.steps.append(("command", rest))
                elif kind == "needs":
                    skip = "" if find_spec(rest) else rest
                elif not start:
                    skip = rest
        elif token.type == "inline":
            found = NAMED.search(token.content)
            named = found[1] if found else ""
        elif token.type in ("code_block", "fence"):
            language = token.info.split(" ")[0] if token.type == "fence" else "sh"
            if language in ("sh", "bash", "console"):
                found = [("command", command) for command in commands(token.content)]
            elif language == "python":
                found = [("python", token.content)]
            else:
                found = [(named, token.content)] if named and language == "toml" else []
            for step in found:
                (page.left_out if skip or step[1].startswith(refused or " ") else page.steps).append(step)
            skip = named = ""
    return page


def commands(block: str) -> list[str]:
    """Return the vsalog commands of a block of shell lines, without prompts."""
    lines = (line.strip().removeprefix("$ ") for line in re.sub(r"\\\n\s*", "", block).splitlines())
    return [line for line in lines if line.startswith("vsalog ")]


def words(line: str, folder: Path = Path()) -> tuple[list[str], str]:
    """Return the words of a command as a shell gives them, and the file that its output goes to."""
    given: list[str] = []
    for word in WORD.findall(line):
        if word.startswith("#"):
            break
        bare = os.path.expandvars("".join(shlex.split(word)))
        found = (
            sorted(str(path.relative_to(folder)) for path in folder.glob(bare)) if word == bare and "*" in word else []
        )
        given += found or [bare]
    output = given.index(">") if ">" in given else len(given)
    return given[:output], "".join(given[output + 1 :])
