"""`vsalog plot` as a user runs it; what figures show is read out of the figures' own data, what a PDF is out of its bytes."""

import json
import re
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from knee import lay

from vsalog.cli import cli
from vsalog.cli.plot import KINDS
from vsalog.core.model import ModelFile
from vsalog.figures.joint_figures import plot_charts
from vsalog.figures.paper import SIZES, draw
from vsalog.figures.trace_file import TraceFile
from vsalog.readers.own_files import TRACE

pytest.importorskip("matplotlib")
import matplotlib
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

pytestmark = pytest.mark.share(3)


@pytest.fixture(scope="module")
def traces(tmp_path_factory, samples):
    """Traces of a joint with a set-point (awas), of two transmissions (vsa2), and of a wide band (sea)."""
    folder = tmp_path_factory.mktemp("traces")
    runs = ("awas_exp2.mcap", "residual-rls"), ("vsa2_exp2.mcap", "residual-rls"), ("sea_exp1.csv", "qr-rls")
    for log, estimator in runs:
        cli(["estimate", str(samples / log), "-e", estimator, "-o", str(folder)], standalone_mode=False)
    return folder


@pytest.fixture
def drawn(traces):
    """Return the axes of a figure of a trace."""

    def drawn(log, kind, transmission="1", style="column"):
        trace = TraceFile.of(traces / f"{log}.stiffness.parquet")
        (joint,) = trace.joints
        (chart,) = (c for c in plot_charts(trace.evidence(joint))[transmission] if c.name == kind)
        canvas = Figure()
        with matplotlib.rc_context(SIZES[style].settings):
            draw(canvas, chart, SIZES[style])
            canvas.draw_without_rendering()
        return canvas

    return drawn


def columns(traces, log, transmission):
    table = pq.read_table(traces / f"{log}.stiffness.parquet", filters=[("transmission", "=", transmission)])
    return {name: table[name].to_numpy() for name in ("time", "deflection", "stiffness", "stiffness_std", "excited", "setpoint")
            if name in table.column_names}  # fmt: skip


def line(axes, label):
    return next(one for one in axes.get_lines() if one.get_label() == label)


@pytest.mark.parametrize(("style", "width"), [("column", 3.5), ("page", 7.16), ("screen", 10.0)])
def test_a_pdf_is_as_wide_as_its_style_says_and_carries_its_fonts(traces, command, tmp_path, style, width):
    args = ("plot", traces / "sea_exp1.stiffness.parquet", "-o", "fig.pdf", "--style", style)
    code, out, err = command(*args, cwd=tmp_path)
    assert (code, err) == (0, "")
    assert out.startswith("fig.pdf: ")
    pdf = (tmp_path / "fig.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", pdf)
    assert len(boxes) == 1
    assert float(boxes[0][0]) / 72.0 == pytest.approx(width, abs=0.01)
    # TrueType (FontFile2), as IEEE's checker wants it, and no Type 3.
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    # What is drawn is drawn as lines: there is no picture in it.
    assert b"/Subtype /Image" not in pdf


def test_the_line_is_the_traces_stiffness_and_the_band_twice_its_deviation(traces, drawn):
    (axes,) = drawn("sea_exp1", "stiffness").axes
    told = columns(traces, "sea_exp1", "1")
    x, y = line(axes, "stiffness").get_data()
    known = np.isfinite(x) & np.isfinite(y)
    at = np.searchsorted(told["time"], x[known])
    np.testing.assert_allclose(y[known], told["stiffness"][at], rtol=1e-12)
    assert np.nanmax(y) == pytest.approx(np.nanmax(told["stiffness"][told["excited"]]), rel=0.05)
    # The band encloses what it says wherever the data excite the estimate.
    band = axes.patches + axes.collections
    (area,) = (p for p in band if p.get_label() == "± 2 standard deviations")
    path = area.get_path()
    few = np.flatnonzero(told["excited"])[50::400]
    low, high = (told["stiffness"][few] + s * 1.9 * told["stiffness_std"][few] for s in (-1.0, 1.0))
    for edge in (low, high):
        assert all(path.contains_point(point) for point in zip(told["time"][few], edge, strict=True))


def test_what_is_not_excited_is_shaded(traces, drawn):
    canvas = drawn("sea_exp1", "stiffness")
    told = columns(traces, "sea_exp1", "1")
    shaded = [p for p in canvas.axes[0].patches if isinstance(p, Rectangle)]
    covered = np.zeros(told["time"].size, dtype=bool)
    for patch in shaded:
        covered |= (told["time"] >= patch.get_x()) & (told["time"] <= patch.get_x() + patch.get_width())
    unexcited = ~told["excited"] & np.isfinite(told["stiffness"])
    assert unexcited.any()
    assert covered[unexcited].all()
    assert np.mean(covered[told["excited"]]) < 0.02


