"""`python -m tests.limits.run`: double and halve each numeric constant of vsalog in turn, and see which changes a test notices.

Each change is made in a copy of the package, never in the checkout. The tests that concern a module are those that run it or a
module that takes the constant from it (see `record`), in the order in which they are likely to tell; they are run until one
fails or the time is up. A constant is noticed when either change makes a test fail. Results are printed, and written as JSON.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import SimpleQueue

from tests.limits.constants import Constant, constants_below

ROOT = Path(__file__).parents[2]
COPIED = (
    "vsalog",
    "tests",
    "benchmarks",
    "pyproject.toml",
    "Makefile",
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CITATION.cff",
    "LICENSE",
)
LINKED = ("docs", "sample_logs", "conda", ".github")
FAILED = (1, 2)
"""What pytest says where a test failed, or could not even be collected."""


Imports = dict[str, dict[str, set[str]]]


@dataclass
class Outcome:
    """What became of one change: the value in the source, the test that failed, and the time it took."""

    value: str
    noticed: bool
    by: str
    seconds: float


@dataclass
class Result:
    """Of one constant."""

    label: str
    value: str
    tests: int
    changes: list[Outcome] = field(default_factory=list)

    @property
    def noticed(self) -> bool:
        return any(change.noticed for change in self.changes)


def changed(source: str, constant: Constant, change: str) -> str:
    """Return a module's source with a constant doubled or halved; text is put behind the module's own assignment.

    A whole number stays whole, so that what counts still counts; zero becomes one, and minus one.
    """
    name = constant.name
    rule = {
        "doubled": "2 * v if v else type(v)(1)",
        "halved": "(v // 2 if isinstance(v, int) else v / 2) if v else type(v)(-1)",
    }[change]
    lines = source.split("\n")
    after = next(
        node.end_lineno
        for node in ast.parse(source).body
        if node.lineno <= constant.line <= (node.end_lineno or node.lineno)
    )
    each = f"(lambda v: {rule})"
    assignment = f"{name} = tuple({each}(v) for v in {name}) if isinstance({name}, tuple | list) else {each}({name})"
    lines.insert(after, assignment)
    return "\n".join(lines)


def imports(package: Path) -> Imports:
    """Return which modules import which from which: importing module → imported module → names."""
    found: Imports = {}
    for path in package.rglob("*.py"):
        own = found.setdefault(path.relative_to(package).as_posix(), {})
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == package.name:
                parts = node.module.split(".")[1:]
                for alias in node.names:
                    for inner in ([*parts, alias.name], parts):
                        file = Path(*inner).with_suffix(".py").as_posix() if inner else "__init__.py"
                        if (package / file).exists():
                            own.setdefault(file, set()).add(alias.name)
                            break
    return found


def concerned(constant: Constant, package: Path, known: Imports) -> list[set[str]]:
    """Return sets of modules whose tests may notice, the likeliest first: its own, those that take it, those that import it."""
    module = constant.module
    compiled = re.search(r"njit|core\.compiled", (package / module).read_text(encoding="utf-8")) is not None
    taking = {name for name, taken in known.items() if constant.name in taken.get(module, ())}
    importing = {name for name, taken in known.items() if module in taken}
    # A compiled module's functions are not seen when they run, nor are those of one that another compiled module calls.
    if compiled:
        importing |= {name for name, taken in known.items() if importing & taken.keys()}
    return [{module}, taking, importing if compiled or taking else set()]


def tests_for(
    constant: Constant, record: Mapping[str, dict], package: Path, known: Mapping[str, Mapping[str, set[str]]]
) -> list[str]:
    """Return the tests that concern a constant, the most telling first: of files that name it, of those that name its module,
    then those that run least besides.
    """
    chosen: list[str] = []
    texts = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    dotted = constant.module.removesuffix(".py").replace("/", ".")
    naming = {file for file, text in texts.items() if re.search(rf"\b{constant.name}\b", text)}
    importing = {file for file, text in texts.items() if re.search(rf"\b{dotted}\b", text)}
    for modules in concerned(constant, package, known):
        fitting = [name for name, note in record.items() if modules & set(note["modules"]) and not note["failed"]]

        def rank(name: str) -> tuple[bool, bool, bool, float]:
            file = name.partition("::")[0]
            near = file.split("/")[1] == constant.module.split("/")[0]
            cost = record[name]["seconds"] * len(record[name]["modules"])
            return file not in naming, file not in importing, not near, cost

        chosen += [name for name in sorted(fitting, key=rank) if name not in set(chosen)]
    return chosen


def copy_of(folder: Path) -> Path:
    """Lay a copy of the checkout, of which what no test changes is linked."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name)
        elif (ROOT / name).exists():
            shutil.copy2(ROOT / name, folder / name)
    for name in LINKED:
        (folder / name).symlink_to(ROOT / name)
    return folder


