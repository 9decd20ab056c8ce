"""A checkout of the product, run as a user runs it: only commands, exit codes and files of the contract are relied on."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The environment of every process: one thread each, as several run at once.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Product:
    """A checkout.

    Attributes
    ----------
    folder : the repository's root, in which `vsalog` lies
    """

    folder: Path

    def run(
        self,
        module: str,
        *arguments: str | Path,
        codes: Sequence[int] = (0,),
        cwd: Path | None = None,
        cache: Path | None = None,
    ) -> str:
        """Run a module of the checkout and return its stdout.

        Parameters
        ----------
        module : for `python -m`
        arguments : of the command
        codes : exit codes that are expected
        cwd : where; the repository's root when absent
        cache : folder of compiled code, instead of the usual one

        Raises
        ------
        RuntimeError
            It ended with another code.
        """
        where = {"PYTHONPATH": str(self.folder)} | ({} if cache is None else {"NUMBA_CACHE_DIR": str(cache)})
        command = [sys.executable, "-m", module, *map(str, arguments)]
        environment = os.environ | ONE_THREAD | where
        done = subprocess.run(command, cwd=cwd or self.folder, env=environment, capture_output=True, text=True)
        if done.returncode not in codes:
            raise RuntimeError(f"{' '.join(command[1:])} ended with {done.returncode}: {done.stderr[-2000:]}")
        return done.stdout

    def vsalog(self, *arguments: str | Path, codes: Sequence[int] = (0,), cache: Path | None = None) -> str:
        """Run a command of vsalog, as `run` does."""
        return self.run("vsalog", *arguments, codes=codes, cache=cache)

    def asked(self, *arguments: str | Path, codes: Sequence[int] = (0,)) -> Any:
        """Return the JSON document that a command of vsalog prints with `--json`."""
        return json.loads(self.vsalog(*arguments, "--json", codes=codes))

    def cpu(self, *arguments: str | Path, cache: Path | None = None) -> float:
        """Return the CPU time of a command of vsalog [s]. No other process may be waited for meanwhile."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.vsalog(*arguments, cache=cache)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def commit(self) -> str:
        """Return the commit that is checked out, with a + where files differ from it."""
        git = ("git", "-C", str(self.folder))
        head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
        changed = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True, check=True)
        return head.stdout.strip() + ("+" if changed.stdout.strip() else "")
