"""The commands and Python lines of a Markdown page or a notebook, in the order in which a reader meets them.

A page says in comments what its snippets need and which of them are not run:

    <!-- files: exp1.mcap=sample_logs/vsa2_exp1.mcap -->      copies of samples, before the first snippet
    <!-- images: torque.png=figures/torque.png -->            pictures in docs/images that the page's commands make
    <!-- before: vsalog simulate sea -o exp1.mcap -->         a command that is run before what follows
    <!-- needs: mujoco -->                                    the next block is run where this package is installed
    <!-- not run: REASON -->                                  the next block is not run
    <!-- not run "vsalog reproduce": REASON -->               commands of the page that begin so
    <!-- slow "vsalog plan": REASON -->                       these are run with all cases only
"""

import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from command_line import vsalog_run
from markdown_it import MarkdownIt

ROOT = Path(__file__).parent.parent
# What commands end with 3 for where a threshold is missed.
MAY_MISS = ("--max-nrmse", "--fail-on-cause", "--fail-on-unchecked")
COMMENT = re.compile(r"<!--\s*(files|images|before|needs|slow|not run)(?: \"([^\"]+)\")?:\s*(.*?)\s*-->", re.DOTALL)
WORD = re.compile(r"""(?:[^\s'"]|'[^']*'|"[^"]*")+""")
NAMED = re.compile(r"`([\w./-]+\.toml)`[^`]*:$")


@dataclass
class Page:
    """What a page has: files to copy, and steps `(kind, text)` with the kinds command, python and (name of a) file."""

    files: dict[str, str] = field(default_factory=dict)
    steps: list[tuple[str, str]] = field(default_factory=list)
    left_out: list[tuple[str, str]] = field(default_factory=list)
    images: dict[str, str] = field(default_factory=dict)
    slow: tuple[str, ...] = ()

    def quick(self) -> list[tuple[str, str]]:
        """Return the steps without the slow ones."""
        return [(kind, text) for kind, text in self.steps if not text.startswith(self.slow or " ")]

    def commands(self) -> Iterator[str]:
        """Yield every command, also those that are not run."""
        return (text for kind, text in (*self.steps, *self.left_out) if kind == "command")


def read(path: Path) -> Page:
    """Return the snippets of a page, or the cells of a notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        lines = [("".join(cell["source"]), cell["cell_type"]) for cell in cells]
        text = "\n\n".join(source if kind == "markdown" else f"```python\n{source}\n```" for source, kind in lines)
    page, skip, named = Page(), "", ""
    page.slow = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "slow")
    refused = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "not run" and start)
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        if token.type == "html_block":
            for kind, start, rest in COMMENT.findall(token.content):
                if kind in ("files", "images"):
                    getattr(page, kind).update(pair.split("=") for pair in rest.split())
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


def run(page: Page, steps: Sequence[tuple[str, str]], folder: Path) -> None:
    """Run steps of a page in a folder that is the current one: commands, files and Python lines, in their order."""
    shutil.copytree(ROOT / "sample_logs", folder / "sample_logs")
    for file, source in page.files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source, folder / file)
    variables: dict[str, object] = {}
    for kind, text in steps:
        if kind == "command":
            (_, *given), output = words(text, folder)
            done = vsalog_run(*given, cwd=folder)
            missed = any(option in given for option in MAY_MISS)
            assert done.returncode in ((0, 3) if missed else (0,)), f"{text}: {done.stderr}"
            if output:
                (folder / output).write_text(done.stdout, encoding="utf-8")
        elif kind == "python":
            exec(compile(text, "page", "exec"), variables)
        else:
            (folder / kind).write_text(text, encoding="utf-8")
