"""Muscles, air and valves against numbers worked out by other means, and stiffness against differences."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from vsalog.core.errors import RigError, SimulationError
from vsalog.mechanics.muscle_forces import contraction_force, force_slopes
from vsalog.mechanics.pneumatic_friction import LEAST_GAUGE, friction_level, kikuuwe_friction
from vsalog.mechanics.pneumatics import (
    critical_ratio,
    isobaric_stiffness,
    joint_torque,
    mode_index,
    muscle_lengths,
    muscle_volume,
    orifice_flow,
    pressure_rate,
    resting_angle,
    resting_pressure,
    trapped_stiffness,
    valve_flow,
    valve_opening,
    volume_slope,
)
from vsalog.rig import Rig
from vsalog.rig.schema import (
    BraidForce,
    ExponentialForce,
    LinearForce,
    PneumaticJoint,
    SimpleFriction,
    SpringForce,
    TonduFriction,
)

replace = msgspec.structs.replace


def pam() -> PneumaticJoint:
    joint = Rig.preset("pam").joints["pam"]
    assert isinstance(joint, PneumaticJoint)
    return joint


PAM = pam()
FORCES = [
    PAM.muscle_1.force,
    BraidForce(rest_length=0.19, rest_radius=5e-3, braid_angle=np.deg2rad(22.0)),
    ExponentialForce(rest_length=0.19, a1=1.2e-4, a2=30.0, a3=-6.0, a4=-1.5e-4, a5=2e-5, a6=-8.0),
    SpringForce(rest_length=0.14, c0=300.0, c1=2e4, c2=0.03, c3=1e-9),
]


def with_force(force: LinearForce | BraidForce | ExponentialForce | SpringForce) -> PneumaticJoint:
    return replace(
        PAM, muscle_1=replace(PAM.muscle_1, force=force, force_gain=1.1), muscle_2=replace(PAM.muscle_2, force=force)
    )


def slope(f: Callable[[float], float], x: float, h: float) -> float:
    """Return df/dx by Richardson's extrapolation of central differences."""
    coarse, fine = (f(x + h) - f(x - h)) / (2.0 * h), (f(x + h / 2.0) - f(x - h / 2.0)) / h
    return (4.0 * fine - coarse) / 3.0


def test_volume_of_the_paper_is_some_36_cubic_centimetres_and_grows_as_the_muscle_shortens() -> None:
    assert muscle_volume(PAM.muscle_1, 0.165) == pytest.approx(36.3e-6, abs=0.1e-6)
    assert volume_slope(PAM.muscle_1, 0.165) < 0.0
    assert volume_slope(PAM.muscle_1, 0.17) == pytest.approx(
        slope(lambda x: float(muscle_volume(PAM.muscle_1, x)), 0.17, 1e-3), rel=1e-9
    )


def test_a_positive_angle_shortens_muscle_1() -> None:
    l1, l2 = muscle_lengths(PAM, np.deg2rad(30.0))
    assert l1 == pytest.approx(0.165 - 0.0365 / 2.0)
    assert l2 == pytest.approx(0.165 + 0.0365 / 2.0)


def test_choked_air_flows_as_the_textbooks_say() -> None:
    # For air, ṁ = 0.0404 P A / √T in SI (ISO 6358 and every pneumatics textbook), independent of what is downstream.
    flow = orifice_flow(PAM.air, 1e-6, 7e5, [1e5, 2e5, 3.6e5])
    assert flow == pytest.approx(0.0404 * 7e5 * 1e-6 / np.sqrt(293.0), rel=2e-3)
    assert critical_ratio(PAM.air) == pytest.approx(0.528, abs=5e-4)


def test_subsonic_air_flows_as_it_expands_isentropically() -> None:
    # From enthalpy: speed c = √(2 c_p (T₀ − T)), ṁ = ϱ A c at the throat's temperature and density.
    up, down, area = 5e5, 4.2e5, 3e-8
    throat = 293.0 * (down / up) ** (0.4 / 1.4)
    speed = np.sqrt(2.0 * 1.4 / 0.4 * 287.0 * (293.0 - throat))
    assert orifice_flow(PAM.air, area, up, down) == pytest.approx(area * speed * down / (287.0 * throat), rel=1e-12)


def test_flow_turns_round_with_the_pressures_and_has_no_step() -> None:
    assert orifice_flow(PAM.air, 1e-8, 2e5, 3e5) == -orifice_flow(PAM.air, 1e-8, 3e5, 2e5)
    assert orifice_flow(PAM.air, 1e-8, 3e5, 3e5) == 0.0
    border = critical_ratio(PAM.air) * 7e5
    below, above = orifice_flow(PAM.air, 1e-8, 7e5, [border * (1.0 - 1e-9), border * (1.0 + 1e-9)])
    assert below == pytest.approx(above, rel=1e-12)


