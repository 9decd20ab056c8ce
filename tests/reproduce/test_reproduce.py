"""`vsalog reproduce`: printed values are the papers', the targets hold with other seeds, and verdicts say what they mean."""

import json
import re
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from vsalog.cli import cli
from vsalog.core.errors import VsalogError
from vsalog.estimators.registry import built_in
from vsalog.figures.paper import FigureError, prepare_folder, write_reproduced
from vsalog.reproduce import flacco2012, flacco2014, serio2011, shin
from vsalog.reproduce.catalogue import ITEMS, select
from vsalog.reproduce.measure import Setting, Study, estimate, mean_relative, mse, msrep, with_noise
from vsalog.reproduce.rows import Result, Row, Spread, Verdict
from vsalog.simulation.experiments import vsa2_experiment

pytestmark = pytest.mark.share(3)

# Neither the report's seeds nor those the settings were chosen with.
SEEDS_OF_TESTS = (101, 102, 103)


@pytest.fixture(scope="module")
def results():
    """Each item once, when a test first asks for it."""
    found = {}

    def result(name):
        if name not in found:
            found[name] = ITEMS[name].run(Study(SEEDS_OF_TESTS))
        return found[name]

    return result


def chosen(rows, **fields):
    return [r for r in rows if all(getattr(r, k) == v for k, v in fields.items())]


def test_seeds_are_several_and_none_is_a_test_s():
    assert len(set(Study().seeds)) >= 5
    assert not set(Study().seeds) & set(SEEDS_OF_TESTS)


def test_printed_values_of_flacco_2012():
    """Table 1 as printed: MSE 20.1 11.1 50.1 | 21.8 12.4 55.2 | 37.4 25.2 92.2, MSREP .05 .02 .026 | … ; Table 2 by rows."""
    parts = [(m, p) for m in ("MODEL", "SENSOR", "RESIDUAL") for p in ("1", "2", "total")]
    assert [flacco2012.TABLE_1[m][p][0] for m, p in parts] == [20.1, 11.1, 50.1, 21.8, 12.4, 55.2, 37.4, 25.2, 92.2]
    assert [flacco2012.TABLE_1[m][p][1] for m, p in parts] == [0.05, 0.02, 0.026, 0.049, 0.02, 0.027, 0.07, 0.05, 0.046]
    table2 = [flacco2012.TABLE_2[m]["total"] for m in ("MODEL", "SENSOR", "RESIDUAL")]
    assert table2 == [(7.84, 0.005), (14.92, 0.01), (18.97, 0.05)]


def test_printed_values_of_the_other_papers():
    """Flacco 2014: Table I, §V and §VII; Serio 2011: Fig. 4; Shin 2021: §IV-A."""
    assert flacco2014.TABLE_1 == {"qr-rls": (0.58, 0.002), "batch-ls": (102.64, 0.224), "residual-rls": (31.6, 0.07)}
    assert [v[0] for v in flacco2014.TABLE_1_MOTOR.values()] == [7.5135, 0.9148]
    assert flacco2014.NOISY == {"qr-rls": (2.0919, 0.5162), "residual-rls": (92.2, 0.046)}
    assert [v[0] for v in flacco2014.NOISY_MOTOR.values()] == [7.2360, 7.3022, 0.9731, 0.9980]
    assert list(flacco2014.CUBIC.values()) == [(1.2583, 1.6936), (4.2, 0.7)]
    assert [v[0] for v in flacco2014.CUBIC_MOTOR.values()] == [0.0023, 7.1942e-4, 1.2843, 1.2706]
    assert serio2011.PRINTED == {"stiffness": 5.1, "damping": 6.7, "inertia": 9.8}
    assert serio2011.EXPERIMENT == {"stiffness": 38.2, "damping": 9.4, "inertia": 12.2}
    assert serio2011.Tuning(2000.0, 0.001, 0.001, 10000.0) == serio2011.SIMULATED
    assert serio2011.Tuning(8.0, 0.00001, 0.000001, 100.0) == serio2011.MEASURED
    assert shin.ONLINE == {"angle": (1.16, 3.06, 7.91), "torque": (0.0899, 0.299, 6.01)}
    assert shin.MODEL_ALONE == {"angle": (1.053, 3.50, 8.87), "torque": (0.162, 0.494, 10.23)}
    assert shin.UKF == {"angle": (0.838, 2.42, 6.13), "torque": (0.108, 0.238, 4.94)}


