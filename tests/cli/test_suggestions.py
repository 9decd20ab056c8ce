"""Commands that a message suggests can be typed as they are printed."""

import re
import shlex

import pytest
from knee import write_log


@pytest.fixture
def suggested(command):
    """Run a command, and return the words of the one that its message suggests."""

    def suggested(*words, cwd, code=2):
        got, _, err = command(*words, cwd=cwd)
        assert got == code, err
        found = [
            shlex.split(line) for line in re.findall(r"vsalog \w+ .*?(?=' (?:lists|writes|shows|is|searches)|$)", err)
        ]
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
