"""Which logs a batch is of: patterns, folders, lists, links, shares."""

import io
import os
import sys

import numpy as np
import pytest
from batch_bench import make_log

from vsalog.batch.plan import make_plan
from vsalog.core.errors import BatchError


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Tables in folders, a bag, what is next to logs, and things that are none."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "day1/b.csv", "day1/deep/c.csv", "day2/d.parquet", ".hidden/e.csv", "day2/[odd].csv"):
        path = tmp_path / "logs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    for name in ("a.rig.toml", "day1/rig.toml", "day1/notes.md"):
        (tmp_path / "logs" / name).write_text("x")
    bag = tmp_path / "logs" / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("x")
    (bag / "bag_0.mcap").write_text("x")
    return tmp_path


def names(*asked, out="out"):
    return [log.name for log in make_plan(asked, out).logs]


def test_patterns(tree):
    assert names("logs/**/*.csv") == ["a.csv", "day1/b.csv", "day1/deep/c.csv", "day2/[odd].csv"]
    assert names("logs/*/*.csv") == ["day1/b.csv", "day2/[odd].csv"]
    assert names("logs/day1/*") == ["b.csv"]  # neither the folder in it nor what is next to logs
    assert names("logs/*") == ["a.csv", "bag"]  # a bag is one log
    assert names("logs/**/*.mcap") == ["bag/bag_0.mcap"]
    assert names("logs/**/*", "logs/**/*.csv").count("a.csv") == 1
    assert names(str(tree / "logs" / "**" / "*.csv")) == names("logs/**/*.csv")


def test_a_name_does_not_depend_on_what_else_is_there(tree):
    """A pattern's names begin below its fixed part: the data set stays as it is when logs come or go."""
    assert names("logs/**/d.parquet") == ["day2/d.parquet"]
    assert names("logs/day*/*.parquet") == ["day2/d.parquet"]


def test_folders_and_files(tree):
    assert names("logs") == ["a.csv", "bag", "day1/b.csv", "day1/deep/c.csv", "day2/[odd].csv", "day2/d.parquet"]
    assert names("logs/bag") == ["bag"]
    assert names("logs/a.csv", "logs/day1/b.csv") == ["a.csv", "day1/b.csv"]
    assert names("logs/day2/[odd].csv") == ["[odd].csv"]  # there is a file of that very name


def test_lists(tree, monkeypatch):
    (tree / "list.txt").write_text("logs/a.csv\n\nlogs/day1/*.csv\n")
    assert names("@list.txt") == ["a.csv", "day1/b.csv"]
    (tree / "logs" / "line\nend.csv").write_text("x")
    (tree / "list.txt").write_bytes(b"logs/a.csv\0logs/line\nend.csv\0")
    assert names("@list.txt") == ["a.csv", "line\nend.csv"]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"logs/a.csv\n")))
    assert names("-") == ["a.csv"]


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["nowhere.csv"], "no such file"),
        (["pipe"], "is no file"),
        (["logs/*.bag"], "matches no log"),
        (["logs/a.csv", "logs/*.bag"], "matches no log"),
        (["@nowhere.txt"], "nowhere.txt"),
        (["@empty.txt"], "empty"),
        (["empty"], "no log in this folder"),
        (["logs/a.csv", "s3://bucket/x.csv"], "two batches"),
        (["nothing://bucket/*.csv"], "nothing://"),
    ],
)
def test_what_cannot_be_meant(tree, asked, said):
    (tree / "empty.txt").write_text("\n")
    (tree / "empty").mkdir()
    os.mkfifo(tree / "pipe")
    with pytest.raises(BatchError, match=said):
        make_plan(asked, "out")


def test_a_file_is_taken_once_whatever_its_names(tree):
    (tree / "logs" / "aa_link.csv").symlink_to("day1/b.csv")
    plan = make_plan(["logs/**/*.csv"], "out")
    assert "aa_link.csv" not in [log.name for log in plan.logs]
    assert "day1/b.csv" in [log.name for log in plan.logs]
    assert "other names" in " ".join(plan.notes)


def test_links_to_folders_are_followed_and_loops_end(tree):
    (tree / "elsewhere" / "day3").mkdir(parents=True)
    (tree / "elsewhere" / "day3" / "f.csv").write_text("x")
    (tree / "logs" / "day3").symlink_to("../elsewhere/day3")
    for i in range(3):
        (tree / "logs" / f"loop{i}").symlink_to(".")
        (tree / "logs" / "day1" / f"up{i}").symlink_to("../..")
        (tree / "elsewhere" / "day3" / f"back{i}").symlink_to("../../logs/day1")
    assert names("logs/*/*.csv") == ["day1/b.csv", "day2/[odd].csv", "day3/f.csv"]
    for asked in ("logs", "logs/**/*.csv"):
        found = names(asked)
        assert "day3/f.csv" in found
        assert [name for name in found if "loop" in name or "up" in name] == []
        assert len(found) == len(set(found)) == (7 if asked == "logs" else 5)


