"""ROS 2 bags: SQLite files, and folders of SQLite or MCAP files."""

from __future__ import annotations

import re
import tempfile
import weakref
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.finding_texts import sentence
from vsalog.readers.compression import MAX_RATIO
from vsalog.readers.container import ZSTD_MAGIC, Container
from vsalog.readers.file_sequence import SeveralContainer
from vsalog.readers.limits import PACKED_BYTES
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.mcap_walk import MAGIC as MCAP_MAGIC
from vsalog.readers.rosbag2_sqlite import SQLITE_MAGIC, SqliteContainer

METADATA = "metadata.yaml"

_LOG_ENDINGS = (".bag", ".csv", ".tsv", ".parquet", ".mat", ".mcap", ".db3")
_BAG_ENDINGS = (".mcap", ".db3", ".zstd")
# Entries of the metadata's list of topics, in either order, and the needed parts of them.
_TOPIC = re.compile(r"^[ \t]*-[ \t]+(?=topic_metadata:|message_count:)", re.MULTILINE)
_NAME = re.compile(r"^[ \t]*name:[ \t]*[\"']?([^\s\"']+)", re.MULTILINE)
_COUNT = re.compile(r"^[ \t]*message_count:[ \t]*(\d{1,18})[ \t]*$", re.MULTILINE)


def _decompressed(path: Path) -> Container:
    """Return the container of a bag file that is compressed as a whole: it is in a temporary file while it is used.

    Raises
    ------
    ReadError
        The file cannot be decompressed, or what comes out is no bag.
    """
    import zstandard

    folder = tempfile.TemporaryDirectory(prefix="vsalog-")
    plain = Path(folder.name) / "bag"
    size, most, damage = 0, PACKED_BYTES + MAX_RATIO * path.stat().st_size, ""
    try:
        with path.open("rb") as source, plain.open("wb") as target:
            for piece in zstandard.ZstdDecompressor().read_to_iter(source):
                size += target.write(piece)
                if size > most:
                    raise ReadError(f"grows more than {MAX_RATIO} times: no recording is compressed so much", path)
    except (zstandard.ZstdError, OSError) as error:
        damage = str(error)
        if not size:
            raise ReadError(f"cannot be decompressed: {error}", path) from error
    container = bag_file(plain, shown=path)
    weakref.finalize(container, folder.cleanup)
    if damage:
        evidence = {"reason": damage}
        container.findings.add(Finding(code="recording.decompression_ended", value=size, unit="B", evidence=evidence))
    return container


def bag_folder(folder: Path) -> SeveralContainer:
    """Return the files of a ROS 2 bag.

    Raises
    ------
    ReadError
        The folder contains no bag.
    """
    findings = Findings()
    parts: list[Container] = []
    for path in _bag_files(folder, findings):
        try:
            parts.append(bag_file(path, shown=path))
        except ReadError as error:
            evidence = {"reason": error.what}
            findings.add(Finding(code="recording.file_left_out", part=path.name, evidence=evidence))
    if not parts:
        raise ReadError("; ".join(["none of its files can be read", *map(sentence, findings)]), folder)
    formats = {part.format for part in parts}
    kind = "rosbag2-mcap" if formats == {"mcap"} else "rosbag2-sqlite3"
    return SeveralContainer(parts, kind, findings, _stated(folder / METADATA))


def bag_file(path: Path, shown: Path) -> Container:
    """Return the container of one file of a ROS 2 bag; messages name it `shown`.

    Raises
    ------
    ReadError
        It is no such file.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise ReadError(f"cannot be opened: {error.strerror or error}", shown) from error
    if head.startswith(MCAP_MAGIC):
        return McapContainer(path)
    if head == SQLITE_MAGIC:
        return SqliteContainer(path)
    if head.startswith(ZSTD_MAGIC) and path == shown:  # compressed once, not twice
        return _decompressed(path)
    if not head:
        raise ReadError("is empty", shown)
    raise ReadError("is neither an MCAP nor an SQLite file", shown)


def is_bag_folder(folder: Path) -> bool:
    """Return whether a folder holds a ROS 2 bag."""
    return (folder / METADATA).is_file() or bool(_candidates(folder))


def _candidates(folder: Path) -> list[Path]:
    """Return the bag files in a folder, by their content, ``bag_10`` after ``bag_9``."""
    found = [path for path in folder.iterdir() if path.is_file() and _is_candidate(path)]
    return sorted(
        found, key=lambda path: [(int(p), "") if p.isdigit() else (0, p) for p in re.split(r"(\d+)", path.name)]
    )


def _is_candidate(path: Path) -> bool:
    """Return whether a file looks like one of a bag, by its name if it cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError:
        return path.suffix in _BAG_ENDINGS
    return head.startswith((MCAP_MAGIC, ZSTD_MAGIC)) or head == SQLITE_MAGIC


