"""What import-linter cannot see: imports inside functions, and what is imported on the way to a help text."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import vsalog

TOP = Path(vsalog.__file__).parent
# Where a process begins: what a command or a worker does not need is not to be loaded.
ENTRIES = ("cli/", "batch/worker.py")
HEAVY = {
    "h5py",
    "jinja2",
    "matplotlib",
    "mcap",
    "msgspec",
    "numba",
    "numpy",
    "pandas",
    "pint",
    "plotly",
    "pyarrow",
    "rosbags",
    "scipy",
}


def own_imports(function):
    """Names of modules of vsalog that are imported inside a function."""
    for node in ast.walk(function):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == "vsalog")
        elif isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").split(".")[0] == "vsalog"):
            yield node.module


def test_only_entries_import_modules_of_vsalog_inside_functions():
    found = {}
    for path in TOP.rglob("*.py"):
        name = path.relative_to(TOP).as_posix()
        if not name.startswith(ENTRIES):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))
            found[name] = {module for function in functions for module in own_imports(function)}
    assert len(found) > 400
    assert {name: modules for name, modules in found.items() if modules} == {}


@pytest.mark.parametrize(
    "code", ["import vsalog", "from vsalog.cli import cli; cli(['--help'], standalone_mode=False)"]
)
def test_help_and_the_package_load_nothing_heavy(code):
    end = f"; import sys; print(sorted({HEAVY!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code + end], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_who_hands_out_logs_does_not_load_what_works_on_them():
    code = "import vsalog.batch.run, sys; print(sorted(m for m in sys.modules if m.startswith('vsalog.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[1] for name in ast.literal_eval(done.stdout)}
    assert not loaded & {
        "checks",
        "diagnosis",
        "estimation",
        "estimators",
        "readers",
        "simulation",
        "validation",
        "writers",
    }
