"""What stands in an exported model, by the simulator's own reading of it, and what is refused."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.errors import ExportError
from vsalog.effects import effects
from vsalog.effects.base import Effect
from vsalog.effects.counterpart import Counterpart, Term
from vsalog.export import collect
from vsalog.export.bodies import angles_of
from vsalog.export.run import export
from vsalog.export.springs import pieces
from vsalog.mechanics.kinematics import rotation_of
from vsalog.mechanics.rigid_body import mass_matrix
from vsalog.mechanics.transmissions import flexibility_torque
from vsalog.rig import Rig
from vsalog.rig.load import presets

SEA = Rig.load("sea")


def compiled(rig, dialect="mjcf", **options):
    return mujoco.MjModel.from_xml_string(export(rig, dialect, **options).text)


def sea(**keys):
    return SEA.with_settings({f"joint.sea.{key.replace('__', '.')}": value for key, value in keys.items()})


def left_out(rig, dialect):
    return set(export(rig, dialect, leave_out=True).left_out)


def inertia_about(model, joint):
    """Return the inertia about a joint's axis with the others still, from the mass matrix that MuJoCo forms."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    at = model.joint(joint).dofadr[0]
    return full[at, at]


def test_inertias_of_motor_and_link_are_those_of_the_rig():
    rig = sea(motor__side="rotor", motor__gear_ratio="50", motor__inertia="2e-5")
    model = compiled(rig)
    assert inertia_about(model, "sea_motor") == pytest.approx(2e-5 * 50**2, rel=1e-6)
    assert inertia_about(model, "sea_link") == pytest.approx(0.05, rel=1e-6)


@pytest.mark.parametrize(("angle", "q"), [(0.0, 0.6), (0.4, 0.9), (-1.0, 2.0)])
def test_a_link_weighs_what_the_rig_says(angle, q):
    model = compiled(sea(link__gravity_angle=str(angle), link__payload__mass="0.4", link__payload__distance="0.25"))
    data = mujoco.MjData(model)
    data.joint("sea_link").qpos[0] = data.joint("sea_motor").qpos[0] = q
    mujoco.mj_forward(model, data)
    held = data.joint("sea_link").qfrc_bias[0]
    assert held == pytest.approx((3.0 + 0.4 * 9.81 * 0.25) * np.sin(q - angle), rel=1e-9)


@pytest.mark.parametrize("name", ["kuka-kr15", "vsa2-2r"])
def test_a_chain_has_the_mass_matrix_of_the_rig(name):
    rig = Rig.load(name)
    links = [link.joint for link in rig.file.chain.link]
    rig = rig.with_settings({f"joint.{links[0]}.link.payload.mass": "0"} if name == "vsa2-2r" else {})
    model = compiled(rig)
    at = [model.joint(f"{joint}_link").dofadr[0] for joint in links]
    for q in np.random.default_rng(1).uniform(-2.0, 2.0, (5, len(links))):
        data = mujoco.MjData(model)
        for joint, position in zip(links, q, strict=True):
            data.joint(f"{joint}_link").qpos[0] = position
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        assert full[np.ix_(at, at)] == pytest.approx(mass_matrix(rig.file.chain, q), rel=1e-6, abs=1e-7)
    if name == "kuka-kr15":
        motor = [model.joint(f"axis{i}_motor").dofadr[0] for i in (1, 2, 3)]
        assert full[np.ix_(motor, motor)] == pytest.approx(np.diag([40.0, 50.0, 25.0]), rel=1e-9)
        assert full[at[1], motor[2]] == pytest.approx(0.5)


LAWS = {
    "four-bar": ("vsa2", "joint.vsa2.transmission_1", 0.9 * 2.0 * np.arcsin(1.0 / 1.8)),
    "lever": ("awas", "joint.awas.transmission", 0.25 * np.pi),
}


@pytest.mark.parametrize(
    "more", [{}, {"asymmetry": "0.3"}, {"backlash": "0.03"}, {"asymmetry": "-0.2", "backlash": "0.03"}]
)
@pytest.mark.parametrize("law", LAWS)
def test_tendons_are_the_spring_to_a_thousandth(law, more):
    name, key, reach = LAWS[law]
    rig = Rig.load(name).with_settings({f"{key}.{k}": v for k, v in more.items()})
    (joint,) = rig.joints.values()
    spring = getattr(joint, key.rsplit(".", 1)[1])
    arm = joint.lever.start if law == "lever" else None
    found, up_to = pieces(spring, arm, spring.added_cubic, spring.asymmetry, spring.backlash)
    assert up_to == pytest.approx(reach)
    assert len(found) <= 60
    phi = np.linspace(-reach, reach, 501)
    total = np.zeros_like(phi)
    for piece in found:
        x = np.where(phi > piece.high, phi - piece.high, np.where(phi < piece.low, phi - piece.low, 0.0))
        a, b, c = piece.coefficients
        total += a * x + b * x**2 + c * x**3
    assert total == pytest.approx(flexibility_torque(spring, phi, arm), rel=1.1e-3, abs=1e-12)