def test_a_transient_does_not_squeeze_the_rest(traces, drawn):
    """Before much is known the estimates and their band reach far beyond what the log excites."""
    table = pq.read_table(traces / "sea_exp1.stiffness.parquet")
    wild = np.where(table["excited"].to_numpy(), 1.0, 1e4)
    for name in ("stiffness", "stiffness_std"):
        table = table.set_column(table.column_names.index(name), name, pa.array(table[name].to_numpy() * wild))
    pq.write_table(table, traces / "wild.stiffness.parquet")
    told = columns(traces, "wild", "1")
    assert np.nanmax(told["stiffness"]) > 1e5
    low, high = drawn("wild", "stiffness").axes[0].get_ylim()
    assert high - low < 2.5 * np.ptp(told["stiffness"][told["excited"]])


def test_a_band_narrower_than_a_line_has_axes_of_its_own(traces, drawn):
    table = pq.read_table(traces / "sea_exp1.stiffness.parquet")
    thin = pa.array(0.01 * table["stiffness_std"].to_numpy())
    pq.write_table(
        table.set_column(table.column_names.index("stiffness_std"), "stiffness_std", thin),
        traces / "thin.stiffness.parquet",
    )
    told = columns(traces, "thin", "1")
    first, second = drawn("thin", "stiffness").axes
    assert second.get_ylabel() == "std [N·m/rad]"
    assert np.nanmax(line(second, "standard deviation").get_ydata()) == np.nanmax(
        told["stiffness_std"][told["excited"]]
    )
    assert len(drawn("sea_exp1", "stiffness").axes) == 1
    # It is narrower than the line indeed: in pixels.
    excited = told["excited"]
    height = first.transData.transform([(0.0, 4.0 * float(np.median(told["stiffness_std"][excited]))), (0.0, 0.0)])
    assert height[0, 1] - height[1, 1] < first.get_lines()[0].get_linewidth() / 72.0 * first.figure.dpi


def test_the_characteristic_is_the_models(traces, drawn):
    (axes,) = drawn("sea_exp1", "torque_over_deflection").axes
    model = ModelFile.load(traces / "sea_exp1.model.toml").joint["sea"]
    phi, torque = line(axes, "model").get_data()
    np.testing.assert_allclose(torque, model.flexibility_torque("1", phi)[0], rtol=1e-12)
    grey, data = (c for c in axes.collections if c.get_offsets().size)
    assert grey.get_label() == "not excited so far"
    assert np.abs(data.get_offsets()[:, 0]).max() <= np.abs(phi).max() * (1.0 + 1e-9)


def test_without_its_model_a_trace_is_drawn_all_the_same(traces, drawn, tmp_path, command):
    """The surface is then the means of the estimates, which are the model's stiffness within its scatter."""
    whole = drawn("awas_exp2", "stiffness_surface")
    trace = tmp_path / "t.parquet"
    trace.write_bytes((traces / "awas_exp2.stiffness.parquet").read_bytes())
    args = [a for kind in ("stiffness-surface", "torque-over-deflection") for a in ("--kind", kind)]
    code, out, _ = command("plot", trace, "-o", "f.svg", *args, cwd=tmp_path)
    assert code == 0
    assert [row.split(":")[0] for row in out.splitlines()] == [
        "f_stiffness_surface.svg",
        "f_torque_over_deflection.svg",
    ]
    alone = TraceFile.of(trace)
    assert alone.model is None
    (chart,) = (c for c in plot_charts(alone.evidence("awas"))["1"] if c.name == "stiffness_surface")
    model = ModelFile.load(traces / "awas_exp2.model.toml").joint["awas"]
    at = np.isfinite(chart.surface.z)
    c = np.repeat(chart.surface.y[:, None], chart.surface.x.shape[1], axis=1)
    expected, _ = model.stiffness("1", chart.surface.x[at], c[at], extrapolate=True)
    np.testing.assert_allclose(chart.surface.z[at], expected, rtol=0.05)
    assert whole.axes[0].get_ylabel() == "set-point [m]"
    assert whole.axes[1].get_ylabel() == "stiffness [N·m/rad]"


