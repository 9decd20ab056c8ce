"""`import vsalog` as a user has it: a function per command, the same numbers, results that print, plot and become tables."""

import inspect
import json
import os
import subprocess
import sys
import warnings
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from knee import lay, write_log
from msgspec.structs import replace

import vsalog
from vsalog.cli import _run, cli
from vsalog.core.documents import document_text
from vsalog.core.finding import Finding

pytest.importorskip("matplotlib")
import matplotlib

matplotlib.use("agg")
from matplotlib import pyplot

pytestmark = pytest.mark.share(2)

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
# Commands whose results are files, or texts.
OF_FILES = {"batch", "explain", "export", "init", "plot", "reproduce", "warm"}
# Options that say where results go, or how much is reported.
OUTPUTS = {
    "output", "report", "figures", "mcap", "json", "force", "repair", "from", "list", "suggest", "fail-on-cause",
    "fail-on-unchecked", "quiet", "verbose", "debug",
}  # fmt: skip
PLURALS = {"joint": "joints", "holdout": "holdouts", "sensor": "sensors"}
"""Options that may be given again, one value at a time."""


@pytest.fixture(autouse=True)
def closed():
    yield
    pyplot.close("all")


@pytest.fixture
def bench(tmp_path, monkeypatch):
    lay(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def printed(monkeypatch, capsys):
    """Run `vsalog ARGS` here; returns what it prints on stdout."""

    def printed(*args):
        monkeypatch.setattr(sys, "argv", ["vsalog", *map(str, args)])
        capsys.readouterr()
        assert _run() == 0
        return capsys.readouterr().out

    return printed


def test_everything_that_is_offered_is_there_and_nothing_is_missing():
    assert dir(vsalog) == sorted(vsalog.__all__)
    for name in dir(vsalog):
        assert getattr(vsalog, name) is not None
    assert set(cli.commands) - OF_FILES <= set(dir(vsalog))
    with pytest.raises(AttributeError, match="estimates"):
        vsalog.estimates  # noqa: B018


@pytest.mark.parametrize("name", sorted(set(cli.commands) - OF_FILES))
def test_options_are_those_of_the_command_with_its_defaults(name):
    own = inspect.signature(getattr(vsalog, name)).parameters
    for option in cli.commands[name].params:
        if option.param_type_name != "option":
            continue
        long = max(option.opts, key=len).removeprefix("--")
        if long in OUTPUTS and not (name == "diagnose" and long == "suggest"):
            continue
        given = own[PLURALS.get(long, long.replace("-", "_"))]
        # What has no default is marked by an object of click's own.
        default = option.default if isinstance(option.default, str | int | float) else None
        assert (given.default or None) == (default or None), long


def test_an_estimate_is_what_the_command_writes_and_says(bench, printed):
    said = printed("estimate", "log.csv", "-e", "direct")
    found = vsalog.estimate("log.csv", estimator="direct")
    (joint,) = found
    assert found.summary() == said.split("trace: ")[0]
    file = pq.read_table("log.stiffness.parquet")
    pd.testing.assert_frame_equal(found.to_pandas(), file.to_pandas())
    assert found.to_arrow().schema.field("stiffness").metadata == {b"unit": b"N*m/rad"}
    assert found.to_arrow().schema.metadata == file.schema.metadata
    *lines, seal = Path("log.model.toml").read_text(encoding="utf-8").splitlines(keepends=True)
    assert found.model.to_toml() == "".join(lines)
    assert seal.startswith("# ")
    sigma = joint.trace["total"]["stiffness"][joint.trace["total"]["excited"]]
    np.testing.assert_allclose(sigma, 20.0, rtol=0.05)
    assert (len(found), found[0], list(found)) == (1, joint, [joint])
    assert found[joint.joint] is joint
    with pytest.raises(KeyError):
        found["elbow"]
    assert repr(found) == "<vsalog Estimate: Stiffness of log.csv>"


def test_every_object_is_one_line_that_says_what_it_is_about(bench):
    shown = {
        repr(one)
        for one in (
            vsalog.Rig.load("rig.toml"),
            vsalog.read("log.csv"),
            vsalog.inspect("log.csv"),
            vsalog.simulate("sea", duration="1 s"),
        )
    }
    assert shown == {
        "<vsalog Rig: rig.toml, 1 joint>",
        "<vsalog Recording: log.csv, csv, 4 channels>",
        "<vsalog Inspection: Inspection of log.csv>",
        "<vsalog Simulation: Simulation of preset sea>",
    }


def test_a_spring_to_begin_with_is_asked_for_as_the_rig_has_it(bench):
    """A Python user has no option of the command line."""
    with pytest.raises(vsalog.VsalogError) as refused:
        vsalog.identify("log.csv")
    head, _, line = str(refused.value).rpartition(": ")
    assert "--" not in head
    rig = Path("rig.toml").read_text(encoding="utf-8").replace("[joint.knee]\n", f"[joint.knee]\n{line}\n")
    assert vsalog.Rig.load(rig).joints["knee"].transmission.stiffness == 100.0


def test_results_say_what_the_command_prints_as_json(bench, printed, samples):
    """The whole document, so the same code made it."""
    printed("estimate", "log.csv", "-e", "direct")
    short, log = ("--end", "1.5"), samples / "sea_exp1.csv"
    asked = {
        ("inspect", "log.csv"): vsalog.inspect("log.csv"),
        ("compare", "log.csv", "-e", "direct,qr-rls", *short): vsalog.compare(
            "log.csv", estimators=["direct", "qr-rls"], end="1.5"
        ),
        ("validate", "log.model.toml", "log.csv", "--no-modalities", *short): vsalog.validate(
            "log.model.toml", "log.csv", modalities=False, end="1.5"
        ),
        ("identify", log, "--fix", "link.*", "--fix", "transmission.*", "--end", "2", "-o", "r.toml"): vsalog.identify(
            log, fix=["link.*", "transmission.*"], end="2"
        ),
    }
    for args, found in asked.items():
        assert json.loads(document_text(found.data)) == json.loads(printed(*args, "--json")), args
        text = printed(*args) if args[0] in ("inspect", "compare") else ""
        if text:
            assert set(found.summary().splitlines()) >= {line for line in text.splitlines() if "--report" not in line}


def test_an_estimate_is_validated_without_a_file(bench):
    write_log(bench / "second.csv", rows=2500)
    found = vsalog.estimate("log.csv", estimator="direct")
    files = set(bench.iterdir())
    seen = vsalog.validate(found, "second.csv", modalities=False, max_nrmse=5.0)
    again = vsalog.validate(found.model, "second.csv", modalities=False, max_nrmse=1e-6)
    assert seen.verdicts == again.verdicts
    assert (seen.met, again.met) == (True, False)
    assert set(bench.iterdir()) == files
    scores = seen.to_arrow().to_pylist()
    (judged,) = (s for s in scores if s["reference"] == s["judged_on"] and s["quantity"] == "flexibility_torque")
    (part,) = seen.data.logs[0].joints[0].transmissions
    (score,) = (
        c.inside for c in part.comparisons if c.reference == part.judged_on and c.quantity == judged["quantity"]
    )
    assert (judged["nrmse"], judged["rmse_high"]) == (score.nrmse.value, score.rmse.high)


def test_a_simulation_is_estimated_without_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = vsalog.Rig.load("sea").with_setting("joint.sea.transmission.cubic", "0.0")
    played = vsalog.simulate(rig, duration="3 s", ideal=True, truth=True, seed=2)
    assert (played.log, played.data["log"]) == (None, None)
    assert "mcap" not in played.summary()
    assert list(tmp_path.iterdir()) == []
    (joint,) = vsalog.estimate(played.recording, estimator="direct")
    excited = joint.trace["total"]["excited"]
    np.testing.assert_allclose(joint.trace["total"]["stiffness"][excited], 20.0, rtol=1e-3)
    table = played.to_arrow()
    true = table["/truth/stiffness.data"].to_numpy()
    np.testing.assert_allclose(true, 20.0)
    assert table.schema.field("stamp").metadata == {b"unit": b"ns"}
    written = vsalog.simulate(rig, duration=3, ideal=True, truth=True, seed=2, output="log.mcap")
    assert {p.name for p in tmp_path.iterdir()} == {"log.mcap"}
    again = vsalog.read(written.log)
    for name, channel in played.recording.channels.items():
        np.testing.assert_array_equal(again.channels[name].values, channel.values)
    for refused in ({"replay": "log.mcap", "seed": 1}, {"window": 1.0, "rig": "sea"}, {}):
        with pytest.raises(vsalog.VsalogError):
            vsalog.simulate(**refused)
    replayed = vsalog.simulate(replay="log.mcap", window="0.5 s")
    assert "/simulated/link_position.data" in replayed.to_arrow().column_names


def test_a_diagnosis_gives_its_rig_and_a_row_per_number(bench):
    """The log's motor has no damping; a rig that claims some is corrected."""
    found = vsalog.diagnose("log.csv", set={"joint.knee.motor.damping": 2.0})
    assert found.verdict in ("explained", "partly explained")
    rows = [row for row in found.to_arrow().to_pylist() if row["cause"] == "motor.viscous_friction"]
    assert len(rows) == 1
    assert rows[0]["value"] == pytest.approx(0.0, abs=0.05)
    assert rows[0]["rig"] == 2.0
    assert found.extended.joints["knee"].motor.damping == pytest.approx(rows[0]["value"])
    assert found.kinds[0] == "gain"
    axes = found.plot().axes[0]
    after = next(c for c in axes.collections if c.get_label() == "extended rig").get_offsets()
    gain = found.data.gain.signals[0]
    assert after[0, 0] == pytest.approx(gain.rmse_after / gain.noise_floor)
    assert found.plot("simulation", part="motor_position").axes
    with pytest.raises(vsalog.VsalogError, match="part="):
        found.plot("simulation")
    # Without causes it has columns all the same.
    empty = type(found)(replace(found.data, causes=()), found._outcome).to_arrow()
    assert (empty.num_rows, empty.schema) == (0, found.to_arrow().schema)


def test_a_plan_names_what_it_confuses(tmp_path):
    from test_plan import RIG, SMALL

    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "small.toml").write_text(SMALL.replace("duration = 5.0", "duration = 2.0"), encoding="utf-8")
    found = vsalog.plan(
        tmp_path / "rig.toml", scenario=tmp_path / "small.toml", sensors=["motor_torque"], max_torque="4 N*m",
        max_speed=0.2, max_angle="60 deg",
    )  # fmt: skip
    rows = found.to_arrow().to_pylist()
    (plan,) = found.data.joints
    assert [row["seen"] for row in rows] == [cause.seen for cause in plan.causes]
    figure = found.plot()
    (dots,) = (c for c in figure.axes[0].collections if c.get_label() == "probability")
    np.testing.assert_allclose(dots.get_offsets()[:, 0], [row["seen"] for row in rows])
    with pytest.raises(vsalog.VsalogError, match="torque above zero"):
        vsalog.plan(tmp_path / "rig.toml", max_torque="-4 N*m")


