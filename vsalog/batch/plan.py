"""Patterns, folders and lists → the logs of a batch, in an order that depends on nothing else."""

from __future__ import annotations

import glob
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from vsalog.batch.names import readable, shown, told_apart
from vsalog.batch.planned import BAG, BESIDE, ENDINGS, Plan, fixed_part
from vsalog.batch.records import Log
from vsalog.batch.remote_plan import remote_plan
from vsalog.batch.storage import is_address
from vsalog.core.errors import BatchError


def make_plan(asked: Sequence[str], out: str) -> Plan:
    """Find the logs.

    Parameters
    ----------
    asked : paths, patterns (``**`` is any depth), folders, addresses with patterns, ``@FILE`` for a list of these, ``-`` for
        one on the standard input
    out : folder or address of the batch, where no log may be

    Raises
    ------
    BatchError
        A pattern matches nothing, a file is not there, or the batch would be written into a log.
    """
    words = [word for text in asked for word in _listed(text)]
    if not words:
        raise BatchError("the list of logs is empty")
    if len({is_address(word) for word in words}) > 1:
        raise BatchError("some logs are files here and some are addresses; put them into two batches")
    if is_address(words[0]):
        return remote_plan(words, out)
    paths, roots, notes = [], [], []
    for word in words:
        found, root = _matched(word)
        paths += found
        roots.append(root)
    paths, left_out = _outside(paths, words, out)
    if left_out:
        notes.append(f"left out: {left_out} files in {shown(out)}, which is where the batch goes")
    paths, twice = _once(_without_parts(paths))
    if twice:
        notes.append(f"left out: {twice} files that are others by another name")
    if not paths:
        raise BatchError(f"no log is left: all that was found lies in {shown(out)}")
    root = os.path.commonpath([Path(r).absolute() for r in roots])
    relative = [os.fsencode(os.path.relpath(Path(p).absolute(), root)) for p in paths]
    names = told_apart([readable(r.replace(os.fsencode(os.sep), b"/")) for r in relative])
    logs = [
        Log(name=n, where=os.fsencode(Path(p).absolute()), remote=False, size=_size(Path(p)))
        for n, p in zip(names, paths, strict=True)
    ]
    return Plan(tuple(sorted(logs, key=lambda log: log.name)), tuple(notes))


def _listed(text: str) -> list[str]:
    """Read a list: lines, or with zeros between, as `find -print0` writes names that hold line ends."""
    if text != "-" and not text.startswith("@"):
        return [text]
    try:
        data = sys.stdin.buffer.read() if text == "-" else Path(text[1:]).read_bytes()
    except OSError as error:
        raise BatchError(f"{shown(text[1:])}: the list of logs cannot be read: {error.strerror}") from error
    parts = data.split(b"\0") if b"\0" in data else data.splitlines()
    return [os.fsdecode(part) for part in parts if part.strip()]


def _matched(word: str) -> tuple[list[str], str]:
    """Return the logs that a word means, and the folder that their names begin below."""
    path = Path(word)
    if path.is_dir():
        if (path / BAG).is_file():
            return [word], str(path.absolute().parent)
        found = _inside(path)
        if not found:
            raise BatchError(f"{shown(word)}: there is no log in this folder (endings: {', '.join(ENDINGS)})")
        return found, word
    if path.exists() or not glob.has_magic(word):
        if not path.is_file():
            raise BatchError(f"{shown(word)}: {'is no file' if path.exists() else 'there is no such file'}")
        return [word], str(path.absolute().parent)
    # Path.glob knows no pattern that begins at the root.
    found = [f for f in glob.glob(word, recursive=True) if _is_log(Path(f))]  # noqa: PTH207
    if not found:
        raise BatchError(f"'{shown(word)}' matches no log")
    return found, fixed_part(word)


def _is_log(path: Path) -> bool:
    """Tell what a pattern may have meant: no folders but bags, and no file of the kinds that lie next to logs."""
    if path.is_dir():
        return (path / BAG).is_file()
    return path.is_file() and path.suffix.lower() not in BESIDE


def _inside(top: Path) -> list[str]:
    found = []
    for folder, folders, files in os.walk(top):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if BAG in files:
            found.append(folder)
            folders.clear()
            continue
        logs = (f for f in files if f.lower().endswith(ENDINGS) and not f.startswith("."))
        found += [str(Path(folder, f)) for f in logs]
    return found


def _outside(paths: Iterable[str], words: Sequence[str], out: str) -> tuple[list[str], int]:
    """Leave out what lies in the batch itself; refuse what was named and lies there, and a batch inside a log."""
    if is_address(out):
        return list(paths), 0
    target, kept, left_out = Path(out).resolve(), [], 0
    for path in paths:
        real = Path(path).resolve()
        if real == target or (real in target.parents and (real / BAG).is_file()):
            raise BatchError(f"{shown(out)}: is a log itself, or lies in one; name another folder with -o")
        if target in real.parents:
            if path in words:
                raise BatchError(
                    f"{shown(path)}: lies in {shown(out)}, where the batch goes; name another folder with -o"
                )
            left_out += 1
        else:
            kept.append(path)
    return kept, left_out


def _without_parts(paths: Sequence[str]) -> list[str]:
    """Leave out the files of bags that are there as folders."""
    bags = {Path(p).absolute() for p in paths if Path(p).is_dir()}
    return [p for p in paths if not any(above in bags for above in Path(p).absolute().parents)]


def _once(paths: Sequence[str]) -> tuple[list[str], int]:
    """Take each file once, by the first of its names in the order of the alphabet; say how many had another one."""
    by_path = {str(Path(p).absolute()): p for p in paths}
    by_file: dict[str, str] = {}
    for path in sorted(by_path):
        # A link gives way to the file, whatever their names.
        real = os.path.realpath(path)
        if real not in by_file or path == real:
            by_file[real] = by_path[path]
    return list(by_file.values()), len(by_path) - len(by_file)


def _size(path: Path) -> int:
    try:
        if path.is_dir():
            return sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
        return path.stat().st_size
    except OSError:
        return 0
