"""Priors of the causes' numbers: what a rig states, as the joint feels it, and a default for every number of the catalogue."""

from dataclasses import replace
from functools import cache

import numpy as np
import pam_machine
import pytest
import rigid_machine
from scipy.stats import norm
from written_out import ELASTIC, channels, joint_of, signals

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.linear import variants_of
from vsalog.diagnosis.priors import deviation_of, felt
from vsalog.diagnosis.run import bound_as_recorded
from vsalog.diagnosis.selection import remainder, sites_of
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint
from vsalog.residuals.system import build_system
from vsalog.rig import Rig
from vsalog.simulation import simulate

# Half-width of a 95 % interval in standard deviations.
HALF = norm.ppf(0.975)


@cache
def elastic():
    joint, found = joint_of(), channels(duration=4.0).thinned()
    return setting_of(joint, build_system(joint, found, balance_for(joint)))


def known(text):
    """A rig's joint and its tolerances as the joint feels them."""
    rig = Rig.from_toml(text)
    joint = rig.joints["arm"]
    return joint, felt(joint, rig.tolerances["arm"])


def of(cause, name, stated, setting=None):
    setting = setting or elastic()
    site = next(s for s in catalogue()[cause].sites(setting))
    parameter = next(p for p in site.parameters if p.name == name)
    return deviation_of(site, parameter, setting, stated)


def test_a_stated_tolerance_is_half_a_95_percent_interval():
    _, stated = known(ELASTIC.replace("inertia = 0.02", 'inertia = "0.02 kg*m^2 ± 10 %"'))
    assert stated == {"motor.inertia": pytest.approx(0.002 / HALF)}
    assert of("motor.inertia", "inertia", stated) == pytest.approx(0.002 / HALF)
    # What is not stated keeps its default: ± 20 % of an inertia.
    assert of("motor.inertia", "inertia", {}) == pytest.approx(0.2 * 0.02 / HALF)
    assert of("link.inertia", "inertia", stated) == pytest.approx(0.2 * 0.03 / HALF)


def test_the_rotors_tolerances_are_felt_through_the_gear():
    """J γ² of an inertia and a damping, γ of a torque."""
    rotor = (
        '[joint.arm.motor]\nside = "rotor"\ngear_ratio = 50.0\ninertia = "8e-6 kg*m^2 ± 10 %"\n'
        'damping = "2e-5 N*m*s/rad ± 30 %"\nfriction = { coulomb = "1 N*mm ± 0.2 N*mm" }\n'
    )
    _, stated = known(ELASTIC.replace("[joint.arm.motor]\ninertia = 0.02\ndamping = 0.05\n", rotor))
    assert stated["motor.inertia"] == pytest.approx(8e-7 / HALF * 50**2)
    assert stated["motor.damping"] == pytest.approx(6e-6 / HALF * 50**2)
    assert stated["motor.friction.coulomb"] == pytest.approx(2e-4 / HALF * 50)
    assert of("motor.inertia", "inertia", stated) == pytest.approx(8e-7 / HALF * 50**2)
    assert of("motor.viscous_friction", "damping", stated) == pytest.approx(6e-6 / HALF * 50**2)
    assert of("motor.coulomb_friction", "torque", stated) == pytest.approx(2e-4 / HALF * 50)


def test_a_sensors_offset_is_felt_without_its_gain_and_a_gain_is_relative():
    sensor = (
        '{ channel = "torque sensor", gain = "2.5 ± 0.05", offset = "0.1 N*m ± 0.02 N*m", delay = "1 ms ± 0.5 ms" }'
    )
    _, stated = known(ELASTIC.replace('torque_sensor = "torque sensor"', f"torque_sensor = {sensor}"))
    assert stated["signals.torque_sensor.gain"] == pytest.approx(0.05 / 2.5 / HALF)
    assert stated["signals.torque_sensor.offset"] == pytest.approx(0.02 / 2.5 / HALF)
    assert stated["signals.torque_sensor.delay"] == pytest.approx(0.5e-3 / HALF)
    assert of("sensor.torque_gain", "gain", stated) == pytest.approx(0.05 / 2.5 / HALF)
    assert of("sensor.torque_offset", "offset", stated) == pytest.approx(0.02 / 2.5 / HALF)
    assert of("sensor.torque_delay", "delay", stated) == pytest.approx(0.5e-3 / HALF)