def test_a_model_of_another_run_is_not_drawn(traces, tmp_path):
    (tmp_path / "t.stiffness.parquet").write_bytes((traces / "sea_exp1.stiffness.parquet").read_bytes())
    text = (traces / "sea_exp1.model.toml").read_text(encoding="utf-8")
    beside = tmp_path / "t.model.toml"
    beside.write_text(text, encoding="utf-8")
    assert TraceFile.of(tmp_path / "t.stiffness.parquet").model is not None
    beside.write_text(re.sub(r'(?m)^("sea_exp1.csv" = ").', r"\1x", text), encoding="utf-8")
    assert TraceFile.of(tmp_path / "t.stiffness.parquet").model is None


def test_a_band_with_gaps_is_one_thing_in_a_legend(traces, drawn):
    table = pq.read_table(traces / "sea_exp1.stiffness.parquet")
    for name in ("stiffness", "stiffness_std"):
        values = table[name].to_numpy().copy()
        values[4000:4500] = values[7000:7500] = np.nan
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    pq.write_table(table, traces / "gaps.stiffness.parquet")
    (axes,) = drawn("gaps", "stiffness").axes
    assert len([p for p in axes.patches if not isinstance(p, Rectangle)]) == 3
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["not excited so far", "± 2 standard deviations", "stiffness"]


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_cut_and_no_numbers_touch_in_a_column(drawn, kind):
    """Every text is within the figure, and no number on an axis touches the next one."""
    canvas = drawn("awas_exp2", kind.replace("-", "_"))
    assert canvas.get_figwidth() == 3.5
    if canvas.axes[0].name == "3d":
        return
    width, height = canvas.bbox.width, canvas.bbox.height
    for axes in canvas.axes:
        box = axes.get_tightbbox()
        assert box.x0 >= -0.5
        assert box.y0 >= -0.5
        assert box.x1 <= width + 0.5
        assert box.y1 <= height + 0.5
        ticks = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
        seen = sorted((t.x0, t.x1) for t in ticks if axes.bbox.x0 - 1.0 <= 0.5 * (t.x0 + t.x1) <= axes.bbox.x1 + 1.0)
        assert all(a[1] < b[0] for a, b in pairwise(seen))


def test_a_log_is_plotted_as_its_trace_is(command, tmp_path):
    lay(tmp_path)
    (log,) = (p for p in tmp_path.iterdir() if p.suffix != ".toml")
    before = set(tmp_path.iterdir())
    code, out, err = command("plot", log, "-o", "log.svg", "--json", cwd=tmp_path)
    assert code == 0, err
    assert set(tmp_path.iterdir()) == before | {tmp_path / "log.svg"}
    (figure,) = json.loads(out)["figures"]
    assert (figure["file"], figure["kind"]) == ("log.svg", "stiffness")
    assert command("estimate", log, "-o", "t.parquet", cwd=tmp_path)[0] == 0
    assert command("plot", "t.parquet", "-o", "trace.svg", cwd=tmp_path)[0] == 0
    assert (tmp_path / "log.svg").read_bytes() == (tmp_path / "trace.svg").read_bytes()


def test_several_figures_have_files_of_their_own_and_none_is_written_over(traces, command, tmp_path):
    trace = traces / "vsa2_exp2.stiffness.parquet"
    args = ("plot", trace, "-o", "f.png", "--kind", "torque-over-deflection")
    code, _, _ = command(*args, cwd=tmp_path)
    assert code == 0
    names = {"f_part1.png", "f_part2.png"}
    assert {p.name for p in tmp_path.iterdir()} == names
    (tmp_path / "f_part2.png").write_text("mine")
    (tmp_path / "f_part1.png").unlink()
    assert command(*args, cwd=tmp_path)[0] == 2
    assert {p.name for p in tmp_path.iterdir()} == {"f_part2.png"}
    assert command(*args, "--force", cwd=tmp_path)[0] == 0
    assert {p.name for p in tmp_path.iterdir()} == names
    assert (tmp_path / "f_part2.png").read_bytes().startswith(b"\x89PNG")
    # What would not be written is not in the way.
    (tmp_path / "f.png").write_text("mine")
    both = ("plot", trace, "-o", "f.png", "--kind", "stiffness", "--kind", "torque")
    assert command(*both, cwd=tmp_path)[0] == 0
    assert (tmp_path / "f.png").read_text() == "mine"
    assert command(*args, "--force", "--transmission", "2", cwd=tmp_path)[0] == 0
    assert (tmp_path / "f.png").read_bytes() == (tmp_path / "f_part2.png").read_bytes()


