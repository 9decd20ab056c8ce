"""Every cause of the catalogue: it has its name and its words, and what it puts into a rig is a rig that plays."""

import re
import runpy
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest

from vsalog.core.notation import part_name
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Parameter, Remainder, Setting, Site
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.run import bound_as_recorded
from vsalog.diagnosis.selection import remainder
from vsalog.diagnosis.setting import setting_of
from vsalog.report.diagnosis_sentences import title_of
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint
from vsalog.residuals.system import build_system
from vsalog.rig import Rig
from vsalog.simulation import simulate

pytestmark = pytest.mark.share(2)

# The names that stay, one side of a joint after the other.
NAMES = [
    *(
        "drive.proportional_gain",
        "drive.derivative_gain",
        "drive.delay",
        "drive.acceleration_limit",
        "drive.speed_limit",
    ),
    *("motor.inertia", "motor.viscous_friction", "motor.coulomb_friction", "motor.stribeck_friction"),
    *(
        "motor.load_dependent_friction",
        "motor.cogging",
        "motor.torque_constant",
        "motor.torque_offset",
        "motor.torque_delay",
    ),
    *("transmission.stiffness", "transmission.nonlinearity", "transmission.asymmetry", "transmission.damping"),
    *("transmission.hysteresis", "transmission.backlash", "transmission.stiffness_drift"),
    *("link.inertia", "link.payload", "link.gravity", "link.viscous_friction", "link.coulomb_friction", "link.contact"),
    *("sensor.torque_gain", "sensor.torque_offset", "sensor.torque_drift", "sensor.torque_delay"),
    *("sensor.torque_not_independent", "sensor.encoder_offset", "sensor.encoder_scale", "sensor.encoder_eccentricity"),
    *("sensor.clock_skew", "pneumatic.leak", "pneumatic.orifice_area", "pneumatic.valve_offset"),
    *("pneumatic.pressure_offset", "pneumatic.force_gain", "pneumatic.muscle_friction"),
]
# It is reported before anything is fitted, and so has nothing to put into a rig.
TOLD_BEFORE = {"sensor.torque_not_independent"}

SERVO = """
[joint.servo]
kind = "rigid"
motor = { inertia = 0.03, damping = 0.3, friction = { coulomb = 0.1 } }
link = { inertia = 0.02, gravity_torque = 0.8 }
drive = { kind = "position-servo", kp = 20.0, kd = 0.6 }
signals = { commanded_position = "command", link_position = { channel = "position", resolution = "1 mrad" } }
"""
DRIVEN = {
    "sea": {"motor_torque": lambda t: 3 * np.sin(5 * t) + np.sin(23 * t)},
    "vsa2": {
        "motor_torque_1": lambda t: 0.05 * np.sin(6 * t) + 0.03,
        "motor_torque_2": lambda t: 0.05 * np.sin(9 * t) - 0.03,
    },
    "awas": {"motor_torque": lambda t: 6 * np.sin(5 * t), "secondary_torque": lambda t: 40 * np.sin(4 * t)},
    "servo": {"commanded_position": lambda t: 0.5 * np.sin(5 * t) + 0.1 * np.sin(23 * t)},
    "pam": {"valve_1": lambda t: 6.2 + 1.5 * np.sin(4 * t), "valve_2": lambda t: 6.2 - 1.5 * np.sin(4 * t)},
}


def test_the_names_are_those_that_stay():
    assert sorted(catalogue()) == sorted(NAMES)
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_cause_says_what_it_is(name):
    cause = catalogue()[name]
    for words in (cause.title, cause.says, cause.confirm, cause.reference, cause.signature, type(cause).__doc__):
        assert words
        assert words.strip()
    assert cause.confirm.endswith(".")
    assert not cause.title.endswith(".")
    assert "{" not in cause.title.replace("{part}", "")


def rig_of(name):
    return Rig.from_toml(SERVO) if name == "servo" else Rig.preset(name)


