"""`vsalog batch` as a user runs it: what it says, what it leaves, and how it ends."""

import json
import re
import sys

import pytest
from batch_bench import RIG, batch, do_batch, make_log, make_logs, summary

from vsalog.cli import _run
from vsalog.cli.batch import settings_of
from vsalog.estimation.job import Options, prepare
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs

pytestmark = pytest.mark.share(3)


@pytest.fixture
def call(monkeypatch, capsys, here, tmp_path):
    """Run `vsalog batch ARGS` in this process; returns exit code, stdout and stderr."""

    def call(*args):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["vsalog", "batch", *map(str, args)])
        code = _run()
        return code, *capsys.readouterr()

    return call


def test_a_thousand_logs_in_small(tmp_path, call):
    """One bad log among them: it is recorded, the others are done, and the exit code says so."""
    make_logs(tmp_path / "logs", 4)
    (tmp_path / "logs" / "day1" / "empty.csv").write_bytes(b"")
    code, out, err = batch("logs/**/*.csv", "-o", "out", "--json", cwd=tmp_path)
    assert code == 2
    told = json.loads(out)
    assert (told["logs"], told["done"], told["kept"]) == (5, 4, 0)
    assert [(f["log"], f["kind"]) for f in told["failed"]] == [("day1/empty.csv", "input")]
    assert err.splitlines()[-1].startswith("vsalog: 1 of 5 logs failed; out/index.html and out/summary.parquet list")
    rows = {row["log"]: row for row in summary(tmp_path / "out")}
    assert rows["day1/empty.csv"]["status"] == "failed"
    assert "is empty" in rows["day1/empty.csv"]["reason"]
    assert rows["day0/exp0.csv"]["joint"] == "knee"
    assert rows["day0/exp0.csv"]["stiffness_low"] == pytest.approx(20.0, rel=0.05)  # what the logs were made with
    assert rows["day0/exp0.csv"]["device"] == "knee rig"
    (tmp_path / "logs" / "day1" / "empty.csv").unlink()
    code, out, err = call("logs/**/*.csv", "-o", "out", "--resume")
    assert (code, err) == (0, "rig: each log's own\n")
    assert "4 logs in" in out
    assert "4 done (4 of them before), 0 failed" in out


def test_a_failure_names_the_rig_of_the_log_without_its_folder(tmp_path, call):
    make_logs(tmp_path / "logs", 1)
    (path,) = (tmp_path / "logs").rglob("rig.toml")
    path.write_text(path.read_text().replace("theta", "phi"))
    code, out, _ = call("logs/**/*.csv", "-o", "out", "--json")
    ((reason, kind),) = ((f["reason"], f["kind"]) for f in json.loads(out)["failed"])
    assert (code, kind) == (2, "input")
    assert "rig.toml" in reason
    assert str(tmp_path) not in reason


def test_one_log_is_one_log(tmp_path, call):
    (tmp_path / "junk.csv").write_bytes(b"")
    code, out, err = call("junk.csv", "-o", "out")
    assert code == 2
    assert out.startswith("1 log in ")
    assert err.splitlines()[0].startswith("failed: junk.csv: is empty")
    assert err.splitlines()[-1].startswith("vsalog: 1 of 1 log failed; ")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<h1>1 log</h1>" in page
    assert "1 log: 0 done, 1 failed." in page


@pytest.fixture
def model(tmp_path, logs):
    """A model, of a log that is not among the others."""
    make_log(tmp_path / "learn" / "x.csv", seed=50)
    (tmp_path / "learn" / "rig.toml").write_text(RIG.format(name="knee rig"))
    job = prepare([tmp_path / "learn" / "x.csv"], Options())
    write_estimate(job, Outputs.named([logs / "x.csv"], str(tmp_path), None))
    return tmp_path / "x.model.toml"


def test_validate(tmp_path, logs, here, model):
    settings = settings_of("validate", None, model, max_nrmse=5.0)
    outcome, _ = do_batch(logs, out=tmp_path / "out", settings=settings)
    assert outcome.code == 0
    rows = summary(tmp_path / "out")
    assert len(rows) == 6
    assert {row["judged_on"] for row in rows} == {"sensor"}
    assert all(0.0 < row["nrmse"] < 5.0 and row["threshold_met"] for row in rows)
    report = json.loads((tmp_path / "out" / rows[1]["document"]).read_text())
    assert (
        report["logs"][0]["joints"][0]["transmissions"][0]["comparisons"][0]["inside"]["nrmse"]["value"]
        == rows[1]["nrmse"]
    )
    assert (tmp_path / "out" / rows[1]["report"]).is_file()
    assert not (tmp_path / "out" / "traces").exists()
    strict = settings_of("validate", None, model, max_nrmse=1e-3)
    outcome, _ = do_batch(logs, out=tmp_path / "strict", settings=strict)
    assert outcome.code == 3
    assert len(outcome.missed) == 6


