"""`vsalog compare` as a user runs it."""

import json

import numpy as np
import pytest
from knee import lay

import vsalog

pytestmark = pytest.mark.share(4)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    from click.testing import CliRunner

    from vsalog.cli import cli

    path = tmp_path_factory.mktemp("log") / "log.mcap"
    done = CliRunner().invoke(cli, ["simulate", "sea", "--truth", "--seed", "3", "-o", str(path)])
    assert done.exit_code == 0
    return path


def test_all_that_the_log_allows_side_by_side(run, log):
    done = run("compare", log, "--report", "page.html", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    names = list(dict.fromkeys(row["estimator"] for row in found["rows"]))
    assert names[0] == "residual-rls"
    assert {"qr-rls", "batch-ls", "direct", "residual-rls:modality=SENSOR"} <= set(names)
    for row in found["rows"]:
        assert row["against_truth"]["msrep"]["value"] < 1.0
        assert (row["difference"] is None) == (row["estimator"] == names[0])
    assert len(found["warnings"]) >= len(found["findings"])
    assert all(finding["joint"] for finding in found["findings"])


def test_the_figures_are_those_of_estimate(run, log):
    done = run("compare", log, "-e", "qr-rls:forgetting=0.999,direct", "--json")
    rows = [row for row in json.loads(done.stdout)["rows"] if row["transmission"] == "1"]
    assert [row["estimator"] for row in rows] == ["qr-rls:forgetting=0.999", "direct"]
    (qr,) = vsalog.estimate(log, estimator="qr-rls", tune={"forgetting": 0.999})
    (direct,) = vsalog.estimate(log, estimator="direct")
    a, b = (e.trace["1"] for e in (direct, qr))
    both = a["excited"] & b["excited"]
    difference = np.sqrt(np.mean(((a["stiffness"] - b["stiffness"])[both] / b["stiffness"][both]) ** 2))
    assert rows[1]["difference"] == pytest.approx(difference)
    assert rows[0]["excited_share"] == pytest.approx(b["excited"].mean())


def test_a_fault_of_one_estimator_does_not_hide_the_others(log, monkeypatch):
    from click.testing import CliRunner

    from vsalog.cli import cli
    from vsalog.estimation.job import Job

    sound = Job.run

    def run(job):
        if job.options.estimator == "direct":
            raise ZeroDivisionError("in the middle")
        return sound(job)

    monkeypatch.setattr(Job, "run", run)
    done = CliRunner().invoke(cli, ["compare", str(log), "-e", "direct,qr-rls", "--json"])
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert {row["estimator"] for row in found["rows"]} == {"qr-rls"}
    assert found["failed"] == {"direct": "ZeroDivisionError: in the middle"}
    assert "a bug in vsalog" in done.stderr
    done = CliRunner().invoke(cli, ["compare", str(log), "-e", "direct,qr-rls"])
    assert (done.exit_code, "failed: direct: ZeroDivisionError: in the middle" in done.stdout) == (1, True)
    assert "qr-rls" in done.stdout
    assert isinstance(CliRunner().invoke(cli, ["compare", str(log), "-e", "direct"]).exception, ZeroDivisionError)


def test_refusals(run, log, samples):
    for arguments, words in (
        (("compare", log, "-e", "qr-rls:forgetting"), "NAME:KEY=VALUE"),
        (("compare", log, "-e", "kalman"), "kalman"),
        (("compare", log, "-e", "direct,kalman"), "kalman"),
        (("compare", log, "-e", "direct,qr-rls:forgeting=0.9"), "forgeting"),
        (("compare", log, "-e", "direct,qr-rls:preset=book"), "book"),
        (("compare", samples / "desr_foot" / "desr_foot.mat", "-e", "qr-rls"), "motor_torque"),
        (("compare", samples / "desr_foot" / "desr_foot.mat", "-e", "qr-rls,batch-ls"), "qr-rls: joint"),
        (("compare", "nothing.mcap"), "nothing.mcap"),
        (("compare", log, "-e", ","), "names no estimator"),
        (("compare", log, "-e", ""), "names no estimator"),
    ):
        done = run(*arguments)
        assert done.returncode == 2, arguments
        assert words in done.stderr
        assert done.stdout == ""


def test_estimators_that_the_log_does_not_allow_are_left_out_with_the_reason(run, samples):
    done = run("compare", samples / "desr_foot" / "desr_foot.mat", "--end", "4", "--json")
    found = json.loads(done.stdout)
    assert {row["estimator"] for row in found["rows"]} == {
        "residual-rls:modality=SENSOR",
        "direct",
        "impedance",
        "smoother",
    }
    assert "motor_torque" in found["left_out"]["qr-rls"]


def test_one_that_was_named_and_is_not_allowed_is_left_out_too(run, samples):
    done = run("compare", samples / "desr_foot" / "desr_foot.mat", "-e", "qr-rls,direct", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert {row["estimator"] for row in found["rows"]} == {"direct"}
    assert list(found["left_out"]) == ["qr-rls"]
    assert "motor_torque" in found["left_out"]["qr-rls"]
    told = run("compare", samples / "desr_foot" / "desr_foot.mat", "-e", "qr-rls,direct")
    assert "qr-rls" in told.stdout + told.stderr


def test_what_the_log_is_too_short_for_is_left_out(command, tmp_path):
    """60 samples: more than the smoother's window of 51, fewer than the 0.15 s at 1 kHz of `algebraic`'s filters."""
    lay(tmp_path, rows=60)
    code, out, err = command("compare", "log.csv", "--json", cwd=tmp_path)
    assert code == 0, err
    found = json.loads(out)
    there = {row["estimator"] for row in found["rows"]}
    assert {"residual-rls", "qr-rls", "batch-ls", "direct"} <= there
    assert "has 60 samples, but" in found["left_out"]["algebraic"]
    assert not there & set(found["left_out"])
    code, out, _ = command("compare", "log.csv", "-e", "algebraic,direct", cwd=tmp_path)
    assert code == 0
    assert "left out: algebraic" in out
    assert "60 samples" in out
    code, out, err = command("compare", "log.csv", "-e", "algebraic", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "60 samples" in err


def test_an_estimator_that_is_named_twice_runs_once(run, log):
    done = run(
        "compare",
        log,
        "-e",
        "direct, direct",
        "-e",
        "qr-rls:forgetting=0.99,direct,qr-rls: forgetting = 0.99",
        "--json",
    )
    rows = [row["estimator"] for row in json.loads(done.stdout)["rows"] if row["transmission"] == "1"]
    assert rows == ["direct", "qr-rls:forgetting=0.99"]


def test_fits_are_held_against_the_torque_sensor(run, log):
    """By hand: the fitted torque less the recorded sensor, where it is supported; noise of 0.02 N·m is left of it."""
    done = run("compare", log, "-e", "residual-rls,qr-rls,impedance", "--json")
    assert done.returncode == 0, done.stderr
    found = {
        row["estimator"]: row["off_sensor"] for row in json.loads(done.stdout)["rows"] if row["transmission"] == "1"
    }
    assert found["impedance"] is None
    sensor = vsalog.read(log).channels["/joint_torque.effort[transmission]"]
    for name in ("residual-rls", "qr-rls"):
        (estimate,) = vsalog.estimate(log, estimator=name)
        part = estimate.trace["1"]
        fit, excited = (np.asarray(part[c], dtype=float) for c in ("flexibility_torque_fit", "excited"))
        seconds = [(s - sensor.stamps[0]) * 1e-9 for s in (estimate.trace.stamps, sensor.stamps)]
        off = (fit - np.interp(*seconds, sensor.values))[excited > 0]
        assert found[name] == pytest.approx(np.sqrt(np.nanmean(off**2)), rel=1e-6)
        assert 0.018 < found[name] < 0.03


def test_the_page_begins_with_all_estimators_in_one_figure(run, log, tmp_path):
    done = run("compare", log, "-e", "residual-rls,direct", "--report", tmp_path / "page.html")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "page.html").read_text()
    assert page.index("Stiffness by all estimators") < page.index("RMS residual")
    assert page.count('class="plot"') == 1
    assert "by every estimator, where it is excited: residual-rls" in page
    assert "; the truth 20" in page


def test_two_sensors_are_added_up(run, samples):
    done = run("compare", samples / "vsa2_exp1.mcap", "-e", "residual-rls", "--json")
    off = {row["transmission"]: row["off_sensor"] for row in json.loads(done.stdout)["rows"]}
    # White noise of 1 mN·m each.
    assert off["1"] == pytest.approx(1.0e-3, rel=0.1)
    assert off["total"] == pytest.approx(2.0**0.5 * 1.0e-3, rel=0.1)


def test_a_cause_is_reported_once_for_all_estimators(command, tmp_path):
    wrong = ("--actual", "joint.sea.signals.torque_sensor.gain=1.3", "--duration", "8", "-o", "log.mcap")
    assert command("simulate", "sea", *wrong, cwd=tmp_path)[0] == 0
    code, out, err = command("compare", "log.mcap", "-e", "residual-rls,qr-rls,batch-ls,direct", "--json", cwd=tmp_path)
    assert code == 0, err
    (scale,) = [f for f in json.loads(out)["findings"] if f["code"] == "cross_check.torque_scale"]
    # The sensor is no reference for the one that reads it.
    assert scale["evidence"]["estimator"] == "residual-rls, qr-rls, batch-ls"
    assert scale["value"] == pytest.approx(1.3, rel=0.05)