def test_both_engines_draw_the_numbers_of_the_trace(bench):
    found = vsalog.estimate("log.csv", estimator="qr-rls")
    (joint,) = found
    trace = joint.trace["1"]
    figure = found.plot("stiffness", style="column")
    assert figure.get_figwidth() == 3.5
    figure.savefig("figure.pdf")
    pdf = Path("figure.pdf").read_bytes()
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    assert b"/MediaBox [ 0 0 252 " in pdf
    assert figure in map(pyplot.figure, pyplot.get_fignums())
    line = next(one for one in figure.axes[0].get_lines() if one.get_label() == "stiffness")
    web = found.plot("stiffness", engine="plotly")
    same = next(one for one in web.data if one.name == "stiffness")
    for x, y in (line.get_data(), (np.asarray(same.x), np.asarray(same.y))):
        known = np.isfinite(y)
        np.testing.assert_allclose(
            y[known], trace["stiffness"][np.searchsorted(joint.trace.time, x[known])], rtol=1e-12
        )
    assert web.layout.yaxis.title.text == "stiffness [N·m/rad]"
    for kind in found.kinds:
        assert found.plot(kind, engine="plotly").data
    with pytest.raises(vsalog.VsalogError, match="did you mean"):
        found.plot("stifness")  # codespell:ignore
    with pytest.raises(vsalog.VsalogError, match="plotly"):
        found.plot(engine="bokeh")
    with pytest.raises(vsalog.VsalogError, match="column"):
        found.plot(style="colum")  # codespell:ignore