def test_a_folder_called_like_a_pattern(tree, monkeypatch):
    (tree / "[lab]").mkdir()
    (tree / "[lab]" / "x.csv").write_text("x")
    monkeypatch.chdir(tree / "[lab]")
    assert names("*.csv") == ["x.csv"]


def test_the_output_is_no_input(tree):
    make_log(tree / "logs" / "out" / "traces" / "part.csv")
    plan = make_plan(["logs/**/*.csv"], "logs/out")
    assert not any("part" in log.name for log in plan.logs)
    assert "left out: 1 files" in plan.notes[0]
    for asked, out in (
        (["logs/out/traces/part.csv"], "logs/out"),  # named: then it is meant
        (["logs/a.csv"], "logs/a.csv"),
        (["logs/bag"], "logs/bag/out"),
        (["logs/bag"], "logs/bag"),
        (["logs/out/**/*.csv"], "logs/out"),
    ):
        with pytest.raises(BatchError, match=r"another folder|no log is left"):
            make_plan(asked, out)


def test_shares_are_all_logs_and_none_twice(tree):
    plan = make_plan(["logs"], "out")
    for count in (1, 2, 3, 7, 10):
        shares = [plan.shard(i + 1, count).logs for i in range(count)]
        assert sorted(log.name for share in shares for log in share) == [log.name for log in plan.logs]
        assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_names_of_any_bytes(tree):
    odd = [b"line\nend.csv", b"\xff\xfe.csv", b"\xff\xff.csv", b"quote'\".csv", b" .csv", b"-rf.csv", "ü.csv".encode()]
    (tree / "odd").mkdir()
    for name in odd:
        (tree / "odd" / os.fsdecode(name)).write_text("x")
    logs = make_plan(["odd/*.csv"], "out").logs
    assert {log.where.rsplit(b"/", 1)[-1] for log in logs} == set(odd)
    assert len({log.name for log in logs}) == len(odd)
    for log in logs:
        log.name.encode("utf-8")  # text


def split_log(folder, late=True):
    """Write a log as two tables in a folder, of one computer's clock: its steps are late now and then, if so said."""
    make_log(folder / "whole.csv", rows=200)
    head, *rows = [line.split(",") for line in (folder / "whole.csv").read_text().splitlines()]
    delay = np.cumsum(np.random.default_rng(0).integers(0, 9, len(rows))) * late
    rows = [[f"{float(t) + 1e-5 * d:.5f}", *cells] for (t, *cells), d in zip(rows, delay, strict=True)]
    (folder / "whole.csv").unlink()
    for name, columns in (("motor", [0, 1]), ("link", [0, 2, 3])):
        text = "\n".join(",".join(row[i] for i in columns) for row in [head, *rows])
        (folder / f"{name}.csv").write_text(text + "\n")


def test_folders_of_tables(tmp_path, monkeypatch):
    """A folder that a pattern means is one log; where tables in it may be meant, too, if their clocks show it."""
    monkeypatch.chdir(tmp_path)
    split_log(tmp_path / "logs" / "late")
    split_log(tmp_path / "logs" / "even", late=False)
    for k in range(2):
        make_log(tmp_path / "logs" / "runs" / f"exp{k}.csv", rows=200)
    make_log(tmp_path / "logs" / "single" / "a.csv", rows=200)
    for name in ("LICENSE", "README.txt"):
        (tmp_path / "logs" / name).write_text("Made by hand.\nNo warranty.\n")
    plan = make_plan(["logs/*"], "out")
    assert [log.name for log in plan.logs] == ["even", "late"]
    assert "LICENSE" in " ".join(plan.notes)
    size = sum(path.stat().st_size for path in (tmp_path / "logs" / "late").iterdir())
    assert {log.name: log.size for log in plan.logs}["late"] == size
    apart = ["even/link.csv", "even/motor.csv"]
    runs = ["runs/exp0.csv", "runs/exp1.csv"]
    assert names("logs") == [*apart, "late", *runs, "single/a.csv"]
    assert names("logs/**") == [*apart, "late", *runs, "single/a.csv"]
    assert names("logs/*/*.csv") == [*apart, "late/link.csv", "late/motor.csv", *runs, "single/a.csv"]
    assert names("logs/late") == ["late"]
    assert names("logs/even") == ["link.csv", "motor.csv"]
    with pytest.raises(BatchError, match="matches no log"):
        make_plan(["logs/run*"], "out")


def test_text_that_a_pattern_names_is_a_log(tmp_path, monkeypatch):
    """So that it fails where it cannot be read."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "exp1.txt").write_text("Made by hand.\nNo warranty.\n")
    assert names("*.txt") == ["exp1.txt"]
    with pytest.raises(BatchError, match="matches no log"):
        make_plan(["*"], "out")
