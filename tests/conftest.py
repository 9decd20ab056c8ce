"""What the tests share: where the sample logs are, and a way to run the command line as a user does."""

import os
from pathlib import Path

# Tests run side by side, one to a core: linear algebra with threads of its own would make them wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# pytest-xdist states a width to its workers, which a pipe has not.
os.environ.pop("COLUMNS", None)

import pytest
from command_line import vsalog_run
from hypothesis import settings

# The first call of a compiled loop takes as long as its compilation: no deadline would be fair to it.
settings.register_profile("vsalog", deadline=None)
settings.load_profile("vsalog")

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def samples() -> Path:
    return ROOT / "sample_logs"


@pytest.fixture
def run(tmp_path):
    """Run `vsalog ARGS` in an empty folder; returns the finished process with text output."""

    def run(*args, cwd=tmp_path):
        return vsalog_run(*args, cwd=cwd)

    return run


@pytest.fixture
def refused(run):
    """Run a command that must be refused: exit code 2, one line on stderr, nothing on stdout, no file left behind."""

    def refused(*args, cwd):
        before = set(cwd.rglob("*"))
        done = run(*args, cwd=cwd)
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr
        assert done.stdout == ""
        assert set(cwd.rglob("*")) == before
        return done.stderr

    return refused