def test_a_characteristic_surface_is_drawn_by_both_engines(samples):
    found = vsalog.estimate(samples / "awas_exp2.mcap", estimator="direct")
    (joint,) = found
    web = found.plot("stiffness-surface", engine="plotly")
    surface = next(one for one in web.data if one.type == "surface")
    x, y, z = (np.asarray(values, np.float64) for values in (surface.x, surface.y, surface.z))
    np.testing.assert_allclose(z.ravel(), joint.model.stiffness("1", x.ravel(), y.ravel())[0])
    assert found.plot("stiffness_surface").axes[0].get_ylabel() == "set-point [m]"


def test_the_device_goes_before_its_transmissions(samples):
    found = vsalog.estimate(samples / "vsa2_exp2.mcap", estimator="direct", end="3")
    (joint,) = found
    assert len(found.plot("stiffness").axes[0].get_lines()) > 0
    total = joint.trace["total"]
    line = next(one for one in found.plot().axes[0].get_lines() if one.get_label() == "stiffness")
    assert np.nanmax(line.get_ydata()) == pytest.approx(np.nanmax(total["stiffness"][total["excited"]]), rel=0.05)
    with pytest.raises(vsalog.VsalogError, match="'1' and '2'"):
        found.plot("torque_over_deflection")
    assert found.plot("torque_over_deflection", part="2").axes


