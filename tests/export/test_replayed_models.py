"""MuJoCo, driven by a simulated log's motor torques, moves as vsalog simulated.

Each effect is also left out of the model, which shows: what it does is not within the tolerance.
"""

import numpy as np
import pytest
from replayed import moved, off, recorded, replay

from vsalog.core.errors import ExportError
from vsalog.export.run import export
from vsalog.rig import Rig
from vsalog.rig.load import presets
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

TOLERANCE = 0.01
EXPORTED = sorted({*presets()} - {"pam", "awas"})


@pytest.mark.parametrize("scenario", ["sines", None])
@pytest.mark.parametrize("preset", EXPORTED)
def test_presets_move_alike(preset, scenario):
    rig, time, channels = recorded(preset, scenario=scenario, duration=3.0)
    pairs = replay(rig, rig, time, channels)
    assert len(pairs) >= 2
    assert {name: error for name, pair in pairs.items() if (error := off(pair)) > TOLERANCE} == {}


def test_a_lever_that_is_held_is_a_spring():
    """The experiment of the preset holds its secondary motor."""
    rig, time, channels = recorded("awas", duration=3.0)
    pairs = replay(rig, rig, time, channels, leave_out=True)
    assert {name: error for name, pair in pairs.items() if (error := off(pair)) > TOLERANCE} == {}


GEARED = {"motor.side": "rotor", "motor.gear_ratio": "20", "motor.inertia": "2e-4", "motor.damping": "1e-3"}
BRISTLES = {"motor.friction.coulomb": "0.3", "motor.friction.presliding_stiffness": "100"}
# Keys below joint.sea, and which of them are the effect; the others are there with and without it.
EFFECTS = {
    "motor inertia": ({"motor.inertia": "0.3"}, None),
    "motor damping": ({"motor.damping": "1.2"}, None),
    "motor friction": ({"motor.friction.coulomb": "0.5"}, None),
    "motor friction behind a gear": ({**GEARED, "motor.friction.coulomb": "0.02"}, GEARED),
    "link inertia": ({"link.inertia": "0.1"}, None),
    "link damping": ({"link.damping": "0.5"}, None),
    "link friction": ({"link.friction.coulomb": "0.1"}, None),
    "bristles": ({**BRISTLES, "motor.friction.presliding_damping": "1"}, None),
    "bristles and a falling level": (
        {**BRISTLES, "motor.friction.static": "0.6", "motor.friction.stribeck_velocity": "0.1"}, None,
    ),
    "backlash": ({"transmission.backlash": "0.02"}, None),
    "transmission damping": ({"transmission.damping": "0.3"}, None),
    "asymmetry": ({"transmission.asymmetry": "0.3"}, None),
    "asymmetry and backlash": ({"transmission.asymmetry": "0.3", "transmission.backlash": "0.02"}, None),
    "added cubic": ({"transmission.added_cubic": "1500"}, None),
    "loop": ({"transmission.bouc_wen.torque": "0.3", "transmission.bouc_wen.width": "0.02"}, None),
    "slip": ({"transmission.slip": "[{stiffness=30,limit=0.3},{stiffness=20,limit=0.1}]"}, None),
    "exponential": ({"transmission": "{type='exponential',stiffness=20,scale=0.05}"}, None),
    "even powers": ({"transmission": "{type='polynomial',coefficients=[2.0,0.2,0.5],scale=0.1}"}, None),
    "even and high powers": ({"transmission": "{type='polynomial',coefficients=[2,0.5,0,0.3,0.3],scale=0.1}"}, None),
    "four-bar with a gap": ({"transmission": "{type='vsa2',stiffness=100,geometry=1.8,backlash=0.02}"}, None),
    "gravity angle": ({"link.gravity_angle": "0.7"}, None),
    "gravity upside down": ({"link.gravity_torque": "-1.0"}, None),
    "no gravity": ({"link.gravity_torque": "0"}, None),
    "payload": ({"link.payload.mass": "0.5", "link.payload.distance": "0.3"}, None),
    "payload in a horizontal plane": (
        {"link.gravity_torque": "0", "link.payload.mass": "0.5", "link.payload.distance": "0.3"},
        {"link.gravity_torque": "0"},
    ),
    "delay": ({"motor.torque_delay": "0.02"}, None),
    "delay of no whole step": ({"motor.torque_delay": "0.0173"}, None),
    "torque gain": ({"motor.torque_gain": "1.3"}, None),
    "torque offset": ({"motor.torque_offset": "0.4"}, None),
    "gear": ({**GEARED, "motor.gear_ratio": "30"}, None),
    "cogging": ({"motor.cogging": "[{torque=0.3,order=7,phase=0.4}]"}, None),
    "cogging behind a gear": ({**GEARED, "motor.cogging": "[{torque=0.03,order=3.5,phase=0.4}]"}, GEARED),
}  # fmt: skip


def below_sea(keys):
    return {f"joint.sea.{key}": value for key, value in keys.items()}


def deflected(pairs):
    return tuple(link - motor for link, motor in zip(pairs["sea_link"], pairs["sea_motor"], strict=True))


