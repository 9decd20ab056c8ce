"""Help at 80 columns, examples that parse, manual pages of the same texts, and values that a shell completes."""

import re
import shlex
import shutil
import subprocess
import sys

import pytest
from command_line import vsalog_run

from docs.make_man import page, write_pages
from vsalog.cli import cli
from vsalog.cli.help import EXAMPLES, GROUPS, grouped

COMMANDS = list(cli.commands)


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_is_whole_at_80_columns(command, monkeypatch, tmp_path, name):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = command(*([name] if name else []), "--help", cwd=tmp_path)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    told = "".join(re.sub(r"[│\s]", "", line) for line in out.splitlines())
    shown = cli.commands[name] if name else cli
    for option in shown.params:
        if option.param_type_name == "option":
            assert option.opts[-1] in told
            assert re.sub(r"\s", "", option.help) in told, option.opts
    for group in grouped(shown):
        assert f"─ {group} ─" in out
    for line in EXAMPLES.get(name, ()):
        assert f" {line} " in out  # on a line of its own


def test_options_are_in_one_group_each(command):
    there = [option for members in GROUPS.values() for option in members]
    assert len(set(there)) == len(there)
    for name in COMMANDS:
        options = [o for own in grouped(cli.commands[name]).values() for o in own]
        assert (
            len(set(options))
            == len(options)
            == sum(p.param_type_name == "option" for p in cli.commands[name].params) + 1
        )


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_can_be_run(name):
    assert any(line.startswith(f"vsalog {name} ") for line in EXAMPLES[name])
    for line in EXAMPLES[name]:
        program, called, *words = shlex.split(line.partition(" > ")[0], comments=True)
        assert program == "vsalog"
        cli.commands[called].make_context(called, words)


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_manual_pages_say_what_help_says(name):
    shown = cli.commands[name] if name else cli
    text = page(name, shown).replace("\\-", "-")
    assert text.isascii()
    for option in shown.params:
        if option.param_type_name == "option":
            assert option.opts[-1] in text


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_manual_pages_are_sound(tmp_path):
    pages = write_pages(tmp_path / "man")
    assert len(pages) == len(COMMANDS) + 1
    done = subprocess.run(["groff", "-man", "-ww", "-Tutf8", *pages], capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.fixture
def completed(command, monkeypatch, tmp_path):
    """Return what a shell is offered for the last word of a line."""

    def completed(line, cwd=tmp_path):
        words = line.split(" ")
        env = {"_VSALOG_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
        for name, value in env.items():
            monkeypatch.setenv(name, value)
        code, out, _ = command(cwd=cwd)
        assert code == 0
        return dict(reversed(offer.split(",", 1)) for offer in out.splitlines() if offer)

    return completed


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("vsalog esti", "estimate"),
        ("vsalog estimate --estimator resid", "residual-rls"),
        ("vsalog batch logs -o out -e qr", "qr-rls"),
        ("vsalog compare log.csv -e direct,qr", "direct,qr-rls"),
        ("vsalog estimate log.csv --rig awa", "awas"),
        ("vsalog export se", "sea"),
        ("vsalog simulate vsa2 --scenario vsa2-exp", "vsa2-exp2"),
        ("vsalog diagnose --differs link.pay", "link.payload"),
        ("vsalog reproduce flacco2012-table", "flacco2012-table2"),
        ("vsalog validate model.toml log.csv --time he", "header"),
        ("vsalog estimate log.csv --joint k", "knee"),
        ("vsalog plan vsa2-2r --joint e", "elbow"),
        ("vsalog estimate log.csv --rig awas --joint a", "awas"),
        ("vsalog init log.csv --preset aw", "awas"),
    ],
)
def test_values_are_completed(completed, bench, line, offered):
    assert completed(line, cwd=bench).get(offered) == "plain"


@pytest.mark.parametrize("line", ["vsalog simulate my.to", "vsalog estimate --rig my.to", "vsalog estimate lo"])
def test_files_are_completed_where_no_name_fits(completed, line):
    assert set(completed(line).values()) == {"file"}


def test_a_joint_of_no_rig_is_no_fault(completed):
    assert completed("vsalog estimate missing.csv --joint k") == {}


def test_shells_get_their_scripts(tmp_path, monkeypatch):
    for shell in ("bash", "zsh", "fish"):
        monkeypatch.setenv("_VSALOG_COMPLETE", f"{shell}_source")
        done = vsalog_run(cwd=tmp_path)
        assert "_VSALOG_COMPLETE" in done.stdout, done.stderr


def test_loops_can_be_compiled_ahead(command, tmp_path):
    code, out, err = command("warm", "simulate", "--preset", "pam", cwd=tmp_path)
    assert (code, out) == (0, ""), err
    assert "loop" in err
    assert list(tmp_path.iterdir()) == []
    assert command("warm", "inspect", cwd=tmp_path)[0] == 2
    # Joints with muscles have no diagnosis ahead.
    assert command("warm", "diagnose", "--preset", "pam", cwd=tmp_path)[0] == 2


def test_help_imports_nothing_heavy(tmp_path):
    heavy = "{'numpy', 'numba', 'scipy', 'pyarrow'}"
    code = f"import sys; from vsalog.cli import cli; print(*{heavy}.intersection(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
