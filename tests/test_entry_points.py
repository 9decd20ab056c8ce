"""A package of a third party with one of each kind: where the commands and the generated pages have them."""

import json
import os
import subprocess
import sys
from zlib import crc32

import numpy as np
import pytest
from command_line import vsalog_run
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.share(3)

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
DRAG = '''
from typing import Annotated

from msgspec.structs import replace

from vsalog.core.quantities import quantity
from vsalog.effects.base import BodyTorque, Default, Effect, Key, OneNumber

Coefficient = Annotated[float, quantity("N*m*s^2/rad^2", "torque per velocity squared", ge=0.0)]
SPEED = 10.0  # that a link's drag is followed to [rad/s]


class Drag(BodyTorque, frozen=True):
    """Drag of air or water.

    Attributes
    ----------
    coefficient : torque per velocity squared [N·m·s²/rad²]
    """

    coefficient: Coefficient = 0.0

    @staticmethod
    def formula(x, v, t, p, at):
        return -p[at] * v * abs(v)

    def numbers(self, ratio):
        return (self.coefficient,)

    def slopes(self, ratio):
        return 0.0, 2.0 * self.coefficient * SPEED

    def geared(self, ratio):
        return replace(self, coefficient=self.coefficient * ratio**3)


EFFECT = Effect(
    keys=(Key("link", "drag", Drag, "drag of air or water"), Key("motor", "fan", Drag, "drag of a fan")),
    tolerances=(Default(("drag.coefficient",), "nobody has measured it", share=0.5, share_of_scale=0.1),),
    causes=(OneNumber(
        name="link.drag", place="link", key="drag.coefficient", number="coefficient", unit="N*m*s^2/rad^2", low=0.0,
        step=lambda s: 1e-3 * s.torque / s.speed**2, scale=lambda s: s.torque / s.speed**2,
        title="The {part} is slowed by air or water", says="the link's equation is off by the square of its velocity",
        confirm="Take the paddle off.", reference="any book on fluids", signature="link equation: v |v|",
    ),),
)
'''
RIPPLE = '''
from typing import Annotated, ClassVar

import numpy as np
from msgspec.structs import replace

from vsalog.core.quantities import AngleWidth
from vsalog.effects.base import Default, Effect, Key, OneNumber
from vsalog.effects.reading_error import ReadingError

CYCLES = 16.0  # per turn


class Ripple(ReadingError, frozen=True):
    """An encoder whose sine and cosine are of unequal size.

    Attributes
    ----------
    amplitude : [rad]
    """

    UNIT: ClassVar[str] = "rad"

    amplitude: AngleWidth = 0.0

    def error(self, x):
        return self.amplitude * np.sin(CYCLES * x)

    def slope(self, x):
        return CYCLES * self.amplitude * np.cos(CYCLES * x)

    def curvature(self, x):
        return -(CYCLES**2) * self.error(x)

    @property
    def largest(self):
        return self.amplitude, CYCLES * self.amplitude

    def scaled(self, factor):
        return replace(self, amplitude=self.amplitude * factor)


EFFECT = Effect(
    keys=(Key("signal", "ripple", Ripple, "of an encoder that interpolates"),),
    tolerances=(Default(("ripple.amplitude",), "its data sheet", least="0.2 deg"),),
    causes=(OneNumber(
        name="sensor.ripple", place="encoder", key="ripple.amplitude", number="amplitude", unit="rad", low=0.0,
        step=1e-5, scale=lambda s: s.deflection,
        title="The {part} encoder interpolates unevenly", says="the deflection is off by a short wave of the position",
        confirm="Turn it slowly.", reference="its data sheet", signature="all equations with the deflection: sin(16 x)",
    ),),
)
'''
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
drag = drag
ripple = ripple
[vsalog.causes]
magnet = magnet
[vsalog.checks]
humidity = humidity:HUMIDITY
[vsalog.estimators]
parabola = parabola
"""
PAGE = "import runpy, sys; print(*runpy.run_path(sys.argv[1])['pages']().values())"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the package as pip lays it out; returns what runs Python with it."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "bench-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bench\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    for name, source in {
        "hanging": EFFECT,
        "magnet": CAUSE,
        "humidity": CHECK,
        "parabola": ESTIMATOR,
        "drag": DRAG,
        "ripple": RIPPLE,
    }.items():
        module = folder / f"{name}.py"
        module.write_text(source, encoding="utf-8")
        # What is compiled for a formula is known again by when its file was written.
        os.utime(module, (crc32(source.encode()),) * 2)
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


@pytest.fixture(scope="module")
def paddle_log(tmp_path_factory):
    """A paddle under water on a spring, a fan on the motor, and an encoder with a ripple, by equations of their own."""
    inertia, damping, spring, link, bearing, drag, fan, ripple = 0.05, 0.1, 30.0, 0.04, 0.05, 0.02, 0.01, 2e-3
    seconds = np.arange(0.0, 8.0, 2e-3)

    def driven(t):
        return 3.0 * np.sin(2.0 * np.pi * 0.9 * t) + 2.0 * np.sin(2.0 * np.pi * 2.3 * t + 1.0)

    def rate(t, s):
        theta, q, dtheta, dq = s
        torque = spring * (q - theta)
        ddtheta = (driven(t) + torque - damping * dtheta - fan * dtheta * abs(dtheta)) / inertia
        return [dtheta, dq, ddtheta, (-torque - bearing * dq - drag * dq * abs(dq)) / link]

    theta, q = solve_ivp(rate, (0.0, 8.0), [0.0] * 4, "DOP853", seconds, rtol=1e-10, atol=1e-12).y[:2]
    noise = np.random.default_rng(5).normal(0.0, 0.01, (2, seconds.size))
    step = 2.0 * np.pi / 2**17

    def counted(angle):
        return np.round(angle / step) * step

    columns = {
        "time": seconds, "motor": counted(theta + ripple * np.sin(16.0 * theta)), "link": counted(q),
        "torque": driven(seconds) + noise[0], "sensor": spring * (q - theta) + noise[1],
    }  # fmt: skip
    folder = tmp_path_factory.mktemp("paddle")
    np.savetxt(
        folder / "log.csv", np.stack([*columns.values()], axis=1), "%.9g", ",", header=",".join(columns), comments=""
    )
    (folder / "rig.toml").write_text(
        f"""
        [joint.paddle]
        kind = "elastic"
        motor = {{ inertia = {inertia}, damping = {damping}, fan.coefficient = {fan} }}
        transmission = {{ type = "linear", stiffness = {spring} }}
        link = {{ inertia = {link}, damping = {bearing} }}
        [joint.paddle.signals]
        motor_position = {{ channel = "motor", resolution = {step}, ripple.amplitude = {ripple} }}
        link_position = {{ channel = "link", resolution = {step} }}
        motor_torque = {{ channel = "torque", noise = 0.01 }}
        torque_sensor = {{ channel = "sensor", noise = 0.01 }}
        """,
        encoding="utf-8",
    )
    return folder / "log.csv"


def generated(installed, request, name):
    return installed("-c", PAGE, request.config.rootpath / "docs" / f"make_{name}.py")


def test_help_and_the_command_line_s_page_list_the_estimator(installed, request):
    assert "parabola" in installed("-m", "vsalog", "estimate", "--help")
    assert "parabola" in generated(installed, request, "cli")


def test_the_causes_page_has_the_effect_s_cause_and_the_cause(installed, request):
    page = generated(installed, request, "causes")
    assert "## link.hanging\n\nThe link hangs at another angle than the rig says.\n" in page
    assert "- Parameters: `angle` [rad]\n" in page
    assert "## motor.magnet\n\nA magnet of the motor is loose.\n" in page


def test_the_findings_page_has_the_check_s_code(installed, request):
    page = generated(installed, request, "findings")
    assert "## bench.humid\n\nSeverity: warning.\n\nthe bench is humid: ⟨value⟩ %.\n" in page


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


def test_a_diagnosis_finds_the_effects_that_one_file_each_adds(installed, paddle_log, tmp_path):
    rig = ("--rig", paddle_log.with_name("rig.toml"), "--set", "joint.paddle.signals.motor_position.ripple.amplitude=0")
    installed("-m", "vsalog", "diagnose", paddle_log, *rig, cwd=tmp_path)
    causes = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["causes"]
    found = {(cause["cause"], cause["part"]): cause["parameters"] for cause in causes}
    assert found.keys() == {("link.drag", "link"), ("sensor.ripple", "motor_position")}
    coefficient = found["link.drag", "link"]["coefficient"]
    assert coefficient["value"] == pytest.approx(0.02, abs=3.0 * coefficient["std"])
    assert 0.0 < coefficient["std"] < 0.001
    amplitude = found["sensor.ripple", "motor_position"]["amplitude"]
    assert amplitude["value"] == pytest.approx(2e-3, abs=3.0 * amplitude["std"])
    assert 0.0 < amplitude["std"] < 2e-4
    extended = (tmp_path / "extended.rig.toml").read_text(encoding="utf-8")
    assert "[joint.paddle.link.drag]" in extended
    assert "[joint.paddle.signals.motor_position.ripple]" in extended


def test_a_simulation_has_the_effect_that_one_file_adds(installed, paddle_log, tmp_path):
    rig = ("--rig", paddle_log.with_name("rig.toml"), "--set", "joint.paddle.link.drag.coefficient=0.02")
    installed("-m", "vsalog", "diagnose", paddle_log, *rig, cwd=tmp_path)
    found = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["causes"] == []


def test_an_estimate_subtracts_the_motor_s_effect(installed, paddle_log, tmp_path):
    """The spring is computed from the motor's side, which the fan is part of."""
    command = ("-m", "vsalog", "estimate", paddle_log, "--rig", paddle_log.with_name("rig.toml"), "--json")
    told = ("-e", "residual-rls", "--tune", "modality=RESIDUAL")

    def off(*setting):
        (joint,) = json.loads(installed(*command, *told, *setting, cwd=tmp_path))["joints"]
        (one, _) = joint["summary"]["transmissions"]
        return max(abs(one[key] / 30.0 - 1.0) for key in ("stiffness_low", "stiffness_high"))

    assert off() < 0.01
    assert off("--set", "joint.paddle.motor.fan.coefficient=0") > 0.02


def test_the_rig_s_schema_has_the_effect_s_keys(installed):
    schema = json.loads(installed("-m", "vsalog.rig.schema_file"))["$defs"]
    assert schema["Link"]["properties"]["drag"]["description"] == "drag of air or water"
    assert schema["Motor"]["properties"]["fan"]["description"] == "drag of a fan"
    assert schema["Signal"]["properties"]["ripple"]["description"] == "of an encoder that interpolates"
    assert "| `drag.coefficient` | ± 50 %, at least 10 % of scale" in installed("-m", "vsalog.rig.tolerance")


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
