"""Commands that a message suggests can be typed as they are printed."""

import json
import re
import shlex

import numpy as np
import pytest
from knee import write_log

pytestmark = pytest.mark.share(3)


@pytest.fixture
def suggested(command):
    """Run a command, and return the words of the one that its message suggests."""

    def suggested(*words, cwd, code=2):
        got, _, err = command(*words, cwd=cwd)
        assert got == code, err
        found = [shlex.split(line) for line in re.findall(r"vsalog \w+ .*?(?=' (?:lists|writes|takes)|$)", err)]
        assert found, err
        return found[0][1:]

    return suggested


def test_a_guessed_rig_can_be_written_down(command, suggested, tmp_path):
    (tmp_path / "my logs").mkdir()
    write_log(
        tmp_path / "my logs" / "first log.csv",
        header="time [s],motor_position [rad],motor_torque [N·m],link_position [rad],torque_sensor [N·m]",
    )
    words = suggested("estimate", "my logs/first log.csv", "-e", "direct", cwd=tmp_path, code=0)
    assert command(*words, cwd=tmp_path)[0] == 0
    assert (tmp_path / "my logs" / "first log.rig.toml").exists()
    code, _, err = command("estimate", "my logs/first log.csv", "-e", "direct", "--force", cwd=tmp_path)
    assert code == 0, err
    assert "guessed" not in err


def test_channels_that_are_missing_can_be_looked_up(command, suggested, bench):
    (bench / "my log.csv").write_text((bench / "log.csv").read_text().replace("theta", "other"))
    for words in (("estimate", "my log.csv"), ("simulate", "--replay", "my log.csv")):
        found = suggested(*words, cwd=bench)
        assert found == ["inspect", "my log.csv"]
        assert command(*found, cwd=bench)[0] == 0


@pytest.fixture
def results(command, bench):
    """A folder with a log, its trace and its model."""
    assert command("estimate", "log.csv", "-e", "direct", cwd=bench)[0] == 0
    return bench


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("validate", "log.csv", "log.csv"), "vsalog estimate log.csv"),
        (("validate", "log.stiffness.parquet", "log.csv"), "log.model.toml"),
        (("validate", "rig.toml", "log.csv"), "vsalog estimate LOG --rig rig.toml"),
        (("diagnose", "log.model.toml"), "vsalog validate log.model.toml LOG"),
        (("inspect", "rig.toml"), "--rig"),
        (("estimate", "rig.toml"), "--rig"),
        (("plot", "nothere.csv"), "no such file"),
        (("plot", "nothere.csv", "-o", "x.pdf"), "no such file"),
        (("estimate", "empty"), "folder"),
    ],
)
def test_a_file_of_another_kind_is_named_with_what_to_give_instead(command, results, words, named):
    (results / "empty").mkdir()
    before = sorted(results.iterdir())
    code, out, err = command(*words, cwd=results)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert named in err
    assert sorted(results.iterdir()) == before


def test_logs_below_a_folder_are_for_a_batch(command, suggested, bench):
    (bench / "my logs" / "monday").mkdir(parents=True)
    for name in ("log.csv", "rig.toml"):
        (bench / name).rename(bench / "my logs" / "monday" / name)
    words = suggested("estimate", "my logs", cwd=bench)
    assert words[0] == "batch"
    assert command(*words, "--jobs", 1, cwd=bench)[0] == 0


def test_a_spring_of_no_type_is_stated_as_the_message_says(command, bench):
    code, _, err = command("identify", "log.csv", cwd=bench)
    assert code == 2
    assert "'knee'" in err
    (line,) = re.findall(r"transmission = {.*}", err)
    rig = (bench / "rig.toml").read_text(encoding="utf-8").replace("[joint.knee]\n", f"[joint.knee]\n{line}\n")
    (bench / "rig.toml").write_text(rig, encoding="utf-8")
    code, _, err = command("identify", "log.csv", "--set", "joint.knee.link.inertia=0.2", "--end", "1", cwd=bench)
    assert code == 0, err


def test_a_diagnosis_names_what_the_rig_lacks_for_an_equation(command, bench):
    rig = bench / "rig.toml"
    rig.write_text(rig.read_text().replace("inertia = 0.1", "damping = 0.1"))
    code, out, _ = command("diagnose", "log.csv", "--json", cwd=bench)
    assert code == 0
    lacking = {f["evidence"]["key"] for f in json.loads(out)["findings"] if f["code"] == "diagnosis.rig_lacks"}
    assert lacking == {"motor.inertia", "link.inertia"}


@pytest.mark.parametrize("estimator", ["direct", "qr-rls"])
def test_a_log_that_is_too_short_is_not_one_without_motion(command, bench, estimator):
    def codes(*more):
        code, out, err = command("estimate", "log.csv", "-e", estimator, "--json", "--force", *more, cwd=bench)
        assert code == 0, err
        return {finding["code"] for finding in json.loads(out)["joints"][0]["findings"]}

    never = {"estimate.never_excited", "estimate.fit_never_excited"}
    assert "estimate.too_short" in (short := codes("--start", "1", "--end", "1.2"))
    assert not never & short
    still = 1e-6 * np.random.default_rng(0).normal(size=(3, 3000))
    write_log(bench / "log.csv", theta=still[0], q=still[1], tau=1e3 * still[2])
    assert never & (resting := codes())
    assert "estimate.too_short" not in resting


def test_no_rig_is_extended_where_no_cause_was_found(command, bench):
    code, out, _ = command("diagnose", "log.csv", "--json", cwd=bench)
    assert (code, json.loads(out)["causes"]) == (0, [])
    assert not (bench / "extended.rig.toml").exists()
