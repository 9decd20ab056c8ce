"""What the figures show: right numbers in their words, nothing of a log's names where they could act."""

import json
import re
from dataclasses import fields, replace
from html.parser import HTMLParser

import numpy as np
import pytest
from reports_evidence import HOSTILE, drawn, evidence, lever_arm_joint, write_page

from vsalog.core.printable import printable
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence
from vsalog.figures.chart import Axes, Chart, Curve, chart_data, label
from vsalog.figures.joint_figures import columns_for, joint_charts
from vsalog.figures.paper import write_figures, write_reproduced
from vsalog.report.document import Document, Figures
from vsalog.report.html import page_of
from vsalog.reproduce.drawing import Curve as Paper
from vsalog.reproduce.drawing import Figure as Reproduced
from vsalog.reproduce.drawing import Panel

NAMES = {
    "torque", "torque_expanded", "torque_over_deflection", "surface", "slices", "stiffness", "error_distribution",
    "error_dependence",
}  # fmt: skip


def charts_of(joint, name, columns):
    return joint_charts(joint, columns)[name]


def test_every_figure_that_the_data_allow_is_there():
    assert {c.name for c in charts_of(lever_arm_joint(), "1", 500)} == NAMES
    curve = {c.name for c in charts_of(evidence(20_000), "1", 500)}
    assert curve == NAMES - {"surface", "slices"}


def test_words_say_the_figures_numbers():
    charts = {c.name: c for c in charts_of(lever_arm_joint(), "1", 500)}
    assert "0.25 N·m (root mean square), at most by 0.25 N·m" in charts["torque"].words
    assert "160 to 240 N·m/rad" in charts["stiffness"].words
    assert "difference is 0.5 N·m/rad" in charts["stiffness"].words
    assert "contains the truth for 100 % of the time" in charts["stiffness"].words
    assert "10 % of the time" in charts["torque"].words
    assert "mean −0.25 N·m" in charts["error_distribution"].words
    assert all(c.words.endswith(".") and len(c.words) > 40 for c in charts.values())


def test_the_surface_is_the_models_and_ends_where_it_was_fitted():
    (chart,) = (c for c in charts_of(lever_arm_joint(), "1", 500) if c.name == "surface")
    s = chart.surface
    c = np.repeat(s.y[:, None], s.x.shape[1], axis=1)
    np.testing.assert_allclose(s.z, (100.0 + 2000.0 * c) * s.x, rtol=1e-9, atol=1e-12)
    assert (np.hypot(s.x / 0.1, (c - 0.05) / 0.02) <= 1.0 + 1e-9).all()


def test_several_runs_are_drawn_one_after_the_other():
    """Each begins at zero: drawn over one another the second's samples would be taken for the first's."""
    one = evidence(4000)
    part = one.transmissions["1"]
    twice = {
        f.name: np.concatenate([v, v]) if isinstance(v := getattr(part, f.name), np.ndarray) else v
        for f in fields(part)
    }
    both = replace(one, time=np.tile(one.time, 2), transmissions={"1": TransmissionEvidence(**twice)})
    charts = {c.name: c for c in charts_of(both, "1", 10_000)}
    for curve in (c for a in charts["torque"].axes for c in a.curves if c.kind == "line"):
        assert np.all(np.diff(curve.x) > 0.0)
        assert curve.x[-1] > 2.0 * one.time[-1]
    assert charts["torque"].axes[0].spans[-1][0] > one.time[-1]


def test_nothing_known_is_no_crash():
    nothing, never = np.full(100, np.nan), np.zeros(100, dtype=bool)
    part = TransmissionEvidence(nothing, nothing, nothing, nothing, "", nothing, nothing, None, never)
    for chart in charts_of(JointEvidence("a", np.arange(100.0), None, "", {"1": part}, None), "1", 100):
        json.dumps(chart_data(chart), allow_nan=False)


