"""The page of a diagnosis: its figures show what they are given, its names stay text, a browser has nothing to complain of."""

import html
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import msgspec
import numpy as np
import pytest
from diagnosis_evidence import (
    EXTENDED,
    HOSTILE,
    LEVEL,
    NOISE,
    PERIOD,
    RIG,
    diagnosis,
    found_cause,
    friction_evidence,
    position_gain,
    remainder,
)
from test_browser import CHROMIUM, probed

from vsalog.core.document_schema import document_schema, schema_text
from vsalog.core.errors import WriteError
from vsalog.core.finding import Finding
from vsalog.diagnosis import document as document_module
from vsalog.diagnosis.document import Gains, Number
from vsalog.diagnosis.evidence import CauseEvidence, SignalEvidence
from vsalog.figures.dot_plots import equations_chart, gain_chart
from vsalog.figures.equation_residuals import cause_chart, means_over, remainder_chart
from vsalog.figures.simulated_signals import in_windows, signal_charts, worst_place
from vsalog.report.diagnose import diagnosis_document, diagnosis_files
from vsalog.report.html import page_of

DOCS = Path(__file__).parents[2] / "docs"


def diagnosis_page(told, evidence, extended):
    return page_of(diagnosis_document(told, {}, evidence, extended))


def seen(joint, shape, variable, cause="transmission.damping", noise=0.0):
    """The joint with a cause of this shape, shown over a variable."""
    view = CauseEvidence(cause, "transmission", "motor", variable, shape + noise, shape)
    return replace(joint, causes=(view,))


def curves_of(chart, panel=0):
    return {c.label: c for c in chart.axes[panel].curves}


def test_a_friction_curve_is_drawn_over_velocity_and_noise_is_left():
    joint = friction_evidence()
    chart = cause_chart(joint, joint.causes[0])
    upper, lower = (curves_of(chart, i) for i in (0, 1))
    line = upper["effect of this cause"]
    assert line.kind == "line"
    # Means near zero mix both signs; but there each is the level with the velocity's sign turned.
    away = np.abs(line.x) > 0.1
    assert np.allclose(line.y[away], -LEVEL * np.sign(line.x[away]))
    points = upper["residual without this cause"]
    assert points.kind == "points"
    assert np.all(np.abs(np.abs(points.y) - LEVEL) < 6.0 * NOISE)
    assert np.abs(lower["residual with it"].y).max() < 6.0 * NOISE
    assert np.nanmax(lower["± 2 standard deviations of noise"].y) == pytest.approx(2.0 * NOISE)
    assert chart.axes[0].x_label == "motor velocity [rad/s]"
    assert chart.axes[0].y_label == "residual [N·m]"


def test_a_shape_that_differs_by_direction_is_drawn_as_two_lines():
    """d·cos(t) over sin(t): +√(1 − x²) rising, −√(1 − x²) falling."""
    joint = friction_evidence(60_000)
    joint = seen(joint, np.cos(joint.rows), "deflection")
    found = curves_of(cause_chart(joint, joint.causes[0]))
    up, down = found["effect of this cause, rising"], found["falling"]
    inner = np.abs(up.x) < 0.98
    assert np.allclose(up.y[inner], np.sqrt(1.0 - up.x[inner] ** 2), atol=0.02)
    assert np.allclose(down.y, -up.y, atol=0.05)
    assert down.dashed != up.dashed  # colours alone do not separate them


def test_loops_of_hysteresis_follow_the_rows_over_the_deflection():
    joint = friction_evidence(60_000)
    shape = np.tanh(20.0 * np.sin(0.9 * joint.rows)) * np.cos(3.1 * joint.rows)
    joint = seen(joint, shape, "time", cause="transmission.hysteresis")
    chart = cause_chart(joint, joint.causes[0])
    path = curves_of(chart)["effect of this cause, for a while"]
    assert chart.axes[0].x_label == "deflection [rad]"
    first = int(np.flatnonzero(joint.variables["deflection"][0] == path.x[0])[0])
    assert np.array_equal(path.y, shape[first : first + path.y.size])


