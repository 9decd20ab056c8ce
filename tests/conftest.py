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
settings.register_profile("vsalog", deadline=None, max_examples=50)
settings.load_profile("vsalog")

ROOT = Path(__file__).parent.parent


def pytest_addoption(parser):
    parser.addoption(
        "--all-cases", action="store_true", help="all tests and cases, also of what is marked every(n) or share(n)"
    )


def pytest_collection_modifyitems(config, items):
    """Run each n-th case of a test that is marked every(n), and each n-th test of a file that is marked share(n).

    Unless all are asked for, or some are named.
    """
    if config.getoption("--all-cases") or any("::" in argument for argument in config.args):
        return
    seen: dict[object, int] = {}
    kept, left = [], []
    for item in items:
        name = item.nodeid.partition("[")[0]
        wanted = True
        for marker, counted in (item.get_closest_marker("every"), name), (item.get_closest_marker("share"), item.path):
            if marker and wanted:
                seen[counted] = seen.get(counted, -1) + 1
                wanted = not seen[counted] % marker.args[0]
        (kept if wanted else left).append(item)
    config.hook.pytest_deselected(items=left)
    items[:] = kept


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