class Tags(HTMLParser):
    """Collect every element with its attributes."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_a_keyboard_and_a_screen_reader_find_every_figure(tmp_path):
    path = tmp_path / "page.html"
    write_page(path, "title", None, drawn([[lever_arm_joint(), evidence(20_000)]]))
    page = Tags()
    page.feed(path.read_text(encoding="utf-8"))
    plots = [attrs for _, attrs in page.found if attrs.get("class") == "plot"]
    assert len(plots) > 12
    for plot in plots:
        assert (plot["role"], plot["tabindex"]) == ("img", "0")
        assert len(plot["aria-label"]) > 40
    assert next(tag for tag, _ in page.found if re.fullmatch("h[1-6]", tag)) == "h1"
    assert sum(tag == "h1" for tag, _ in page.found) == 1
    assert next(attrs for _, attrs in page.found if attrs.get("class") == "skip")["href"] == "#main"
    for tag, attrs in page.found:
        assert "src" not in attrs
        assert tag != "link"


@pytest.mark.parametrize("hostile", [HOSTILE, "</SCRIPT>", "<!--<script>", "a\u2029b", "\udcff", "\u202egnp.exe"])
def test_texts_cannot_leave_a_script(hostile):
    chart = Chart("torque", "t", "w", (Axes(hostile, "y", (Curve(hostile, np.zeros(2), np.zeros(2), "model"),)),))
    page = page_of(Document("", "", (Figures((chart,)),)))
    (text,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.S)
    assert not re.search(r"[<>&\u2028\u2029]", text)
    (axes,) = json.loads(text)["axes"]
    assert axes["curves"][0]["label"] == label(hostile)


def test_labels_hold_no_tags_and_texts_no_controls():
    assert label('<a href="javascript:alert(1)">x</a>') == '&lt;a href="javascript:alert(1)"&gt;x&lt;/a&gt;'
    assert printable("a\u202eb\x1b[31m\udcff\u2028") == "a�b�[31m��"


def test_figures_for_papers_are_named_after_nothing_in_a_log(tmp_path):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "figures"
    hostile = evidence(3000, "../../" + HOSTILE + "$x$")
    files = write_figures(folder, drawn([[hostile, lever_arm_joint()]]), [HOSTILE], ("svg", "png"))
    assert {p.name for p in files} | {"figures.txt"} == {p.name for p in folder.iterdir()}
    assert all(re.fullmatch(r"log1_joint[12]_part1_[a-z_]+\.(svg|png)", p.name) for p in files)
    assert {p.name.split("part1_")[1].split(".")[0] for p in files} == NAMES
    for path in files:
        head = path.read_bytes()[:1000]
        assert b"<svg" in head if path.suffix == ".svg" else head.startswith(b"\x89PNG")
        assert b"<script" not in path.read_bytes()


def test_equal_results_make_equal_figures(tmp_path):
    pytest.importorskip("matplotlib")
    for name in "ab":
        write_figures(tmp_path / name, drawn([[evidence(3000)]]), (), ("svg",))
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


@pytest.mark.parametrize(("transmissions", "columns"), [(0, 1200), (1, 1200), (4, 600), (9, 400)])
def test_figures_share_the_columns_of_a_page(transmissions, columns):
    assert columns_for(transmissions) == columns


def test_ticks_of_a_logarithmic_axis_are_numbers(tmp_path):
    pytest.importorskip("matplotlib")
    x = np.geomspace(1e-3, 1.0, 30)
    panel = Panel(x_label="a", y_label="b", curves=(Paper("c", x, x**2, "dashdot"),), log_x=True, log_y=True)
    (path,) = write_reproduced(tmp_path, [Reproduced("name", "title", (panel,))])
    text = path.read_text(encoding="utf-8")
    assert "<!-- 0.01 -->" in text
    assert "math" not in text


def test_the_stiffness_is_scaled_to_where_it_is_known():
    joint = lever_arm_joint()
    part = joint.transmissions["1"]
    known = (joint.time >= 2.0) & (joint.time < 15.0)
    std = np.where(known, 1.0, 40.0)
    jump = np.argmax(known) + 50
    std[jump] = 30.0  # excited by a fifth of 200 N·m/rad, for one sample
    part = replace(part, inside=known, stiffness_std=std, true_stiffness=None)
    (chart,) = [c for c in charts_of(replace(joint, transmissions={"1": part}), "1", 500) if c.name == "stiffness"]
    low, high = chart.axes[0].y_range
    sigma = part.stiffness[known]
    # Twice the standard deviation of 1 N·m/rad above and below, and a margin.
    assert np.ptp(sigma) < high - low <= 1.1 * (np.ptp(sigma) + 4.0)
    assert low < sigma.min()
    assert high > sigma.max()
    # Nothing is known, or one number without a deviation: the figure's own range.
    flat = replace(part, stiffness=np.full_like(std, 200.0), stiffness_std=np.full_like(std, np.nan))
    (chart,) = [c for c in charts_of(replace(joint, transmissions={"1": flat}), "1", 500) if c.name == "stiffness"]
    assert chart.axes[0].y_range is None