def test_what_a_variable_alone_does_not_tell_is_drawn_as_points_and_said():
    joint = friction_evidence()
    joint = seen(joint, np.random.default_rng(2).standard_normal(joint.rows.size), "deflection")
    chart = cause_chart(joint, joint.causes[0])
    assert curves_of(chart)["effect of this cause"].kind == "points"
    assert "of it follows from this variable alone" in chart.words


def test_a_ramp_is_drawn_over_time_and_rows_that_do_not_count_are_left_out():
    joint = friction_evidence()
    shape = 0.03 * joint.rows
    shape[100:200] = np.nan
    joint = seen(joint, shape, "time")
    line = curves_of(cause_chart(joint, joint.causes[0]))["effect of this cause"]
    known = np.isfinite(line.y)
    assert np.allclose(line.y[known], 0.03 * line.x[known])
    assert not np.any((line.x[known] > joint.rows[99]) & (line.x[known] < joint.rows[200]))


def test_nothing_is_drawn_where_nothing_counts():
    joint = friction_evidence()
    joint = seen(joint, np.full(joint.rows.size, np.nan), "deflection")
    assert cause_chart(joint, joint.causes[0]) is None
    assert means_over(np.zeros(0), np.zeros(0)).left == 1.0
    assert means_over(np.ones(50), np.arange(50.0)).x.tolist() == [1.0]


def test_signals_before_and_after_and_their_errors():
    joint = friction_evidence()
    chart, expanded = signal_charts(joint, {"motor_position": 1e-4}, 800)
    assert [a.x_label for a in chart.axes] == ["time [s]"] * 2
    before, after = (c for c in chart.axes[1].curves if c.kind == "line")
    # Extremes survive the thinning.
    assert np.nanmax(before.y) == pytest.approx(0.01, rel=1e-6)
    assert np.nanmax(np.abs(after.y)) == pytest.approx(1e-4, rel=1e-4)
    # The mean of sin²(w t) over 20 s is 1/2 − sin(40 w)/(80 w).
    rms = [a * np.sqrt(0.5 - np.sin(40.0 * w) / (80.0 * w)) for a, w in ((0.01, 7.0), (1e-4, 70.0))]
    said = re.search(r"([\d.]+) rad with the original rig, ([\d.e−]+) rad with the extended rig", chart.words)
    assert [float(v.replace("−", "-")) for v in said.groups()] == pytest.approx(rms, rel=2e-3)

    assert expanded.axes[0].y_label == "error of motor position [rad]"
    assert np.nanmax(np.abs(curves_of(expanded)["simulated, original rig"].y)) <= 0.01


def test_the_expanded_view_is_where_the_simulation_is_worst():
    joint = friction_evidence(60_000)
    signal = joint.signals["motor_position"]
    spike = signal.before + 0.5 * np.exp(-(((joint.time - 37.0) / 0.1) ** 2))
    joint = replace(joint, signals={"motor_position": SignalEvidence("rad", signal.measured, spike, signal.after)})
    worst = worst_place(in_windows(joint), {})
    assert joint.time[worst] == pytest.approx(37.0, abs=0.1)
    line = curves_of(signal_charts(joint, {}, 800)[-1])["simulated, original rig"]
    assert line.x.size == 1600
    np.testing.assert_allclose(line.y, (spike - signal.measured)[worst - 800 : worst + 800])


def test_an_unextended_rig_is_drawn_once():
    joint = friction_evidence()
    signal = joint.signals["motor_position"]
    joint = replace(joint, signals={"motor_position": replace(signal, after=signal.before)})
    labels = [c.label for chart in signal_charts(joint, {}, 800) for a in chart.axes for c in a.curves]
    assert "simulated, original rig" in labels
    assert "simulated, extended rig" not in labels


def test_few_windows_of_a_long_log_stand_side_by_side():
    count, width = 600_000, 500
    windows = np.zeros(count, dtype=bool)
    starts = np.arange(10) * 60_000
    for start in starts:
        windows[start : start + width] = True
    joint = friction_evidence(count, windows=windows)
    stretch = in_windows(joint)
    assert stretch.time.size == 10 * width
    assert np.all(np.diff(stretch.place) > 0.0)
    assert stretch.place[-1] < 1.5 * 10 * width * PERIOD
    assert np.allclose(stretch.signals["motor_position"].measured, np.sin(stretch.time))
    for place, text in stretch.ticks:
        assert stretch.time[np.argmin(np.abs(stretch.place - place))] == pytest.approx(float(text), rel=1e-3)
    assert {float(text) for _, text in stretch.ticks} <= {start * PERIOD for start in starts}
    # No line joins two windows.
    line = curves_of(signal_charts(joint, {}, 800)[0])["measured"]
    assert np.isnan(line.y).sum() == 9


