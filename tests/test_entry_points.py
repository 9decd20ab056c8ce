"""A package of a third party with one of each kind: where the commands and the generated pages have them."""

import json
import os
import subprocess
import sys

import pytest
from command_line import vsalog_run

EFFECT = """
from vsalog.effects.base import Effect, OneNumber

EFFECT = Effect(causes=(OneNumber(
    name="link.hanging", place="link", key="gravity_angle", number="angle", unit="rad", step=1e-3,
    title="The link hangs at another angle than the rig says",
    says="the link's equation is off by the cosine of its position",
    confirm="Let the link hang with the motor switched off, and read its encoder.",
    reference="a base that is not level",
    signature="link equation: cos(q - q0)",
),))
"""
CAUSE = '''
from vsalog.diagnosis.causes.base import Cause


class Magnet(Cause):
    """A magnet that is loose."""

    name, title, says = "motor.magnet", "A magnet of the {part} is loose", "nothing"
    confirm, reference, signature = "Look at it.", "none", "none"

    def sites(self, setting):
        return iter(())
'''
CHECK = """
from vsalog.checks.check import OfSignals
from vsalog.core.finding import Finding
from vsalog.core.finding import Text
from vsalog.core.finding_texts import add_texts

add_texts({"bench.humid": Text("the bench is humid: {value:.0f} %.", "Dry it.")})


class Humidity:
    name = "humidity"
    supersedes = {}

    def start(self, context):
        joint = context.device.joint
        humid = Finding(code="bench.humid", joint=joint, value=float(len(context.look)), limit=60.0, unit="%")
        return OfSignals([humid])


HUMIDITY = Humidity()
"""
ESTIMATOR = """
from vsalog.estimators.methods import direct

NAME, SUMMARY, TUNING = "parabola", "a parabola through deflection and torque", direct.TUNING
roles = direct.roles


def build(device, signals, tuning):
    fold = direct.build(device, signals, tuning)
    fold.name = NAME
    return fold
"""
POINTS = """
[vsalog.effects]
hanging = hanging
[vsalog.causes]
magnet = magnet
[vsalog.checks]
humidity = humidity:HUMIDITY
[vsalog.estimators]
parabola = parabola
"""
PAGE = "import runpy, sys; print(runpy.run_path(sys.argv[1])['reference']())"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the package as pip lays it out; returns what runs Python with it."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "bench-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bench\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    for name, source in {"hanging": EFFECT, "magnet": CAUSE, "humidity": CHECK, "parabola": ESTIMATOR}.items():
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])

    def run(*args, cwd=folder):
        environment = {**os.environ, "PYTHONPATH": path}
        command = [sys.executable, *map(str, args)]
        done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, encoding="utf-8")
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="module")
def bench_log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    done = vsalog_run("simulate", "sea", "--duration", "3 s", "-o", "log.csv", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "log.csv"


def generated(installed, request, name):
    return installed("-c", PAGE, request.config.rootpath / "docs" / f"make_{name}.py")


def test_help_and_the_command_line_s_page_list_the_estimator(installed, request):
    assert "parabola" in installed("-m", "vsalog", "estimate", "--help")
    assert "parabola" in generated(installed, request, "cli")


def test_the_causes_page_has_the_effect_s_cause_and_the_cause(installed, request):
    page = generated(installed, request, "causes")
    assert "### link.hanging\n\nThe link hangs at another angle than the rig says.\n" in page
    assert "- Parameters: `angle` [rad]\n" in page
    assert "### motor.magnet\n\nA magnet of the motor is loose.\n" in page


def test_the_findings_page_has_the_check_s_code(installed, request):
    page = generated(installed, request, "findings")
    assert "### bench.humid\n\nSeverity: warning.\n\nthe bench is humid: ⟨value⟩ %.\n" in page


def test_estimate_uses_the_estimator_and_tells_what_the_check_found(installed, bench_log, tmp_path):
    command = (
        "-m",
        "vsalog",
        "estimate",
        bench_log,
        "--rig",
        "sea",
        "-e",
        "parabola",
        "--json",
        "--report",
        "page.html",
    )
    joint = json.loads(installed(*command, cwd=tmp_path))["joints"][0]
    assert joint["estimator"] == "parabola"
    (found,) = (f for f in joint["findings"] if f["code"] == "bench.humid")
    # Three seconds at 500 Hz, both ends included.
    assert (found["value"], found["unit"]) == (1501.0, "%")
    assert any("the bench is humid: 1501 %" in words for words in joint["warnings"])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "the bench is humid: 1501 %" in page
    assert "parabola" in page


def test_a_diagnosis_names_the_effect_s_cause_with_its_number(installed, bench_log, tmp_path):
    rig = ("--rig", "sea", "--set", "joint.sea.link.gravity_angle=0.1")
    installed("-m", "vsalog", "diagnose", bench_log, *rig, cwd=tmp_path)
    (cause,) = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["causes"]
    assert (cause["cause"], cause["part"]) == ("link.hanging", "link")
    # The log's link hangs at zero.
    angle = cause["parameters"]["angle"]
    assert abs(angle["value"]) < 3.0 * angle["std"] < 0.05
    assert angle["rig"] == pytest.approx(0.1)


def test_a_package_that_cannot_be_loaded_is_named_and_nothing_else_is_done(bench_log, tmp_path):
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[vsalog.checks]\nleak = nowhere:LEAK\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    command = [sys.executable, "-m", "vsalog", "estimate", str(bench_log), "-o", str(tmp_path / "out.parquet")]
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()[-1:]
    assert "broken" in line
    assert "leak = nowhere:LEAK" in line
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out.parquet").exists()
