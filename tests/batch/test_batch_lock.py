"""The lock of a batch: a sign of life every 20 s, and dead where four of them are missing or its process is gone."""

import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest

from vsalog.batch.lock import Owner, locked
from vsalog.batch.storage import Store
from vsalog.core.errors import BatchError


@pytest.fixture
def store(tmp_path):
    return Store(str(tmp_path))


def left(store, **more):
    """Leave a sign of life."""
    owner = {"host": "elsewhere", "process": 1, "at": time.time()}
    store.write(".lock-1", msgspec.json.encode(Owner(**owner | more)))


@pytest.mark.parametrize(("age", "alive"), [(0.0, True), (60.0, True), (100.0, False)])
def test_an_owner_without_signs_of_life_is_dead(age, alive):
    assert Owner(host="elsewhere", process=1, at=time.time() - age).alive() == alive


def test_an_owner_on_this_machine_is_dead_with_its_process():
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    owner = Owner(host=socket.gethostname(), process=child.pid, at=time.time())
    assert owner.alive()
    child.communicate()
    assert not owner.alive()


@pytest.mark.parametrize("held", [b"", b"{}", b'{"host": "x", "process": "y", "at": 0}'])
def test_what_is_no_lock_is_nobodys(store, held):
    store.write(".lock-1", held)
    with locked(store, None):
        assert ".lock-1" not in store.names()
    assert store.empty()
    assert store.names() == [".scratch"]


@pytest.mark.parametrize(
    ("share", "shard", "free"),
    [
        ("", None, False),
        ("", (1, 2), False),
        ("1-of-2", None, False),
        ("1-of-2", (1, 2), False),
        ("1-of-2", (2, 2), True),
    ],
)
def test_shares_of_an_array_get_along_and_nothing_else_does(store, share, shard, free):
    left(store, share=share)
    if free:
        with locked(store, shard):
            pass
        return
    with pytest.raises(BatchError, match="process 1 on elsewhere"), locked(store, shard):
        pass
    assert sorted(store.names()) == [".lock-1", ".scratch"]


HOLD = """
import sys
from vsalog.batch.lock import locked
from vsalog.batch.storage import Store
from vsalog.core.errors import BatchError

input()
try:
    with locked(Store(sys.argv[1]), None):
        print("in", flush=True)
        input()
except BatchError:
    print("out", flush=True)
"""


def test_of_runs_that_begin_together_one_goes_on_at_most(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    runs = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    for run in runs:
        run.stdin.write("\n")
        run.stdin.flush()
    with ThreadPoolExecutor(4) as threads:
        said = list(threads.map(lambda run: run.stdout.readline().strip(), runs))
    for run in runs:
        run.communicate("\n")
    assert said.count("in") <= 1
    assert len(said) == said.count("in") + said.count("out")