@pytest.mark.every(2)
@pytest.mark.parametrize("name", ["flacco2012-table1", "flacco2012-table2"])
def test_every_modality_reaches_the_printed_msrep_by_default(results, name):
    rows = chosen(results(name).rows, settings="vsalog's default", quantity="MSREP of the stiffness")
    assert len(rows) == (9 if name.endswith("1") else 3)
    for row in rows:
        assert row.ours.seeds == len(SEEDS_OF_TESTS)
        assert row.ours.high <= row.printed, row.of


@pytest.mark.parametrize("name", ["flacco2012-table1", "flacco2012-table2"])
def test_the_paper_s_own_settings_reach_it_within_a_tenth(results, name):
    """The one that is worse (RESIDUAL, second transmission) is so by a few percent, and by the lag, as is reported."""
    rows = chosen(results(name).rows, settings="the paper's", quantity="MSREP of the stiffness")
    for row in rows:
        assert row.ours.median <= 1.1 * row.printed, row.of
    for row in chosen(results(name).rows, settings="the paper's, but with the lag matched"):
        if row.quantity.startswith("MSREP"):
            assert row.ours.high <= row.printed, row.of


def test_table_1_of_flacco_2014_is_reached_by_every_method(results):
    rows = results("flacco2014-table1").rows
    compared = [r for r in rows if r.quantity.startswith("MSREP") and r.printed is not None]
    assert {r.estimator for r in compared} == {"qr-rls", "batch-ls", "residual-rls"}
    for row in compared:
        assert row.ours.median <= row.printed, (row.of, row.settings)
    inertia, damping = (r for r in rows if r.quantity.startswith("motor"))
    assert inertia.ours.median == pytest.approx(7.5, rel=1e-3)
    assert damping.ours.median == pytest.approx(0.9, rel=1e-3)


@pytest.mark.every(2)
@pytest.mark.parametrize("name", ["flacco2014-noisy", "flacco2014-cubic"])
def test_the_noisy_cases_reach_the_printed_numbers_after_the_transient(results, name):
    rows = [r for r in chosen(results(name).rows, window="after 5 s") if r.estimator == "qr-rls"]
    assert len(rows) >= 4
    for row in rows:
        ours = row.ours.high if row.quantity.startswith("MSREP") else row.ours.median
        assert ours <= row.printed, (row.of, row.quantity)


def test_the_transient_is_where_the_other_method_has_its_printed_number_and_qr_rls_has_its_own_there(results):
    rows = [r for r in results("flacco2014-noisy").rows if r.window == f"after {flacco2014.TRANSIENT:g} s"]
    other = [r for r in rows if r.estimator == "residual-rls" and r.quantity.startswith("MSE ")]
    assert [r.printed for r in other] == [92.2]
    assert other[0].ours.median == pytest.approx(92.2, rel=0.1)
    ours = [r for r in rows if r.settings == "vsalog's default" and r.estimator == "qr-rls"]
    assert len(ours) == 2
    for row in ours:
        assert row.ours.median <= row.printed, (row.of, row.quantity)


@pytest.mark.parametrize("name", ["flacco2012-table1", "flacco2012-table2", "flacco2014-table1", "flacco2014-noisy"])
def test_a_row_says_all_that_is_needed_to_judge_it(results, name):
    result = results(name)
    for row in result.rows:
        assert row.item == name
        assert row.paper
        assert row.place
        assert row.conditions
        assert row.chosen
        assert row.window
        assert row.estimator in built_in()
        if row.verdict in ("worse", "does not hold"):
            assert len(row.reason) > 40, (row.of, row.quantity)
        else:
            assert row.reason == ""
        if row.quantity.startswith(("MSE", "MSREP")) and row.printed is not None:
            assert row.whole_run.seeds == row.ours.seeds
    assert result.figures
    assert all(np.isfinite(c.x).all() for f in result.figures for p in f.panels for c in p.curves)


