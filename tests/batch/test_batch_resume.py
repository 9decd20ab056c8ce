"""Killed at any moment, gone on with: nothing is lost, nothing is done twice, nothing half is taken for whole."""

import os
import random
import signal
import time

import pytest
from batch_bench import RIG, batch, contents, do_batch, make_log, make_logs, same, start

from vsalog.batch import run as whole_run
from vsalog.batch.records import Settings
from vsalog.core.errors import BatchError

pytestmark = pytest.mark.share(6)


def test_killed_again_and_again_it_ends_as_if_it_never_was(tmp_path, here):
    """As a user does it, with `kill -9` on the whole of it; `python -m tests.batch.kills` does more of this."""
    make_logs(tmp_path / "logs", 8, rows=6000)
    (tmp_path / "logs" / "day0" / "broken.csv").write_bytes(b"\x89PNG")
    do_batch(tmp_path / "logs", out=tmp_path / "whole")
    records = tmp_path / "out" / "records"
    moments = random.Random(4)
    for finished in (0, 2, 5):
        resume = ["--resume"] if (tmp_path / "out" / "batch.json").exists() else []
        process = start("logs", "-o", "out", "-j", "1", *resume, cwd=tmp_path)
        deadline = time.monotonic() + 30.0
        while len(list(records.glob("*.json"))) < finished and time.monotonic() < deadline:
            time.sleep(0.005)
        time.sleep(moments.uniform(0.0, 0.15 if finished else 2.0))
        process.kill()
        process.communicate()
        # What is in the data set is whole at any moment.
        for part in (tmp_path / "out").glob("traces/**/*"):
            whole = tmp_path / "whole" / part.relative_to(tmp_path / "out")
            assert part.is_dir() or part.read_bytes() == whole.read_bytes()
    code, _, err = batch("logs", "-o", "out", "--resume", cwd=tmp_path)
    assert code == 2, err
    same(contents(tmp_path / "out"), contents(tmp_path / "whole"))


def test_what_is_finished_is_not_done_again(tmp_path, logs, here):
    outcome, _ = do_batch(logs, out=tmp_path / "out")
    assert (outcome.planned, outcome.kept, outcome.code) == (6, 0, 0)
    before = {p: p.stat() for p in (tmp_path / "out").rglob("*.*") if "day" in p.as_posix()}
    assert len(before) > 12
    outcome, _ = do_batch(logs, out=tmp_path / "out", resume=True)
    assert outcome.kept == 6
    for path, stat in before.items():
        assert (path.stat().st_ino, path.stat().st_mtime_ns) == (stat.st_ino, stat.st_mtime_ns)


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("change", "again"),
    [
        (lambda logs: make_log(logs / "day0" / "exp0.csv", 99), {"day0/exp0.csv"}),
        (lambda logs: (logs / "day1" / "rig.toml").write_text(RIG.format(name="other")), {"day1"}),
        (lambda logs: (logs / "day0" / "exp2.rig.toml").write_text(RIG.format(name="own")), {"day0/exp2.csv"}),
        (lambda logs: os.utime(logs / "day0" / "exp0.csv", (1, 1)), set()),  # its content counts, not its age
    ],
)
def test_changed_inputs_and_rigs_are_noticed(tmp_path, logs, here, change, again):
    do_batch(logs, out=tmp_path / "out")
    change(logs)
    outcome, _ = do_batch(logs, out=tmp_path / "out", resume=True)
    redone = {name for name, answer in here.answers.items() if not answer.kept}
    assert all(any(name.startswith(a) for a in again) for name in redone)
    assert outcome.kept == 6 - len(redone)
    assert bool(redone) == bool(again)
    do_batch(logs, out=tmp_path / "fresh")  # also where a rig's new name moved a partition
    same(contents(tmp_path / "out"), contents(tmp_path / "fresh"))


