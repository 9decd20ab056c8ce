"""Packages of third parties: an effect with a cause, and a cause with code of its own, in the manual and in a diagnosis."""

import json
import os
import subprocess
import sys

import pytest
from written_out import ELASTIC, Truth, log, write_csv

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
POINTS = "[vsalog.effects]\nhanging = hanging\n\n[vsalog.causes]\nmagnet = magnet\n"
MANUAL = "import runpy, sys; print(runpy.run_path(sys.argv[1])['reference']())"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with a package as pip lays it out; returns what runs Python with it."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "hanging-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hanging\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    (folder / "hanging.py").write_text(EFFECT, encoding="utf-8")
    (folder / "magnet.py").write_text(CAUSE, encoding="utf-8")
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(*args, cwd=folder):
        environment = {**os.environ, "PYTHONPATH": path}
        command = [sys.executable, *map(str, args)]
        return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, encoding="utf-8", check=True)

    return run


def test_the_manual_has_them(installed, request):
    manual = installed("-c", MANUAL, request.config.rootpath / "docs" / "make_causes.py").stdout
    assert "### link.hanging\n\nThe link hangs at another angle than the rig says.\n" in manual
    assert "- Parameters: `angle` [rad]\n" in manual
    assert "### motor.magnet\n\nA magnet of the motor is loose.\n" in manual


def test_a_diagnosis_names_it_with_its_number(installed, tmp_path):
    time, said = log(Truth(), duration=6.0)
    write_csv(tmp_path / "log.csv", time, said)
    rig = ELASTIC.replace("gravity_torque = 1.5", "gravity_torque = 1.5\ngravity_angle = 0.1")
    (tmp_path / "rig.toml").write_text(rig, encoding="utf-8")
    installed("-m", "vsalog", "diagnose", "log.csv", "--rig", "rig.toml", cwd=tmp_path)
    document = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    (cause,) = document["causes"]
    assert (cause["cause"], cause["part"]) == ("link.hanging", "link")
    # The log's link hangs at zero.
    angle = cause["parameters"]["angle"]
    assert abs(angle["value"]) < 3.0 * angle["std"] < 0.05
    assert angle["rig"] == pytest.approx(0.1)