def test_a_rig_for_all_is_the_same_as_a_rig_next_to_each(tmp_path, logs, here, model):
    """Rig and model go to the workers as text: what is written names the files as they were given, and no place of ours."""
    rig = logs / "day0" / "rig.toml"
    do_batch(logs, out=tmp_path / "beside")
    for day in logs.iterdir():
        (day / "rig.toml").rename(tmp_path / "given.toml")
    do_batch(logs, out=tmp_path / "given", settings=settings_of("estimate", str(tmp_path / "given.toml"), None))
    one, two = (summary(tmp_path / name) for name in ("beside", "given"))
    keys = ("log", "joint", "stiffness_low", "stiffness_high", "fit_rms", "rig_sha256", "device")
    assert [[row[k] for k in keys] for row in one] == [[row[k] for k in keys] for row in two]
    settings = settings_of("validate", str(tmp_path / "given.toml"), model)
    do_batch(logs / "day0", out=tmp_path / "validated", settings=settings)
    for path in (tmp_path / "validated").rglob("*"):
        assert path.is_dir() or str(tmp_path).encode() not in path.read_bytes(), path
    assert not rig.exists()


def test_diagnose(tmp_path, here, samples):
    (tmp_path / "sea_exp1.csv").symlink_to(samples / "sea_exp1.csv")
    (tmp_path / "rig.toml").write_text((samples / "sea_exp1.rig.toml").read_text())
    settings = settings_of("diagnose", None, None, fail_on_cause=True, end="6")
    outcome, _ = do_batch(tmp_path / "sea_exp1.csv", out=tmp_path / "out", settings=settings)
    (row,) = summary(tmp_path / "out")
    assert row["verdict"] in ("consistent", "explained", "partly explained", "unexplained")
    assert outcome.code == (0 if row["verdict"] == "consistent" else 3)
    assert {error["signal"] for error in row["errors"]} >= {"link_position"}
    document = json.loads((tmp_path / "out" / row["document"]).read_text())
    assert document["verdict"] == row["verdict"]
    assert (tmp_path / "out" / row["report"]).stat().st_size > 100_000
    if row["rig"] is not None:
        assert row["rig"].endswith("extended.rig.toml")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-e", "directt"], "did you mean 'direct'"),
        (["--tune", "forgeting=1"], "forgetting"),
        (["--rig", "vsa3"], "did you mean 'vsa2'"),
        (["--start", "noon"], "noon"),
        (["--do", "validate"], "needs --model"),
        (["--do", "validate", "--model", "nowhere.toml"], "nowhere.toml"),
        (["--do", "validate", "--model", "logs/day0/rig.toml"], "is a rig, no model"),
        (["--do", "diagnose", "-e", "direct"], "--estimator is for --do estimate"),
        (["--shard", "3/2"], "3/2"),
        (["--shard", "0/2"], "0/2"),
        (["--memory", "much"], "no size"),
        (["--scheduler", "tcp://127.0.0.1:1", "-j", "2"], "--jobs"),
        (["-o", "logs/day0/exp0.csv"], "is a file|is in one"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_anything_is_written(tmp_path, logs, call, options, said):
    if "tune" in " ".join(options):
        options = [*options, "-e", "direct"]
    before = set(tmp_path.rglob("*"))
    output = [] if "-o" in options else ["-o", "out"]
    code, out, err = call("logs", *output, *options)
    assert (code, out) == (2, ""), err
    assert re.search(said, " ".join(err.replace("│", " ").split())), err
    assert set(tmp_path.rglob("*")) == before


def test_options_reach_the_estimator(tmp_path, logs, here):
    settings = settings_of(
        "estimate", None, None, estimator="direct", tune={"forgetting": "0.97"}, start="0.2", end="1.2"
    )
    do_batch(logs / "day0" / "exp0.csv", out=tmp_path / "out", settings=settings)
    (row,) = summary(tmp_path / "out")
    assert row["estimator"] == "direct"
    assert row["duration"] == pytest.approx(1.0, abs=0.01)


def test_bags_are_logs(tmp_path, here, monkeypatch):
    """A folder that is a ROS 2 bag, hashed and read as one log."""
    (tmp_path / "logs").mkdir()
    bag = f"{tmp_path / 'logs' / 'bag'}/"
    monkeypatch.setattr(sys, "argv", ["vsalog", "simulate", "sea", "--duration", "2", "-o", bag])
    assert _run() == 0
    outcome, _ = do_batch(tmp_path / "logs", out=tmp_path / "out")
    assert (outcome.planned, outcome.code) == (1, 0)
    assert summary(tmp_path / "out")[0]["log"] == "bag"
    again, _ = do_batch(tmp_path / "logs", out=tmp_path / "out", resume=True)
    assert again.kept == 1