def test_changed_options_and_versions_are_noticed(tmp_path, logs, here, monkeypatch):
    do_batch(logs, out=tmp_path / "out")
    forgetting = Settings(options={"tune": {"forgetting": "0.99"}})
    outcome, watch = do_batch(logs, out=tmp_path / "out", resume=True, settings=forgetting)
    assert outcome.kept == 0
    assert "other options" in watch.said[-1]
    for module in ("work", "run"):
        monkeypatch.setattr(f"vsalog.batch.{module}.__version__", "9.9.9")
    outcome, _ = do_batch(logs, out=tmp_path / "out", resume=True, settings=forgetting)
    assert outcome.kept == 0


def test_a_worker_of_another_version_is_refused(tmp_path, logs, here, monkeypatch):
    monkeypatch.setattr("vsalog.batch.run.__version__", "9.9.9")
    with pytest.raises(BatchError, match=r"needs 9\.9\.9"):
        do_batch(logs, out=tmp_path / "out")


def test_half_a_file_is_none(tmp_path, logs, here):
    """Files cut short behind our back, records cut short, records without files: the log is done again."""
    do_batch(logs, out=tmp_path / "out")
    whole = contents(tmp_path / "out")
    traces, records = sorted((tmp_path / "out").rglob("part.parquet")), sorted((tmp_path / "out/records").iterdir())
    traces[0].write_bytes(traces[0].read_bytes()[:1000])
    traces[1].unlink()
    records[2].write_bytes(records[2].read_bytes()[:100])
    records[3].unlink()
    outcome, _ = do_batch(logs, out=tmp_path / "out", resume=True)
    assert outcome.kept == 2
    same(contents(tmp_path / "out"), whole)


def test_a_log_that_failed_is_tried_again(tmp_path, logs, here):
    sound = (logs / "day0" / "exp0.csv").read_bytes()
    (logs / "day0" / "exp0.csv").write_bytes(b"")
    outcome, _ = do_batch(logs, out=tmp_path / "out")
    assert [r.log for r in outcome.failures] == ["day0/exp0.csv"]
    (logs / "day0" / "exp0.csv").write_bytes(sound)
    outcome, _ = do_batch(logs, out=tmp_path / "out", resume=True)
    assert (outcome.code, outcome.kept) == (0, 5)
    do_batch(logs, out=tmp_path / "fresh")
    same(contents(tmp_path / "out"), contents(tmp_path / "fresh"))


def test_a_log_that_went_bad_leaves_nothing_of_before(tmp_path, logs, here):
    do_batch(logs, out=tmp_path / "out")
    (logs / "day0" / "exp0.csv").write_bytes(b"")
    do_batch(logs, out=tmp_path / "out", resume=True)
    do_batch(logs, out=tmp_path / "fresh")
    same(contents(tmp_path / "out"), contents(tmp_path / "fresh"))


def test_logs_that_are_gone_stay_and_renamed_ones_are_not_there_twice(tmp_path, logs, here):
    do_batch(logs, out=tmp_path / "out")
    (logs / "day0" / "exp0.csv").rename(logs / "day0" / "renamed.csv")
    (logs / "day1" / "exp1.csv").unlink()
    outcome, watch = do_batch(logs, out=tmp_path / "out", resume=True)
    assert outcome.others == 1
    assert "1 log of an earlier run" in watch.said[-1]
    there = {path.parent.name for path in (tmp_path / "out").rglob("part.parquet")}
    assert there == {f"log=day{i % 2}%2Fexp{i}.csv" for i in range(1, 6)} | {"log=day0%2Frenamed.csv"}


def test_a_log_that_changes_while_it_is_read_is_not_taken(tmp_path, logs, here, monkeypatch):
    from vsalog.batch import one_log

    def grow(log, path, settings, scratch, do=one_log.COMMANDS["estimate"]):
        make_log(path, 77)
        return do(log, path, settings, scratch)

    monkeypatch.setitem(one_log.COMMANDS, "estimate", grow)
    outcome, _ = do_batch(logs / "day0" / "exp0.csv", out=tmp_path / "out")
    assert "changed while" in outcome.failures[0].reason
    assert not list((tmp_path / "out").rglob("part.parquet"))


