"""Tolerances: how well a rig says its quantities are known, and what is assumed where it says nothing."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.errors import RigError, SimulationError, UnitError
from vsalog.core.printable import LONGEST_TEXT
from vsalog.core.significance import INTERVAL
from vsalog.rig import Rig
from vsalog.rig.schema_file import structures
from vsalog.rig.tolerance import DEFAULTS, default_deviation, table_text
from vsalog.rig.uncertain import Tolerance, UncertainNumber, parse_stated, parse_stated_number, stated
from vsalog.simulation.scenario import Scenario

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "rig" / "tolerances.md"
DEG = math.pi / 180.0

ARM = """
[joint.arm]
kind = "serial"
[joint.arm.motor]
side = "rotor"
gear_ratio = 50
inertia = "0.08 kg*m^2 ± 10 %"
damping = "0.3 N*m*s/rad ± 100 N*mm*s/rad"
torque_gain = "1 +/- 1 %"
torque_offset = "0 N*m +- 0.1 N*m"
torque_constant = "52 ± 2 mNm/A"
friction = { coulomb = "0 N*m ± 0.2 N*m", load = "0.1 ± 0.05" }
[[joint.arm.motor.cogging]]
torque = "30 N*mm ± 50 %"
order = 14
[joint.arm.transmission]
type = "polynomial"
scale = "10 deg"
coefficients = [12, "1.5 N*m ± 0.1 N*m"]
bouc_wen = { torque = "1 N*m ± 20 %", width = "0.5 deg" }
[[joint.arm.transmission.slip]]
stiffness = "60 N*m/rad ± 5 %"
limit = 0.3
[joint.arm.lever]
start = "100 mm ± 1 mm"
travel = "2.5 mm/rev ± 0"
[joint.arm.link]
inertia = 0.05
payload = { mass = "500 g ± 20 g", distance = 0.3 }
[joint.arm.signals]
motor_position = { channel = "theta ± 1", gain = "1 ± 0.1 %", drift = "0 deg/s ± 0.1 deg/s" }
setpoint = { constant = "1 rev ± 0.1 rev" }
[joint.arm.signals.link_position]
channel = "q"
offset = "0 rad ± 0.5 deg"
delay = "0 s ± 2 ms"
eccentricity = { amplitude = "0 deg ± 0.2 deg" }
[[joint.arm.run]]
setpoint = "33 mm ± 0.5 mm"
[chain]
gravity = [0, 0, "-9.81 m/s^2 ± 0.1 %"]
[[chain.link]]
joint = "arm"
mass = "2 kg ± 5 %"
"""

# Half-widths, in SI, by key.
STATED = {
    "motor.inertia": 0.008,
    "motor.damping": 0.1,
    "motor.torque_gain": 0.01,
    "motor.torque_offset": 0.1,
    "motor.torque_constant": 0.002,
    "motor.friction.coulomb": 0.2,
    "motor.friction.load": 0.05,
    "motor.cogging[0].torque": 0.015,
    "transmission.coefficients[1]": 0.1,
    "transmission.bouc_wen.torque": 0.2,
    "transmission.slip[0].stiffness": 3.0,
    "lever.start": 1e-3,
    "lever.travel": 0.0,
    "link.payload.mass": 0.02,
    "signals.motor_position.gain": 1e-3,
    "signals.motor_position.drift": 0.1 * DEG,
    "signals.link_position.offset": 0.5 * DEG,
    "signals.link_position.delay": 2e-3,
    "signals.link_position.eccentricity.amplitude": 0.2 * DEG,
    "signals.setpoint.constant": 2.5e-4,  # of the lever arm: 2.5 mm a turn
    "run[0].setpoint": 5e-4,
}


def motor(line: str) -> str:
    return f'[joint.arm]\nkind = "elastic"\n[joint.arm.motor]\n{line}\n'


def test_a_deviation_is_what_covers_95_per_cent():
    from scipy.stats import norm

    assert 2.0 * norm.cdf(INTERVAL) - 1.0 == pytest.approx(0.95, abs=1e-4)


def test_every_quantity_states_its_tolerance():
    rig = Rig.from_toml(ARM)
    assert rig.tolerances["arm"] == pytest.approx({key: half / INTERVAL for key, half in STATED.items()})
    assert rig.chain_tolerances == pytest.approx({"gravity[2]": 9.81e-3 / INTERVAL, "link[0].mass": 0.1 / INTERVAL})


def test_the_structures_are_those_of_a_rig_without_tolerances():
    plain = ARM
    for old, new in {
        "0.08 kg*m^2 ± 10 %": "0.08 kg*m^2", "0.3 N*m*s/rad ± 100 N*mm*s/rad": "0.3 N*m*s/rad", '"1 +/- 1 %"': "1",
        "0 N*m +- 0.1 N*m": "0 N*m", "52 ± 2 mNm/A": "52 mNm/A", "0 N*m ± 0.2 N*m": "0 N*m", '"0.1 ± 0.05"': "0.1",
        "30 N*mm ± 50 %": "30 N*mm", "1.5 N*m ± 0.1 N*m": "1.5 N*m", "1 N*m ± 20 %": "1 N*m", " ± 5 %": "", " ± 1 mm": "",
        " ± 0\"": '"', " ± 20 g": "", '"1 ± 0.1 %"': "1", " ± 0.1 deg/s": "", " ± 0.5 deg": "", " ± 2 ms": "",
        " ± 0.2 deg": "", " ± 0.1 rev": "", " ± 0.5 mm": "", "9.81 m/s^2 ± 0.1 %": "9.81 m/s^2",
    }.items():  # fmt: skip
        assert old in plain, old
        plain = plain.replace(old, new)
    rig, same = Rig.from_toml(ARM), Rig.from_toml(plain)
    assert rig.file == same.file
    assert same.tolerances == {"arm": {}}
    assert same.chain_tolerances == {}
    inertia = rig.joints["arm"].motor.inertia
    assert type(inertia) is float


@pytest.mark.parametrize("text", [ARM, 'preset = "sea"\n[joint.sea.motor]\ninertia = "0.1 kg*m^2 ± 10 %"'])
def test_what_is_written_loads_to_the_same_tolerances(text):
    rig = Rig.from_toml(text)
    again = Rig.from_toml(rig.to_toml())
    assert again == rig
    assert again.to_toml() == rig.to_toml()


def test_pressures_valves_and_muscles_have_tolerances():
    rig = Rig.preset("pam").with_settings(
        {
            "joint.pam.valve_1.area_scale": "1 ± 20 %",
            "joint.pam.valve_1.offset": "0 V ± 50 mV",
            "joint.pam.muscle_2.leak_area": "0 mm^2 ± 0.01 mm^2",
            "joint.pam.air.outside_pressure": "1.013 bar ± 3 %",
        }
    )
    assert rig.tolerances["pam"] == pytest.approx(
        {
            "valve_1.area_scale": 0.2 / INTERVAL,
            "valve_1.offset": 0.05 / INTERVAL,
            "muscle_2.leak_area": 1e-8 / INTERVAL,
            "air.outside_pressure": 3039.0 / INTERVAL,
        }
    )
    assert Rig.from_toml(rig.to_toml()).stated == rig.stated


@pytest.mark.parametrize("sign", ["±", "+-", "+/-", " ± ", "  +/- ", "+−"])
@pytest.mark.parametrize(("number", "half"), [("10 %", 0.5), ("10%", 0.5), ("200 mm", 0.2), ("0.2m", 0.2), ("0", 0.0)])
def test_spellings(sign, number, half):
    quantity = parse_stated(f"5 m{sign}{number}").to("m")
    assert quantity == 5.0
    assert isinstance(quantity, UncertainNumber)
    assert quantity.tolerance == (pytest.approx(half), "m")


def test_one_unit_behind_both_numbers_is_that_of_both():
    assert parse_stated("-5 ± 1 deg").to("rad") == pytest.approx(-5.0 * DEG)
    assert parse_stated("-5 ± 1 deg").to("rad").tolerance.half_width == pytest.approx(DEG)


def test_per_cent_is_of_the_size_of_the_value():
    assert parse_stated("-5 m ± 10 %").to("m").tolerance.half_width == 0.5


def test_arithmetic_gives_plain_numbers():
    number = UncertainNumber(2.0, Tolerance(0.1, "m"))
    assert number == 2.0
    assert type(number * 1.0) is type(float(number)) is float


def test_a_value_over_another_brings_its_own_tolerance():
    below = Rig.from_toml(ARM)
    assert "motor.inertia" in below.tolerances["arm"]
    changed = below.with_setting("joint.arm.motor.inertia", "0.09 kg*m^2")
    assert "motor.inertia" not in changed.tolerances["arm"]
    assert len(changed.tolerances["arm"]) == len(STATED) - 1
    again = changed.with_setting("joint.arm.motor.inertia", "0.09 kg*m^2 ± 10 %")
    assert again.tolerances["arm"]["motor.inertia"] == pytest.approx(0.009 / INTERVAL)


@pytest.mark.parametrize(
    ("key", "value", "half"),
    [
        ("motor.inertia", "0.08 kg*m^2 ± 10 %", 0.008),
        ("motor.inertia", '"0.08 kg*m^2 ± 10 %"', 0.008),
        ("motor.torque_gain", "1 +- 0.02", 0.02),
        ("motor.cogging[0].phase", "20 deg ± 5 deg", 5.0 * DEG),
        ("motor.cogging[0].torque", "0.03 N*m ± 1 N*mm", 1e-3),
        ("run[0].setpoint", "1 rev ± 0.1 rev", 2.5e-4),
        ("signals.link_position.offset", "0 deg ± 2 deg", 2.0 * DEG),
        ("signals.setpoint.constant", "33 mm ± 1 mm", 1e-3),
        ("transmission.coefficients[0]", "12 N*m ± 1 N*m", 1.0),
    ],
)
def test_settings(key, value, half):
    rig = Rig.from_toml(ARM).with_setting(f"joint.arm.{key}", value)
    others = {k: v for k, v in Rig.from_toml(ARM).tolerances["arm"].items() if k != key}
    assert rig.tolerances["arm"] == pytest.approx({**others, key: half / INTERVAL})


def test_a_preset_keeps_its_tolerances_where_nothing_is_put_over_it(monkeypatch):
    import vsalog.rig.load as load

    monkeypatch.setattr(load, "preset_text", lambda _: ARM)
    rig = Rig.from_toml('preset = "arm"\n[joint.arm.motor]\ninertia = 0.1\ndamping = "0.3 N*m*s/rad ± 20 %"\n')
    assert "motor.inertia" not in rig.tolerances["arm"]
    assert rig.tolerances["arm"]["motor.damping"] == pytest.approx(0.06 / INTERVAL)
    assert rig.tolerances["arm"]["lever.start"] == pytest.approx(1e-3 / INTERVAL)


def test_names_may_hold_the_sign():
    rig = Rig.from_toml(
        'name = "bench ± 5 %"\n[joint."a ± b"]\nkind = "elastic"\nmotor = { inertia = "1 kg*m^2 ± 1 %" }\n'
        '[joint."a ± b".signals]\nlink_position = "q ± 1"\nmotor_position = { channel = "m +- 2" }'
    )
    assert rig.name == "bench ± 5 %"
    assert rig.tolerances == {"a ± b": {"motor.inertia": pytest.approx(0.01 / INTERVAL)}}
    assert Rig.from_toml(rig.to_toml()).tolerances == rig.tolerances


def test_other_joints_keep_the_tolerances_of_what_stays_the_same():
    rig = Rig.from_toml(ARM)
    same = rig.with_joints(rig.joints)
    assert same == rig
    changed = rig.with_setting("joint.arm.motor.inertia", "0.5").joints
    kept = rig.with_joints(changed, "extended")
    assert kept.where == "extended"
    assert kept.tolerances["arm"].keys() == STATED.keys() - {"motor.inertia"}
    assert Rig.from_toml(kept.to_toml()).file == kept.file
    assert rig.with_joints({}).tolerances == {}


def test_a_rig_is_renamed_with_its_tolerances():
    assert Rig.from_toml(ARM).renamed("x").tolerances == Rig.from_toml(ARM).tolerances


@pytest.mark.parametrize(
    "value",
    [
        "0.08 kg*m^2 ± -10 %", "0.08 kg*m^2 ± -0.1 kg*m^2", "0.08 kg*m^2 ± 0.5 deg", "0.08 kg*m^2 ± 0.1 nosuchunit",
        "0.08 kg*m^2 ± nan kg*m^2", "0.08 kg*m^2 ± inf %", "0.08 kg*m^2 ± 1e999 kg*m^2", "0.08 kg*m^2 ± 1e999 %",
        "0.08 kg*m^2 ± 1e155 kg*m^2", "1e999 kg*m^2 ± 10 %", "0.08 kg*m^2 ± 0.01", "0.08 kg*m^2 ±", "± 0.1 kg*m^2",
        "0.08 kg*m^2 ± x", "0.08 kg*m^2 ± 1 % ± 2 %", "0.08 ± 10 %", "0.08 kg*m^2 ± 10 % kg", "0.08 ± 0 ",
        "0.08 kg*m^2 ± 1" + "0" * LONGEST_TEXT + " %", "0.08 kg*m^2 ± 0.1 " + "m*" * 40 + "m", "-0.08 kg*m^2 ± 10 %",
        "0 kg*m^2 ± 10 %", "0.08 % ± 0.01 %", "0.08 kg*m^2 ± \\u0000", "0.08 kg*m^2 \\n± 1\\n0 %",
    ],
)  # fmt: skip
def test_what_cannot_be(value):
    with pytest.raises(RigError) as caught:
        Rig.from_toml(motor(f'inertia = "{value}"'), "my.toml")
    assert str(caught.value).startswith("my.toml: joint.arm.motor.inertia: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (motor('torque_gain = "1 ± 0.1 kg"'), "motor.torque_gain"),
        (motor('torque_gain = "100 % ± 1 %"'), "motor.torque_gain"),
        (motor('torque_gain = "1 ± -1"'), "motor.torque_gain"),
        (motor('torque_gain = "-1 ± 1"'), "motor.torque_gain"),
        (motor('torque_gain = "1"'), "motor.torque_gain"),
        (motor('side = "joint ± 1"'), "motor.side"),
        (motor('cogging = [{ torque = 1, order = "3 ± 1" }]'), "motor.cogging[0].order"),
        ('[joint.arm]\nkind = "elastic ± 1"', "kind"),
        ('[joint.arm]\nkind = "elastic"\nbasis = { order = "4 ± 1" }', "basis.order"),
        ('[joint.arm]\nkind = "elastic"\nbasis = { odd = "true ± 1" }', "basis.odd"),
        ('[joint.arm]\nkind = "elastic"\nbasis = { deflection_scale = "4 deg ± 1 deg" }', "basis.deflection_scale"),
        (ARM.replace('scale = "10 deg"', 'scale = "10 deg ± 1 deg"'), "transmission.scale"),
        (ARM.replace("0 rad ± 0.5 deg", "0 rad ± 10 %"), "signals.link_position.offset"),
        (ARM.replace("0 rad ± 0.5 deg", "0 rad ± 1 mm"), "signals.link_position.offset"),
        (ARM.replace("1 rev ± 0.1 rev", "1 rev ± 0.1 mm"), "signals.setpoint.constant"),
        (
            ARM.replace("1 rev ± 0.1 rev", "1 rev ± 1e149 rev").replace("2.5 mm/rev ± 0", "1e9 m/rad"),
            "signals.setpoint",
        ),
        (ARM.replace("33 mm ± 0.5 mm", "33 mm ± 0.5 kg"), "run[0].setpoint"),
    ],
)
def test_what_has_no_such_tolerance(text, key):
    with pytest.raises(RigError) as caught:
        Rig.from_toml(text, "my.toml")
    assert str(caught.value).startswith(f"my.toml: joint.arm.{key}: ")


def test_a_scenario_has_no_tolerances():
    with pytest.raises(SimulationError, match="duration"):
        Scenario.from_toml('duration = "5 s ± 1 s"')


def test_exactly_known_is_not_unknown():
    assert Rig.from_toml(motor('inertia = "1 kg*m^2 ± 0"')).tolerances == {"arm": {"motor.inertia": 0.0}}
    assert Rig.from_toml(motor('torque_offset = "0 N*m ± 0 %"')).tolerances == {"arm": {"motor.torque_offset": 0.0}}


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(0.0, 1e154),
    st.sampled_from(["kg*m^2", "N*m*s/rad", "N*m/rad^3", "rad", "s", ""]),
)
def test_what_is_written_is_read_back_exactly(value, half_width, unit):
    text = stated(value, Tolerance(half_width, unit))
    again = (parse_stated(text) if unit else parse_stated_number(text)).to(unit)
    assert (float(again), again.tolerance) == (value, Tolerance(half_width, unit))


@given(
    st.floats(1e-9, 1e9),
    st.one_of(st.floats(0.0, 1e9).map(lambda half: f"{half!r} g*cm^2"), st.floats(0.0, 1e6).map(lambda p: f"{p!r} %")),
)
def test_any_tolerance_makes_the_round_trip(value, tolerance):
    rig = Rig.from_toml(motor(f'inertia = "{value!r} N*mm*s^2 +/- {tolerance}"'))
    assert Rig.from_toml(rig.to_toml()) == rig


@given(st.text(max_size=40).map(lambda text: f"1 m ±{text}") | st.text(max_size=40).map(lambda text: f"{text}± 1 %"))
def test_any_text_is_a_quantity_or_a_unit_error(text):
    for parse, unit in ((parse_stated, "m"), (parse_stated_number, "")):
        try:
            number = parse(text).to(unit)
        except UnitError:
            continue
        assert not isinstance(number, UncertainNumber) or 0.0 <= number.tolerance.half_width**2 < math.inf


# Defaults.


def test_the_documentation_has_the_table():
    assert table_text() in PAGE.read_text(encoding="utf-8"), (
        "run: python -m vsalog.rig.tolerance, and put it in docs/reference/rig/tolerances.md"
    )


def test_the_table_names_keys_of_the_rig():
    keys = {field.encode_name for struct in structures() for field in struct.fields}
    known = keys | {key.removesuffix("_1") for key in keys}
    for default in DEFAULTS:
        assert default.reason
        for name in default.names:
            assert set(name.split(".")) <= known, name


def test_no_name_is_in_the_table_twice():
    names = [name for default in DEFAULTS for name in default.names]
    assert len(names) == len(set(names))


@pytest.mark.parametrize(
    ("quantity", "nominal", "scale", "half"),
    [
        ("inertia", 0.5, 0.0, 0.1),
        ("motor_1.inertia", 0.5, 0.0, 0.1),
        ("link.payload.mass", 2.0, 0.0, 0.4),
        ("link.gravity_torque", -10.0, 1.0, 1.0),
        ("motor.torque_constant", 0.05, 0.0, 0.005),
        ("motor.torque_gain", 1.0, 0.0, 0.1),
        ("transmission_2.stiffness", 60.0, 0.0, 6.0),
        ("motor.damping", 0.5, 1.0, 1.0),
        ("motor.damping", 0.0, 1.0, 0.1),
        ("motor.friction.coulomb", 2.0, 1.0, 1.0),
        ("motor.friction.static", 0.0, -3.0, 0.3),
        ("signals.link_position.gain", 1.0, 0.0, 1e-3),
        ("signals.motor_position_2.offset", 0.0, 9.0, DEG),
        ("signals.torque_sensor_1.gain", 1.0, 0.0, 0.05),
        ("torque_sensor.offset", 0.0, 4.0, 0.2),
        ("motor.torque_offset", 0.0, 4.0, 0.2),
        ("signals.link_position.delay", 0.0, 1.0, 2e-3),
        ("motor.torque_delay", 0.01, 1.0, 2e-3),
        ("signals.torque_sensor.drift", 0.0, 0.4, 0.02),
        ("signals.link_position.eccentricity.amplitude", 0.0, 1.0, 0.2 * DEG),
        ("transmission.slip[0].stiffness", 60.0, 0.0, 30.0),
        ("transmission.coefficients[1]", 0.0, 10.0, 0.5),
        ("transmission.asymmetry", 0.0, 0.0, 0.1),
        ("gear_ratio", 50.0, 1.0, 0.0),
        ("valve_1.offset", 0.0, 5.0, 0.25),
    ],
)
def test_defaults(quantity, nominal, scale, half):
    assert default_deviation(quantity, nominal, scale) == pytest.approx(half / INTERVAL)


@pytest.mark.parametrize("quantity", ["", "channel", "nosuch", "motor", "start", "inertia.nosuch", "cogging.order"])
def test_what_is_no_quantity_has_no_default(quantity):
    with pytest.raises(KeyError):
        default_deviation(quantity, 1.0, 1.0)
