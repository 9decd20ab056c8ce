"""Every command and Python snippet of the README and the documentation does what it says, as printed."""

import shutil
from pathlib import Path

import click
import pytest
import snippets
from command_line import vsalog_run

from vsalog.cli import cli

ROOT = Path(__file__).parent.parent
READ = {path: snippets.read(path) for path in (*sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("docs/**/*.md")))}
SHOWN = {str(path.relative_to(ROOT)): page for path, page in READ.items() if page.steps or page.left_out}
# What they return where a threshold that they ask for is missed.
MAY_MISS = ("--max-nrmse", "--fail-on-cause", "--fail-on-unchecked")


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


@pytest.mark.every(12)
@pytest.mark.parametrize("name", [name for name, page in SHOWN.items() if page.steps])
def test_the_snippets_of_a_page_run(name, request, tmp_path, monkeypatch):
    page, variables = SHOWN[name], {}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    shutil.copytree(ROOT / "sample_logs", tmp_path / "sample_logs")
    for file, source in page.files.items():
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source, file)
    for kind, text in page.steps if request.config.getoption("--all-cases") else page.quick():
        if kind == "command":
            (_, *given), output = snippets.words(text, tmp_path)
            done = vsalog_run(*given, cwd=tmp_path)
            missed = any(option in given for option in MAY_MISS)
            assert done.returncode in ((0, 3) if missed else (0,)), f"{text}: {done.stderr}"
            if output:
                Path(output).write_text(done.stdout, encoding="utf-8")
        elif kind == "python":
            exec(compile(text, name, "exec"), variables)
        else:
            Path(kind).write_text(text, encoding="utf-8")