@cache
def played(preset):
    """The preset driven for four seconds: its joint, what causes may know, and what its equations leave over."""
    rig = rig_of(preset)
    name = next(iter(rig.joints))
    recording = simulate(rig.file, {name: DRIVEN[preset]}, 4.0, period=2e-3).recording()
    joint = at_joint(rig.joints[name])
    system = build_system(joint, channels_of(bound_as_recorded(recording, name, joint)), balance_for(joint))
    setting = setting_of(joint, system)
    return name, joint, setting, remainder(system, joint)


def sites(preset):
    _, _, setting, _ = played(preset)
    return [site for cause in catalogue().values() for site in cause.sites(setting)]


def measured(preset, joint):
    """What perfect sensors say of the joint in half a second."""
    rig, name = rig_of(preset), played(preset)[0]
    file = msgspec.structs.replace(rig.file, joint={name: joint})
    # What a log or a person would be given is text: it has to be read again.
    again = Rig.from_toml(Rig(file, "changed").to_toml())
    assert again.joints[name] == joint
    return simulate(again.file, {name: DRIVEN[preset]}, 0.5, period=2e-3, ideal=True).measured


def far(one, other):
    """Greatest difference of two recordings, over the signals' ranges."""
    return max(np.abs(one[r] - other[r]).max() / (np.ptp(one[r]) or 1.0) for r in one)


@pytest.mark.every(2)
@pytest.mark.parametrize("preset", DRIVEN)
def test_no_effect_is_the_rig_as_it_stands(preset):
    joint = played(preset)[1]
    plain = measured(preset, joint)
    for site in sites(preset):
        # Of friction that the rig has, bristles begin soft: without an effect are those that hardly give way [ln rad].
        nothing = [-19.0 if p.name == "way" else p.start for p in site.parameters]
        same = measured(preset, placed(joint, [(site, np.array(nothing))]))
        # A payload begins at a millionth of the link.
        assert far(plain, same) < 1e-5, site.key


@pytest.mark.every(2)
@pytest.mark.parametrize("preset", DRIVEN)
def test_an_effect_is_a_rig_that_loads_and_plays_and_is_another(preset):
    joint = played(preset)[1]
    plain = measured(preset, joint)
    for site in sites(preset):
        values = [min(p.start + 30 * p.step, p.high) for p in site.parameters]
        assert values != list(site.start), site.key
        changed = placed(joint, [(site, np.array(values))])
        if changed == joint:  # bristles of a friction that has no level of its own are none
            assert site.cause == "motor.load_dependent_friction"
            continue
        other = measured(preset, changed)
        assert all(np.isfinite(v).all() for v in other.values()), site.key
        assert far(plain, other) > 1e-9, site.key
        told = site.reported(values)
        assert all(np.isfinite(v) for v, _ in told.values())
        confirm = catalogue()[site.cause].confirm
        assert set(re.findall(r"\{(\w+)\}", confirm)) <= set(told), site.key


@pytest.mark.parametrize("preset", DRIVEN)
def test_sites_are_well_made(preset):
    _, joint, _, left = played(preset)
    found = sites(preset)
    keys = [(*s.key, len(s.parameters)) for s in found]
    assert len(keys) == len(set(keys))
    for site in found:
        title = title_of(site.cause, site.part)
        assert "{" not in title
        if "{part}" in catalogue()[site.cause].title:
            assert part_name(site.part) in title
        for p in site.parameters:
            assert p.step > 0.0, site.key
            assert p.low <= p.start <= p.high, site.key
            assert p.reach > p.step, site.key
        for start in site.starts(left) if site.starts else ():
            assert len(start) == len(site.parameters)
            assert np.isfinite(start).all()
            assert joint != placed(joint, [(site, np.array(start))]) or not any(start), site.key


def test_the_catalogue_in_the_manual_is_current(request):
    docs = request.config.rootpath / "docs"
    made = runpy.run_path(str(docs / "make_causes.py"))["pages"]()
    kept = {path.stem: path.read_text(encoding="utf-8") for path in (docs / "reference" / "causes").glob("*.md")}
    assert kept == made, "run: python docs/make_causes.py"
    sides = "\n".join(text for stem, text in made.items() if stem != "index")
    assert sorted(re.findall(r"^## (.+)$", sides, re.MULTILINE)) == sorted(NAMES)
    assert "{" not in sides


