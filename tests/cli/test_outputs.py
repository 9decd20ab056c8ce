"""Files that are there: earlier results of the same logs are replaced, everything else is kept unless --force is given."""

import hashlib

import pytest
from knee import RIG, write_log

from vsalog.core.errors import WriteError
from vsalog.report.outputs import require_new, sealed

pytestmark = pytest.mark.share(2)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_results_of_the_same_log_are_replaced_and_said(command, bench):
    for options in ((), ("-e", "qr-rls"), ("--set", "joint.knee.motor.inertia=0.2")):
        code, _, err = command("estimate", "log.csv", *options, cwd=bench)
        assert code == 0, err
        assert ("replacing log.stiffness.parquet, log.model.toml" in err) == bool(options)


def test_results_of_another_log_of_that_name_are_kept(command, bench):
    assert command("estimate", "log.csv", cwd=bench)[0] == 0
    (bench / "day2").mkdir()
    write_log(bench / "day2" / "log.csv", stiffness=10.0)
    (bench / "day2" / "rig.toml").write_text(RIG)
    before = contents(bench)
    code, out, err = command("estimate", "day2/log.csv", cwd=bench)
    assert (code, out, contents(bench)) == (2, "", before)
    assert "log.stiffness.parquet" in err
    assert "--force" in err
    assert len(err.splitlines()) == 1
    assert command("estimate", "day2/log.csv", "--force", cwd=bench)[0] == 0
    assert contents(bench)["log.model.toml"] != before["log.model.toml"]


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (("estimate", "log.csv"), "log.model.toml"),
        (("estimate", "log.csv", "--mcap", "mine.mcap"), "mine.mcap"),
        (("estimate", "log.csv", "--report", "mine.html"), "mine.html"),
        (("estimate", "log.csv", "--figures", "."), "."),
        (("validate", "model.toml", "log.csv"), "report.json"),
        (("validate", "model.toml", "log.csv"), "report.html"),
        (("validate", "model.toml", "log.csv", "--report", "mine.html"), "mine.html"),
        (("diagnose", "log.csv"), "diagnosis.html"),
        (("diagnose", "log.csv", "--report", "mine.html"), "mine.html"),
        (("diagnose", "log.csv"), "extended.rig.toml"),
        (("diagnose", "log.csv", "--suggest"), "next.scenario.toml"),
        (("identify", "log.csv"), "identified.rig.toml"),
        (("identify", "log.csv", "--report", "mine.html"), "mine.html"),
        (("compare", "log.csv", "--report", "mine.html"), "mine.html"),
        (("simulate", "sea"), "sea-exp1.mcap"),
        (("simulate", "--replay", "log.csv"), "log-replay.mcap"),
        (("export", "sea", "--to", "mjcf", "-o", "sea.xml"), "sea.xml"),
        (("plan", "sea", "-o", "next.toml"), "next.toml"),
        (("plan", "sea", "--report", "mine.html"), "mine.html"),
        (("init", "log.csv", "-o", "rig.toml"), "rig.toml"),
        (("reproduce", "deluca2007", "--plots", "."), "."),
        (("reproduce", "deluca2007", "--report", "mine.html"), "mine.html"),
    ],
)
def test_what_somebody_else_wrote_is_kept(command, bench, words, file):
    if file != ".":
        (bench / file).write_text("notes of a whole year\n")
    before = contents(bench)
    code, out, err = command(*words, cwd=bench)
    assert (code, out) == (2, ""), err
    assert contents(bench) == before
    assert "--force" in err


@pytest.mark.parametrize(
    "words", [("validate", "model.toml", "log.csv"), ("diagnose", "log.csv"), ("reproduce", "deluca2007")]
)
def test_a_page_that_cannot_be_written_is_refused_before_the_work(command, bench, words):
    code, out, err = command(*words, "--report", "nowhere/page.html", cwd=bench)
    assert (code, out) == (2, "")
    assert "nowhere" in err


def test_a_page_goes_where_it_is_asked_for(command, bench):
    assert command("estimate", "log.csv", cwd=bench)[0] == 0
    options = ("-o", "judged", "--report", "page.html", "--no-modalities")
    code, _, err = command("validate", "log.model.toml", "log.csv", *options, cwd=bench)
    assert code == 0, err
    assert (bench / "page.html").read_text().startswith("<!")
    assert [path.name for path in (bench / "judged").iterdir()] == ["report.json"]


def test_a_rig_that_was_edited_is_no_result(tmp_path):
    log, rig = tmp_path / "log.csv", tmp_path / "extended.rig.toml"
    write_log(log, rows=10)
    text = 'name = "knee"\n'
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    rig.write_text(sealed(text, [digest]))
    assert require_new(rig, False, [log]) == (rig,)
    rig.write_text(sealed(text, [digest]).replace("knee", "elbow"))
    with pytest.raises(WriteError):
        require_new(rig, False, [log])
    assert require_new(rig, True, [log]) == (rig,)
    # Nor is a result of one log one of two.
    rig.write_text(sealed(text, [digest]))
    write_log(tmp_path / "other.csv", rows=11)
    with pytest.raises(WriteError):
        require_new(rig, False, [log, tmp_path / "other.csv"])


def test_an_identified_rig_can_be_identified_again_until_it_is_edited(command, tmp_path):
    assert command("simulate", "sea", "--duration", "3", "-o", "log.mcap", cwd=tmp_path)[0] == 0
    words = ("identify", "log.mcap")
    for _ in range(2):
        code, _, err = command(*words, cwd=tmp_path)
        assert code == 0, err
    assert "replacing identified.rig.toml" in err
    rig = tmp_path / "identified.rig.toml"
    rig.write_text(rig.read_text().replace("inertia = ", "inertia = 2", 1))
    assert command(*words, cwd=tmp_path)[0] == 2


def test_a_model_can_be_estimated_again_until_it_is_edited(command, bench):
    model = bench / "log.model.toml"
    for _ in range(2):
        assert command("estimate", "log.csv", "-e", "direct", cwd=bench)[0] == 0
    written = model.read_text()
    changed, below = written.replace("coefficients = [", "coefficients = [ # mine", 1), written + "# mine\n"
    for edited in (changed, below, "\n".join(written.splitlines()[:-1])):
        model.write_text(edited)
        before = contents(bench)
        code, out, err = command("estimate", "log.csv", "-e", "direct", cwd=bench)
        assert (code, out, contents(bench)) == (2, "", before)
        assert "--force" in err
    assert command("validate", "log.model.toml", "log.csv", "--no-modalities", cwd=bench)[0] == 0