def _bag_files(folder: Path, findings: Findings) -> list[Path]:
    """Return the files of a bag: those that the metadata list, or else all that look like bag files.

    The metadata only choose among the files of the folder; their entries are never opened as paths.
    """
    candidates = _candidates(folder)
    listed = _listed_in(folder / METADATA)
    if not listed and (candidates or listed is None):
        if len({_bag_name(path) for path in candidates}) > 1:
            raise ReadError(
                f"is a folder of several logs, no single bag (it has no {METADATA} that names them): name one of"
                f" {_listed(candidates)}",
                folder,
            )
        evidence = {"files": _listed(candidates)}
        findings.add(Finding(code="recording.no_file_list", part=METADATA, value=len(candidates), evidence=evidence))
        if skipped := _skipped_numbers(candidates):
            findings.add(_missing(skipped, "the numbers"))
        findings.add(*_others(folder, candidates))
        return candidates
    present = {path.name: path for path in folder.iterdir() if path.is_file()}
    chosen = [present[name] for name in listed if name in present]
    missing = [name for name in listed if name not in present]
    if missing and not chosen:
        chosen = candidates
        findings.add(Finding(code="recording.listed_files_absent", part=METADATA, value=len(candidates)))
    elif missing:
        findings.add(_missing(missing, METADATA))
    if not chosen:
        raise ReadError(f"has a {METADATA}, but no bag files; copy them next to it", folder)
    findings.add(*_others(folder, chosen))
    return chosen


def _missing(files: list[str], told_by: str) -> Finding:
    evidence = {"told_by": told_by, "files": ", ".join(files[:5])}
    return Finding(code="recording.files_missing", value=len(files), evidence=evidence)


def _bag_name(path: Path) -> str:
    """Return the common name of the files of one bag: ``run`` of ``run_0.mcap`` and ``run_1.mcap.zstd``."""
    return re.sub(r"_\d+$", "", path.name.partition(".")[0])


def _skipped_numbers(paths: list[Path]) -> list[str]:
    """Return the names, without endings, of the files of a bag between those that are there: ROS counts from 0."""
    numbers = {int(found[1]) for path in paths if (found := re.search(r"_(\d{1,6})$", path.name.partition(".")[0]))}
    if len(numbers) < len(paths):
        return []  # named by somebody else
    return [f"{_bag_name(paths[0])}_{number}" for number in range(max(numbers, default=0)) if number not in numbers]


def _others(folder: Path, chosen: list[Path]) -> list[Finding]:
    """Return which files of the folder look like logs too, but are no part of the bag."""
    others = [
        path
        for path in sorted(folder.iterdir())
        if path not in chosen and path.is_file() and path.suffix in _LOG_ENDINGS
    ]
    evidence = {"logs": _listed(others)}
    return [Finding(code="recording.other_logs", part=folder.name, evidence=evidence)] if others else []


def _listed(paths: list[Path]) -> str:
    more = f" and {len(paths) - 5} more" if len(paths) > 5 else ""
    return ", ".join(path.name for path in paths[:5]) + more


def counted(file: Container, path: Path) -> Container:
    """Return a bag's file, compared with the metadata next to it where these name only that file."""
    metadata = path.with_name(METADATA)
    if _listed_in(metadata) != [path.name] or not (stated := _stated(metadata)):
        return file
    return SeveralContainer([file], file.format, file.findings, stated)


def _stated(metadata: Path) -> dict[str, int]:
    """Return how many messages of each topic the metadata count."""
    found: dict[str, int] = {}
    for item in _TOPIC.split((_text(metadata) or "").partition("topics_with_message_count:")[2])[1:]:
        name, count = _NAME.search(item), _COUNT.search(item)
        if name and count:
            found[name[1]] = found.get(name[1], 0) + int(count[1])
    return found


def _text(metadata: Path) -> str | None:
    """Return the text of the metadata; None where it cannot be read."""
    try:
        return metadata.read_text("utf-8", "replace") if metadata.is_file() else None
    except OSError:
        return None


def _listed_in(metadata: Path) -> list[str] | None:
    """Return the names of the files that the metadata list, without folders; None where they cannot be read."""
    text = _text(metadata)
    if text is None:
        return None
    block = re.search(r"^[ \t]*relative_file_paths:[ \t]*\n((?:[ \t]*-[ \t]+\S.*\n?)+)", text, re.MULTILINE)
    lines = block.group(1).splitlines() if block else []
    names = [line.strip()[1:].strip().strip("\"'").replace("\\", "/").rpartition("/")[2] for line in lines]
    return [name for name in names if name and name.isprintable()]
