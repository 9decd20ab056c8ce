"""The external stiffness, against the equilibria that a solver finds with the motors held (Flacco 2012 eq. 3, 6)."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from scipy.optimize import brentq

from vsalog.core.trace import EXTRA_UNITS
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

pytestmark = pytest.mark.share(3)

ROWS = slice(2500, None, 400)
EXTERNAL = "external_stiffness"


def played(rig, scenario, seconds=5.0):
    return simulate(rig.file, Scenario.find(scenario, rig.file).inputs(rig.file), seconds, ideal=True)


def estimated(rig, experiment, name, method="direct", **options):
    joint = rig.joints[name]
    choice = choose(name, joint, method, {}, rig.file)
    return estimate_joint([experiment.recording()], name, joint, choice, rig=rig.file, **options)


def vsa2_torque(phi, k=0.5, c=1.8):
    """Flacco 2012 eq. 47–48."""
    lever = c * np.sin(phi / 2.0)
    slope = 0.5 * c * np.cos(phi / 2.0) / np.sqrt(1.0 - lever**2) - 0.5
    return 2.0 * k * (np.arcsin(lever) - phi / 2.0) * slope


def by_equilibrium(torque, q):
    """∂τ_ext/∂q: the link is pushed to either side, and a solver finds where it comes to rest."""
    push, found = 1e-5, []
    for sign in (-1.0, 1.0):
        wanted = torque(q) + sign * push
        found.append(brentq(lambda x, wanted=wanted: torque(x) - wanted, q - 1e-3, q + 1e-3, xtol=1e-14))
    return 2.0 * push / (found[1] - found[0])


@pytest.fixture(scope="module")
def vsa2():
    rig = Rig.preset("vsa2").with_settings({"joint.vsa2.link.gravity_angle": "25 deg"})
    return rig, played(rig, "vsa2-exp1")


@pytest.mark.parametrize("method", ["direct", "residual-rls"])
def test_it_is_what_equilibria_with_held_motors_show(vsa2, method):
    rig, experiment = vsa2
    total = estimated(rig, experiment, "vsa2", method).trace["total"]
    truth = experiment.joints["vsa2"].truth
    expected = np.array(
        [
            by_equilibrium(
                lambda x, held=held: (
                    sum(vsa2_torque(x - theta) for theta in held) + 0.06 * np.sin(x - np.radians(25.0))
                ),
                q,
            )
            for q, *held in zip(
                *(truth[k][ROWS] for k in ("link_position", "motor_position_1", "motor_position_2")), strict=True
            )
        ]
    )
    assert np.ptp(expected - truth["stiffness_total"][ROWS]) > 0.002  # gravity's share changes with the position
    sure = total["excited"][ROWS]
    assert sure.sum() >= 5
    assert np.all(np.abs(total[EXTERNAL][ROWS] / expected - 1.0)[sure] < 0.03)


def test_in_an_arm_the_other_links_count_and_what_they_carry():
    rig = Rig.preset("vsa2-2r")
    experiment = played(rig, "vsa2-2r-exp1", 3.0)
    truths = {name: record.truth for name, record in experiment.joints.items()}
    q1, q2 = (truths[name]["link_position"] for name in ("shoulder", "elbow"))

    def energy(a, b):
        """Two rods of 0.1 kg and 0.5 m and the second actuator of 0.345 kg; the arm hangs at zero (Flacco 2012 §6.3)."""
        near, elbow, far = 0.25 * np.cos(a), 0.5 * np.cos(a), 0.5 * np.cos(a) + 0.25 * np.cos(a + b)
        return -9.81 * (0.1 * near + 0.345 * elbow + 0.1 * far)

    h = 1e-4
    slopes = {
        "shoulder": (energy(q1 + h, q2) - 2.0 * energy(q1, q2) + energy(q1 - h, q2)) / h**2,
        "elbow": (energy(q1, q2 + h) - 2.0 * energy(q1, q2) + energy(q1, q2 - h)) / h**2,
    }
    for name, slope in slopes.items():
        total = estimated(rig, experiment, name).trace["total"]
        known = np.isfinite(total["stiffness"])
        found = (total[EXTERNAL] - total["stiffness"])[known]
        assert found == pytest.approx(slope[known], abs=2e-5 * np.abs(slope).max())


def test_its_deviation_counts_how_well_the_weight_is_known(vsa2):
    rig, experiment = vsa2
    q = experiment.joints["vsa2"].truth["link_position"] - np.radians(25.0)
    found = {}
    for name, stated in {"usual": {}, "exact": {"link.gravity_torque": 0.0, "link.gravity_angle": 0.0}}.items():
        total = estimated(rig, experiment, "vsa2", stated=stated).trace["total"]
        known = np.isfinite(total["stiffness_std"])
        found[name] = (total[f"{EXTERNAL}_std"] ** 2 - total["stiffness_std"] ** 2)[known]
    assert found["exact"] == pytest.approx(0.0, abs=1e-12)
    # 10 % of the weight and 2° at 95 %: docs/reference/rig.
    q = q[known]
    usual = (0.06 * 0.1 / 1.96 * np.cos(q)) ** 2 + (0.06 * np.radians(2.0) / 1.96 * np.sin(q)) ** 2
    assert found["usual"] == pytest.approx(usual, rel=1e-3)


DEFLECTION = {"joint.sea.signals.deflection": "/deflection.data"}


def test_a_position_that_the_method_does_not_read_is_used_all_the_same():
    """A deflection is measured itself; the link's encoder, five times as slow, tells where the weight hangs."""
    rig = Rig.preset("sea").with_settings({**DEFLECTION, "joint.sea.signals.link_position": "/link.data"})
    experiment = played(rig, "sines", 4.0)
    recording = experiment.recording()
    whole = recording.channels["/link.data"]
    recording.channels["/link.data"] = replace(whole, stamps=whole.stamps[::5], values=whole.values[::5])
    joint = rig.joints["sea"]
    choice = choose("sea", joint, "direct", {}, rig.file)
    assert "link_position" not in choice.roles
    total = estimate_joint([recording], "sea", joint, choice, rig=rig.file).trace["total"]
    slope = total[EXTERNAL] - total["stiffness"]
    q = experiment.joints["sea"].truth["link_position"]
    known = np.isfinite(slope)
    assert known[10:-10].all()
    assert slope[known] == pytest.approx(3.0 * np.cos(q[known]), abs=2e-3)


@pytest.mark.parametrize("lacking", ["gravity", "position"])
def test_without_gravity_or_a_position_there_is_none(lacking):
    rig = Rig.preset("sea").with_settings(DEFLECTION)
    if lacking == "gravity":
        rig = rig.with_settings({"joint.sea.link.gravity_torque": "0 N*m"})
    else:
        joint = rig.joints["sea"]
        signals = changed(joint.signals, link_position=None)
        rig = rig.with_joints({"sea": changed(joint, signals=signals)})
    found = estimated(rig, played(rig, "sines", 2.0), "sea")
    assert EXTERNAL not in found.trace["total"]
    assert found.summary.transmissions[-1].external_stiffness_low is None


def test_its_unit_is_in_the_file(vsa2):
    rig, experiment = vsa2
    table = estimated(rig, experiment, "vsa2").trace.to_table()
    for column in (EXTERNAL, f"{EXTERNAL}_std"):
        assert table.schema.field(column).metadata[b"unit"].decode() == EXTRA_UNITS[column] == "N*m/rad"
    of_one = table.filter(table["transmission"].cast("string").to_numpy(zero_copy_only=False) == "1")
    assert of_one[EXTERNAL].null_count == len(of_one)
