"""Workers that die, hang, or would need too much: the others go on. Workers here do what the names of logs say."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from work_by_name import do_by_name, load_nothing

from vsalog.batch import pool
from vsalog.batch.memory import BASE, expected, free
from vsalog.batch.records import Log, Settings, Task
from vsalog.cli.batch import parse_size
from vsalog.core.errors import BatchError
from vsalog.core.memory import cores

pytestmark = pytest.mark.share(3)


@pytest.fixture
def play(monkeypatch, tmp_path):
    """Run a pool over logs of these names; returns name → record."""
    monkeypatch.setattr(pool, "do_task", do_by_name)
    monkeypatch.setattr(pool, "prepare", load_nothing)

    def play(*names, jobs=2, bound=10**12, timeout=None, size=1000):
        logs = [Log(name=n, where=os.fsencode(tmp_path / n), size=size) for n in names]
        tasks = [Task(log=log, settings=Settings(), out=b"", vsalog="", keep=False) for log in logs]
        with pool.Pool(jobs, bound, timeout) as workers:
            return {task.log.name: answer.record for task, answer in workers.run(tasks)}

    return play


def spans(records):
    return [tuple(map(float, r.reason.split())) for r in records.values() if r.status == "done"]


def most_at_once(records):
    begins = [begin for begin, _, _ in spans(records)]
    return max(sum(a <= begin < b for a, b, _ in spans(records)) for begin in begins)


def test_a_log_that_kills_its_worker_is_recorded_and_the_others_go_on(play, tmp_path):
    records = play("a", "b", "deadly", "c", "d", "deadly too")
    assert {n for n, r in records.items() if r.status == "done"} == {"a", "b", "c", "d"}
    for name in ("deadly", "deadly too"):
        assert (records[name].status, records[name].kind) == ("failed", "killed")
        assert "SIGKILL (out of memory?), twice" in records[name].reason
        assert (tmp_path / name).read_text() == "xx"  # tried once more, and not again


def test_a_worker_that_died_by_chance_costs_nothing(play):
    records = play("a", "unlucky", "b")
    assert {r.status for r in records.values()} == {"done"}


def test_a_log_without_end_is_given_up(play):
    records = play("a", "endless", "b", timeout=1.5)
    assert records["endless"].kind == "time"
    assert "--timeout" in records["endless"].reason
    assert records["a"].status == records["b"].status == "done"


def load_slowly():
    time.sleep(2.0)


def test_the_time_of_a_log_does_not_begin_before_its_worker_is_there(play, monkeypatch):
    monkeypatch.setattr(pool, "prepare", load_slowly)
    assert play("a", jobs=1, timeout=1.5)["a"].status == "done"


def test_a_worker_that_keeps_memory_is_replaced(play):
    def workers(records):
        return {record.reason.split()[2] for record in records.values()}

    assert len(workers(play("a", "b", "c", jobs=1))) == 1
    assert len(workers(play("a leaky", "b leaky", jobs=1))) == 2


def test_one_log_is_done_alone_first_where_nothing_is_compiled(play, monkeypatch, tmp_path):
    """Until one went well nobody else begins: what has to be compiled is compiled once."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    records = play(*"abcdef")
    first, *others = sorted(spans(records))
    assert all(begin >= first[1] - 0.05 for begin, _, _ in others)
    assert most_at_once(records) == 2


def test_memory_bounds_what_goes_on_at_a_time(play):
    need = expected(Log(name="", where=b"", size=10**8), Settings())
    assert most_at_once(play(*"abcdefghijkl", jobs=3, bound=int(2.2 * need), size=10**8)) == 2
    assert most_at_once(play(*"abcdefgh", jobs=3, bound=int(1.5 * need), size=10**8)) == 1
    records = play("a", "b", bound=need - 1, size=10**8)
    assert {r.kind for r in records.values()} == {"memory"}
    assert "100 MB is expected to need" in records["a"].reason
    assert "--memory" in records["a"].reason


def die_once():
    """Die when the first worker of all starts, as from outside."""
    try:
        Path(os.environ["DIED"]).touch(exist_ok=False)
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_worker_that_dies_while_it_starts_is_replaced(play, monkeypatch, tmp_path, jobs):
    monkeypatch.setenv("DIED", str(tmp_path / "died"))
    monkeypatch.setattr(pool, "prepare", die_once)
    assert {r.status for r in play(*"abcd", jobs=jobs).values()} == {"done"}
    (tmp_path / "died").unlink()
    with pool.Pool(jobs, 10**12) as workers:
        workers.check(Settings())


def test_a_share_without_logs_is_done(play, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert play() == {}


def leave():
    os._exit(7)


@pytest.mark.parametrize("dead", [False, True])
def test_workers_that_cannot_live_are_reported(monkeypatch, dead):
    """Also where they are gone before they are asked."""
    monkeypatch.setattr(pool, "prepare", leave)
    with pool.Pool(1, 10**12) as workers:
        time.sleep(2.0 if dead else 0.0)
        with pytest.raises(BatchError, match="no worker could be started"):
            workers.check(Settings())


def test_long_logs_need_no_more_than_what_is_held_in_memory():
    """But MATLAB's, which are read as a whole; told by where they lie, since a name may have been cut."""

    def need(where, size, **options):
        return expected(Log(name="…-1a2b3c", where=where, size=size), Settings(**options))

    assert need(b"x.mcap", 10**11) == need(b"x.mcap", 10**12) < 1.5e9
    assert need(b"x.mcap", 10**11, report=True) == need(b"x.mcap", 10**12, report=True) < 4.1e9
    assert need(b"x.MAT", 10**11) > 10**11
    assert need(b"x.mcap", 10**11, do="diagnose") > 10**11


BUSY = """
import multiprocessing
from vsalog.batch import pool
from vsalog.batch.records import Log, Settings, Task
from work_by_name import do_by_name

pool.do_task = do_by_name
log = Log(name="endless", where=b"", size=1)
with pool.Pool(2, 10**12) as workers:
    workers.check(Settings())
    print(*(child.pid for child in multiprocessing.active_children()), flush=True)
    for answer in workers.run([Task(log=log, settings=Settings(), out=b"", vsalog="", keep=False)]):
        print(answer)
"""


def test_workers_leave_when_their_parent_is_killed(tmp_path):
    """The idle one, and the one whose log never ends."""
    paths = [str(Path(__file__).parent), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    parent = subprocess.Popen(
        [sys.executable, "-c", BUSY], stdout=subprocess.PIPE, text=True, cwd=tmp_path, env=environment
    )
    pids = [int(pid) for pid in parent.stdout.readline().split()]
    assert len(pids) == 2
    assert select.select([parent.stdout], [], [], 3.0)[0] == []  # it is at work
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 20.0
    while any(_runs(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.1)
    left = [pid for pid in pids if _runs(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("text", "size"),
    [("4GB", 4e9), ("512 MiB", 512 * 2**20), ("3e9", 3e9), ("1.5g", 1.5e9), ("2Gi", 2**31), ("1TB", 1e12)],
)
def test_sizes_as_people_write_them(text, size):
    assert parse_size(text) == int(size)


@pytest.mark.parametrize("text", ["", "much", "-1GB", "1XB", "nan", "1e300", "1MB", "0"])
def test_sizes_that_cannot_be(text):
    with pytest.raises(BatchError, match="--memory"):
        parse_size(text)


def test_what_is_free_is_something():
    assert free() >= BASE
    assert cores() >= 1
