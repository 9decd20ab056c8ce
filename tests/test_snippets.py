"""Every command and Python snippet of the README and the documentation does what it says, as printed."""

from pathlib import Path

import click
import pytest
import snippets

from vsalog.cli import cli

ROOT = Path(__file__).parent.parent
FILES = (*sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("docs/**/*.ipynb")))
READ = {path: snippets.read(path) for path in FILES}
SHOWN = {str(path.relative_to(ROOT)): page for path, page in READ.items() if page.steps or page.left_out}


@pytest.mark.parametrize("name", SHOWN)
def test_every_command_has_options_that_exist(name, monkeypatch):
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "1")
    for line in SHOWN[name].commands():
        _, command, *given = snippets.words(line)[0]
        assert command in cli.commands, line
        try:
            cli.commands[command].make_context(command, given)
        except click.exceptions.Exit:  # --help and --list
            pass
        except click.UsageError as error:
            pytest.fail(f"{line}: {error.format_message()}")


@pytest.mark.every(20)
@pytest.mark.parametrize("name", [name for name, page in SHOWN.items() if page.steps])
def test_the_snippets_of_a_page_run(name, request, tmp_path, monkeypatch):
    page = SHOWN[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    every = request.config.getoption("--all-cases")
    snippets.run(page, page.steps if every else page.quick(), tmp_path)
    for image, source in page.images.items() if every else ():
        assert (tmp_path / source).is_file()
        assert (ROOT / "docs" / "images" / image).is_file(), "run: python -m docs.make_images"


def test_a_number_that_is_stale_is_noticed():
    step = snippets.Step("command", "vsalog estimate log.csv", "stiffness  20.1 N·m/rad\n  …\nexcited 99 %\n")
    snippets.compare(step, ["stiffness 20.1 N·m/rad\n± 1 %\nexcited\n99 %\n", ""])
    for said in ("stiffness 20.2 N·m/rad excited 99 %", "stiffness 20.1 N·m/rad"):
        with pytest.raises(AssertionError):
            snippets.compare(step, [said, ""])


def test_what_a_page_says_is_printed_belongs_to_its_command(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        """
    $ vsalog inspect a.csv
    1 stream
    $ vsalog inspect b.csv
    2 streams

A block:

    vsalog estimate a.csv

```text
20 N·m/rad
```

```text
for example
```
"""
    )
    steps = snippets.read(page).steps
    assert [(step.text, step.printed.strip(), step.begins) for step in steps] == [
        ("vsalog inspect a.csv", "1 stream", True),
        ("vsalog inspect b.csv", "2 streams", False),
        ("vsalog estimate a.csv", "20 N·m/rad", True),
    ]
