"""On a Dask cluster and on an S3 server: real ones, as processes of their own, on this machine."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from batch_bench import batch, contents, do_batch, make_logs, same, start, summary

from vsalog.core.errors import BatchError

pytest.importorskip("distributed")
pytest.importorskip("s3fs")

pytestmark = pytest.mark.share(3)
moto_server = pytest.importorskip("moto.server")

SERVER = """
from moto.server import ThreadedMotoServer
import sys, threading
server = ThreadedMotoServer(ip_address="127.0.0.1", port=int(sys.argv[1]), verbose=False)
server.start()
print("ready", flush=True)
threading.Event().wait()
"""


@contextmanager
def processes():
    """Start processes that end with the context; gives a function to start one."""
    started = []

    def begin(*command, **more):
        process = subprocess.Popen([sys.executable, *map(str, command)], stderr=subprocess.DEVNULL, **more)
        started.append(process)
        return process

    try:
        yield begin
    finally:
        for process in started:
            process.kill()
            process.wait()


@contextmanager
def cluster(folder, environment=None):
    """A scheduler and two workers; gives its address, itself and the workers."""
    with processes() as begin:
        where = ["--scheduler-file", folder / "scheduler.json"]
        quiet = {"env": environment or os.environ, "stdout": subprocess.DEVNULL, "cwd": folder}
        local = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        scheduler = begin("-m", "distributed.cli.dask_scheduler", *local, *where, **quiet)
        workers = [
            begin(
                "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard",
                "--local-directory", folder / f"worker{i}", *where, **quiet,
            )
            for i in range(2)
        ]  # fmt: skip
        deadline = time.monotonic() + 30.0
        file, said = folder / "scheduler.json", ""
        while not said.endswith("}") and time.monotonic() < deadline:
            time.sleep(0.05)
            said = file.read_text().strip() if file.exists() else ""
        yield json.loads(said)["address"], scheduler, workers


def wait_for_records(out, count):
    """Wait until so many logs are finished; returns how many are."""
    deadline = time.monotonic() + 60.0
    while (found := len(list(out.glob("records/*")))) < count and time.monotonic() < deadline:
        time.sleep(0.02)
    return found


@contextmanager
def object_store():
    """An S3 server with an empty bucket; gives the environment that leads there, and an fsspec file system."""
    import s3fs

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with processes() as begin:
        server = begin("-c", SERVER, port, stdout=subprocess.PIPE, text=True)
        assert server.stdout.readline().strip() == "ready"
        address = f"http://127.0.0.1:{port}"
        keys = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1"}
        store = s3fs.S3FileSystem(key="test", secret="test", endpoint_url=address, skip_instance_cache=True)
        store.mkdir("lab")
        yield os.environ | keys | {"AWS_ENDPOINT_URL": address}, store
        server.stdout.close()


def test_a_worker_that_is_killed_loses_nothing_and_the_cluster_makes_the_same(tmp_path, here):
    make_logs(tmp_path / "logs", 8, rows=8000)
    (tmp_path / "logs" / "day0" / "broken.csv").write_bytes(b"\x89PNG")
    with cluster(tmp_path) as (address, _, workers):
        do_batch(tmp_path / "logs", out=tmp_path / "here")
        running = start("logs", "-o", "there", "--scheduler", address, cwd=tmp_path)
        wait_for_records(tmp_path / "there", 2)
        workers[0].send_signal(signal.SIGKILL)
        left = 9 - wait_for_records(tmp_path / "there", 0)
        _, err = running.communicate(timeout=90)
        assert running.returncode == 2, err
        assert left > 0  # it was killed in mid-run
    same(contents(tmp_path / "there"), contents(tmp_path / "here"))


def test_a_scheduler_that_is_killed_ends_the_run_and_another_one_goes_on(tmp_path, here):
    """Its workers may still be writing what they had begun when the next run is there."""
    make_logs(tmp_path / "logs", 12, rows=8000)
    there = tmp_path / "there"
    with cluster(tmp_path) as (address, scheduler, _):
        do_batch(tmp_path / "logs", out=tmp_path / "here")
        whole = contents(tmp_path / "here")
        running = start("logs", "-o", "there", "--scheduler", address, cwd=tmp_path)
        wait_for_records(there, 3)
        scheduler.kill()
        out, err = running.communicate(timeout=60)
        finished = wait_for_records(there, 0)
        assert (running.returncode, out) == (2, ""), err
        assert finished < 12  # it was killed in mid-run
        assert len(err.strip().splitlines()) == 1, err
        assert "the connection to the scheduler was lost" in err
        assert "--resume" in err
        left = contents(there)
        assert not [name for name in left if name.startswith("traces/") and left[name] != whole[name]]
        assert not [name for name in left if name.startswith("records/") and left[name] != whole[name]]
        (tmp_path / "scheduler.json").unlink()
        with cluster(tmp_path) as (other, _, _):
            code, out, err = batch("logs", "-o", "there", "--resume", "--scheduler", other, cwd=tmp_path)
    assert code == 0, err
    assert "of them before" in out
    same(contents(there), whole)


def test_an_object_store_holds_the_same_as_a_folder(tmp_path, here, monkeypatch):
    """Logs from it, results into it, gone on with; and a second run at the same time is refused."""
    make_logs(tmp_path / "logs", 3)
    (tmp_path / "logs" / "day0" / "broken.csv").write_bytes(b"\x89PNG")
    do_batch(tmp_path / "logs", out=tmp_path / "here")
    with object_store() as (environment, store):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        store.put(str(tmp_path / "logs"), "lab/logs", recursive=True)
        outcome, _ = do_batch("s3://lab/logs/**/*.csv", out="s3://lab/out")
        assert (outcome.planned, outcome.code) == (4, 2)
        with pytest.raises(BatchError, match="--resume"):
            do_batch("s3://lab/logs/**/*.csv", out="s3://lab/out")
        held = {"host": "elsewhere", "process": 1, "at": time.time()}
        store.pipe("lab/out/.lock-1", json.dumps(held).encode())
        with pytest.raises(BatchError, match="process 1 on elsewhere"):
            do_batch("s3://lab/logs", out="s3://lab/out", resume=True)
        store.pipe("lab/out/.lock-1", json.dumps(held | {"at": time.time() - 1000.0}).encode())  # its owner is dead
        store.rm("lab/out/models/day1%2Fexp1.csv.model.toml")
        store.pipe("lab/out/traces/device=gone/date=1970-01-01/log=x/part.parquet", b"left over")
        outcome, _ = do_batch("s3://lab/logs", out="s3://lab/out", resume=True)
        assert (outcome.kept, outcome.code) == (2, 2)
        assert not store.glob("lab/out/.lock*")
        # As a user does it, from the command line to the workers.
        code, out, err = batch(
            "s3://lab/logs", "-o", "s3://lab/out", "--resume", "-j", "1", cwd=tmp_path, env=environment
        )
        assert (code, "3 done (3 of them before)" in out) == (2, True), err
        store.get("lab/out", str(tmp_path / "fetched"), recursive=True)
    same(contents(tmp_path / "fetched"), contents(tmp_path / "here"))
    assert [row["status"] for row in summary(tmp_path / "fetched")] == ["failed", "done", "done", "done"]


def test_nobody_answers(tmp_path, monkeypatch):
    import dask

    from vsalog.batch import cluster as module

    dask.config.set({"distributed.comm.timeouts.connect": "1s"})
    with pytest.raises(BatchError, match="no Dask scheduler answers"):
        module.Cluster("tcp://127.0.0.1:1")
    with pytest.raises(BatchError, match="no Dask scheduler answers"):
        module.Cluster("nonsense://x")


def test_an_address_that_cannot_be_opened(tmp_path):
    make_logs(tmp_path / "logs", 1)
    environment = os.environ | {
        "AWS_ENDPOINT_URL": "http://127.0.0.1:1",
        "AWS_ACCESS_KEY_ID": "x",
        "AWS_SECRET_ACCESS_KEY": "x",
    }
    code, out, err = batch("logs", "-o", "s3://nowhere/out", cwd=tmp_path, env=environment | {"AWS_MAX_ATTEMPTS": "1"})
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1), err
    assert "s3://nowhere/out" in err