def test_settings_told_in_a_row_give_its_number(results):
    """Who runs the estimator with a row's tuning on the row's experiment finds the row's number."""
    row = chosen(results("flacco2012-table1").rows, settings="the paper's", of="RESIDUAL, total", unit="%")[0]
    found = []
    for seed in SEEDS_OF_TESTS:
        experiment = vsa2_experiment(seed=seed)
        stiffness = estimate(experiment, Setting("", row.estimator, row.tune))["total"]["stiffness"]
        true = experiment.truth["stiffness_total"]
        found.append(100.0 * np.mean(((true - stiffness)[2000:] / true[2000:]) ** 2))
    assert Spread.of(found) == row.ours


def test_noise_on_the_same_motion_is_the_experiment_s_own():
    motion = vsa2_experiment(ideal=True, duration=1.0)
    (noisy,) = with_noise(motion, [7])
    same = vsa2_experiment(seed=7, duration=1.0)
    for role, values in same.measured.items():
        np.testing.assert_array_equal(noisy.measured[role], values)


def test_errors_by_hand():
    true, estimated = np.array([1.0, 2.0, 4.0, 5.0]), np.array([0.0, 2.2, 3.0, np.nan])
    assert mse(estimated, true) == pytest.approx((1.0 + 0.04 + 1.0) / 3)
    assert msrep(estimated, true) == pytest.approx(100.0 * (1.0 + 0.01 + 0.0625) / 3)
    assert msrep(estimated, true, start=1) == pytest.approx(100.0 * (0.01 + 0.0625) / 2)
    assert mean_relative(estimated, true) == pytest.approx(100.0 * (1.0 + 0.1 + 0.25) / 3)


def test_an_error_is_better_or_worse_where_all_seeds_say_so():
    row = Row(item="", paper="", place="", quantity="", printed=1.0, ours=Spread(0.5, 0.4, 0.9, 3))
    assert row.verdict == "better"
    assert row.with_values(ours=Spread(0.5, 0.4, 2.0, 3)).verdict == "within our spread"
    assert row.with_values(ours=Spread(1.2, 0.4, 2.0, 3)).verdict == "within our spread"
    assert row.with_values(ours=Spread(1.2, 1.1, 2.0, 3)).verdict == "worse"
    assert row.with_values(ours=Spread(1.004, 0.1, 9.0, 3)).verdict == "as printed"
    assert row.with_values(printed=1.004, ours=Spread(1.0, 0.1, 9.0, 3)).verdict == "within our spread"
    assert row.with_values(ours=Spread(float("nan"), float("nan"), float("nan"), 3)).verdict == "worse"
    assert row.with_values(compare="holds", holds=False).verdict == "does not hold"
    assert row.because("why").reason == ""
    assert row.with_values(ours=Spread(1.2, 1.2, 1.2, 1)).because("why").reason == "why"


def test_a_parameter_is_compared_by_its_distance_to_the_true_value():
    row = Row(item="", paper="", place="", quantity="", printed=1.0, compare="closer", true_value=1.1)
    assert row.with_values(ours=Spread(1.12, 1.11, 1.13, 3)).verdict == "better"
    assert row.with_values(ours=Spread(1.5, 1.4, 1.6, 3)).verdict == "worse"
    assert row.with_values(ours=Spread(1.3, 0.9, 1.4, 3)).verdict == "within our spread"
    assert row.with_values(ours=Spread(0.998, 0.9, 1.4, 3)).verdict == "as printed"


@pytest.mark.parametrize(
    ("printed", "ours", "verdict"),
    [(0.05, 0.0549, "as printed"), (0.05, 0.0551, "worse"), (0.05, 0.0449, "better"), (7.5135, 7.51354, "as printed"),
     (7.5135, 7.5134, "better"), (20.1, 20.04, "better"), (20.1, 20.16, "worse"), (1e-17, 1.4e-17, "as printed")],
)  # fmt: skip
def test_a_number_is_as_printed_where_it_rounds_to_the_printed_digits(printed, ours, verdict):
    row = Row(item="x", paper="p", place="1", quantity="q", printed=printed, ours=Spread(ours, ours, ours, 1))
    assert row.verdict == verdict