def test_shares_of_an_array_make_the_same_whole(tmp_path, logs, here):
    do_batch(logs, out=tmp_path / "whole")
    for i in (2, 3, 1):
        outcome, _ = do_batch(logs, out=tmp_path / "out", shard=(i, 3))
        assert outcome.planned == 2
    assert (outcome.finished, outcome.everything) == (6, 6)
    same(contents(tmp_path / "out"), contents(tmp_path / "whole"))
    with pytest.raises(BatchError, match="contains a batch already"):
        do_batch(logs, out=tmp_path / "out", shard=(1, 3), settings=Settings(options={"estimator": "direct"}))


def test_a_place_that_is_taken_is_not_touched(tmp_path, logs, here):
    do_batch(logs, out=tmp_path / "out")
    whole = contents(tmp_path / "out")
    with pytest.raises(BatchError, match="--resume"):
        do_batch(logs, out=tmp_path / "out")
    with pytest.raises(BatchError, match="contains a batch of 'estimate'"):
        do_batch(logs, out=tmp_path / "out", resume=True, settings=Settings(do="diagnose"))
    same(contents(tmp_path / "out"), whole)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x")
    with pytest.raises(BatchError, match="contains no batch"):
        do_batch(logs, out=tmp_path / "mine", resume=True)
    (tmp_path / "out" / "batch.json").write_text("{}")
    with pytest.raises(BatchError, match="is not of vsalog"):
        do_batch(logs, out=tmp_path / "out", resume=True)


def test_what_others_put_beside_stays(tmp_path, logs, here):
    do_batch(logs, out=tmp_path / "out")
    mine = tmp_path / "out" / "reports" / "notes.txt"
    mine.parent.mkdir()
    mine.write_text("x")
    do_batch(logs, out=tmp_path / "out", resume=True)
    assert mine.exists()


def test_interrupted_at_any_moment(tmp_path, here):
    """Ctrl-C reaches all processes of the terminal: no traceback, no half file, and the same command goes on."""
    make_logs(tmp_path / "logs", 4, rows=20_000)
    for i, moment in enumerate((0.6, 3.0)):
        resume = ["--resume"] if (tmp_path / "out" / "batch.json").exists() else []
        process = start("logs", "-o", "out", *resume, cwd=tmp_path, start_new_session=True)
        time.sleep(moment)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=20)
        assert process.returncode in (130, 0), (i, err)
        assert "Traceback" not in err
        assert not list((tmp_path / "out").glob("traces/**/*.part"))
    do_batch(tmp_path / "logs", out=tmp_path / "out", resume=True)
    assert len(list((tmp_path / "out").rglob("part.parquet"))) == 4


def test_scratch_of_a_worker_that_was_killed_on_the_way_is_cleared(tmp_path, logs, here):
    """As when a worker dies of a log: what it was writing is there, and no one of its own to remove it."""

    def leave(task):
        left = tmp_path / "out" / ".scratch" / f"of-{task.log.name.replace('/', '-')}"
        left.mkdir(parents=True)
        (left / "part.parquet").write_text("half")

    here.before = leave
    outcome, _ = do_batch(logs, out=tmp_path / "out")
    assert outcome.finished == 6
    assert not (tmp_path / "out" / ".scratch").exists()


def test_scratch_of_a_killed_run_is_cleared(tmp_path, logs, here):
    (tmp_path / "out" / ".scratch" / "old").mkdir(parents=True)
    (tmp_path / "out" / ".scratch" / "old" / "part.parquet").write_text("half")
    do_batch(logs, out=tmp_path / "out")
    assert not (tmp_path / "out" / ".scratch").exists()
    assert whole_run.MANIFEST in {p.name for p in (tmp_path / "out").iterdir()}
