"""Commands in this process, which spares an interpreter's start; and a folder with a log and its rig."""

import json
import sys

import pytest
from knee import lay

from vsalog.cli import _run


@pytest.fixture
def command(monkeypatch, capsys):
    """Run `vsalog ARGS` in a folder; returns exit code, stdout and stderr."""

    def command(*args, cwd):
        monkeypatch.chdir(cwd)
        monkeypatch.setattr(sys, "argv", ["vsalog", *map(str, args)])
        code = _run()
        return code, *capsys.readouterr()

    return command


@pytest.fixture
def simulate(command):
    """Run `vsalog simulate ARGS`."""
    return lambda *args, cwd: command("simulate", *args, cwd=cwd)


@pytest.fixture
def done(simulate):
    """Run `vsalog simulate ARGS`, which must succeed; returns the JSON on stdout, or its text, None where there is none."""

    def done(*args, cwd):
        code, out, err = simulate(*args, "--force", cwd=cwd)
        assert code == 0, err
        return json.loads(out) if out.startswith("{") else out or None

    return done


@pytest.fixture
def bench(tmp_path):
    """A folder with a log and its rig."""
    lay(tmp_path)
    return tmp_path
