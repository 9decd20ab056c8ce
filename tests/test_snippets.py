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
