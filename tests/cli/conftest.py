"""`vsalog simulate` in this process."""

import json
import sys

import pytest

from vsalog.cli import _run


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command line in this process, which spares an interpreter's start; returns exit code, stdout and stderr."""

    def call(*args, cwd):
        monkeypatch.chdir(cwd)
        monkeypatch.setattr(sys, "argv", ["vsalog", "simulate", *map(str, args)])
        code = _run()
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def done(call):
    """Run a command that must succeed; returns the JSON document on its stdout, or its text, None where there is none."""

    def done(*args, cwd):
        code, out, err = call(*args, cwd=cwd)
        assert code == 0, err
        return json.loads(out) if out.startswith("{") else out or None

    return done