def test_the_valve_uses_the_area_of_the_way_the_air_takes() -> None:
    valve = PAM.valve_1
    assert valve_flow(valve, PAM.air, 1.0, 2e5) == pytest.approx(
        float(orifice_flow(PAM.air, valve.inflow_area, 7.1e5, 2e5)), rel=1e-12
    )
    assert valve_flow(valve, PAM.air, 0.0, 2e5) == pytest.approx(
        -float(orifice_flow(PAM.air, valve.outflow_area, 2e5, 1.013e5)), rel=1e-12
    )
    scaled = replace(valve, area_scale=0.5)
    assert valve_flow(scaled, PAM.air, 0.3, 4e5) == pytest.approx(0.5 * float(valve_flow(valve, PAM.air, 0.3, 4e5)))


def test_the_map_of_the_valve_is_monotone_half_open_at_5_5_volt_and_shifted_by_the_offset() -> None:
    volts = np.linspace(-1.0, 11.0, 241)
    opening = valve_opening(PAM.valve_1, volts)
    assert (np.diff(opening) >= 0.0).all()
    assert (opening[0], opening[-1]) == (0.0, 1.0)
    assert valve_opening(PAM.valve_1, 5.5) == 0.5
    assert valve_opening(replace(PAM.valve_1, offset=0.4), 5.1) == pytest.approx(0.5)


def test_resting_pressure_does_not_depend_on_the_orifice_but_falls_with_a_leak() -> None:
    # Proposition 1 of the paper.
    pressures = [resting_pressure(PAM.air, PAM.valve_1, PAM.muscle_1, a) for a in (0.0, 0.1, 0.2, 0.5, 0.9, 1.0)]
    assert pressures[0] == PAM.air.outside_pressure
    assert pressures[-1] == PAM.air.supply_pressure
    assert (np.diff(pressures) > 0.0).all()
    large = replace(PAM.valve_1, area_scale=7.0)
    assert resting_pressure(PAM.air, large, PAM.muscle_1, 0.2) == pytest.approx(pressures[2], rel=1e-9)
    # Both flows are choked at α = 0.2: α P_tank = (1 − α) P.
    assert resting_pressure(PAM.air, PAM.valve_1, PAM.muscle_1, 0.25) == pytest.approx(7.1e5 / 3.0, rel=1e-9)
    leaky = replace(PAM.muscle_1, leak_area=1e-8)
    assert resting_pressure(PAM.air, PAM.valve_1, leaky, 0.5) < pressures[3] - 1e4


def test_isothermal_filling_balances_the_mass() -> None:
    # With both indexes 1, P V = m R T: d(P V)/dt = R T (flow − leak), whatever the motion.
    air = replace(PAM.air, inflow_index=1.0, volume_index=1.0)
    muscle = replace(PAM.muscle_1, leak_area=2e-9)
    pressure, length, speed, flow = 3e5, 0.17, 0.12, 4e-5
    rate = float(pressure_rate(air, muscle, pressure, length, speed, flow))
    volume, swelling = float(muscle_volume(muscle, length)), float(volume_slope(muscle, length)) * speed
    leak = float(orifice_flow(air, 2e-9, pressure, air.outside_pressure))
    assert rate * volume + pressure * swelling == pytest.approx(287.0 * 293.0 * (flow - leak), rel=1e-12)


@pytest.mark.parametrize("force", FORCES, ids=lambda f: type(f).__name__)
def test_slopes_of_the_force_are_its_derivatives(
    force: LinearForce | BraidForce | ExponentialForce | SpringForce,
) -> None:
    muscle = with_force(force).muscle_1
    pressure, length = 4.3e5, 0.172
    by_length, by_pressure = force_slopes(muscle, PAM.air, pressure, length)
    assert by_length == pytest.approx(
        slope(lambda x: float(contraction_force(muscle, PAM.air, pressure, x)), length, 1e-3), rel=1e-6
    )
    assert by_pressure == pytest.approx(
        slope(lambda p: float(contraction_force(muscle, PAM.air, p, length)), pressure, 1e3), rel=1e-7
    )


