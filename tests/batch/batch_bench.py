"""What the tests of batches share: small logs, a run in this process or as a user runs it, and what a batch holds."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.parquet as pq

from vsalog.batch.records import Answer, Settings
from vsalog.batch.run import Asked, run_batch
from vsalog.batch.worker import check_settings, do_task
from vsalog.core.errors import BatchError

RIG = """
name = "{name}"
[joint.knee]
kind = "elastic"
[joint.knee.basis]
order = 2
[joint.knee.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "sensor"
"""


def make_log(path, seed=0, rows=800):
    """Write a table of a spring of 20 N·m/rad that a sine moves, with noise of its own."""
    rng, t = np.random.default_rng(seed), np.arange(rows) * 2e-3
    theta, q = 0.3 * np.sin(6.0 * t), 0.4 * np.sin(6.0 * t + 0.3)
    torque = 20.0 * (q - theta) + 0.01 * rng.normal(size=rows)
    lines = [f"{a:.4f},{b:.6f},{c:.6f},{d:.6f}" for a, b, c, d in zip(t, theta, q, torque, strict=True)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(["time [s],theta [rad],q [rad],sensor [N·m]", *lines]))


def make_logs(folder, count, name="knee rig", rows=800):
    for i in range(count):
        make_log(folder / f"day{i % 2}" / f"exp{i}.csv", i, rows)
    for day in folder.iterdir():
        (day / "rig.toml").write_text(RIG.format(name=name))


class Watching:
    """A watch that remembers."""

    def __init__(self):
        self.said = []

    def say(self, text):
        self.said.append(text)

    def begin(self, sizes):
        self.planned = len(sizes)

    def add(self, size, kept, failure):
        pass


class Here:
    """Does tasks in this process; like a pool, it has nothing but JSON from outside.

    `before` is called with each task; `answers` are those of the last run.
    """

    before = staticmethod(lambda task: None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def check(self, settings):
        if said := check_settings(msgspec.json.encode(settings)):
            raise BatchError(said)

    def run(self, tasks):
        self.answers = {}
        for task in tasks:
            self.before(task)
            answer = self.answers[task.log.name] = msgspec.json.decode(do_task(msgspec.json.encode(task)), type=Answer)
            yield task, answer


def do_batch(*logs, out, resume=False, shard=None, settings=None):
    """Run a batch (see the fixture `here`); returns what came of it, and what was reported."""
    watch = Watching()
    asked = Asked(tuple(map(str, logs)), str(out), settings or Settings(), resume=resume, shard=shard)
    return run_batch(asked, watch), watch


def start(*args, cwd, **more):
    """Start `vsalog batch ARGS`, as a user does."""
    command = [sys.executable, "-c", "from vsalog.cli import main; main()", "batch", *map(os.fsdecode, map(_raw, args))]
    return subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


def _raw(arg):
    return arg if isinstance(arg, bytes) else str(arg)


def batch(*args, cwd, **more):
    """Run `vsalog batch ARGS` to its end; returns exit code, stdout and stderr."""
    process = start(*args, cwd=cwd, **more)
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def timeless(record):
    return {key: value for key, value in json.loads(record).items() if key != "run_seconds"}


def contents(out):
    """Return what a batch holds: files byte for byte, records and table without run times; locks are no part of it."""
    found = {}
    for path in sorted(Path(out).rglob("*")):
        name = path.relative_to(out).as_posix()
        if path.is_dir() or name.startswith(".lock"):
            continue
        if name.startswith("records/"):
            found[name] = timeless(path.read_bytes())
        elif name == "summary.parquet":
            found[name] = pq.read_table(path).drop(["run_seconds"]).to_pylist()
        else:
            found[name] = path.read_bytes()
    return found


def same(one, two):
    """Compare two batches; a test that fails says where."""
    assert sorted(one) == sorted(two)
    assert [name for name in one if one[name] != two[name]] == []


def summary(out):
    with (Path(out) / "summary.parquet").open("rb") as file:
        return pq.read_table(file).to_pylist()


COMMAND = """vsalog() { "$PYTHON" -c 'from vsalog.cli import main; main()' "$@"; }\n"""


def private_disk(script, cwd):
    """Run a shell script where it may mount disks of its own; returns the process, or None where that is not allowed."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        probe = subprocess.run(["unshare", "-rm", "mount", "-t", "tmpfs", "none", "/mnt"], stdout=out, stderr=err)
    if probe.returncode != 0:
        return None
    environment = os.environ | {"PYTHON": sys.executable}
    return subprocess.run(
        ["unshare", "-rm", "sh", "-ec", COMMAND + script],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        env=environment,
    )
