"""Documents on a terminal: lines are as wide as it is, and no number is cut, whatever the width."""

import io
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from vsalog.core.finding import Finding
from vsalog.diagnosis import document as diagnosis
from vsalog.report.document import TONES, Cell, Document, Facts, Notes, Section, Table, Verdict, Words
from vsalog.report.reproduce import rows_document
from vsalog.report.terminal import console_for, print_document, print_findings
from vsalog.reproduce.catalogue import ITEMS
from vsalog.reproduce.rows import Row, Spread
from vsalog.validation import document as validation

COMMANDS = (
    "estimate",
    "estimate two",
    "validate",
    "validate two",
    "compare",
    "diagnose",
    "inspect",
    "simulate",
    "reproduce",
)


def shown(document, columns):
    """Return what a terminal of so many columns shows."""
    console = Console(file=io.StringIO(), width=columns, highlight=False, emoji=False, markup=False)
    print_document(document, console)
    return console.file.getvalue()


def tables(items):
    for item in items:
        if item.where == "page":
            continue
        if isinstance(item, Section):
            yield from tables(item.items)
        elif isinstance(item, Table):
            yield item


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_cell_of_every_table_is_shown_in_full(said, command, columns):
    in_full(said[command].document, columns)


@pytest.mark.parametrize("columns", [80, 120])
def test_the_papers_numbers_are_shown_in_full(columns):
    item = next(iter(ITEMS.values()))
    rows = [
        Row(item=item.name, paper="Flacco 2012", place="Table 1", quantity="MSREP", unit="%", of=f"RESIDUAL, transmission {i}",
            settings="the paper's own", printed=0.026, ours=Spread(0.0123, 0.0101, 0.0202, 5), window="all but the first second",
            whole_run=Spread(1234.5, 1200.0, 1300.0, 5), conditions="noise of 1 mN·m", reason="it is late")
        for i in (1, 2, 3)
    ]  # fmt: skip
    in_full(rows_document([item], {item.name: rows}, (1, 2), ()), columns)


def in_full(document, columns):
    """See that every cell is shown: numbers in one piece, words broken where they are longer than a line."""
    text = shown(document, columns)
    lines, words = text.splitlines(), " ".join(text.split())
    assert max(map(len, lines)) <= columns
    cells = [cell for table in tables(document.items) for row in table.cells() for cell in row]
    assert cells
    for cell in cells:
        long = len(cell.text) > 40
        assert cell.text in words if long else any(cell.text in line for line in lines), cell.text
        assert cell.brief or any(cell.detail in line for line in lines), cell.detail
    assert not any(line.rstrip().endswith("…") for line in lines)


def test_every_verdict_has_a_tone():
    assert set(TONES) == {*get_args(validation.Verdict), *get_args(diagnosis.Verdict)}


numbers = st.floats(-1e6, 1e6).map(lambda v: f"{v:.6g}")
cells = st.builds(Cell, numbers, st.one_of(st.just(""), numbers))


@given(st.integers(1, 12), st.integers(1, 6), st.sampled_from([40, 80, 120]), st.data())
def test_a_table_of_any_shape_keeps_its_numbers(width, height, columns, data):
    heads = tuple(data.draw(st.text("abcdef [N·m]", max_size=20)) for _ in range(width + 1))
    rows = tuple((f"row {i}", *(data.draw(cells) for _ in range(width))) for i in range(height))
    lines = shown(Document("", "", (Table("", heads, rows),)), columns).splitlines()
    assert max(map(len, lines)) <= columns
    for row in rows:
        assert any(row[0] in line for line in lines)
        for cell in row[1:]:
            assert any(cell.text in line for line in lines)
            assert any(cell.detail in line for line in lines)


def table(width, height, keys=1):
    heads = ("name", *(f"column {i}" for i in range(1, width)))
    return Table("", heads, tuple((f"r{k}", *(f"{k}.{i}" for i in range(1, width))) for k in range(height)), keys)


def heads_of(text):
    return [line.split() for line in text.splitlines() if "column" in line]


def test_a_table_is_whole_where_it_fits_else_turned_else_in_blocks_else_a_list():
    whole = shown(Document("", "", (table(4, 9),)), 80)
    assert len(heads_of(whole)) == 1
    turned = shown(Document("", "", (table(12, 2),)), 80).splitlines()
    assert [line.split() for line in turned if "column 3" in line] == [["column", "3", "0.3", "1.3"]]
    blocks = shown(Document("", "", (table(12, 20),)), 80).splitlines()
    assert sum(line.startswith("name") for line in blocks) == 2  # every block names its rows
    assert sum(line.startswith("r7 ") for line in blocks) == 2
    long = Table("", ("name", "value"), (("n" * 90, "1.25"),) * 3)
    listed = shown(Document("", "", (long,)), 80)
    assert "value  1.25" in listed
    assert max(map(len, listed.splitlines())) <= 80


def test_what_is_for_pages_is_left_out_and_sections_are_reported_by_their_verdicts():
    verdict = Verdict("elbow", "holds", "good", ("It is good.",))
    items = (Section("Joint elbow", (Words("Here."), Words("There.", "page")), verdict), Facts((("key", "value"),)))
    text = shown(Document("title", "about", items), 80)
    assert text.splitlines() == ["elbow: holds", "  It is good.", "  Here.", "key: value"]


def test_names_stay_text():
    bad = "[bold red]x[/]\x1b[31m\x07"
    items = (
        Words(bad),
        Facts(((bad, bad),)),
        Table(bad, (bad, bad), ((bad, bad),)),
        Section(bad, (), Verdict(bad, bad, "bad", (bad,))),
    )
    text = shown(Document(bad, bad, items), 80)
    assert text.count("[bold red]x[/]") == 11
    assert "\x1b" not in text
    assert "\x07" not in text


@pytest.mark.parametrize(
    ("severity", "word"), [("info", "note: "), ("warning", "warning: "), ("invalidates", "invalid: ")]
)
def test_a_line_about_a_finding_begins_with_its_severity(severity, word, capsys):
    print_document(Document("", "", (Notes((Finding(code="setpoint.constant", joint="elbow", severity=severity),)),)))
    out = capsys.readouterr()
    assert out.out == ""
    assert out.err.startswith(f"{word}joint 'elbow': ")


def test_what_was_found_alike_of_several_joints_is_one_line_per_severity(capsys):
    found = [Finding(code="setpoint.constant", joint=joint, severity="info") for joint in ("a", "b")]
    print_findings([*found, Finding(code="setpoint.constant", joint="c")])
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["note", "joints 'a', 'b'"], ["warning", "joint 'c'"]]


def test_a_findings_names_stay_text(capsys):
    print_findings([Finding(code="setpoint.constant", joint="[bold]x[/]\x1b[31m")])
    err = capsys.readouterr().err
    assert "[bold]x[/]" in err
    assert "\x1b" not in err


def test_no_line_of_a_pipe_is_broken(capsys):
    console_for().print("word " * 1000)
    assert len(capsys.readouterr().out.splitlines()) == 1