REFUSED = {
    "joint.sea.link.contact": {"link__contact": "[{start=1,duration=1,torque=2}]"},
    "joint.sea.transmission.drift": {"transmission__drift": "0.1"},
    "joint.sea.motor.torque_step": {"motor__torque_step": "0.1"},
    "joint.sea.motor.friction.load": {"motor__friction__load": "0.1"},
    "joint.sea.link.friction.static": {
        "link__friction__coulomb": "0.1", "link__friction__static": "0.2", "link__friction__stribeck_velocity": "0.1",
    },
    "joint.sea.transmission.damping": {"transmission__damping": "0.1", "transmission__backlash": "0.02"},
    "joint.sea.transmission.slip": {"transmission__slip": "[{stiffness=1,limit=1}]", "transmission__backlash": "0.02"},
    "joint.sea.transmission.bouc_wen": {"transmission__bouc_wen": "{torque=1,width=0.1,exponent=2}"},
}  # fmt: skip


@pytest.mark.parametrize("key", REFUSED)
def test_what_mjcf_lacks_is_refused_by_its_key_or_left_out(key):
    rig = sea(**REFUSED[key])
    with pytest.raises(ExportError, match=key.replace(".", r"\.")):
        export(rig, "mjcf")
    model = export(rig, "mjcf", leave_out=True)
    assert set(model.left_out) == {key}
    assert f"left out: {key}: " in model.text
    assert mujoco.MjModel.from_xml_string(model.text).nu == 1


def test_a_key_of_which_no_effect_says_anything_is_refused(monkeypatch):
    silent = {
        name: effect._replace(counterparts=()) if name == "cogging" else effect for name, effect in effects().items()
    }
    rig = sea(motor__cogging="[{torque=0.3,order=7}]")
    assert not left_out(rig, "mjcf")
    monkeypatch.setattr(collect, "effects", lambda: silent)
    with pytest.raises(ExportError, match=r"joint\.sea\.motor\.cogging"):
        export(rig, "mjcf")


def test_an_effect_that_is_added_says_what_it_becomes(monkeypatch):
    told = Counterpart("link", ("contact",), lambda link: (Term("joint", {"damping": 0.25}),))
    monkeypatch.setattr(collect, "effects", lambda: {**effects(), "new": Effect(counterparts=(told,))})
    model = compiled(sea(**REFUSED["joint.sea.link.contact"]))
    assert model.joint("sea_link").damping[0] == pytest.approx(0.1 + 0.25)


@pytest.mark.parametrize("dialect", ["mjcf", "urdf"])
@pytest.mark.parametrize("name", sorted({*presets()} - {"pam"}))
def test_every_preset_is_a_model_once_what_lacks_is_left_out(name, dialect):
    model = compiled(Rig.load(name), dialect, leave_out=True)
    assert model.njnt >= len(Rig.load(name).joints)


def test_pneumatic_joints_are_refused_as_a_whole():
    for leave_out in (False, True):
        with pytest.raises(ExportError, match=r"joint\.pam: it is moved by compressed air"):
            export(Rig.load("pam"), "mjcf", leave_out=leave_out)
    both = replace(SEA, file=type(SEA.file)(joint={**SEA.joints, **Rig.load("pam").joints}))
    assert left_out(both, "mjcf") == {"joint.pam"}


def test_a_spring_of_unknown_law_is_refused():
    with pytest.raises(ExportError, match=r"give transmission\.type"):
        export(sea(transmission="{type='unknown'}"), "mjcf")


def test_a_joint_without_inertia_is_refused_by_what_lacks():
    text = '[joint.a]\nkind = "elastic"\ntransmission = { type = "linear", stiffness = 1 }\n'
    with pytest.raises(ExportError, match=r"joint 'a' has no link to move: give 'link\.inertia'"):
        export(Rig.from_toml(text), "mjcf")
    with pytest.raises(ExportError, match=r"motor has no inertia: give 'motor\.inertia'"):
        export(Rig.from_toml(text + "link = { inertia = 1 }"), "mjcf")
    with pytest.raises(ExportError, match="there is no joint to export"):
        export(Rig.from_toml('name = "x"'), "urdf")


