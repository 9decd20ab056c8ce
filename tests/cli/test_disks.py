"""Read-only and full disks, and outputs that are inputs, for every command that writes: one line, nothing half written."""

import hashlib
import json
import os
import subprocess
import sys
import tempfile

import pytest
from command_line import vsalog_run
from knee import RIG, lay

pytestmark = pytest.mark.share(2)

COMMANDS = {
    "estimate": [
        "estimate",
        "log.csv",
        "-e",
        "direct",
        "-o",
        "DISK/",
        "--report",
        "DISK/page.html",
        "--mcap",
        "DISK/x.mcap",
    ],
    "validate": ["validate", "log.model.toml", "log.csv", "--no-modalities", "-o", "DISK"],
    "diagnose": ["diagnose", "log.csv", "-o", "DISK"],
    "simulate": ["simulate", "sea", "--duration", "2", "-o", "DISK/sim.csv"],
    "a ROS 2 bag": ["simulate", "sea", "--duration", "2", "-o", "DISK/sim/"],
    "init": ["init", "log.csv", "-o", "DISK/new.toml"],
    "repair": ["inspect", "log.csv", "--repair", "DISK/repaired.mcap"],
}
# One process does all: what takes its time is to import the libraries.
PLAY = """
import contextlib, io, json, os, sys
from vsalog.cli import _run
commands = json.loads(sys.argv[1])
for disk, name, words in [(d, *c) for d in ("full", "readonly") for c in commands.items()]:
    if (disk, name) == ("full", "diagnose"):
        continue  # which takes its time, and writes as the others do
    sys.argv = ["vsalog", *(w.replace("DISK", disk) for w in words)]
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.TextIOWrapper(io.BytesIO(), "utf-8")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = _run()
    out.flush(), err.flush()
    said = [stream.buffer.getvalue().decode() for stream in (out, err)]
    print(json.dumps([disk, name, code, *said, sorted(set(os.listdir(disk)) - {"filler"})]))
"""
SCRIPT = """
set -e
mkdir full readonly
mount -t tmpfs -o size=64k none full
cat /dev/zero > full/filler || true
mount -t tmpfs none readonly
mount -o remount,ro readonly
"$PYTHON" -c "$PLAY" "$COMMANDS"
"""


def lay_with_model(folder):
    lay(folder)
    done = vsalog_run("estimate", "log.csv", "-e", "direct", cwd=folder)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What the commands say where the disk is full, and where it is read-only; None where no disk may be mounted."""
    folder = tmp_path_factory.mktemp("disks")
    lay_with_model(folder)
    with tempfile.TemporaryFile() as nowhere:
        probe = subprocess.run(
            ["unshare", "-rm", "mount", "-t", "tmpfs", "none", "/mnt"], stdout=nowhere, stderr=nowhere
        )
    if probe.returncode != 0:
        return None
    more = {"PYTHON": sys.executable, "PLAY": PLAY, "COMMANDS": json.dumps(COMMANDS)}
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", SCRIPT],
        cwd=folder,
        capture_output=True,
        text=True,
        env=os.environ | more,
        timeout=200,
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return {(row[0], row[1]): row[2:] for row in rows}


@pytest.mark.parametrize("disk", ["full", "readonly"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_disk_that_takes_nothing(said, name, disk):
    if said is None:
        pytest.skip("no disks may be mounted here")
    if (disk, name) == ("full", "diagnose"):
        return
    code, out, err, left = said[disk, name]
    assert (code, out) == (2, ""), err
    *_, last = err.strip().splitlines()
    assert ("No space left" if disk == "full" else "Read-only file system") in last or (disk, name) == (
        "full",
        "a ROS 2 bag",
    )
    assert "Traceback" not in err
    assert not left


ALSO_INPUTS = [
    ["estimate", "log.csv", "--mcap", "rig.toml", "--rig", "rig.toml"],
    ["estimate", "log.csv", "--report", "rig.toml"],
    ["estimate", "log.csv", "-o", "rig.toml"],
    ["estimate", "--from", "log.stiffness.parquet", "--report", "log.stiffness.parquet"],
    ["estimate", "bag", "--rig", "sea", "--mcap", "bag/bag.db3"],
    ["estimate", "log.csv", "--report", "hard.csv"],
    ["estimate", "log.csv", "-o", "soft.csv"],
    ["validate", "report.json", "log.csv", "--no-modalities"],
    ["validate", "log.model.toml", "report.html"],
    ["validate", "log.model.toml", "log.csv", "--rig", "report.json"],
    ["diagnose", "diagnosis.html"],
    ["diagnose", "log.csv", "--rig", "extended.rig.toml"],
    ["inspect", "log.csv", "--repair", "hard.csv"],
    ["inspect", "log.csv", "--repair", "soft.csv"],
    ["compare", "log.csv", "--report", "log.csv"],
    ["compare", "log.csv", "--report", "rig.toml"],
    ["simulate", "own.rig.toml", "-o", "own.csv"],
    ["simulate", "--replay", "log.csv", "-o", "log.csv"],
    ["init", "log.csv", "-o", "log.csv", "--force"],
    ["init", "log.csv", "-o", "hard.csv", "--force"],
]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    lay_with_model(folder)
    for name in ("report.html", "diagnosis.html"):
        (folder / name).write_bytes((folder / "log.csv").read_bytes())
    (folder / "report.json").write_bytes((folder / "log.model.toml").read_bytes())
    for name in ("extended.rig.toml", "own.rig.toml"):
        (folder / name).write_text(RIG)
    done = vsalog_run("simulate", "sea", "--duration", "0.2", "-o", "bag/", cwd=folder)
    assert done.returncode == 0, done.stderr
    (folder / "hard.csv").hardlink_to(folder / "log.csv")
    (folder / "soft.csv").symlink_to("log.csv")
    return folder


@pytest.mark.parametrize("words", ALSO_INPUTS, ids=" ".join)
def test_an_output_that_is_also_an_input(words, inputs):
    """Whatever its name, link or not: it is refused, and every file stays as it was."""
    before = {p.name: hashlib.sha256(p.read_bytes()).digest() for p in inputs.rglob("*") if p.is_file()}
    done = vsalog_run(*words, cwd=inputs)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert {p.name: hashlib.sha256(p.read_bytes()).digest() for p in inputs.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("words", ["inspect log.csv", "inspect log.csv --json", "explain --list", "inspect --help"])
def test_a_reader_that_closes_the_output_is_no_error(words, tmp_path):
    """As `head` does: no traceback, and not the code of a bug."""
    lay(tmp_path)
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "vsalog", *words.split()]
    done = subprocess.run(command, cwd=tmp_path, check=False, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize(("log", "code"), [("log.csv", 0), ("nothing.csv", 2)])
def test_streams_that_are_closed_are_no_error(log, code, tmp_path):
    """As by `>&-`: nobody listens, and no file that is opened later takes the place of the output."""
    lay(tmp_path)
    command = f"exec '{sys.executable}' -m vsalog inspect {log} >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, check=False).returncode == code
    command = f"exec '{sys.executable}' -m vsalog inspect {log} >&-"
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, check=False, stderr=subprocess.PIPE)
    assert done.returncode == code
    assert b"Traceback" not in done.stderr
    assert b"a bug" not in done.stderr
