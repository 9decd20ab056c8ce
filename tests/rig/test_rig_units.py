"""Unit text, with pint as the oracle for what is known by heart."""

import math
from contextlib import suppress

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.errors import RigError, UnitError
from vsalog.core.unit_tables import ATOMS, KINDS, QUANTITIES
from vsalog.core.units import (
    LINE_LENGTH,
    is_counts,
    matching,
    parse_quantity,
    parse_unit,
    si_factor,
    split_header,
    split_quantity,
)
from vsalog.rig import Rig

REGISTRY = pint.UnitRegistry()
BASES = ("[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")
# Names that pint does not have, spelt as it would know them.
TO_PINT = {
    "Nm": "N*m", "mNm": "mN*m", "Nmm": "N*mm", "Ncm": "N*cm", "kNm": "kN*m", "uNm": "uN*m", "mNmm": "mN*mm",
    "newtonmeter": "N*m", "newtonmeters": "N*m", "degs": "deg", "revs": "revolution", "rev": "revolution",
    "rotation": "revolution", "rotations": "revolution", "gf": "gram_force", "ozf": "ounce_force", "amp": "A", "amps": "A",
    "g_n": "standard_gravity", "°": "deg", "Ω": "ohm", "arcminute": "arcmin", "arcsecond": "arcsec",
}  # fmt: skip
ATOM = st.sampled_from(sorted(set(ATOMS) - {"%"}))


def oracle(text: str) -> tuple[float, tuple[float, ...]]:
    quantity = REGISTRY.Quantity(1.0, text).to_base_units()
    exponents = dict(quantity.dimensionality)
    return float(quantity.magnitude), tuple(float(exponents.get(base, 0)) for base in BASES)


@pytest.mark.parametrize("name", sorted(set(ATOMS) - {"%"}))
def test_the_table_agrees_with_pint(name):
    factor, dimension = oracle(TO_PINT.get(name, name))
    ours = parse_unit(name)
    assert ours.factor == pytest.approx(factor, rel=1e-12)
    assert ours.dimension[:-1] == dimension


@given(st.lists(st.tuples(ATOM, st.integers(-3, 3).filter(bool), st.booleans()), min_size=1, max_size=4))
def test_products_and_quotients_agree_with_pint(parts):
    ours, theirs = "", ""
    for name, power, divide in parts:
        sign = "" if not ours else "/" if divide else "*"
        ours += f"{sign}{name}^{power}"
        theirs += f"{sign}({TO_PINT.get(name, name)})**({power})"
    if len(ours) > LINE_LENGTH:
        return
    factor, dimension = oracle(theirs)
    unit = parse_unit(ours)
    assert unit.factor == pytest.approx(factor, rel=1e-9)
    assert unit.dimension[:-1] == pytest.approx(dimension)


@pytest.mark.parametrize(
    ("text", "like", "factor"),
    [
        ("N·mm/rad", "N*m/rad", 1e-3),
        ("N⋅mm", "N*m", 1e-3),
        ("N.mm", "N*m", 1e-3),
        ("N mm", "N*m", 1e-3),
        ("N-mm", "N*m", 1e-3),
        ("kg*m*mm", "kg*m^2", 1e-3),
        ("N*mm*s²/rad", "kg*m^2", 1e-3),
        ("kg m²", "kg*m^2", 1.0),
        ("g*cm^2", "kg*m^2", 1e-7),
        ("kgf cm", "N*m", 0.0980665),
        ("N*m/deg", "N*m/rad", 180.0 / math.pi),
        ("N*m", "N*m/rad", 1.0),
        ("kN/mm", "N/m", 1e6),
        ("mm/rev", "m/rad", 1e-3 / (2.0 * math.pi)),
        ("µm", "m", 1e-6),
        ("µrad", "rad", 1e-6),
        ("°", "rad", math.pi / 180.0),
        ("Degrees", "rad", math.pi / 180.0),
        ("g", "m/s^2", 9.80665),
        ("g", "kg", 1e-3),
        ("N*m*s**2", "kg*m^2", 1.0),
        ("N*m/(rad/s)", "N*m*s/rad", 1.0),
        ("s⁻¹", "Hz", 1.0),
        ("rpm", "rad/s", math.pi / 30.0),
        ("lbf*ft", "N*m", 1.3558179483314),
        ("slug*ft^2", "kg*m^2", 1.3558179483314),
    ],
)
def test_spellings(text, like, factor):
    assert si_factor(text, like) == pytest.approx(factor, rel=1e-12)


def test_printed_values_convert_without_a_trace_of_rounding():
    assert parse_quantity("7.3 kg*m*mm", "kg*m^2") == 7.3e-3
    assert parse_quantity("0.01422 kN/mm", "N/m") == 14220.0
    assert parse_quantity("100 mm", "m") == 0.1


def test_a_mismatch_names_both_quantities():
    with pytest.raises(UnitError, match=r"'N\*m' is a torque, but an angle \(rad, deg, …\) is wanted"):
        si_factor("N*m", "rad")
    with pytest.raises(UnitError, match="'deg' is an angle, but a rotational stiffness"):
        si_factor("deg", "N*m/rad")
    with pytest.raises(UnitError, match=r"'N' is a force, but an angle .* or a length .* is wanted"):
        matching("N", ("rad", "m"))
    assert matching("mm", ("rad", "m")) == "m"