def test_what_is_left_out_and_other_conditions_are_part_of_the_verdict():
    row = Row(item="", paper="", place="", quantity="", printed=1.0, ours=Spread(0.5, 0.4, 0.9, 3))
    over_the_start = row.with_values(whole_run=Spread(3.0, 2.0, 4.0, 3))
    assert over_the_start.verdict == "better after the transient"
    assert over_the_start.with_values(window_printed=True).verdict == "better"
    assert row.with_values(whole_run=Spread(0.8, 0.7, 0.9, 3)).verdict == "better"
    assert over_the_start.with_values(ours=Spread(1.01, 0.9, 1.1, 3)).verdict == "as printed after the transient"
    elsewhere = row.with_values(differs="another machine")
    assert elsewhere.verdict == "below, conditions differ"
    assert elsewhere.with_values(ours=Spread(1.5, 0.4, 2.0, 3)).verdict == "above, conditions differ"


def test_what_items_share_is_made_once():
    study, made = Study((1,)), []
    assert [study.once("a", lambda: made.append(1) or "one") for _ in range(3)] == ["one"] * 3
    assert study.once("b", lambda: "two") == "two"
    assert made == [1]


def test_papers_and_items_select():
    assert [i.name for i in select([])] == list(ITEMS)
    assert [i.name for i in select(["flacco2014"])] == [n for n in ITEMS if n.startswith("flacco2014")]
    assert [i.name for i in select(["shin", "flacco2012-fig22", "shin-offline"])] == [
        "flacco2012-fig22",
        *(n for n in ITEMS if n.startswith("shin")),
    ]
    with pytest.raises(VsalogError, match="did you mean 'flacco2012-table1'"):
        select(["flacco2012-tabel1"])


def test_list_and_unknown_names():
    listed = CliRunner().invoke(cli, ["reproduce", "--list"])
    assert listed.exit_code == 0
    assert [line.split()[0] for line in listed.stdout.splitlines()] == list(ITEMS)


def test_the_command_line_refuses_an_unknown_name(monkeypatch, capsys):
    from vsalog.cli import _run

    monkeypatch.setattr(sys, "argv", ["vsalog", "reproduce", "flaco2014"])
    assert _run() == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "did you mean 'flacco2014'" in said.err


@pytest.fixture
def two_quick_items(monkeypatch, results):
    """The command on results that are there already."""
    plain = Row(item="shin-offline", paper="", place="", quantity="", differs="another machine")
    ready = {"flacco2012-table1": results("flacco2012-table1"), "shin-offline": Result([plain], [])}
    for name, result in ready.items():
        monkeypatch.setitem(ITEMS, name, SimpleNamespace(**msgspec_fields(ITEMS[name]), run=lambda _, r=result: r))
    return list(ready)


def msgspec_fields(item):
    return {"name": item.name, "paper": item.paper, "title": item.title, "work": item.work}


def test_json_is_one_document(two_quick_items):
    result = CliRunner().invoke(cli, ["reproduce", "--json", *two_quick_items])
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert document["seeds"] == list(Study().seeds)
    assert {r["item"] for r in document["rows"]} == set(two_quick_items)
    fields = set(Row.__struct_fields__) | {"verdict"}
    assert all(set(r) == fields for r in document["rows"])
    first = document["rows"][0]
    assert first["ours"]["low"] <= first["ours"]["median"] <= first["ours"]["high"]
    msgspec.convert({k: v for k, v in first.items() if k != "verdict"}, Row)


def test_numbers_that_are_not_finite_are_null_in_json(monkeypatch, results):
    row = results("flacco2012-table1").rows[0].with_values(ours=Spread(float("inf"), 0.0, float("nan"), 3))
    item = SimpleNamespace(
        **msgspec_fields(ITEMS["shin-offline"]), run=lambda _: SimpleNamespace(rows=[row], figures=[])
    )
    monkeypatch.setitem(ITEMS, "shin-offline", item)
    result = CliRunner().invoke(cli, ["reproduce", "--json", "shin-offline"])
    ours = json.loads(result.stdout)["rows"][0]["ours"]
    assert (ours["median"], ours["high"]) == (None, None)


def test_the_table_marks_worse_by_a_word(two_quick_items):
    result = CliRunner().invoke(cli, ["reproduce", *two_quick_items])
    assert result.exit_code == 0
    line = next(x for x in result.stdout.splitlines() if re.search(r"RESIDUAL, total +MSE", x))
    assert line.rstrip().endswith("worse")
    assert "chosen, not printed: C = 1.8" in result.stdout