def test_an_inertia_that_no_body_has_is_refused():
    rig = Rig.load("kuka-kr15").with_setting("chain.link[1].inertia", "[0.1, 0.1, 3.0]")
    with pytest.raises(ExportError, match=r"chain\.link\[1\]\.inertia"):
        export(rig, "mjcf")


def test_a_joint_next_to_a_chain_in_another_gravity_loses_its_weight():
    arm = Rig.load("vsa2-2r")
    both = replace(arm, file=type(arm.file)(joint={**arm.joints, **SEA.joints}, chain=arm.file.chain))
    assert not left_out(both, "mjcf")
    model = compiled(both)
    data = mujoco.MjData(model)
    data.joint("sea_link").qpos[0] = data.joint("sea_motor").qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    assert data.joint("sea_link").qfrc_bias[0] == pytest.approx(3.0 * np.sin(0.5), rel=1e-9)
    floating = both.with_setting("chain.gravity", "[0, 0, 0]")
    assert left_out(floating, "mjcf") == {"joint.sea.link.gravity_torque"}


RIGID = """
[joint."left knee"]
kind = "rigid"
motor = { side = "rotor", gear_ratio = 20, inertia = 1e-4, damping = 1e-4, friction.coulomb = 0.01 }
link = { inertia = 0.05, damping = 0.05, gravity_torque = 2.0, friction.coulomb = 0.1, payload = { mass = 0.5, distance = 0.2 } }
"""


def test_a_rigid_joint_is_whole_in_urdf():
    exported = export(Rig.from_toml(RIGID), "urdf")
    root = ET.fromstring(exported.text)
    assert exported.left_out == {}
    dynamics = root.find("joint/dynamics").attrib
    assert float(dynamics["damping"]) == pytest.approx(0.05 + 1e-4 * 400)
    assert float(dynamics["friction"]) == pytest.approx(0.1 + 0.01 * 20)
    assert root.findtext("transmission/actuator/mechanicalReduction") == "20"
    model = mujoco.MjModel.from_xml_string(exported.text)
    assert inertia_about(model, "left_knee") == pytest.approx(0.05 + 1e-4 * 400 + 0.5 * 0.2**2, rel=1e-6)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.7
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias[0] == pytest.approx((2.0 + 0.5 * 9.81 * 0.2) * np.sin(0.7), rel=1e-6)


def test_a_chain_hangs_in_urdf_as_in_mjcf():
    rig = Rig.load("vsa2-2r")
    first, second = compiled(rig), compiled(rig, "urdf", leave_out=True)
    for q in ([0.3, 0.5], [-1.0, 2.0]):
        held = []
        for model, names in ((first, ("shoulder_link", "elbow_link")), (second, ("shoulder", "elbow"))):
            data = mujoco.MjData(model)
            for name, position in zip(names, q, strict=True):
                data.joint(name).qpos[0] = position
            mujoco.mj_forward(model, data)
            held.append([data.joint(name).qfrc_bias[0] for name in names])
        assert held[0] == pytest.approx(held[1], rel=1e-6)


def test_what_urdf_lacks():
    rig = sea(
        motor__torque_gain="1.1", motor__torque_offset="0.1", motor__torque_delay="0.01", motor__torque_constant="0.1",
        motor__cogging="[{torque=1,order=1}]", link__friction__load="0.1",
    )  # fmt: skip
    keys = ("motor.torque_gain", "motor.torque_offset", "motor.torque_delay", "motor.torque_constant", "motor.cogging")
    assert left_out(rig, "urdf") == {f"joint.sea.{key}" for key in (*keys, "link.friction.load", "transmission")}
    kuka = left_out(Rig.load("kuka-kr15").with_setting("chain.gravity", "[0, 0, -1.6]"), "urdf")
    assert {"chain.coupling[0]", "chain.gravity", "joint.axis1.motor.inertia"} < kuka


@given(st.lists(st.floats(-np.pi, np.pi), min_size=3, max_size=3))
def test_angles_give_the_rotation_back(angles):
    rotation = rotation_of(angles)
    assert rotation_of(angles_of(rotation)) == pytest.approx(rotation, abs=1e-7)


@given(st.text(min_size=1, max_size=8), st.text(max_size=20))
def test_any_names_make_a_document(joint, name):
    file = SEA.file
    rig = replace(
        SEA, file=type(file)(name=name, joint={joint: file.joint["sea"], f"{joint}-": file.joint["sea"]}), where=name
    )
    assert mujoco.MjModel.from_xml_string(export(rig, "mjcf").text).nu == 2