@pytest.mark.parametrize("unit", ["degC", "°C", "celsius", "degF"])
@pytest.mark.parametrize("like", ["rad", "K"])
def test_units_with_a_zero_of_their_own_are_refused(unit, like):
    with pytest.raises(UnitError, match="a zero of its own"):
        si_factor(unit, like)


@pytest.mark.parametrize(
    "text",
    ["", " ", "((((", "m)", "m/", "*m", "m**m", "9**9**9**9", "2 m", "m" * 81, "__import__('os')",
     "m;m", "m\nm\0", "km^12*km^12*km^12*km^12/um^12/um^12/um^12", "nosuchunit", "é"],
)  # fmt: skip
def test_what_is_no_unit_is_refused(text):
    with pytest.raises(UnitError):
        parse_unit(text)


@given(st.text(max_size=80))
def test_any_text_gives_a_unit_or_a_unit_error(text):
    for function in (parse_unit, split_quantity):
        with suppress(UnitError):
            function(text)
    name, unit = split_header(text)
    assert unit is None or is_counts(unit) or parse_unit(unit).factor > 0.0
    assert name in text


def test_pint_is_not_imported_for_what_is_known_by_heart():
    import subprocess
    import sys

    code = "import sys, vsalog.core.units as u; u.si_factor('N·mm/deg', 'N*m/rad'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("500 N·mm/rad", 500.0, "N·mm/rad"),
        (" -5deg ", -5.0, "deg"),
        ("−5 deg", -5.0, "deg"),
        ("1e-3kg m^2", 1e-3, "kg m^2"),
        (".5 m", 0.5, "m"),
    ],
)
def test_quantities(text, value, unit):
    assert split_quantity(text) == (value, unit)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("5", "has no unit"),
        ("deg", "does not begin with a number"),
        ("2.5/(2*pi) mm/rad", "not one plain number"),
        ("1,5 mm", "not one plain number"),
        ("2^3 m", "not one plain number"),
    ],
)
def test_what_is_no_quantity(text, why):
    with pytest.raises(UnitError, match=why):
        split_quantity(text)


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("theta [deg]", "theta", "deg"),
        ("theta[deg]", "theta", "deg"),
        ("torque (N·mm)", "torque", "N·mm"),
        ("k (N*m/(rad/s))", "k", "N*m/(rad/s)"),
        ("x (filtered)", "x (filtered)", None),
        ("q (min)", "q (min)", None),
        ("q[1]", "q[1]", None),
        ("[deg]", "[deg]", None),
        ("plain", "plain", None),
        ("/joint_states.position[m]", "/joint_states.position[m]", None),
        ("/joint_states.position[elbow] [rad]", "/joint_states.position[elbow]", "rad"),
    ],
)
def test_headers(header, name, unit):
    assert split_header(header) == (name, unit)


def test_every_quantity_of_a_key_has_a_name():
    for unit in QUANTITIES:
        assert parse_unit(unit).dimension in KINDS


def test_a_unit_is_read_up_to_80_characters():
    assert parse_unit("m" + "*rad/rad" * 9 + "*rad/s" + " ") == parse_unit("m*rad/s")
    with pytest.raises(UnitError, match="too long"):
        parse_unit("m" + "*rad/rad" * 9 + "*rad/s" + "  ")


def test_a_header_is_split_up_to_256_characters():
    name = "q" * 250
    assert split_header(f"{name} [deg]") == (name, "deg")
    assert split_header(f"{name}q [deg]") == (f"{name}q [deg]", None)


@pytest.mark.parametrize(
    ("unit", "like", "factor"),
    [("rev/4096", "rad", 2.0 * math.pi / 4096.0), ("rev/4096/s", "rad/s", 2.0 * math.pi / 4096.0), ("N/2.5", "N", 0.4)],
)
def test_a_number_may_divide_a_unit(unit, like, factor):
    assert si_factor(unit, like) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("unit", ["4096 rev", "rev 4096", "4096/rev", "rev/0", "rev/", "rev/(4096)", "rev/-2"])
def test_a_number_elsewhere_is_no_unit(unit):
    with pytest.raises(UnitError):
        si_factor(unit, "rad")


@pytest.mark.parametrize("unit", ["counts", "Ticks", "counts/s", "LSB"])
def test_counts_alone_are_refused_with_the_way_out(unit):
    with pytest.raises(UnitError, match=r"counts_per_turn = 4096 .* unit = \"rev/4096\""):
        si_factor(unit, "rad/s" if "/" in unit else "rad")
    assert split_header(f"Enc1 [{unit}]")[1] == (None if "/" in unit else unit)


def test_counts_per_turn_is_the_unit_of_a_loaded_rig():
    text = """
        [joint.a]
        kind = "elastic"
        [joint.a.signals]
        motor_position = { channel = "Enc1", counts_per_turn = 131072 }
        link_position = { channel = "Enc2", counts_per_turn = 0.5e3, unit = "counts" }
        motor_velocity = { channel = "v", counts_per_turn = 2048.5 }
    """
    with pytest.raises(RigError, match="not possible: it has to be at least 1"):
        Rig.from_toml(text.replace("0.5e3", "0.5"), "rig.toml")
    signals = Rig.from_toml(text, "rig.toml").joints["a"].signals
    units = (signals.motor_position.unit, signals.link_position.unit, signals.motor_velocity.unit)
    assert units == ("rev/131072", "rev/500", "rev/2048.5/s")
