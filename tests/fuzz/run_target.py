"""One fuzz target in this process: ``run_target.py TARGET CORPUS [options of libFuzzer]``."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import sys
import traceback
from pathlib import Path

import atheris

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "readers")]
sys.setrecursionlimit(1000)  # as a user's process has it


def main() -> None:
    name, corpus, *options = sys.argv[1:]
    compiled = [] if os.environ.get("NUMBA_DISABLE_JIT") == "1" else with_loops()
    with atheris.instrument_imports(include=["vsalog", "tomllib", "rosbags", "mcap"], exclude=compiled):
        target = importlib.import_module(f"fuzz_{name}")
        seed(target, Path(corpus))
        if not compiled:
            wrap_numbers()
    findings = Path(next(o for o in options if o.startswith("-artifact_prefix=")).partition("=")[2]).parent
    if hasattr(target, "words"):
        words = Path(corpus).with_suffix(".dict")
        words.write_text("".join(f'"{word}"\n' for word in target.words() if word.isascii() and word.isprintable()))
        options.append(f"-dict={words}")
    bounded = importlib.import_module("fuzz_contract").bounded
    seen = {path.stem for path in findings.glob("*.txt")}
    too_much = False

    def one(data: bytes) -> None:
        nonlocal too_much
        try:
            target.one(data)
            if not too_much:
                bounded()
        except Exception as error:
            too_much = too_much or "GiB of memory" in str(error)
            keep(error, data)

    def keep(error: Exception, data: bytes) -> None:
        stack = traceback.extract_tb(error.__traceback__)
        ours = [f"{Path(f.filename).name}:{f.lineno}" for f in stack if "vsalog" in f.filename or "fuzz_" in f.filename]
        where = f"{name}-{type(error).__name__}-{hashlib.sha1(' '.join(ours[-2:]).encode()).hexdigest()[:10]}"
        if where in seen:
            return
        seen.add(where)
        (findings / where).write_bytes(data)
        told = "".join(traceback.format_exception(error))
        (findings / f"{where}.txt").write_text(told, encoding="utf-8", errors="backslashreplace")

    atheris.Setup([sys.argv[0], *options, corpus], one)
    atheris.Fuzz()


def with_loops() -> list[str]:
    """Return the modules that are compiled, which cannot be when calls of the fuzzer's are among their instructions."""
    top = Path(importlib.util.find_spec("vsalog").origin).parent
    files = [path for path in top.rglob("*.py") if "njit" in path.read_text(encoding="utf-8")]
    return [".".join(path.relative_to(top.parent).with_suffix("").parts) for path in files]


def wrap_numbers() -> None:
    """Let interpreted loops count as compiled ones do, where a number beyond int64 becomes negative."""
    from vsalog.readers import mcap_scan

    number = mcap_scan._number
    mcap_scan._number = lambda *where: (number(*where) + 2**63) % 2**64 - 2**63


def seed(target, corpus: Path) -> None:
    """Write the seeds into the corpus, unless they are there."""
    for data in target.seeds():
        path = corpus / hashlib.sha1(data).hexdigest()
        if not path.exists():
            path.write_bytes(data)
        target.one(data)  # what is only imported when it is used is imported now


if __name__ == "__main__":
    main()