def test_the_gain_in_multiples_of_the_noise():
    silent = position_gain(signal="link_position", noise_floor=0.0)
    chart = gain_chart([position_gain(), silent], "the held-out log")
    (axes,) = chart.axes
    assert axes.rows == ("motor position",)
    found = curves_of(chart)
    assert found["original rig"].x == pytest.approx([40.0])
    assert found["extended rig"].x == pytest.approx([2.0])
    ends = found["95 % interval of the remaining error"].x
    assert np.nanmin(ends) == pytest.approx(0.025 * 40.0)
    assert np.nanmax(ends) == pytest.approx(0.1 * 40.0)
    assert found["original rig"].symbol != found["extended rig"].symbol
    assert gain_chart([silent], "x") is None
    (equation,) = diagnosis().equations
    assert curves_of(equations_chart([equation]))["original rig"].x == pytest.approx([50.0])


def test_the_remainders_curve():
    curves = curves_of(remainder_chart(remainder(), "N*m"))
    line = curves["mean of the residual"]
    assert line.y[(line.x > 0.01) & (line.x < 0.09)].size == 0  # steps: their ends alone
    assert line.y.max() == 0.05
    assert line.x[line.y == 0.05].tolist() == pytest.approx([0.0, 0.1])
    assert remainder_chart(remainder(curve=()), "N*m") is None


