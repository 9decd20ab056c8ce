"""All commands that take a log take a folder of tables, and say of it what they say of the same samples in one table."""

import json
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

pytestmark = pytest.mark.share(3)

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "sea_exp1.csv"
NAMED = {"log", "logs", "log_sha256", "holdout", "holdout_sha256", "rig", "settings"}
RIG = """
preset = "sea"
[joint.sea.signals]
motor_position = "{motor}motor position"
link_position = "{link}link position"
motor_torque = "{motor}motor torque"
torque_sensor = "{link}torque sensor"
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A log as one table, the same as a folder of two, and a second experiment."""
    place = tmp_path_factory.mktemp("commands")
    rows = [line.split(",") for line in SAMPLE.read_text().splitlines()]
    for name, part in (("exp1", rows[:2501]), ("exp2", [rows[0], *rows[2501:5001]])):
        (place / f"{name}.csv").write_text("\n".join(map(",".join, part)) + "\n")
        (place / name).mkdir()
        for table, columns in (("motor", (0, 1, 2)), ("link", (0, 3, 4))):
            text = "\n".join(",".join(row[i] for i in columns) for row in part)
            (place / name / f"{table}.csv").write_text(text + "\n")
    (place / "one.toml").write_text(RIG.format(motor="", link=""))
    (place / "folder.toml").write_text(RIG.format(motor="motor.", link="link."))
    return place


def run(place, *args, code=0):
    done = vsalog_run(*args, cwd=place)
    assert done.returncode == code, done.stderr
    return done.stdout


def both(place, *args):
    """Run a command on the table and on the folder; return both documents."""
    logs = {"one": ("exp1.csv", "exp2.csv"), "folder": ("exp1", "exp2")}
    for kind, (first, second) in logs.items():
        words = [{"LOG": first, "OTHER": second}.get(word, word) for word in args]
        document = json.loads(run(place, *words, "--rig", f"{kind}.toml", "--json", "--force"))
        yield {key: value for key, value in document.items() if key not in NAMED}


def test_estimate_and_validate(place):
    traces = []
    for log, kind in (("exp1.csv", "one"), ("exp1", "folder")):
        run(place, "estimate", log, "--rig", f"{kind}.toml", "--force")
        (place / "exp1.model.toml").rename(place / f"{kind}.model.toml")
        traces.append(pq.read_table(place / "exp1.stiffness.parquet").to_pandas())
    pd.testing.assert_frame_equal(*traces)
    one, folder = both(place, "validate", "one.model.toml", "OTHER")
    assert one == folder


def test_the_current_folder_has_a_name_and_its_rig(place):
    named, here = place / "exp1", []
    for cwd, log in ((place, "exp1"), (named, "."), (named, "../exp1")):
        (named / "rig.toml").write_text(RIG.format(motor="motor.", link="link."))
        done = vsalog_run("estimate", log, "--json", "-o", place / "here/", cwd=cwd)
        assert done.returncode == 0, done.stderr
        document = json.loads(done.stdout)
        here.append((document["outputs"]["trace"], document["joints"]))
        assert (cwd / document["rig"]["path"]).samefile(named / "rig.toml")
        (named / "rig.toml").write_text(RIG.format(motor="other.", link="link."))
        done = vsalog_run("estimate", log, "--json", cwd=cwd)
        assert (done.returncode, done.stderr[:14]) == (2, "vsalog: exp1: ")
        (named / "rig.toml").unlink()
    assert here[0] == here[1] == here[2]


@pytest.mark.parametrize(("command", "options"), [("diagnose", ["--holdout", "OTHER"]), ("compare", ["-e", "qr-rls"])])
def test_diagnose_and_compare(place, command, options):
    one, folder = both(place, command, "LOG", *options)
    assert one == folder


def test_replay(place):
    rms = []
    for rig, log in (("one.toml", "exp1.csv"), ("folder.toml", "exp1")):
        rms.append(json.loads(run(place, "simulate", rig, "--replay", log, "-o", f"{rig}.mcap", "--json"))["joints"])
    assert rms[0] == rms[1]


def test_batch(place):
    asked = ("batch", "exp[12]", "-o", "out", "--rig", "folder.toml", "-j", "1")
    run(place, *asked)
    rows = pq.read_table(place / "out" / "summary.parquet").to_pylist()
    assert [(row["log"], row["status"]) for row in rows] == [("exp1", "done"), ("exp2", "done")]
    with (place / "exp2" / "motor.csv").open("a") as file:
        file.write("99,0,0\n")  # what a result depends on
    assert "2 done (1 of them before)" in run(place, *asked, "--resume")


def test_nothing_is_written_over_a_table(place):
    before = (place / "exp1" / "motor.csv").read_bytes()
    for words in (("init", "exp1", "--force"), ("estimate", "exp1", "--rig", "folder.toml")):
        run(place, *words, "-o", "exp1/motor.csv", code=2)
    assert (place / "exp1" / "motor.csv").read_bytes() == before