def _pytest(
    folder: Path, arguments: Sequence[str], limit: float | None, environment: Mapping[str, str] | None = None
) -> tuple[int | None, str]:
    """Run pytest in a copy; returns its exit code, None where the time was up, and its output."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "--all-cases"]
    command += arguments
    variables = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"} | dict(environment or {})
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            command, cwd=folder, env=variables, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            code: int | None = process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        output.seek(0)
        return code, output.read()


def recorded(place: Path, tests: Sequence[str]) -> dict[str, dict]:
    """Return which test runs which modules; made by one run of the tests where `place` does not hold it yet."""
    if not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as temporary, tempfile.TemporaryDirectory() as children:
            folder = copy_of(Path(temporary))
            variables = {"VSALOG_LIMITS_RECORD": str(place.absolute()), "VSALOG_LIMITS_CHILDREN": children}
            variables["PYTHONPATH"] = os.pathsep.join((str(folder), str(folder / "tests")))
            _, output = _pytest(folder, ["-p", "tests.limits.record", *(tests or ["tests"])], None, variables)
        if not place.exists():
            raise SystemExit(f"the tests could not be recorded:\n{output[-2000:]}")
    return json.loads(place.read_text(encoding="utf-8"))


@contextmanager
def _in_force(package: Path, constant: Constant, change: str) -> Iterator[None]:
    """Change a constant of a copy of the package for a while.

    What numba has kept of all that may have the number compiled in is put aside: its cache does not see imports change.
    """
    known, path = imports(package), package / constant.module
    stale, new = set(), {constant.module}
    while new:
        stale |= new
        new = {name for name, taken in known.items() if stale & taken.keys()} - stale
    kept = [file for name in stale for file in (package / name).parent.glob(f"__pycache__/{Path(name).stem}.*.nb?")]
    with tempfile.TemporaryDirectory(dir=package.parent) as aside:
        for k, file in enumerate((path, *kept)):
            file.rename(Path(aside) / str(k))
        path.write_text(changed(Path(aside, "0").read_text(encoding="utf-8"), constant, change), encoding="utf-8")
        try:
            yield
        finally:
            for name in stale:
                for file in (package / name).parent.glob(f"__pycache__/{Path(name).stem}.*.nb?"):
                    file.unlink()
            for k, file in enumerate((path, *kept)):
                (Path(aside) / str(k)).replace(file)


def tried(folder: Path, constant: Constant, tests: Sequence[str], limit: float) -> Result:
    """Try both changes of a constant in a copy of the checkout."""
    result = Result(constant.label, ast.unparse(constant.value), len(tests))
    for change in ("doubled", "halved") if tests else ():
        begun = time.perf_counter()
        with _in_force(folder / "vsalog", constant, change):
            code, output = _pytest(folder, ["-x", *tests], limit)
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
        seconds = round(time.perf_counter() - begun, 1)
        result.changes.append(Outcome(change, code in FAILED, failed[1] if failed else "", seconds))
    return result


def try_all(constants: Sequence[Constant], record: Mapping[str, dict], workers: int, limit: float) -> Iterator[Result]:
    """Try all constants, each worker in a copy of its own; yields results as they come."""
    package = ROOT / "vsalog"
    known = imports(package)
    # All is chosen ahead, and copied: the checkout may change meanwhile.
    chosen = [(constant, tests_for(constant, record, package, known)) for constant in constants]
    with tempfile.TemporaryDirectory() as temporary:
        copies: SimpleQueue[Path] = SimpleQueue()
        for k in range(workers):
            (Path(temporary) / str(k)).mkdir()
            copies.put(copy_of(Path(temporary) / str(k)))

        def one(task: tuple[Constant, list[str]]) -> Result:
            folder = copies.get()
            try:
                return tried(folder, *task, limit)
            finally:
                copies.put(folder)

        with ThreadPoolExecutor(workers) as pool:
            yield from pool.map(one, chosen)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Which numeric constants of vsalog does a test notice?")
    parser.add_argument(
        "--only", metavar="PATTERN", default="", help="of labels such as readers/message_reader.py:BLOCK_VALUES"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--limit", type=float, default=120.0, metavar="SECONDS", help="for the tests of one change")
    parser.add_argument("--out", type=Path, default=ROOT / ".limits", help="folder of results and of what is kept")
    parser.add_argument(
        "--record", nargs="*", metavar="TESTS", help="record anew which test runs what, of these tests alone"
    )
    options = parser.parse_args()
    place = options.out / "tests.json"
    if options.record is not None:
        place.unlink(missing_ok=True)
    record = recorded(place, options.record or [])
    constants = [c for c in constants_below(ROOT / "vsalog") if re.search(options.only, c.label)]
    results = []
    for result in try_all(constants, record, options.workers, options.limit):
        results.append(result)
        told = (
            ", ".join(f"{c.value} {c.by or 'noticed' if c.noticed else '—'}" for c in result.changes)
            or "no test runs it"
        )
        print(f"{'noticed' if result.noticed else 'NOT    '}  {result.label:60} {result.value:16} {told}", flush=True)
        document = [asdict(one) | {"noticed": one.noticed} for one in results]
        (options.out / "limits.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    count = sum(result.noticed for result in results)
    print(f"\n{count} of {len(results)} are noticed ({count / max(len(results), 1):.0%}); those that are not:")
    for result in results:
        if not result.noticed:
            print(f"    {result.label}  {result.value}")


if __name__ == "__main__":
    main()
