"""Logs behind addresses: found by patterns, fetched for as long as they are worked on."""

from __future__ import annotations

import glob
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vsalog.batch.names import encoded, readable, told_apart
from vsalog.batch.planned import BAG, BESIDE, ENDINGS, Plan, fixed_part
from vsalog.batch.records import Log
from vsalog.batch.storage import file_system
from vsalog.core.errors import BatchError, ReadError


def remote_plan(words: Sequence[str], out: str) -> Plan:
    """Find the logs behind addresses; see `vsalog.batch.plan.make_plan`."""
    found: dict[str, str] = {}
    roots, left_out, sizes = [], 0, dict[str, int]()
    for word in words:
        system, pattern = file_system(word)
        scheme = word.split("://", 1)[0]
        try:
            matched, root = _matched(system, pattern)
        except BatchError:
            raise
        except Exception as error:
            raise BatchError(f"{word}: cannot be looked at: {type(error).__name__}: {error}") from error
        if not matched:
            raise BatchError(f"'{word}' matches no log")
        roots.append(root)
        for path, size in matched.items():
            address = f"{scheme}://{path.lstrip('/') if scheme != 'memory' else path}"
            if f"{address}/".startswith(f"{out.rstrip('/')}/"):
                left_out += 1
                continue
            found[path], sizes[path] = address, size
    if not found:
        raise BatchError(f"no log is left: all that was found lies in {out}")
    root = os.path.commonpath(roots)
    paths = sorted(found)
    names = told_apart([readable(os.path.relpath(p, root).encode("utf-8", "surrogateescape")) for p in paths])
    logs = [
        Log(name=n, where=found[p].encode("utf-8", "surrogateescape"), remote=True, size=sizes[p])
        for n, p in zip(names, paths, strict=True)
    ]
    notes = [f"left out: {left_out} objects in {out}, which is where the batch goes"] if left_out else []
    return Plan(tuple(sorted(logs, key=lambda log: log.name)), tuple(notes))


def _matched(system: Any, pattern: str) -> tuple[dict[str, int], str]:
    """Return path → size, and what the names begin below. Folders that are bags are one log."""
    if glob.has_magic(pattern):
        found = system.glob(pattern, detail=True)
        files = {p: i for p, i in found.items() if not p.lower().endswith(BESIDE)}
        root = fixed_part(pattern)
    elif system.isfile(pattern):
        return {pattern: int(system.size(pattern) or 0)}, pattern.rsplit("/", 1)[0]
    else:
        everything = system.find(pattern, detail=True)
        bags = {p.rsplit("/", 1)[0] for p in everything if p.endswith(f"/{BAG}")}
        files = {p: i for p, i in everything.items() if p.lower().endswith(ENDINGS)}
        files = {p: i for p, i in files.items() if not any(p.startswith(f"{bag}/") for bag in bags)}
        sizes = {bag: sum(i["size"] for p, i in everything.items() if p.startswith(f"{bag}/")) for bag in bags}
        plain = {p: int(i["size"] or 0) for p, i in files.items()}
        return plain | sizes, pattern.rsplit("/", 1)[0] if pattern in bags else pattern
    kept = {}
    for path, info in files.items():
        if info["type"] == "directory":
            if system.isfile(f"{path}/{BAG}"):
                kept[path] = int(system.du(path))
        else:
            kept[path] = int(info["size"] or 0)
    bags = {p for p, i in files.items() if i["type"] == "directory" and p in kept}
    return {p: s for p, s in kept.items() if not any(p.startswith(f"{b}/") for b in bags)}, root


@contextmanager
def fetched(log: Log) -> Iterator[Path]:
    """Give a log as a path here: its own, or that of a copy, with the rigs that lie next to it, while the context lasts.

    Raises
    ------
    ReadError
        It cannot be fetched.
    """
    if not log.remote:
        yield Path(os.fsdecode(log.where))
        return
    address = log.where.decode("utf-8", "surrogateescape")
    with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
        system, path = file_system(address)
        above, _, name = path.rpartition("/")
        # The name is only ever one of a file in this folder, whatever the store calls the object.
        safe = (
            name
            if name not in ("", ".", "..") and "\0" not in name and len(os.fsencode(name)) < 250
            else encoded(log.name)
        )
        target = Path(folder) / safe
        try:
            if system.isfile(path):
                system.get_file(path, str(target))
                for rig in (f"{Path(name).stem}.rig.toml", "rig.toml"):
                    if system.isfile(f"{above}/{rig}"):
                        system.get_file(f"{above}/{rig}", str(target.with_name(rig)))
            else:
                _fetch_folder(system, path, target)
        except Exception as error:
            raise ReadError(f"{log.name}: cannot be fetched: {type(error).__name__}: {error}") from error
        yield target


def _fetch_folder(system: Any, path: str, target: Path) -> None:
    target.mkdir()
    parts = system.ls(path, detail=True)
    if not parts:
        raise FileNotFoundError(path)
    for part in parts:
        name = part["name"].rsplit("/", 1)[-1]
        if part["type"] == "file" and name not in ("", ".", ".."):
            system.get_file(part["name"], str(target / name))