def test_every_cause_has_a_place_in_some_joint():
    somewhere = {site.cause for preset in DRIVEN for site in sites(preset)}
    assert somewhere == set(NAMES) - TOLD_BEFORE


@pytest.mark.parametrize("preset", DRIVEN)
def test_searches_cope_with_nothing_left_over(preset):
    """Remainders of zero, and such that are not known anywhere."""
    _, _, _, left = played(preset)
    for fill in (0.0, np.nan):
        blank = Remainder(
            left.time, {n: np.full_like(e, fill) for n, e in left.equations.items()}, left.roles, left.noise
        )
        for site in sites(preset):
            for start in site.starts(blank) if site.starts else ():
                assert np.isfinite(start).all(), site.key


def test_causes_ask_for_the_equations_they_show_in():
    """Without the motor's torque nothing is reported of the motor; without anything, nothing at all."""
    _, _, setting, _ = played("sea")
    less = replace(setting, roles={r: v for r, v in setting.roles.items() if r != "motor_torque"}, equations=("link",))
    named = {s.cause for c in catalogue().values() for s in c.sites(less)}
    assert not {n for n in named if n.startswith("motor.")}
    assert "link.inertia" in named
    none = replace(setting, roles={}, equations=(), deflections={}, torques={})
    assert [s.key for c in catalogue().values() for s in c.sites(none)] == []


def gain(low, high, count=1, hard=False):
    """A cause of some numbers within the same bounds."""
    numbers = tuple(Parameter(f"gain{i}", "1", 0.5, 1e-6, low, high, hard=hard) for i in range(count))
    return Site("gain", "part", numbers, lambda joint, values: joint)


def test_a_wall_is_a_bound_that_all_numbers_were_driven_to_but_not_zero():
    assert gain(0.1, 2.0).driven_out(np.array([0.1]))
    assert gain(-9.0, -3.5).driven_out(np.array([-3.5]))
    assert not gain(0.0, 2.0).driven_out(np.array([0.0]))
    assert not gain(-9.0, 2.0).driven_out(np.array([-3.0]))
    assert not gain(0.1, 2.0, count=2).driven_out(np.array([0.1, 0.5]))
    assert gain(0.1, 2.0, count=2).driven_out(np.array([0.1, 2.0]))
    assert gain(0.1, 2.0, count=2, hard=True).driven_out(np.array([0.1, 0.5]))
    assert not gain(-9.0, 2.0, count=2, hard=True).driven_out(np.array([-3.0, 0.5]))


def test_a_value_that_rounding_left_short_of_a_bound_is_at_it():
    assert gain(0.05, 20.0).driven_out(np.array([0.050000000000000155]))
    assert gain(0.05, 20.0).driven_out(np.array([20.0 * (1.0 - 3e-16)]))
    assert not gain(0.05, 20.0).driven_out(np.array([0.05 * (1.0 + 1e-7)]))


def test_stronger_friction_gives_way_over_the_same_displacement_where_the_rig_has_bristles():
    """So a scale that all torques have in common stays one: bristles that stayed as stiff would tell it."""
    text = (
        Rig.preset("sea")
        .to_toml()
        .replace(
            "[joint.sea.transmission]",
            "[joint.sea.motor.friction]\ncoulomb = 0.2\npresliding_stiffness = 100.0\n\n[joint.sea.transmission]",
        )
    )
    joint = at_joint(Rig.from_toml(text).joints["sea"])
    wave = np.stack([np.sin(k + np.linspace(0.0, 6.0, 100)) for k in range(3)])
    roles = dict.fromkeys(("motor_position", "link_position", "motor_torque"), wave)
    setting = Setting(joint, roles, 1e-3, 0.1, equations=("motor",))
    (site,) = catalogue()["motor.coulomb_friction"].sites(setting)
    friction = site.apply(joint, [0.5]).motor.friction
    assert (friction.coulomb, friction.presliding_stiffness) == pytest.approx((0.5, 250.0))
