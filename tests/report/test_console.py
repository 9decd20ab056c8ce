"""Findings on a terminal: each after the word of its severity, on stderr."""

import pytest

from vsalog.core.finding import Finding
from vsalog.report.console import console_for_stdout, print_findings


@pytest.mark.parametrize(
    ("severity", "word"), [("info", "note: "), ("warning", "warning: "), ("invalidates", "invalid: ")]
)
def test_a_line_begins_with_its_severity(severity, word, capsys):
    print_findings([Finding(code="setpoint.constant", joint="elbow", severity=severity)])
    out = capsys.readouterr()
    assert out.out == ""
    assert out.err.startswith(f"{word}joint 'elbow': ")


def test_what_was_found_alike_of_several_joints_is_one_line_per_severity(capsys):
    found = [Finding(code="setpoint.constant", joint=joint, severity="info") for joint in ("a", "b")]
    print_findings([*found, Finding(code="setpoint.constant", joint="c")])
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["note", "joints 'a', 'b'"], ["warning", "joint 'c'"]]


def test_names_stay_text(capsys):
    print_findings([Finding(code="setpoint.constant", joint="[bold]x[/]\x1b[31m")])
    err = capsys.readouterr().err
    assert "[bold]x[/]" in err
    assert "\x1b" not in err


def test_no_line_of_a_pipe_is_broken(capsys):
    console_for_stdout().print("word " * 1000)
    assert len(capsys.readouterr().out.splitlines()) == 1