def test_a_springs_tolerance_is_that_of_its_factor():
    """Stated in N·m/rad or in per cent it is the same: relative."""
    for text in ('"12 N*m/rad ± 0.6 N*m/rad"', '"12 N*m/rad ± 5 %"'):
        _, stated = known(ELASTIC.replace("stiffness = 12.0", f"stiffness = {text}"))
        assert stated["transmission.stiffness"] == pytest.approx(0.6 / HALF)
        assert of("transmission.stiffness", "factor", stated) == pytest.approx(0.05 / HALF)


def test_a_linear_friction_of_the_link_and_a_motors_gain():
    text = ELASTIC.replace("damping = 0.02", 'damping = "0.02 N*m*s/rad ± 0.01 N*m*s/rad"')
    text = text.replace("damping = 0.05", 'damping = 0.05\ntorque_gain = "1.2 ± 0.06"\ntorque_delay = "2 ms ± 1 ms"')
    _, stated = known(text)
    assert of("link.viscous_friction", "damping", stated) == pytest.approx(0.01 / HALF)
    assert of("motor.torque_delay", "delay", stated) == pytest.approx(1e-3 / HALF)
    assert of("motor.torque_constant", "gain", stated) == pytest.approx(0.06 / HALF)


@pytest.mark.parametrize(
    ("path", "nominal", "cause", "name"),
    [
        ("motor.damping", 0.05, "motor.viscous_friction", "damping"),
        ("motor.torque_offset", 0.0, "motor.torque_offset", "torque"),
        ("motor.cogging.torque", 0.0, "motor.cogging", "cosine"),
        ("motor.friction.static", 0.0, "motor.stribeck_friction", "excess"),
        ("motor.friction.load", 0.0, "motor.load_dependent_friction", "share"),
        ("transmission.damping", 0.0, "transmission.damping", "damping"),
        ("transmission.asymmetry", 0.0, "transmission.asymmetry", "asymmetry"),
        ("transmission.backlash", 0.0, "transmission.backlash", "gap"),
        ("transmission.added_cubic", 0.0, "transmission.nonlinearity", "cubic"),
        ("transmission.bouc_wen.torque", 0.0, "transmission.hysteresis", "torque"),
        ("transmission.drift", 0.0, "transmission.stiffness_drift", "rate"),
        ("link.gravity_torque", 1.5, "link.gravity", "torque"),
        ("link.friction.coulomb", 0.0, "link.coulomb_friction", "torque"),
        ("signals.torque_sensor.drift", 0.0, "sensor.torque_drift", "rate"),
    ],
)
def test_each_key_of_a_rig_is_that_of_its_cause(path, nominal, cause, name):
    """Whatever is stated at the key's path is the cause's, and without it there is a default."""
    assert of(cause, name, {path: 0.0123}) == pytest.approx(0.0123)
    assert of(cause, name, {}) != pytest.approx(0.0123)


def test_defaults_scale_with_what_would_matter():
    """What may be absent is a part of the torques and motions of the log."""
    setting = elastic()
    torque, speed = np.nanstd(setting.roles["motor_torque"][0]), np.nanstd(setting.roles["motor_position"][1])
    assert of("motor.coulomb_friction", "torque", {}) == pytest.approx(0.1 * torque / HALF, rel=1e-6)
    assert of("motor.viscous_friction", "damping", {}) == pytest.approx(
        max(2.0 * 0.05, 0.1 * torque / speed) / HALF, rel=1e-6
    )
    deflection = np.nanquantile(np.abs(setting.deflections[""]), 0.99)
    assert of("transmission.backlash", "gap", {}) == pytest.approx(0.02 * deflection / HALF, rel=1e-6)


POLYNOMIAL = ELASTIC.replace(
    'type = "cubic"\nstiffness = 12.0\ncubic = 150.0',
    'type = "polynomial"\nscale = "1 rad"\ncoefficients = ["12 N*m ± 1 N*m", "150 N*m ± 2 N*m"]',
)


def test_a_factor_on_a_polynomial_spring_is_known_as_well_as_its_first_coefficient():
    joint, stated = known(POLYNOMIAL)
    found = channels(duration=4.0).thinned()
    setting = setting_of(joint, build_system(joint, found, balance_for(joint)))
    assert of("transmission.stiffness", "factor", stated, setting) == pytest.approx(1.0 / 12.0 / HALF)
    # Without it the default of a stiffness holds.
    assert of("transmission.stiffness", "factor", {}, setting) == pytest.approx(0.1 / HALF)


