"""A plugin of pytest that notes which modules of vsalog each test runs: `pytest -p tests.limits.record`.

A module counts when one of its Python functions is called, in the process of the tests or in that of a command they run; what a
fixture calls counts for every test that uses the fixture. Compiled functions are not seen: who selects tests adds the modules
that import a compiled one. The notes go to the file that VSALOG_LIMITS_RECORD names, as JSON.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from types import FrameType

import command_line
import pytest

import vsalog

PLACE = "VSALOG_LIMITS_RECORD"
CHILDREN = "VSALOG_LIMITS_CHILDREN"
_PACKAGE = str(Path(vsalog.__file__).parent) + os.sep
_module_of: dict[str, str] = {}
_seen: set[str] = set()
_play = command_line._play


def _called(frame: FrameType, event: str, argument: object) -> None:
    """Note the module of a function that is called; returning nothing, its lines are not followed."""
    code = frame.f_code
    name = code.co_filename
    if (module := _module_of.get(name)) is None:
        module = _module_of[name] = (
            name.removeprefix(_PACKAGE).replace(os.sep, "/") if name.startswith(_PACKAGE) else ""
        )
    if module and code.co_name != "<module>":
        _seen.add(module)


def _follow() -> None:
    sys.settrace(_called)
    threading.settrace(_called)


def play(args: list[str], cwd: str, out: str, err: str, environment: dict[str, str]) -> None:
    """Be a command's process, see `command_line`, and leave what it called in a file."""
    _seen.clear()
    _follow()
    try:
        _play(args, cwd, out, err, environment)
    finally:
        sys.settrace(None)
        Path(environment[CHILDREN], str(os.getpid())).write_text(json.dumps(sorted(_seen)), encoding="utf-8")


def _of_children() -> set[str]:
    """Return what commands called that have ended since."""
    found: set[str] = set()
    for path in Path(os.environ[CHILDREN]).iterdir():
        found.update(json.loads(path.read_text(encoding="utf-8")))
        path.unlink()
    return found


class Recorder:
    """Follows a run of tests."""

    def __init__(self) -> None:
        self.fixtures: dict[tuple[str, str], set[str]] = {}
        self.tests: dict[str, dict[str, object]] = {}
        self.users: dict[str, tuple[str, ...]] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        before = set(_seen)
        _seen.clear()
        try:
            return (yield)
        finally:
            used = self.fixtures.setdefault((fixturedef.argname, fixturedef.baseid), set())
            used |= _seen | _of_children()
            _seen.update(before)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item, nextitem):
        _seen.clear()
        begun = time.perf_counter()
        _follow()
        try:
            return (yield)
        finally:
            sys.settrace(None)
            note = self.tests.setdefault(item.nodeid, {"failed": False})
            note |= {"seconds": round(time.perf_counter() - begun, 2), "modules": _seen | _of_children()}
            self.users[item.nodeid] = tuple(item.fixturenames)

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.tests.setdefault(report.nodeid, {})["failed"] = True

    def pytest_sessionfinish(self):
        for name, note in self.tests.items():
            for (fixture, base), modules in self.fixtures.items():
                if fixture in self.users.get(name, ()) and name.startswith(base):
                    note["modules"] |= modules
        document = {name: note | {"modules": sorted(note.get("modules", ()))} for name, note in self.tests.items()}
        Path(os.environ[PLACE]).write_text(json.dumps(document), encoding="utf-8")


def pytest_configure(config):
    command_line._play = play
    config.pluginmanager.register(Recorder())
