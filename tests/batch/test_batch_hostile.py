"""What may go wrong around a batch: names, disks, other runs, and logs that mean harm."""

import ast
import base64
import hashlib
import os
import re
import time
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import polars as pl
import pyarrow.parquet as pq
import pytest
from batch_bench import RIG, batch, contents, do_batch, make_log, make_logs, private_disk, same, start, summary

import vsalog.batch
from vsalog.batch.lock import locked
from vsalog.batch.records import Settings
from vsalog.batch.storage import Store

pytestmark = pytest.mark.share(5)

JOINT = "</script><script>alert(1)</script><img src=x onerror=alert(2)> \"'` ../../x=y"
EVIL = f"{JOINT}\n\x00\x1b[31m"  # joints have to be printable


def toml(text):
    """Write a text as a TOML string."""
    return "".join(c if c.isalnum() else f"\\u{ord(c):04x}" for c in text)


class Page(HTMLParser):
    """Every element and attribute of a page."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.scripts, self._inside = [], [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._inside = tag == "script"

    def handle_data(self, data):
        if self._inside:
            self.scripts.append(data)
            self._inside = False


@pytest.fixture
def hostile(tmp_path, here):
    """A batch over logs whose names, rig, joint and channels are hostile; the folder it is in."""
    evil_name = "<img src=x onerror=alert(3)>\n\"'&.csv"
    make_log(tmp_path / "logs" / evil_name)
    (tmp_path / "logs" / "bad <script>alert(4).csv").write_text("time,<script>alert(5)</script>\n0,x\n")
    rig = RIG.format(name=toml(EVIL)).replace("joint.knee", f'joint."{toml(JOINT)}"')
    (tmp_path / "logs" / "rig.toml").write_text(rig)
    before = {p for p in tmp_path.rglob("*") if "out" not in p.parts}
    outcome, _ = do_batch(tmp_path / "logs", out=tmp_path / "out")
    assert outcome.planned == 2
    assert [r.log for r in outcome.failures] == ["bad <script>alert(4).csv"]
    assert {p for p in tmp_path.rglob("*") if "out" not in p.relative_to(tmp_path).parts} == before
    return tmp_path / "out"


def test_no_name_becomes_markup_or_script(hostile):
    text = (hostile / "index.html").read_text(encoding="utf-8")
    page = Page(text)
    assert not any(attribute.startswith("on") for _, attributes in page.elements for attribute in attributes)
    assert not [tag for tag, _ in page.elements if tag in ("img", "iframe", "object", "base", "form")]
    assert len(page.scripts) == 1
    (policy,) = [a["content"] for tag, a in page.elements if tag == "meta" and "http-equiv" in a]
    digest = base64.b64encode(hashlib.sha256(page.scripts[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy  # no other script would run, even if one got in
    assert "default-src 'none'" in policy
    assert "\x1b" not in text
    assert "\x00" not in text


def test_the_links_of_the_page_lead_to_files(hostile):
    page = Page((hostile / "index.html").read_text(encoding="utf-8"))
    links = [attributes["href"] for tag, attributes in page.elements if tag == "a" and attributes["href"][0] != "#"]
    assert len(links) == 2  # trace and model of the log that went well
    for link in links:
        target = (hostile / unquote(link)).resolve()
        assert target.is_file()
        assert target.is_relative_to(hostile)


def test_no_path_is_made_of_what_a_log_says(hostile):
    (trace,) = hostile.rglob("part.parquet")
    parts = trace.relative_to(hostile).parts
    assert len(parts) == 5
    assert parts[1].startswith("device=%3C%2Fscript%3E")
    table = pl.scan_parquet(hostile / "traces", hive_partitioning=True).collect()
    assert table["device"].unique().to_list() == [EVIL]
    assert table["joint"].unique().to_list() == [JOINT]
    (row,) = [row for row in summary(hostile) if row["status"] == "done"]
    assert (row["device"], row["joint"], row["log"]) == (EVIL, JOINT, table["log"][0])
    assert (hostile / row["trace"]).is_file()


def test_nothing_that_runs_what_it_reads_is_used():
    """No pickle of what logs hold, no eval, no shell."""
    for path in Path(vsalog.batch.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {n.split(".")[0] for n in names} & {
                "pickle",
                "subprocess",
                "shelve",
                "marshal",
                "cloudpickle",
            }, path
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec", "compile", "__import__"), path
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "os":
                assert node.attr not in ("system", "popen", "execv", "spawnv"), path


def test_names_with_line_ends_and_without_text(tmp_path):
    """As a user runs it: every log is done, every file has a name, the terminal gets nothing to obey."""
    names = [b"line\nend.csv", b"\xff\xfe.csv", b"\xff\xfd.csv", b"a b;$(touch x)`.csv", b"\x1b[31mred.csv"]
    for i, name in enumerate(names):
        make_log(tmp_path / "logs" / os.fsdecode(name), i)
    (tmp_path / "logs" / "rig.toml").write_text(RIG.format(name="knee rig"))
    (tmp_path / "logs" / os.fsdecode(b"bad\xff\x1b[31m.csv")).write_bytes(b"")
    code, out, err = batch("logs/*.csv", "-o", os.fsdecode(b"out\xff"), "-j", "1", cwd=tmp_path)
    assert code == 2, err
    assert "6 logs" in out
    assert "Traceback" not in err
    assert "\x1b" not in out + err
    done = [row for row in summary(tmp_path / os.fsdecode(b"out\xff")) if row["status"] == "done"]
    assert len({row["log"] for row in done}) == 5
    for row in done:
        with (tmp_path / os.fsdecode(b"out\xff") / row["trace"]).open("rb") as file:
            assert pq.ParquetFile(file).metadata.num_rows > 0
    assert not (tmp_path / "x").exists()


def test_two_runs_into_one_folder(tmp_path, here):
    """The second is refused while the first runs; a run that was killed locks nobody out."""
    make_logs(tmp_path / "logs", 4, rows=20_000)
    killed = start("logs", "-o", "out", "-j", "1", cwd=tmp_path)
    deadline = time.monotonic() + 30.0
    while not (tmp_path / "out" / "batch.json").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    killed.kill()
    killed.communicate()
    with locked(Store(str(tmp_path / "out")), None):
        code, out, err = batch("logs", "-o", "out", "--resume", "-j", "1", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert f"another run is writing there (process {os.getpid()}" in err
    outcome, _ = do_batch(tmp_path / "logs", out=tmp_path / "out", resume=True)
    assert outcome.code == 0


FULL = """
mkdir small
mount -t tmpfs -o size=1500k none small
vsalog batch logs -o small/out -j 1 || echo "code $?"
ls small/out
find small/out/traces -type f | wc -l
mount -o remount,size=100m small
vsalog batch logs -o small/out -j 1 --resume || echo "code $?"
cp -r small/out roomy
"""
READ_ONLY = """
mkdir small
mount -t tmpfs none small
mount -o remount,ro small
vsalog batch logs -o small/out -j 1 || echo "code $?"
"""


def test_a_full_disk_ends_the_run_and_room_lets_it_go_on(tmp_path, here):
    make_logs(tmp_path / "logs", 4, rows=10_000)
    done = private_disk(FULL, tmp_path)
    if done is None:
        pytest.skip("no disks may be mounted here")
    assert "code 2" in done.stdout
    assert "No space left on device" in done.stderr
    assert "--resume" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.count("code") == 1, done.stderr
    do_batch(tmp_path / "logs", out=tmp_path / "whole")
    same(contents(tmp_path / "roomy"), contents(tmp_path / "whole"))


def test_a_read_only_disk(tmp_path):
    make_logs(tmp_path / "logs", 2)
    done = private_disk(READ_ONLY, tmp_path)
    if done is None:
        pytest.skip("no disks may be mounted here")
    assert "code 2" in done.stdout
    assert re.search("Read-only file system", done.stderr)
    assert len(done.stderr.strip().splitlines()) == 1


def test_an_output_that_is_a_file(tmp_path):
    make_logs(tmp_path / "logs", 2)
    (tmp_path / "file").write_text("x")
    for out in ("file", "file/out"):
        code, _, err = batch("logs", "-o", out, cwd=tmp_path)
        assert (code, len(err.splitlines())) == (2, 1), err
    assert (tmp_path / "file").read_text() == "x"


def test_a_bug_in_one_log_does_not_stop_the_others(tmp_path, logs, here, monkeypatch):
    """Whatever a log brings out of a library: it is recorded, and the exit code says that it is no fault of the log."""
    from vsalog.batch import one_log

    def burst(log, path, settings, scratch, do=one_log.COMMANDS["estimate"]):
        if "exp3" in log.name:
            raise ZeroDivisionError("<b>of all things</b>")
        if "exp4" in log.name:
            raise MemoryError
        return do(log, path, settings, scratch)

    monkeypatch.setitem(one_log.COMMANDS, "estimate", burst)
    outcome, _ = do_batch(logs, out=tmp_path / "out", settings=Settings())
    assert {r.log: r.kind for r in outcome.failures} == {"day1/exp3.csv": "bug", "day0/exp4.csv": "memory"}
    assert outcome.code == 1
    assert len(list((tmp_path / "out").rglob("part.parquet"))) == 4
