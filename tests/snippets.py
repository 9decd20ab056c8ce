"""The commands and Python lines of a Markdown page or a notebook, in the order in which a reader meets them.

A page says in comments what its snippets need and which of them are not run:

    <!-- files: exp1.mcap=sample_logs/vsa2_exp1.mcap -->      copies of samples, before the first snippet
    <!-- images: torque.png=figures/torque.png -->            pictures in docs/images that the page's commands make
    <!-- before: vsalog simulate sea -o exp1.mcap -->         a command that is run before what follows
    <!-- needs: mujoco -->                                    the next block is run where this package is installed
    <!-- not run: REASON -->                                  the next block is not run
    <!-- not run "vsalog reproduce": REASON -->               commands of the page that begin so
    <!-- slow "vsalog plan": REASON -->                       these are run with all cases only

A block of text that follows is what they print, on stdout or stderr, and so are lines below a command with a prompt: every word
and digit, but for the ends of lines, the spaces between columns, and what a line "…" stands for.

    <!-- varies "vsalog diagnose": REASON -->                what these print is not compared: it depends on the processor
    <!-- columns: 100 -->                                     width of the terminal
"""

import json
import os
import re
import shlex
import shutil
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from unittest.mock import patch

from command_line import vsalog_run
from markdown_it import MarkdownIt

ROOT = Path(__file__).parent.parent
# What commands end with 3 for where a threshold is missed.
MAY_MISS = ("--max-nrmse", "--fail-on-cause", "--fail-on-unchecked")
COMMENT = re.compile(
    r"<!--\s*(files|images|before|columns|needs|slow|varies|not run)(?: \"([^\"]+)\")?:\s*(.*?)\s*-->", re.DOTALL
)
WORD = re.compile(r"""(?:[^\s'"]|'[^']*'|"[^"]*")+""")
NAMED = re.compile(r"`([\w./-]+\.toml)`[^`]*:$")


@dataclass
class Step:
    """A command, Python lines or a file.

    Attributes
    ----------
    kind : command, python, or the file's name
    text : of it
    printed : what the page says that it, or one before it in the same block, prints
    begins : whether it is the first of its block
    """

    kind: str
    text: str
    printed: str = ""
    begins: bool = True


@dataclass
class Page:
    """What a page has: files to copy, and steps."""

    files: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    left_out: list[Step] = field(default_factory=list)
    images: dict[str, str] = field(default_factory=dict)
    slow: tuple[str, ...] = ()
    columns: str | None = None

    def quick(self) -> list[Step]:
        """Return the steps without the slow ones."""
        return [step for step in self.steps if not step.text.startswith(self.slow or " ")]

    def commands(self) -> Iterator[str]:
        """Yield every command, also those that are not run."""
        return (step.text for step in (*self.steps, *self.left_out) if step.kind == "command")


def read(path: Path) -> Page:
    """Return the snippets of a page, or the cells of a notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        lines = [("".join(cell["source"]), cell["cell_type"]) for cell in cells]
        text = "\n\n".join(source if kind == "markdown" else f"```python\n{source}\n```" for source, kind in lines)
    page, skip, named, last = Page(), "", "", None
    page.slow = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "slow")
    varied = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "varies")
    refused = tuple(start for kind, start, _ in COMMENT.findall(text) if kind == "not run" and start)
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        if token.type == "html_block":
            for kind, start, rest in COMMENT.findall(token.content):
                if kind in ("files", "images"):
                    getattr(page, kind).update(pair.split("=") for pair in rest.split())
                elif kind == "columns":
                    page.columns = rest
                elif kind == "before":
                    page.steps.append(Step("command", rest))
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
                found = list(shell(token.content))
            elif language == "python":
                found = [Step("python", token.content)]
            else:
                found = [Step(named, token.content)] if named and language == "toml" else []
            if last is not None and language == "text" and not last.text.startswith(varied or " "):
                last.printed = token.content
            for step in found:
                (page.left_out if skip or step.text.startswith(refused or " ") else page.steps).append(step)
            skip = named = ""
            last = found[-1] if found else None
    return page


def shell(block: str) -> Iterator[Step]:
    """Yield the vsalog commands of a block of shell lines; where these have prompts, other lines are what is printed."""
    step, begins = None, True
    for line in re.sub(r"\\\n\s*", "", block).splitlines():
        command = line.strip().removeprefix("$ ")
        if command.startswith("vsalog "):
            if step is not None:
                yield step
            step, begins = Step("command", command, begins=begins), False
        elif step is not None and "$ vsalog " in block:
            step.printed += f"{line}\n"
    if step is not None:
        yield step


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


def run(page: Page, steps: Sequence[Step], folder: Path) -> None:
    """Run steps of a page in a folder that is the current one: commands, files and Python lines, in their order.

    What they print is compared with the page.
    """
    shutil.copytree(ROOT / "sample_logs", folder / "sample_logs")
    for file, source in page.files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source, folder / file)
    variables: dict[str, object] = {}
    said: list[str] = []
    for step in steps:
        text = step.text
        if step.begins:
            said = []
        if step.kind == "command":
            (_, *given), output = words(text, folder)
            width = {} if page.columns is None else {"COLUMNS": page.columns}
            with patch.dict(os.environ, width):
                done = vsalog_run(*given, cwd=folder)
            missed = any(option in given for option in MAY_MISS)
            assert done.returncode in ((0, 3) if missed else (0,)), f"{text}: {done.stderr}"
            if output:
                (folder / output).write_text(done.stdout, encoding="utf-8")
            said += done.stdout, done.stderr
            compare(step, said)
        elif step.kind == "python":
            with redirect_stdout(StringIO()) as output_of_it:
                exec(compile(text, "page", "exec"), variables)
            compare(step, [output_of_it.getvalue()])
        else:
            (folder / step.kind).write_text(text, encoding="utf-8")


def compare(step: Step, streams: Sequence[str]) -> None:
    """Compare what a block printed up to a step with what its page says."""
    for part in re.split(r"^\s*…\s*$", step.printed, flags=re.MULTILINE):
        wanted, printed = " ".join(part.split()), [" ".join(stream.split()) for stream in streams]
        assert any(wanted in stream for stream in printed), f"{step.text} prints\n{''.join(streams)}\nand not\n{part}"
