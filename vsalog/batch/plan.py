"""Patterns, folders and lists → the logs of a batch, in an order that depends on nothing else."""

from __future__ import annotations

import glob
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from fsspec.utils import glob_translate

from vsalog.batch.names import readable, shown, told_apart
from vsalog.batch.records import Log
from vsalog.batch.storage import address, explained, file_system, is_local
from vsalog.batch.worker import is_prose, is_recording
from vsalog.core.errors import BatchError
from vsalog.core.printable import plural

BAG = "metadata.yaml"
# Suffixes that a folder is searched for; a pattern may match anything.
ENDINGS = (".mcap", ".bag", ".db3", ".csv", ".tsv", ".parquet", ".mat", ".gz", ".zst", ".bz2", ".lz4")
# Those of tables; a folder of them may be one recording.
TABLES = (".csv", ".tsv", ".csv.gz", ".tsv.gz", ".parquet")
# Files next to logs that are no logs.
NO_LOGS = (".toml", ".yaml", ".yml", ".md", ".html", ".json")


@dataclass(frozen=True, slots=True)
class Plan:
    """The logs of a batch, sorted by name, and what was left out on the way, in words."""

    logs: tuple[Log, ...]
    notes: tuple[str, ...]

    def shard(self, index: int, count: int) -> Plan:
        """Return every count-th log, beginning with the index-th, counted from 1."""
        return Plan(self.logs[index - 1 :: count], self.notes)


def make_plan(asked: Sequence[str], out: str) -> Plan:
    """Find the logs.

    Parameters
    ----------
    asked : paths, addresses, patterns of either (``**`` is any depth), folders, ``@FILE`` for a list of these, ``-`` for
        one on the standard input
    out : folder or address of the batch, where no log may be

    Raises
    ------
    BatchError
        A pattern matches nothing, a file does not exist, or the batch would be written into a log.
    """
    words = [word for text in asked for word in _listed(text)]
    if not words:
        raise BatchError("the list of logs is empty")
    placed = [file_system(word) for word in words]
    system = placed[0][0]
    if any(other != system for other, _ in placed):
        raise BatchError("some logs are local files and some are addresses; use two batches")
    sizes: dict[str, int] = {}
    roots, notes, named = [], [], set()
    for word, (_, path) in zip(words, placed, strict=True):
        found, root, prose = _found(system, path, word)
        sizes |= found
        if prose:
            notes.append(
                f"left out: {plural(len(prose), 'file')} of text that contain no table, such as {shown(prose[0])}"
            )
        roots.append(root)
        named |= {path} & set(found)
    paths, left_out = _outside(system, sizes, named, out)
    if left_out:
        notes.append(f"left out: {left_out} files in {shown(out)}, the folder of the batch")
    paths, twice = _once(system, paths)
    if twice:
        notes.append(f"left out: {twice} files that are other names of the same logs")
    if not paths:
        raise BatchError(f"no log is left: all logs found are in {shown(out)}")
    root = os.path.commonpath(roots)
    names = told_apart([readable(os.fsencode(Path(os.path.relpath(p, root)).as_posix())) for p in paths])
    logs = [
        Log(name=n, where=os.fsencode(address(system, p)), size=sizes[p]) for n, p in zip(names, paths, strict=True)
    ]
    return Plan(tuple(sorted(logs, key=lambda log: log.name)), tuple(notes))


def _listed(text: str) -> list[str]:
    """Read a list: lines, or zero-separated as of `find -print0`, for names that contain line ends."""
    if text != "-" and not text.startswith("@"):
        return [text]
    try:
        data = sys.stdin.buffer.read() if text == "-" else Path(text[1:]).read_bytes()
    except OSError as error:
        raise BatchError(f"{shown(text[1:])}: the list of logs cannot be read: {error.strerror}") from error
    parts = data.split(b"\0") if b"\0" in data else data.splitlines()
    return [os.fsdecode(part) for part in parts if part.strip()]


def _found(system: Any, path: str, word: str) -> tuple[dict[str, int], str, list[str]]:
    """Return path → size [bytes] of the logs that a word means, the folder that their names begin below, and the names of files
    that a pattern matches although they are no logs.
    """
    with explained(shown(word), "looked at"):
        kind = _kind(system, path)
        prose: list[str] = []
        if kind == "file":
            return {path: int(system.info(path)["size"] or 0)}, path.rpartition("/")[0], prose
        if kind == "directory":
            logs = _logs(system, _below(system, path, None))
            top = path.rpartition("/")[0] if path in logs else path
        elif glob.has_magic(word):
            fixed, rest = _parts(word)
            top, matches = file_system(fixed)[1], re.compile(glob_translate(rest)).match
            # One level deeper than requested, to see which folders are bags.
            there = _below(system, top, None if "**" in rest else rest.count("/") + 2)
            logs = _logs(system, there, lambda path: matches(path.removeprefix(top).lstrip("/")) is not None)
            if is_local(system) and not rest.rpartition("/")[2].strip("*"):  # a pattern that names no ending
                prose = [path for path in logs if not path.lower().endswith(ENDINGS) and is_prose(path)]
            logs = {path: size for path, size in logs.items() if path not in prose}
        else:
            raise BatchError(f"{shown(word)}: {'is no file' if kind else 'there is no such file'}")
    if not logs and kind:
        raise BatchError(f"{shown(word)}: there is no log in this folder (suffixes: {', '.join(ENDINGS)})")
    if not logs:
        raise BatchError(f"'{shown(word)}' matches no log")
    return logs, top, [path.rpartition("/")[2] for path in prose]