@pytest.mark.parametrize("force", FORCES, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("psi", [-0.3, 0.0, 0.25])
def test_stiffness_is_the_slope_of_the_torque(
    force: LinearForce | BraidForce | ExponentialForce | SpringForce, psi: float
) -> None:
    joint, p1, p2 = with_force(force), 3.1e5, 5.2e5

    def isobaric(x: float) -> float:
        return float(joint_torque(joint, x, p1, p2))

    def locked(x: float) -> float:
        # P V^k₂ keeps its value.
        now, before = muscle_lengths(joint, x), muscle_lengths(joint, psi)
        pressures = [
            p * float(muscle_volume(joint.muscle_1, b) / muscle_volume(joint.muscle_1, a)) ** joint.air.volume_index
            for p, a, b in zip((p1, p2), now, before, strict=True)
        ]
        return float(joint_torque(joint, x, *pressures))

    assert isobaric_stiffness(joint, psi, p1, p2) == pytest.approx(-slope(isobaric, psi, 1e-3), rel=1e-8)
    assert trapped_stiffness(joint, psi, p1, p2) == pytest.approx(-slope(locked, psi, 1e-3), rel=1e-7)
    assert np.ndim(trapped_stiffness(joint, np.full(3, psi), p1, np.full(3, p2))) == 1


def test_more_pressure_stiffens_and_locked_air_is_stiffer() -> None:
    # Both muscles at the same pressure: the variable stiffness that the machine is built for.
    pressures = np.linspace(2e5, 7e5, 11)
    soft, hard = isobaric_stiffness(PAM, 0.0, pressures, pressures), trapped_stiffness(PAM, 0.0, pressures, pressures)
    assert (np.diff(soft) > 0.0).all()
    assert (hard > soft).all()


def test_the_braid_pulls_nothing_at_its_magic_angle() -> None:
    # The threads' angle rises as the muscle shortens, cos α = (1 − ε) cos α₀, until tan α = √2 (54.7°), where the pull ends.
    start = np.deg2rad(22.0)
    shortest = 0.19 * np.cos(np.arctan(np.sqrt(2.0))) / np.cos(start)
    muscle = with_force(FORCES[1]).muscle_1
    assert contraction_force(muscle, PAM.air, 5e5, shortest) == pytest.approx(0.0, abs=1e-9)
    assert contraction_force(muscle, PAM.air, 5e5, 0.19) > 0.0


def test_the_preset_spans_the_torque_and_angle_that_the_paper_reports() -> None:
    # Pressures of 200 to 700 kPa; printed: −2.68 to 2.15 N·m offline, to 2.50 N·m and −2.89 N·m online, −21.5 to 19.1°.
    assert joint_torque(PAM, 0.0, 7e5, 2e5) == pytest.approx(2.6, abs=0.1)
    assert joint_torque(PAM, 0.0, 2e5, 7e5) == pytest.approx(-2.68, abs=0.1)
    assert np.rad2deg(resting_angle(PAM, 7e5, 2e5)) == pytest.approx(20.0, abs=2.0)
    assert np.rad2deg(resting_angle(PAM, 2e5, 7e5)) == pytest.approx(-21.5, abs=2.0)


def test_equal_muscles_at_equal_pressures_rest_at_zero_and_stay_where_they_are_held() -> None:
    equal = replace(PAM, muscle_2=PAM.muscle_1)
    assert resting_angle(equal, 4e5, 4e5) == pytest.approx(0.0, abs=1e-12)
    assert resting_angle(equal, 5e5, 3e5) == pytest.approx(-resting_angle(equal, 3e5, 5e5), rel=1e-9)
    held = replace(equal, seesaw=replace(equal.seesaw, held_at=0.1))
    assert resting_angle(held, 7e5, 2e5) == 0.1


def test_rest_beyond_the_volumes_is_refused() -> None:
    with pytest.raises(SimulationError, match="no rest position"):
        resting_angle(PAM, 7e5, 2e5, external=20.0)
    blocked = replace(PAM.valve_1, inflow_area=0.0, outflow_area=0.0)
    with pytest.raises(SimulationError, match="areas are zero"):
        resting_pressure(PAM.air, blocked, PAM.muscle_1, 0.5)


def test_eighteen_modes_by_hand() -> None:
    # Borders: 0.5283 · 710 kPa = 375 kPa (inflow), 101.3 kPa / 0.5283 = 192 kPa (outflow).
    zones = (1.5e5, 3e5, 5e5)
    found = [mode_index(PAM.air, a, b, slip) for slip in (False, True) for a in zones for b in zones]
    assert found == list(range(1, 19))


def test_friction_level_is_the_papers() -> None:
    # T_s = 0.006 · 0.2 · |40 + 30 − 0.256 · 9.8|, T_p = 4e8 (1/(2e5)² + 1/(4e5)²).
    level = friction_level(PAM, 3.013e5, 5.013e5, 40.0, 30.0, 0.1)
    assert level == pytest.approx(0.0012 * (70.0 - 2.5088) + 4e8 * (1.0 / 4e10 + 1.0 / 16e10), rel=1e-12)
    empty = friction_level(PAM, 1.013e5, 5e5, 0.0, 0.0, 0.0)
    assert np.isfinite(empty)
    assert empty == friction_level(PAM, 1.013e5 + LEAST_GAUGE, 5e5, 0.0, 0.0, 0.0)


def test_friction_models_that_the_paper_compares_with() -> None:
    simple = replace(PAM, friction=SimpleFriction(level=0.2))
    assert friction_level(simple, 2e5, 2e5, 0.0, 0.0, np.array([0.0, -3.0])) == pytest.approx([0.2, 0.2])
    tondu = replace(PAM, friction=TonduFriction(static=0.146, kinetic=0.03285, speed=0.8))
    levels = friction_level(tondu, 2e5, 2e5, 0.0, 0.0, np.array([0.0, 0.8, -0.8, 100.0]))
    assert levels == pytest.approx([0.146, 0.03285 + 0.11315 / np.e, 0.03285 + 0.11315 / np.e, 0.03285])
    assert friction_level(replace(PAM, friction=None), 2e5, 2e5, 0.0, 0.0, np.zeros(3)).tolist() == [0.0, 0.0, 0.0]


def test_kikuuwes_step_solves_the_implicit_equation() -> None:
    # v = v* − Z T_f and T_f ∈ c_s v + level Sgn v, tried for velocities on either side of sticking.
    free, level, viscous, z = np.linspace(-2.0, 2.0, 41), 0.1, 0.3, 2.0
    torque = kikuuwe_friction(free, level, viscous, z)
    v = free - z * torque
    sticks = np.abs(free) <= z * level
    assert v[sticks] == pytest.approx(0.0, abs=1e-15)
    assert (np.abs(torque[sticks]) <= level).all()
    assert torque[~sticks] == pytest.approx(viscous * v[~sticks] + level * np.sign(v[~sticks]), rel=1e-12)
    assert (v[~sticks] * free[~sticks] > 0.0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("air]\nsupply_pressure = 1e5", "joint.pam.air.supply_pressure: has to be above"),
        ("air]\nheat_ratio = 1.0", "heat_ratio: 1 is not possible"),
        ('air]\ntemperature = "20 degC"', "zero of its own"),
        ('air]\nsupply_pressure = "7 N"', "is a force, but a pressure"),
        ("valve_1]\nvoltage = [0, 10]", "joint.pam.valve_1.opening: the map needs"),
        ("valve_1]\nvoltage = [0]\nopening = [1]", "joint.pam.valve_1.opening: the map needs"),
        ("valve_2]\nvoltage = [5, 5]\nopening = [0, 1]", "joint.pam.valve_2.voltage: each voltage"),
        ("valve_2]\nvoltage = [0, 5]\nopening = [1, 0]", "joint.pam.valve_2.opening: the opening cannot fall"),
        ("valve_2]\nvoltage = [0, 5]\nopening = [0, 1.5]", "at most 1"),
        ("valve_2]\ninflow_area = -1", "at least 0"),
        ("muscle_2]\nvolume_constant = -1", "joint.pam.muscle_2: the volume at the length 0.165 m"),
        ("muscle_1]\nleak_area = -1e-9", "at least 0"),
        ('muscle_1.force]\ntype = "cubic"', '"cubic" is not one of "linear", "braid"'),
        (
            'muscle_1.force]\ntype = "braid"',
            "'rest_length' and 'rest_radius' and 'braid_angle' are missing in a part of type",
        ),
        (
            'muscle_1.force]\ntype = "braid"\nrest_length = 0.2\nrest_radius = 0.01\nbraid_angle = "95 deg"',
            "muscle_1.force.braid_angle: has to be below 90°",
        ),
        (
            'friction]\ntype = "tondu"\nstatic = 0.1\nkinetic = 0.2\nspeed = 1',
            "joint.pam.friction.static: cannot be below",
        ),
        ("seesaw]\nradius = 0", "greater than 0"),
        ('signals]\npressure_3 = "x"', "no such role"),
        ('signals]\npressure_1 = { channel = "x", unit = "V" }', "is a voltage, but a pressure"),
        ('signals]\nvalve_1 = "/muscle_1/pressure.data"', "two roles for one channel"),
    ],
)
def test_bad_rigs_are_refused_by_key(change: str, message: str) -> None:
    with pytest.raises(RigError) as caught:
        Rig.from_toml(f'preset = "pam"\n[joint.pam.{change}\n')
    assert message in str(caught.value)


def test_the_preset_is_written_and_read_back() -> None:
    rig = Rig.preset("pam")
    assert Rig.from_toml(rig.to_toml()).file == rig.file


@pytest.mark.parametrize(("gauge", "bounded"), [(600.0, True), (1200.0, False)])
def test_the_friction_of_a_muscle_grows_down_to_a_kilopascal_above_the_outside(gauge: float, bounded: bool) -> None:
    levels = [friction_level(PAM, PAM.air.outside_pressure + p, 5e5, 0.0, 0.0, 0.0) for p in (gauge, 1.3 * gauge)]
    assert (levels[0] == levels[1]) == bounded
