"""What commands say on stderr: which rig they used, which other one lies there, and as much as is asked for."""

import json
import re
from pathlib import Path

import pytest
from knee import RIG, lay, write_log

import vsalog
from vsalog.core.progress import Advanced, counted, watched
from vsalog.report.progress import STEPS

pytestmark = pytest.mark.share(3)

OTHER = RIG.replace("inertia = 0.1", "inertia = 0.2")


@pytest.fixture
def spoken(command, bench):
    """Run `estimate ARGS` in the folder; returns the lines on stderr."""

    def spoken(*args, cwd=bench):
        code, _, err = command("estimate", *args, cwd=cwd)
        assert code == 0, err
        return [line for line in err.splitlines() if not line.startswith(("compiling", "replacing"))]

    return spoken


def test_the_rig_that_is_used_is_reported(spoken, command, bench):
    assert spoken("log.csv")[0].startswith("rig: rig.toml")
    (bench / "log.rig.toml").write_text(RIG)
    assert spoken("log.csv")[0].startswith("rig: log.rig.toml")
    assert spoken("log.csv", "--rig", "rig.toml")[0].startswith("rig: rig.toml")
    code, _, err = command("validate", "log.model.toml", "log.csv", "--rig", "rig.toml", cwd=bench)
    assert (code, "rig: rig.toml" in err) == (0, True)
    assert "rig: preset sea" in command("export", "sea", "--to", "mjcf", cwd=bench)[2]


def test_another_rig_beside_is_reported_loudly_unless_it_says_the_same_or_was_passed_over_knowingly(spoken, bench):
    (bench / "log.rig.toml").write_text(RIG)
    assert not any("warning" in line for line in spoken("log.csv"))
    (bench / "rig.toml").write_text(OTHER)
    loud = [line for line in spoken("log.csv", "-q") if line.startswith("warning: rig.toml")]
    assert len(loud) == 1
    known = spoken("log.csv", "--rig", "log.rig.toml")
    assert not any("warning" in line for line in known)
    assert "rig.toml is not used" in known[0]


def test_a_rig_in_the_working_directory_is_no_rig_of_a_log_elsewhere(spoken, tmp_path):
    (tmp_path / "logs").mkdir()
    lay(tmp_path / "logs")
    (tmp_path / "rig.toml").write_text(OTHER)
    lines = spoken("logs/log.csv", cwd=tmp_path)
    assert lines[0].startswith("rig: logs/rig.toml")
    assert [line for line in lines if line.startswith("warning: rig.toml")]


def test_the_rig_of_the_model_is_reported_where_a_log_has_none(spoken, command, bench, tmp_path):
    spoken("log.csv")
    (tmp_path / "bare").mkdir()
    write_log(tmp_path / "bare" / "log2.csv")
    (bench / "rig.toml").rename(bench / "elsewhere.toml")
    code, _, err = command("validate", "log.model.toml", "bare/log2.csv", cwd=bench)
    assert code == 0, err
    assert "rig: the rig in the model file" in err


@pytest.mark.parametrize("before", [True, False])
def test_quiet_says_nothing_and_verbose_what_took_how_long(command, bench, before):
    def said(option):
        words = (option, "estimate", "log.csv") if before else ("estimate", "log.csv", option)
        code, out, err = command(*words, cwd=bench)
        assert code == 0, err
        return out, err

    (out, quiet), (same, verbose) = said("-q"), said("-v")
    assert quiet == ""
    assert out == same
    assert str(bench / "rig.toml") in verbose
    assert any(line.startswith("reading log.csv: ") and line.endswith(" s") for line in verbose.splitlines())


@pytest.mark.parametrize(
    "words",
    [
        ("estimate", "log.csv", "-q", "-v"),
        ("-v", "estimate", "log.csv", "--quiet"),
        ("-q", "-v", "estimate", "log.csv"),
    ],
)
def test_quiet_and_verbose_contradict_each_other(command, bench, words):
    code, out, err = command(*words, cwd=bench)
    assert (code, out) == (2, "")
    assert "--quiet" in err
    assert not (bench / "log.model.toml").exists()


def test_a_refusal_is_one_line(command, bench):
    (bench / "log.rig.toml").write_text(OTHER.replace("theta", "phi"))
    code, _, err = command("estimate", "log.csv", cwd=bench)
    assert (code, len(err.splitlines())) == (2, 1)


@pytest.mark.parametrize(
    "words",
    [
        ("estimate", "log.csv"),
        ("estimate", "log.csv", "-q"),
        ("plot", "log.csv", "-o", "figure.svg"),
        ("compare", "log.csv"),
        ("validate", "log.model.toml", "log.csv"),
        ("diagnose", "log.csv"),
        ("identify", "log.csv"),
        ("simulate", "--replay", "log.csv", "-o", "replayed.csv"),
        ("export", "rig.toml", "--to", "mjcf"),
    ],
)
def test_a_refusal_names_the_rig_that_was_used(command, bench, words):
    """It may be another experiment's."""
    assert command("estimate", "log.csv", cwd=bench)[0] == 0
    (bench / "rig.toml").write_text(RIG.replace('"theta"', '"phi"').replace('"q"', '"z"'))
    code, out, err = command(*words, cwd=bench)
    assert (code, out) == (2, "")
    assert "rig.toml" in err


def test_a_log_that_cannot_be_read_is_no_fault_of_the_rig(command, bench):
    (bench / "log.csv").write_text("")
    code, _, err = command("estimate", "log.csv", "--rig", "rig.toml", cwd=bench)
    assert code == 2
    assert "rig.toml" not in err


def test_the_json_has_the_path_of_the_rig(command, bench):
    def rig(*words):
        code, out, err = command("estimate", "log.csv", "--json", *words, cwd=bench)
        assert code == 0, err
        return json.loads(out)["rig"]

    assert rig() == {"name": "", "path": "rig.toml", "guessed": False}
    assert rig("--set", "joint.knee.motor.inertia=0.2", "--set", "name=x")["path"] == "rig.toml"
    (bench / "rig.toml").unlink()
    assert (rig()["path"], rig()["guessed"]) == (None, True)


def test_steps_within_steps_share_in_the_outer_one():
    told = []
    with watched(told.append):
        for _ in counted("outer", range(2)):
            for _ in counted("inner", range(4), at_most=True):
                pass
    assert {event.step for event in told} == {"outer"}
    shares = [event.share for event in told]
    assert shares == sorted(shares)
    assert sorted(set(shares)) == pytest.approx([k / 8 for k in range(9)])
    assert told[-1] == Advanced("outer", 1.0, False)
    before = list(told)
    list(counted("outer", range(2)))
    assert told == before  # nobody watches any more


def test_a_loop_that_is_left_early_leaves_no_trace():
    told = []
    with watched(told.append):
        for _ in counted("one", range(4)):
            break
        list(counted("other", range(1)))
    assert told[-1] == Advanced("other", 1.0, False)


def test_every_step_has_its_words():
    source = "".join(path.read_text(encoding="utf-8") for path in Path(vsalog.__file__).parent.rglob("*.py"))
    steps = set(re.findall(r'(?:counted|Advanced)\(\s*"(\w+)"', source))
    assert steps == set(STEPS)