def test_the_page_says_all_of_it():
    cause = found_cause(indistinguishable_from=("motor.stribeck_friction",), tell_apart="Move slower.")
    beware = Finding(code="diagnosis.no_experiment", evidence={"reason": "Beware."})
    told = diagnosis(
        verdict="partly explained", causes=(cause,), unexplained=remainder(), next_experiment="Sweep it.",
        holdout="other.mcap", holdout_sha256="1" * 64, findings=(beware,),
    )  # fmt: skip
    text = diagnosis_page(told, [friction_evidence()], EXTENDED)
    for part in ("partly explained", "One.", "Three.", "0.2000 ± 0.0020 N·m", "motor.stribeck_friction", "Move slower.",
                 "Raise the torque slowly.", "Armstrong (1994)", "Sweep it.", "Beware.", "other.mcap", "0" * 64, "1" * 64,
                 "95 % (90 … 98)", "12 % of the error beyond noise is unexplained", "<ins>+coulomb = 0.2</ins>"):  # fmt: skip
        assert part in text, part
    names = [json.loads(d)["name"] for d in re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', text)]
    assert names == ["simulation", "simulation_expanded", "cause", "gain", "equations", "unexplained"]
    assert text.count('role="img"') == text.count("<figcaption>") == len(names)
    assert all(len(words) > 40 for words in re.findall(r'role="img"[^>]*aria-label="([^"]*)"', text))


def test_a_consistent_log_and_one_that_was_not_simulated():
    consistent = diagnosis(verdict="consistent", causes=(), gain=Gains(holdout=False, where="", signals=()))
    text = diagnosis_page(consistent, [replace(friction_evidence(), causes=())], None)
    assert "No cause of the catalogue was found" in text
    assert "The residuals of this log's equations are noise." in html.unescape(text)
    assert "The extended rig" not in text
    bare = diagnosis(simulation_error=(), equations=(), causes=(), gain=Gains(holdout=False, where="", signals=()))
    assert "Nothing could be simulated" in diagnosis_page(bare, [], None)


def hostile():
    cause = found_cause(joint=HOSTILE, why=HOSTILE, title=HOSTILE, indistinguishable_from=(HOSTILE,))
    cause = msgspec.structs.replace(cause, parameters={HOSTILE: Number(value=1.0, std=None, unit=HOSTILE)})
    gain = Gains(holdout=True, where=HOSTILE, signals=(position_gain(joint=HOSTILE, signal=HOSTILE, unit=HOSTILE),))
    told = diagnosis(
        log=HOSTILE, causes=(cause, found_cause(joint="other")), gain=gain, warnings=(HOSTILE,), sentences=(HOSTILE,) * 3,
        settings={HOSTILE: HOSTILE}, rig=f'name = "{HOSTILE}"\n', holdout=HOSTILE, next_experiment=HOSTILE,
        unexplained=remainder(depends_on=(HOSTILE,), unit=HOSTILE),
    )  # fmt: skip
    joint = friction_evidence(joint=HOSTILE)
    signals = {HOSTILE: replace(joint.signals["motor_position"], unit=HOSTILE)}
    return told, [replace(joint, signals=signals, signals_log=HOSTILE), friction_evidence(joint="other")]


def test_hostile_names_stay_text():
    told, evidence = hostile()
    text = diagnosis_page(told, evidence, f'name = "{HOSTILE}2"\n')
    assert "<script>alert" not in text
    assert "<img src=x" not in text
    assert "&lt;script&gt;alert(1)" in text


def test_an_hour_at_1_khz_makes_a_small_page(tmp_path):
    windows = np.zeros(3_600_000, dtype=bool)
    windows[: 60 * 60_000].reshape(60, 60_000)[:, :500] = True
    joint = friction_evidence(windows.size, windows=windows)
    signal, cause = joint.signals["motor_position"], joint.causes[0]
    roles = ("motor_position", "motor_position_2", "link_position", "torque_sensor", "setpoint")
    joint = replace(joint, signals=dict.fromkeys(roles, signal), causes=(cause, replace(cause, variable="time")) * 3)
    # The causes of the document take the views by name: as many as a joint has parts.
    views = tuple(replace(c, part=f"motor_{i}") for i, c in enumerate(joint.causes))
    told = diagnosis(causes=tuple(found_cause(part=f"motor_{i}") for i in range(len(views))))
    page = Path(diagnosis_files(told, [replace(joint, causes=views)], EXTENDED, tmp_path)["report"])
    assert page.stat().st_size < 6_000_000
    assert page.read_text(encoding="utf-8").count('data-chart="') == 5 + 1 + 6 + 2


def test_all_files_are_written_and_the_document_keeps_its_schema(tmp_path):
    told = diagnosis(unexplained=remainder())
    files = diagnosis_files(told, [friction_evidence()], EXTENDED, tmp_path / "new")
    assert {p.name for p in (tmp_path / "new").iterdir()} == {"diagnosis.json", "diagnosis.html", "extended.rig.toml"}
    document = json.loads(Path(files["data"]).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(document_schema(document_module)).validate(document)
    assert msgspec.convert(document, type(told)) == told
    rig = Path(files["extended rig"]).read_text(encoding="utf-8")
    assert tomllib.loads(rig) == tomllib.loads(EXTENDED)


@pytest.mark.parametrize("log", ["a\nb = 1", "a\rb = 1", "a\x00b", HOSTILE])
def test_a_logs_name_does_not_get_out_of_the_rigs_comment(tmp_path, log):
    files = diagnosis_files(diagnosis(log=log), [], EXTENDED, tmp_path)
    rig = Path(files["extended rig"]).read_text(encoding="utf-8")
    assert tomllib.loads(rig) == tomllib.loads(EXTENDED)


def test_an_extended_rig_from_before_is_never_deleted(tmp_path):
    rig = tmp_path / "extended.rig.toml"
    assert set(diagnosis_files(diagnosis(), [], None, tmp_path)) == {"report", "data"}
    rig.write_text(RIG)
    files = diagnosis_files(diagnosis(), [], None, tmp_path)
    assert files["note"].startswith(f"{rig} is from an earlier run")
    assert "extended rig" not in files
    assert rig.read_text() == RIG


def test_nothing_is_written_where_one_file_cannot_be(tmp_path):
    (tmp_path / "extended.rig.toml").mkdir()
    with pytest.raises(WriteError, match=r"extended\.rig\.toml: is a folder"):
        diagnosis_files(diagnosis(), [], EXTENDED, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["extended.rig.toml"]
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(WriteError, match="cannot be made a folder"):
        diagnosis_files(diagnosis(), [], EXTENDED, blocked / "x")


def test_the_schema_file_is_up_to_date():
    assert (DOCS / "diagnosis.schema.json").read_text(encoding="utf-8") == schema_text(document_module), (
        "run: python -m docs.make_schemas"
    )


PROBE = """<script>
(async () => {
  const told = {};
  const until = async (ready) => { for (let i = 0; i < 100 && !ready(); i++) await new Promise((r) => setTimeout(r, 50)); };
  const plots = [...document.querySelectorAll(".plot")];
  try {
    for (const p of plots) await until(() => p.dataset.state === "drawn");
    told.plots = plots.length;
    told.drawn = plots.filter((p) => p.dataset.state === "drawn").length;
    told.wide = plots.map((p) => p.querySelector(".main-svg").clientWidth - p.clientWidth);
    const gain = plots.find((p) => p.spec.name === "gain");
    told.log = gain._fullLayout.xaxis.type;
    told.rows = [...gain.querySelectorAll(".yaxislayer-above .ytick text")].map((t) => t.textContent);
    told.yrange = [...gain._fullLayout.yaxis.range];
    const xrange = [...gain._fullLayout.xaxis.range];
    gain.dispatchEvent(new KeyboardEvent("keydown", { key: "+" }));
    await until(() => gain._fullLayout.xaxis.range[0] !== xrange[0]);
    told.zoomed = gain._fullLayout.xaxis.range[0] !== xrange[0];
    gain.dispatchEvent(new KeyboardEvent("keydown", { key: "0" }));
    await until(() => Math.abs(gain._fullLayout.xaxis.range[0] - xrange[0]) < 1e-9);
    told.yrangeAfter = [...gain._fullLayout.yaxis.range];
    told.tooWide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    told.requests = performance.getEntriesByType("resource").map((e) => e.name).filter((n) => !/^(data|blob):/.test(n));
    told.images = document.querySelectorAll("img").length;
    told.unnamed = [...document.querySelectorAll("[tabindex='0']")].filter((e) => !e.ariaLabel && e.tagName !== "PRE").length;
    const widest = () => Math.max(...plots.map((p) => p.querySelector(".main-svg").clientWidth)), shown = widest();
    dispatchEvent(new Event("beforeprint"));
    await until(() => widest() <= 690);
    told.printed = [widest(), gain._fullLayout.font.color];
    dispatchEvent(new Event("afterprint"));
    await until(() => widest() === shown);
    told.shownAgain = widest() - shown;
    const wide = (element) => element.getBoundingClientRect().width;
    told.bars = [...document.querySelectorAll(".bar")].map((b) => wide(b.firstChild) / wide(b));
  } catch (error) { told.error = String(error.stack); }
  const pre = document.createElement("pre");
  pre.id = "probe";
  pre.textContent = JSON.stringify(told);
  document.body.append(pre);
})();
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
@pytest.mark.parametrize(("width", "dark"), [(500, True), (1280, False)])
def test_a_browser_draws_it_without_complaint_and_without_a_network(tmp_path, width, dark):
    told, evidence = hostile()
    page = Path(diagnosis_files(told, evidence, EXTENDED, tmp_path)["report"])
    options = [f"--window-size={width},20000", f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    found, console = probed(page, tmp_path / "profile", *options, probe=PROBE)
    assert console == []
    assert found["plots"] == found["drawn"] == 9
    assert found["wide"] == [0] * found["plots"]
    assert found["log"] == "log"
    assert [name[:9] for name in found["rows"]] == ["</script>"]  # text, not an element
    assert found["zoomed"]
    assert found["yrangeAfter"] == found["yrange"]  # rows keep their places
    assert found["tooWide"] == 0
    assert found["printed"][0] <= 690  # as wide as paper
    assert found["printed"][1] == "#1c2126"  # dark on white, whatever the screen shows
    assert found["shownAgain"] == 0
    assert found["requests"] == []
    assert found["images"] == 0
    assert found["unnamed"] == 0
    # The bars' borders take a pixel on each side.
    assert found["bars"] == pytest.approx([0.91, 0.985, 0.91, 0.985, 0.12], abs=0.03)