def test_warnings_are_seen_where_the_call_stands(bench):
    (bench / "rig.toml").unlink()
    with pytest.warns(vsalog.VsalogWarning) as seen:
        found = vsalog.estimate("log.csv", estimator="direct")
    assert {warning.filename for warning in seen} == {__file__}
    codes = {finding.code: finding.severity for finding in found.findings}
    assert codes["rig.guessed"] == "warning"
    assert len(seen) == len([severity for severity in codes.values() if severity != "info"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(vsalog.VsalogWarning):
            vsalog.estimate("log.csv", estimator="direct")


def test_what_is_worth_a_note_only_is_no_warning(bench):
    write_log(bench / "second.csv", rows=2500)
    found = vsalog.estimate("log.csv", estimator="direct")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        seen = vsalog.validate(found, ["second.csv", "second.csv"], modalities=False)
    assert {(finding.code, finding.severity) for finding in seen.findings} == {("validation.same_log", "info")}


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.attributes, self.text = set(), set(), ""

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.text += data


def test_hostile_names_do_nothing_in_a_notebook(bench):
    rig = (bench / "rig.toml").read_text(encoding="utf-8").replace("joint.knee", f"joint.{json.dumps(HOSTILE)}")
    found = vsalog.estimate("log.csv", vsalog.Rig.from_toml(rig), estimator="direct")
    assert found[0].joint == HOSTILE
    hostile = Finding(code="sensor.constant", joint=HOSTILE, part=f"{HOSTILE}\u202e")
    found._job = type(found._job)(**{
        name: getattr(found._job, name) for name in found._job.__slots__
    } | {"findings": (hostile,)})  # fmt: skip
    for result in (found, vsalog.compare("log.csv", vsalog.Rig.from_toml(rig), estimators="direct")):
        page = Tags()
        page.feed(result._repr_html_())
        assert page.tags <= {
            "div", "style", "p", "strong", "bdi", "section", "h4", "h5", "table", "caption", "thead", "tbody", "tr", "th", "td",
            "span", "ul", "li", "dl", "dt", "dd", "code", "br",
        }  # fmt: skip
        assert not {name for name in page.attributes if name.startswith("on")}
    assert HOSTILE in found.summary()
    assert "\u202e" not in found._repr_html_() + found.summary() + repr(found)
    for trace in found.plot(engine="plotly").data:
        assert "<script" not in str(trace.name)
    assert found.plot().axes


def test_without_pandas_it_says_what_to_install(bench, monkeypatch):
    found = vsalog.inspect("log.csv")
    monkeypatch.setitem(sys.modules, "pandas", None)
    (joint,) = vsalog.estimate("log.csv", estimator="direct")
    for one in (found, joint.trace):
        with pytest.raises(vsalog.VsalogError, match="pip install"):
            one.to_pandas()


def test_a_log_is_seen_before_anything_is_known_of_it(bench):
    found = vsalog.inspect("log.csv")
    figure = found.plot()
    (line,) = (one for axes in figure.axes for one in axes.get_lines() if "theta" in one.get_label())
    recorded = vsalog.read("log.csv").channels["theta"].values
    assert np.nanmax(line.get_ydata()) == recorded.max()
    row = next(row for row in found.to_arrow().to_pylist() if row["channel"] == "theta")
    assert (row["role"], row["unit"], row["maximum"]) == ("motor_position", "rad", recorded.max())


def test_in_a_notebook_everything_is_displayed_once(bench, monkeypatch):
    """The inline backend displays what pyplot has open, and what a cell returns; rich displays what it prints."""
    found = vsalog.inspect("log.csv")
    text = found.summary()
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert found.summary() == text
    assert len(text.splitlines()) > 5
    monkeypatch.setattr(pyplot, "get_backend", lambda: "module://matplotlib_inline.backend_inline")
    found.plot()
    assert pyplot.get_fignums() == []


SCRIPT = """
import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure
import vsalog

found: vsalog.Estimate = vsalog.estimate("exp1.mcap", joints="elbow", tune={"window": 0.1})
(joint,) = found
sigma = np.asarray(joint.trace["total"]["stiffness"], dtype=np.float64)
figure: Figure = found.plot("stiffness", style="column")
found.plot(engine="plotly").show()
table: pa.Table = found.to_arrow()
text: str = found.summary()
codes: list[str] = [finding.code for finding in found.findings]
held: bool = vsalog.validate(found, ["exp2.mcap"], max_nrmse=5.0).met
extended: vsalog.Rig | None = vsalog.diagnose("exp1.mcap", holdouts="exp2.mcap").extended
best: list[float] = [n.value for n in vsalog.identify("exp1.mcap", free=["motor.*"]).numbers]
recording: vsalog.Recording = vsalog.simulate("sea", duration="3 s").recording
rows: int = vsalog.compare("exp1.mcap").to_arrow().num_rows
seen: list[float] = [c.seen for joint_plan in vsalog.plan("sea").data.joints for c in joint_plan.causes]
logs: list[str] = [log.path for log in vsalog.inspect("exp1.mcap").logs]
reveal_type(found.kinds)
"""


def test_a_users_script_is_typed(tmp_path):
    pytest.importorskip("mypy")
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    top = Path(vsalog.__file__).parents[1]
    args = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--config-file",
        "",
        "--cache-dir",
        str(Path(__file__).parents[2] / ".mypy_cache" / "user"),
    ]
    done = subprocess.run(
        [*args, "script.py"], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(top)}, capture_output=True, text=True
    )
    told = done.stdout.splitlines()
    # Arrow and plotly come without types of their own.
    assert [line for line in told if " error: " in line and "import-untyped" not in line] == []
    assert any('Revealed type is "tuple[str, ...]"' in line.replace("builtins.", "") for line in told), done.stdout


@pytest.mark.parametrize(
    "call",
    [
        lambda: vsalog.estimate(3),
        lambda: vsalog.inspect(None),
        lambda: vsalog.validate("a.model.toml", 3),
        lambda: vsalog.validate(vsalog.Rig.preset("sea"), "log.csv"),
        lambda: vsalog.Rig("rig.toml"),
    ],
)
def test_what_is_no_log_rig_or_model_is_refused(call):
    with pytest.raises(vsalog.VsalogError, match=r"is no (path|model|rig)"):
        call()


@pytest.mark.parametrize("name", ["estimate", "inspect", "diagnose", "compare"])
def test_no_log_is_refused(name):
    with pytest.raises(vsalog.VsalogError, match="no log was given"):
        getattr(vsalog, name)([])