@pytest.mark.parametrize(
    "args",
    [
        ("-o", "f.bmp"),
        ("-o", "f.pdf", "--kind", "stiffness-surface"),
        ("-o", "f.pdf", "--joint", "knee"),
        ("-o", "f.pdf", "--transmission", "3"),
        ("-o", "f.pdf", "--rig", "sea"),
        ("-o", "f.pdf", "-e", "direct"),
        ("-o", "nowhere/f.pdf"),
        (),
    ],
)
def test_what_cannot_be_plotted_is_refused(traces, command, tmp_path, monkeypatch, args):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("MPLBACKEND", "agg")
    matplotlib.use("agg")
    code, out, err = command("plot", traces / "sea_exp1.stiffness.parquet", *args, cwd=tmp_path)
    assert (code, out) == (2, "")
    assert err
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_trace_is_refused(traces, command, tmp_path):
    whole = (traces / "sea_exp1.stiffness.parquet").read_bytes()
    group = pq.read_metadata(traces / "sea_exp1.stiffness.parquet").row_group(0)
    (column,) = (c for c in map(group.column, range(group.num_columns)) if c.path_in_schema == "stiffness")
    middle = column.data_page_offset + column.total_compressed_size // 2
    (tmp_path / "t.parquet").write_bytes(whole[:middle] + bytes(50) + whole[middle + 50 :])
    code, _, err = command("plot", "t.parquet", "-o", "f.pdf", cwd=tmp_path)
    assert code == 2, err
    assert {p.name for p in tmp_path.iterdir()} == {"t.parquet"}


def test_without_matplotlib_it_says_what_to_install(traces, command, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    code, _, err = command("plot", traces / "sea_exp1.stiffness.parquet", "-o", "f.pdf", cwd=tmp_path)
    assert code == 2
    assert "pip install" in err


def test_without_a_file_it_opens_windows(traces, run, tmp_path, monkeypatch):
    """matplotlib's window is a stand-in, which writes down what it shows."""
    monkeypatch.setenv("MPLBACKEND", "module://window_stand_in")
    done = run("plot", traces / "sea_exp1.stiffness.parquet", "--kind", "stiffness", "--kind", "torque")
    assert done.returncode == 0, done.stderr
    assert {p.name for p in tmp_path.glob("*.png")} == {"1.png", "2.png"}
    titles = (tmp_path / "titles").read_text(encoding="utf-8").splitlines()
    assert [title for title in titles if "joint sea" in title] == [
        "Stiffness over time, joint sea, transmission 1", "Torque over time, joint sea, transmission 1",
    ]  # fmt: skip


def test_a_trace_among_logs_is_refused_as_one(traces, command, tmp_path):
    trace = traces / "sea_exp1.stiffness.parquet"
    for both in ((trace, "log.csv"), ("log.csv", trace)):
        (tmp_path / "log.csv").write_text("time,x\n0,1\n1,2\n")
        code, _, err = command("plot", *both, "-o", "fig.pdf", cwd=tmp_path)
        assert code == 2
        assert "TRACE" in err


def bomb(kind):
    """A small file with a trace's columns that would take gigabytes."""
    rows, text = 2**16, "k" * 2**17
    names = pa.array(["a" * 8] * rows)
    table = {name: np.zeros(rows) for name in TRACE if name not in ("joint", "transmission", "excited")}
    table |= {"joint": names, "transmission": names, "excited": np.zeros(rows, bool)}
    indices = pa.array(np.zeros(rows, np.int32))
    coded = pa.DictionaryArray.from_arrays(indices, pa.array([text]))
    table["joint"] = coded
    schema = pa.table(table).schema
    if kind == "texts":
        # Read as plain texts, each written out.
        schema = schema.set(schema.get_field_index("joint"), pa.field("joint", pa.string()))
    return pa.table(table), schema


@pytest.mark.skipif(sys.platform != "linux", reason="the peak of memory is told by /proc")
@pytest.mark.parametrize("kind", ["texts", "dictionary"])
def test_a_small_file_takes_no_gigabytes(tmp_path, kind):
    table, schema = bomb(kind)
    path = tmp_path / "log.stiffness.parquet"
    pq.write_table(table, path, compression="zstd", store_schema=kind == "dictionary", use_dictionary=["joint"],
                   write_statistics=False)  # fmt: skip
    assert path.stat().st_size < 2**20
    assert schema.field("joint").type == pq.read_schema(path).field("joint").type
    script = (
        "import sys\nfrom vsalog.cli import _run\ncode = _run()\n"
        "status = dict(line.split(':') for line in open('/proc/self/status'))\n"
        "print(code, int(status['VmHWM'].split()[0]) * 1024)"
    )
    words = ("plot", path.name, "-o", "figure.pdf")
    done = subprocess.run(
        [sys.executable, "-c", script, *words], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    code, peak = map(int, done.stdout.split()[-2:])
    assert peak < 2**30, done.stderr
    assert code == (0 if kind == "dictionary" else 2), done.stderr
