"""What a recording's numbers say about guesses, on either side of each bound."""

from types import SimpleNamespace

import pytest

from vsalog.rig import guess_checks
from vsalog.rig.guess_data import Line
from vsalog.rig.guess_types import RoleGuess
from vsalog.rig.template import _line


def checked(monkeypatch, **numbers):
    line = Line(**{"slope": 50.0, "intercept": 0.0, "correlation": 0.5, "residual": 0.5} | numbers)
    monkeypatch.setattr(guess_checks, "_over_deflection", lambda *_: ("the deflection", line))
    found = guess_checks.Checked({"torque_sensor": RoleGuess("tau", 0.9, ())})
    guess_checks._torque(found, {"torque_sensor": SimpleNamespace(name="tau")}, "")
    return found


@pytest.mark.parametrize(("residual", "computed"), [(0.0007, True), (0.0015, False)])
def test_no_two_sensors_agree_to_a_part_in_a_thousand(monkeypatch, residual, computed):
    assert bool(checked(monkeypatch, residual=residual).findings) == computed


@pytest.mark.parametrize(("correlation", "sign"), [(-0.85, -1), (-0.7, 1), (0.85, 1)])
def test_a_torque_falls_with_its_angle_from_a_correlation_of_eight_tenths(monkeypatch, correlation, sign):
    assert checked(monkeypatch, correlation=correlation).roles["torque_sensor"].sign == sign


def test_comments_stand_below_one_another_where_lines_leave_room():
    short, long = (_line("x" * length, "why") for length in (5, 45))
    assert short.index("#") == long.index("#") < 60