@pytest.mark.parametrize("effect", EFFECTS)
def test_effects_act_alike(effect):
    keys, without = EFFECTS[effect]
    rig, time, channels = recorded("sea", scenario="sines", duration=4.0, set=below_sea(keys))
    pairs = replay(rig, rig, time, channels)
    assert off(pairs["sea_motor"]) < TOLERANCE
    assert off(pairs["sea_link"]) < TOLERANCE
    assert off(deflected(pairs)) < TOLERANCE
    bare = replay(Rig.load("sea").with_settings(below_sea(without or {})), rig, time, channels)
    assert max(off(bare["sea_motor"]), off(bare["sea_link"]), off(deflected(bare))) > 2.0 * TOLERANCE


def test_a_motor_that_is_recorded_in_ampere_is_driven_by_current():
    keys = {"motor.torque_constant": "0.05", "motor.gear_ratio": "20", "signals.motor_torque": "{channel='i',unit='A'}"}
    rig, time, channels = recorded("sea", scenario="sines", duration=2.0, set=below_sea(keys))
    assert max(map(off, replay(rig, rig, time, channels).values())) < TOLERANCE


def test_motors_that_others_carry_push_them():
    """The coupling of the arm is large here: without it the model is off."""
    keys = {"chain.coupling[0].inertia": "12", "joint.axis3.motor.inertia": "25"}
    rig, time, channels = recorded("kuka-kr15", scenario="sines", duration=2.0, set=keys)
    assert max(map(off, replay(rig, rig, time, channels).values())) < TOLERANCE
    bare = replay(rig.with_setting("chain.coupling[0].inertia", "0"), rig, time, channels)
    assert max(map(off, bare.values())) > 2.0 * TOLERANCE


RIGID = """
[joint.knee]
kind = "rigid"
[joint.knee.motor]
inertia = 0.02
damping = 0.1
friction = { coulomb = 0.2 }
[joint.knee.link]
inertia = 0.05
damping = 0.05
gravity_torque = 2.0
gravity_angle = 0.3
friction = { coulomb = 0.1 }
"""
TIME = np.arange(3001) * 1e-3
TORQUE = 1.5 * np.sin(2.0 * np.pi * 0.7 * TIME) + 0.8 * np.sin(2.0 * np.pi * 1.9 * TIME)


@pytest.mark.parametrize("more", ["", "[joint.knee.motor.friction]\npresliding_stiffness = 200\ncoulomb = 0.2"])
def test_a_rigid_joint_moves_as_one(more):
    text = RIGID.replace("friction = { coulomb = 0.2 }\n", "" if more else "friction = { coulomb = 0.2 }\n") + more
    rig = Rig.from_toml(text)
    truth = play(build(rig.joints), {"knee": {"motor_torque": lambda t: np.interp(t, TIME, TORQUE)}}, TIME)["knee"]
    start = {"knee_link": float(truth["link_position"][0])}
    found = moved(export(rig, "mjcf").text, TIME, start, {"knee_motor": TORQUE})
    assert off((truth["link_position"], found["knee_link"])) < TOLERANCE
    assert np.ptp(truth["link_position"]) > 0.5


@pytest.mark.parametrize("kind", ["rigid", "elastic"])
@pytest.mark.parametrize("more", ["", "torque_limit = 1.5", "delay = 0.02"])
def test_a_drive_that_is_commanded_a_position(kind, more):
    text = f"""
    [joint.a]
    kind = "{kind}"
    [joint.a.motor]
    inertia = 0.02
    damping = 0.1
    torque_gain = 0.9
    [joint.a.link]
    inertia = 0.03
    gravity_torque = 0.4
    [joint.a.drive]
    kind = "position-servo"
    kp = 10.0
    kd = 0.5
    {more}
    [joint.a.signals]
    commanded_position = "command"
    link_position = "link"
    """
    spring = "[joint.a.transmission]\ntype = 'linear'\nstiffness = 60.0" if kind == "elastic" else ""
    rig = Rig.from_toml(text + spring)
    time = np.arange(3000) * 1e-3
    command = 0.3 * np.sin(2.0 * np.pi * time) + 0.1 * np.sin(11.0 * time)
    truth = play(build(rig.joints), {"a": {"commanded_position": command}}, time)["a"]
    start = {"a_link": truth["link_position"][0]}
    found = moved(export(rig, "mjcf").text, time, start, {"a_motor": command})
    assert off((truth["link_position"], found["a_link"])) < TOLERANCE
    without = moved(
        export(rig.with_settings({"joint.a.drive.kd": "0.4"}), "mjcf").text, time, start, {"a_motor": command}
    )
    assert off((truth["link_position"], without["a_link"])) > TOLERANCE


@pytest.mark.parametrize(
    "key", ["ki = 1.0", "speed_limit = 3.0", "acceleration_limit = 30.0", "resolution = 0.01", "period = 0.01"]
)
def test_what_a_drive_has_that_mjcf_lacks(key):
    text = "[joint.a]\nkind = 'rigid'\nmotor.inertia = 0.02\n[joint.a.drive]\nkind = 'position-servo'\nkp = 10.0\n"
    with pytest.raises(ExportError, match=key.partition(" ")[0]):
        export(Rig.from_toml(text + key), "mjcf")