def test_plots_without_matplotlib_say_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(FigureError, match="pip install matplotlib"):
        prepare_folder(tmp_path / "figures", "--plots")
    result = CliRunner().invoke(cli, ["reproduce", "--plots", str(tmp_path / "figures")])
    assert isinstance(result.exception, FigureError)  # before anything is computed or written
    assert not (tmp_path / "figures").exists()


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_computed(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "file").write_text("x")
    result = CliRunner().invoke(cli, ["reproduce", "--plots", str(tmp_path / "file" / "figures")])
    assert isinstance(result.exception, VsalogError)
    assert "figures" in str(result.exception)


def test_figures_are_written(results, tmp_path):
    pytest.importorskip("matplotlib")
    figures = results("flacco2012-table1").figures
    assert [f.name for f in figures] == [f"flacco2012-fig{n}" for n in (4, 5, 6, 7, 8)]
    figures = figures[2::2]
    for folder in ("new/folder", "again"):
        prepare_folder(tmp_path / folder, "--plots")
    written = write_reproduced(tmp_path / "new" / "folder", figures)
    assert [p.name for p in written] == ["flacco2012-fig6.svg", "flacco2012-fig8.svg"]
    text = written[0].read_text(encoding="utf-8")
    assert text.startswith("<?xml")
    assert "<svg" in text
    again = write_reproduced(tmp_path / "again", figures)
    said = (tmp_path / "again" / "figures.txt").read_text(encoding="utf-8")
    assert all(f"{f.name}: {f.title}\n    {f.caption}" in said and "Chosen, not printed" in f.caption for f in figures)
    assert again[0].read_bytes() == written[0].read_bytes()
    assert not list(tmp_path.rglob("*.part"))


DOCS = Path(__file__).parents[2] / "docs"
MADE = runpy.run_path(str(DOCS / "make_reproduce.py"))


def stored_rows():
    return json.loads((DOCS / "reproduce.json").read_text(encoding="utf-8"))["rows"]


def test_the_page_has_the_tables_of_the_stored_numbers_of_every_item():
    texts, rows = [path.read_text(encoding="utf-8") for path in MADE["PAGES"].glob("*.md")], stored_rows()
    assert all(MADE["page"](text, rows) == text for text in texts), "python -m docs.make_reproduce"
    assert {row["item"] for row in rows} == set(ITEMS)
    assert all(any(f"<!-- table: {name} -->" in text for text in texts) for name in ITEMS)
    assert {row["verdict"] for row in rows} <= set(get_args(Verdict))
    assert set(MADE["SIGNS"]) == set(get_args(Verdict))


@pytest.mark.parametrize("name", ["flacco2014-table1", "shin-parameters"])
def test_the_stored_numbers_are_those_of_a_run(results, name):
    """Of the items that take a second and have no noise: whoever changes a number runs `vsalog reproduce --json` again."""
    stored = [row for row in stored_rows() if row["item"] == name]
    fresh = json.loads(json.dumps([msgspec.to_builtins(r) | {"verdict": r.verdict} for r in results(name).rows]))
    assert len(stored) == len(fresh)
    for row, other in zip(fresh, stored, strict=True):
        for field in set(other) - {"ours", "whole_run"}:
            assert row[field] == other[field], field
        for field in ("ours", "whole_run"):
            if isinstance(row[field], dict):
                # Another processor rounds otherwise.
                assert other[field]["median"] == pytest.approx(row[field]["median"], rel=0.02), (
                    row["of"],
                    row["quantity"],
                )
            else:
                assert row[field] == other[field]


def test_a_table_has_a_column_per_setting_and_says_once_what_all_rows_share():
    common = {"item": "x", "place": "Table 1", "quantity": "q", "unit": "%", "window": "after 2 s", "whole_run": None}
    ours = {"median": 0.01234, "low": 0.0, "high": 1.0, "seeds": 2}
    rows = [
        {**common, "of": of, "settings": s, "printed": 0.05, "ours": ours, "verdict": v}
        for of, s, v in (("a", "one", "better"), ("a", "two", "worse"), ("b", "one", "not compared"))
    ]
    assert list(MADE["table"](rows)) == [
        "Place: Table 1; quantity: q [%]; counted: after 2 s.",
        "",
        "| of | printed | one | two |",
        "| --- | --- | --- | --- |",
        "| a | 0.05 | 0.0123 + | 0.0123 **−** |",
        "| b | 0.05 | 0.0123 |  |",
    ]