def test_a_factor_on_a_lever_arms_springs_is_known_as_well_as_these_are():
    joint, found = of_kind("awas")
    setting = setting_of(joint, build_system(joint, found, balance_for(joint)))
    stated = {"transmission.spring_stiffness": 0.02 * joint.transmission.spring_stiffness}
    assert of("transmission.stiffness", "factor", stated, setting) == pytest.approx(0.02)


DRIVEN = {
    "vsa2": {
        "motor_torque_1": lambda t: 0.05 * np.sin(6 * t) + 0.03,
        "motor_torque_2": lambda t: 0.05 * np.sin(9 * t) - 0.03,
    },
    "awas": {"motor_torque": lambda t: 6 * np.sin(5 * t), "secondary_torque": lambda t: 40 * np.sin(4 * t)},
}


def of_kind(kind):
    """A joint and its channels."""
    if kind == "elastic":
        return joint_of(), channels(duration=4.0).thinned()
    if kind == "rigid":
        time, said = rigid_machine.log(duration=4.0)
        return at_joint(joint_of(rigid_machine.RIGID)), channels_of(signals(said, time[1])).thinned()
    if kind == "pneumatic":
        bench = pam_machine.Bench()
        said = pam_machine.played(bench, duration=4.0)
        names = {"link_position": "angle", "torque_sensor": "torque", "pressure_1": "p1", "pressure_2": "p2",
                 "valve_1": "u1", "valve_2": "u2"}  # fmt: skip
        found = channels_of(signals({role: said[name] for role, name in names.items()}, said["time"][1]))
        return at_joint(pam_machine.joint_of(bench)), found
    rig = Rig.preset(kind)
    name = next(iter(rig.joints))
    recording = simulate(rig.file, {name: DRIVEN[kind]}, 4.0, period=2e-3).recording()
    joint = at_joint(rig.joints[name])
    return joint, channels_of(bound_as_recorded(recording, name, joint))


@pytest.mark.parametrize("kind", ["elastic", "vsa2", "awas", "pneumatic", "rigid"])
def test_every_number_of_every_cause_has_a_prior(kind):
    joint, found = of_kind(kind)
    system = build_system(joint, found, balance_for(joint))
    setting = setting_of(joint, system)
    sites = sites_of(setting, frozenset())
    assert len(sites) > 10
    for variant in variants_of(sites, setting, remainder(system, joint), (), {}):
        for deviation in variant.deviation:
            assert np.isfinite(deviation), variant.site.key
            assert deviation > 0.0, variant.site.key
    for site in sites:
        for p in (p for p in site.parameters if not p.shape):
            deviation = deviation_of(site, p, setting, {})
            assert 0.0 < deviation < np.inf, (site.key, p.name)
            # A step over which equations are straight is not larger than what is likely.
            assert p.step < 30.0 * deviation, (site.key, p.name)


def test_a_lever_motors_bristles_give_way_by_a_part_of_its_angle():
    """Its position is logged as the set-point that it drives [m], which is a small number where its angle is not."""
    joint, found = of_kind("awas")
    system = build_system(joint, found, balance_for(joint))
    setting = setting_of(joint, system)
    torque = {"secondary_torque": 40.0 * np.sin(4.0 * system.channels.time)}
    setting = replace(setting, roles=setting.roles | torque, equations=(*setting.equations, "secondary_motor"))
    (way,) = [
        p
        for s in catalogue()["motor.coulomb_friction"].sites(setting)
        for p in s.parameters
        if s.part == "secondary_motor" and p.name == "way"
    ]
    angle = np.nanstd(setting.roles["setpoint"][0]) / joint.lever.travel
    np.testing.assert_allclose(np.exp(way.high), 0.3 * angle, rtol=1e-9)


def test_a_part_that_rests_has_no_bristles():
    setting = elastic()
    roles = {
        r: v if r != "link_position" else np.full_like(v, 0.5) * [[1.0], [0.0], [0.0]] for r, v in setting.roles.items()
    }
    sites = list(catalogue()["link.coulomb_friction"].sites(replace(setting, roles=roles)))
    assert [[p.name for p in s.parameters] for s in sites] == [["torque"]]