def _kind(system: Any, path: str) -> str:
    """Return what is at a path: "file", "directory", another word for what is neither, "" for nothing."""
    try:
        return str(system.info(path)["type"])
    except (FileNotFoundError, NotADirectoryError):
        return ""


def _parts(pattern: str) -> tuple[str, str]:
    """Return the folder above the first part of a pattern that has a wildcard, the same whatever it matches; and the rest."""
    parts = pattern.rstrip("/").split("/")
    first = next(i for i, part in enumerate(parts) if glob.has_magic(part))
    return "/".join(parts[:first]) or ("/" if pattern.startswith("/") else "."), "/".join(parts[first:])


def _below(system: Any, top: str, depth: int | None) -> dict[str, int]:
    """Return path → size [bytes] of the files below a folder, without hidden ones, to a given depth.

    Links to folders are followed once each, and none to a folder that contains the link.
    """
    files: dict[str, int] = {}
    seen = {str(folder) for folder in (Path(top).resolve(), *Path(top).resolve().parents)}
    folders = [(top, depth)]
    while folders:
        folder, deep = folders.pop()
        for path, info in system.find(folder, maxdepth=deep, detail=True).items():
            below = path.removeprefix(folder).strip("/").split("/")
            if any(part.startswith(".") for part in below):
                continue
            if info["type"] == "file" or system.isfile(path):
                files[path] = int(info["size"] or 0)
            elif info.get("islink") and (real := os.path.realpath(path)) not in seen and system.isdir(path):
                seen.add(real)
                if deep is None or deep > len(below):
                    folders.append((path, None if deep is None else deep - len(below)))
    return files


def _logs(system: Any, files: Mapping[str, int], matches: Callable[[str], bool] | None = None) -> dict[str, int]:
    """Choose what a pattern means of a folder's files, or the folder itself: logs, and folders that are one log."""
    bags = {path.rpartition("/")[0] for path in files if path.endswith(f"/{BAG}")}
    if matches is not None:
        bags = {bag for bag in bags if matches(bag)}
    bags |= _table_folders(system, files, matches) - bags
    chosen: Counter[str] = Counter()
    for path, size in files.items():
        bag = [above for above in map(str, PurePosixPath(path).parents) if above in bags]
        name = path.lower()
        if bag:
            chosen[bag[-1]] += size
        elif name.endswith(ENDINGS) if matches is None else matches(path) and not name.endswith(NO_LOGS):
            chosen[path] = size
    return dict(chosen)


def _table_folders(system: Any, files: Iterable[str], matches: Callable[[str], bool] | None) -> set[str]:
    """Return the folders whose tables are one recording.

    A pattern that matches a folder and no table in it means the folder. Else the tables' clocks have to show that they were
    recorded together, since the pattern may mean each of them.
    """
    tables: dict[str, list[str]] = {}
    for path in files if is_local(system) else ():
        if path.lower().endswith(TABLES):
            tables.setdefault(path.rpartition("/")[0], []).append(path)
    found = set()
    for folder, own in tables.items():
        if len(own) > 1 and (matches is None or matches(folder)):
            meant = matches is not None and not any(map(matches, own))
            if is_recording(folder, meant):
                found.add(folder)
    return found


def _place(system: Any, path: str) -> str:
    """Return a path without links, or an address: unique for each file."""
    return os.path.realpath(path) if is_local(system) else address(system, path)


def _outside(system: Any, paths: Iterable[str], named: Collection[str], out: str) -> tuple[list[str], int]:
    """Leave out files of the batch itself; refuse named files in it, and a batch inside a log."""
    target, kept, left_out = _place(*file_system(out)), [], 0
    for path in paths:
        place = _place(system, path)
        if f"{target}/".startswith(f"{place}/"):
            raise BatchError(f"{shown(out)}: is a log itself, or is in one; name another folder with -o")
        if not place.startswith(f"{target}/"):
            kept.append(path)
        elif path in named:
            raise BatchError(f"{shown(path)}: is in {shown(out)}, the folder of the batch; name another folder with -o")
        else:
            left_out += 1
    return kept, left_out


def _once(system: Any, paths: Sequence[str]) -> tuple[list[str], int]:
    """Take each file once, by the first of its names in alphabetical order; return how many had another one."""
    by_place: dict[str, str] = {}
    for path in sorted(paths):
        place = _place(system, path)
        # A file precedes a link to it, whatever their names.
        if place not in by_place or path == place:
            by_place[place] = path
    return list(by_place.values()), len(paths) - len(by_place)
