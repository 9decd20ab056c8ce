"""Pneumatic joints diagnosed: the equations, what roles allow, and the six causes found in logs that scipy made."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pam_machine import LEVEL, PAPER, Array, Bench, joint_of, played, rates, torque_of

from vsalog.core.errors import DiagnosisError
from vsalog.core.signals import JointSignals
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.found import loss_of
from vsalog.diagnosis.joint import diagnose_joint
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.selection import Choice, Selection, select
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.balance_pneumatic import _least_about, balance_pneumatic, pneumatic_motion
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint
from vsalog.residuals.system import build_system
from vsalog.rig.schema import PneumaticJoint, SimpleFriction, TonduFriction

pytestmark = pytest.mark.share(3)

CHANNELS = {
    "link_position": "angle", "torque_sensor": "torque", "pressure_1": "p1", "pressure_2": "p2", "valve_1": "u1", "valve_2": "u2",
}  # fmt: skip
SI = np.array([1.0, 1.0, 1e5, 1e5])


def signals_of(bench: Bench, without: tuple[str, ...] = (), seed: int = 0) -> JointSignals:
    columns = played(bench, seed=seed)
    roles = {role: columns[name] for role, name in CHANNELS.items() if role not in without}
    n = columns["time"].size
    starts = np.zeros(n, np.bool_)
    starts[0] = True
    return JointSignals("arm", 0.002, np.arange(n) * 2_000_000, columns["time"], roles, starts, np.zeros(n, np.int32))


@cache
def diagnosed(bench: Bench, without: tuple[str, ...] = (), friction: str = PAPER) -> Selection:
    joint = at_joint(joint_of(bench, friction))
    system = build_system(joint, channels_of(signals_of(bench, without)), balance_for(joint), 0.001)
    return select(system, joint, setting_of(joint, system), frozenset(), {})


def material(found: Selection) -> list[Choice]:
    return [c for c in found.choices if c.size >= 1.0]


def loss(found: Selection) -> float:
    return loss_of(found.system, placed(found.problem.joint, found.posterior.fit))


def value_of(found: Selection, parameter: str) -> tuple[float, str]:
    (choice,) = material(found)
    values = next(v for s, v in found.posterior.fit if s.key == choice.site.key)
    return choice.site.reported(values.tolist())[parameter]


def names(bench: Bench, without: tuple[str, ...] = ()) -> tuple[str, ...]:
    joint = joint_of(bench)
    return build_system(joint, channels_of(signals_of(bench, without)), balance_for(joint)).names


def exact(bench: Bench, seed: int, n: int = 40, least: float = 1.3) -> tuple[dict[str, Array], Array]:
    """Return roles of states that have nothing to do with each other, with their true rates, and the states."""
    rng = np.random.default_rng(seed)
    way = rng.choice([-1.0, 1.0], n)
    x = np.stack([rng.uniform(-0.4, 0.4, n), way * rng.uniform(0.1, 3.0, n), *rng.uniform(least, 6.8, (2, n))])
    u = rng.uniform(0.0, 10.0, (2, n))
    dx = np.array([rates(bench, state, (a, b)) for state, a, b in zip(x.T, *u, strict=True)]).T
    zero = np.zeros(n)
    roles = {
        "link_position": np.stack([x[0], x[1], dx[1]]),
        "torque_sensor": np.stack([[torque_of(bench, state) for state in x.T], zero, zero]),
        "pressure_1": np.stack([1e5 * x[2], 1e5 * dx[2], zero]),
        "pressure_2": np.stack([1e5 * x[3], 1e5 * dx[3], zero]),
        "valve_1": np.stack([u[0], zero, zero]),
        "valve_2": np.stack([u[1], zero, zero]),
    }
    return roles, x


def as_rig(bench: Bench, friction: str = PAPER) -> PneumaticJoint:
    """Return the joint with all that is true put into its rig."""
    joint = joint_of(bench, friction)
    changed = {}
    for i in (0, 1):
        muscle, valve = getattr(joint, f"muscle_{i + 1}"), getattr(joint, f"valve_{i + 1}")
        changed[f"muscle_{i + 1}"] = msgspec.structs.replace(
            muscle, force_gain=bench.gain[i], leak_area=1e-6 * bench.leak[i]
        )
        changed[f"valve_{i + 1}"] = msgspec.structs.replace(valve, area_scale=bench.scale[i], offset=bench.valve[i])
    if bench.level is None:
        changed["friction"] = msgspec.structs.replace(joint.friction, muscle=bench.tube)
    return msgspec.structs.replace(joint, **changed)


benches = st.builds(
    Bench,
    gain=st.tuples(st.floats(0.7, 1.4), st.floats(0.7, 1.4)),
    leak=st.tuples(st.floats(0.0, 0.05), st.floats(0.0, 0.05)),
    scale=st.tuples(st.floats(0.5, 2.0), st.floats(0.5, 2.0)),
    valve=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    tube=st.floats(0.0, 3e9),
)


@settings(max_examples=25, deadline=None)
@given(benches, st.integers(0, 1000))
def test_no_residual_is_left_of_equations_written_out_by_hand(bench: Bench, seed: int) -> None:
    roles, _ = exact(bench, seed)
    time = np.arange(40) * 1e-3
    found = balance_pneumatic(as_rig(bench), roles, time, {})
    assert [(e.name, e.side, e.unit) for e in found] == [
        ("seesaw", "link", "N*m"),
        ("transmission", "transmission", "N*m"),
        ("pressure_1", "pneumatic", "Pa/s"),
        ("pressure_2", "pneumatic", "Pa/s"),
    ]
    sizes = [np.abs(roles["torque_sensor"][0]).max()] * 2 + [np.abs(roles[f"pressure_{i}"][1]).max() for i in (1, 2)]
    for equation, size in zip(found, sizes, strict=True):
        assert np.abs(equation.whole).max() < 1e-9 * size


def test_a_push_from_outside_moves_the_seesaw() -> None:
    roles, _ = exact(Bench(), 1)
    push = np.linspace(-1.0, 1.0, 40)
    roles["link_position"][2] += push / 8e-4
    roles["external_torque"] = np.stack([push, np.zeros(40), np.zeros(40)])
    seesaw = balance_pneumatic(as_rig(Bench()), roles, np.arange(40) * 1e-3, {})[0]
    assert np.abs(seesaw.whole).max() < 1e-9


@pytest.mark.parametrize("missing", ["link_position", "pressure_1", "pressure_2"])
def test_the_torque_meter_tells_one_angle_or_pressure(missing: str) -> None:
    bench = Bench(gain=(1.1, 0.9))
    roles, x = exact(bench, 3)
    given = {r: v for r, v in roles.items() if r != missing}
    motion = pneumatic_motion(as_rig(bench), given, np.arange(40) * 1e-3, {})
    assert motion.spent == {"transmission"}
    index = {"link_position": 0, "pressure_1": 2, "pressure_2": 3}[missing]
    assert motion.roles[missing][0] == pytest.approx(x[index] * SI[index], rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("missing", ["pressure_1", "pressure_2"])
def test_without_a_meter_the_seesaw_tells_a_pressure(missing: str) -> None:
    bench = Bench()
    # Far from empty, where friction would have no bounds.
    roles, x = exact(bench, 4, least=2.5)
    given = {r: v for r, v in roles.items() if r not in (missing, "torque_sensor")}
    motion = pneumatic_motion(as_rig(bench), given, np.arange(40) * 1e-3, {})
    assert motion.spent == {"seesaw"}
    assert motion.roles[missing][0] == pytest.approx(1e5 * x[int(missing[-1]) + 1], rel=1e-6)


@pytest.mark.parametrize(
    ("without", "expected"),
    [
        ((), ("seesaw", "transmission", "pressure_1", "pressure_2")),
        (("torque_sensor",), ("seesaw", "pressure_1", "pressure_2")),
        (("valve_1",), ("seesaw", "transmission", "pressure_2")),
        (("valve_1", "valve_2", "torque_sensor"), ("seesaw",)),
        (("link_position",), ("seesaw", "pressure_1", "pressure_2")),
        (("pressure_2",), ("seesaw", "pressure_1", "pressure_2")),
        (("pressure_1", "torque_sensor"), ("pressure_1", "pressure_2")),
        (("pressure_1", "pressure_2"), ()),
        (("link_position", "torque_sensor"), ()),
    ],
)
def test_the_roles_say_which_equations_there_are(without: tuple[str, ...], expected: tuple[str, ...]) -> None:
    assert names(Bench(), without) == expected


def test_a_clamped_seesaw_needs_no_encoder_and_has_no_equation_of_its_own() -> None:
    bench = Bench(held=0.1)
    assert names(bench, ("link_position",)) == ("transmission", "pressure_1", "pressure_2")
    assert names(bench) == ("transmission", "pressure_1", "pressure_2", "link_position")


METER = ("torque_sensor",)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("bench", "without", "cause", "part", "parameter", "truth"),
    [
        (Bench(leak=(0.006, 0.0)), (), "leak", "muscle_1", "area", 0.006e-6),
        (Bench(leak=(0.0, 0.02)), METER, "leak", "muscle_2", "area", 0.02e-6),
        (Bench(scale=(1.0, 0.9)), (), "orifice_area", "valve_2", "scale", 0.9),
        (Bench(scale=(1.3, 1.0)), METER, "orifice_area", "valve_1", "scale", 1.3),
        (Bench(valve=(0.15, 0.0)), (), "valve_offset", "valve_1", "offset", 0.15),
        (Bench(valve=(0.0, -0.3)), METER, "valve_offset", "valve_2", "offset", -0.3),
        (Bench(gauge=(0.0, 4000.0)), (), "pressure_offset", "pressure_2", "offset", 4000.0),
        (Bench(gauge=(-9000.0, 0.0)), METER, "pressure_offset", "pressure_1", "offset", -9000.0),
        (Bench(gain=(1.05, 1.0)), (), "force_gain", "muscle_1", "gain", 1.05),
        (Bench(gain=(1.0, 0.88)), METER, "force_gain", "muscle_2", "gain", 0.88),
        (Bench(gain=(1.05, 1.0)), ("pressure_2", "torque_sensor"), "force_gain", "muscle_1", "gain", 1.05),
        (Bench(tube=2e9), (), "muscle_friction", "friction", "muscle", 2e9),
        (Bench(tube=0.2e9), METER, "muscle_friction", "friction", "muscle", 0.2e9),
    ],
    ids=lambda v: v if isinstance(v, str) else None,
)
def test_each_cause_is_named_with_its_size(
    bench: Bench, without: tuple[str, ...], cause: str, part: str, parameter: str, truth: float
) -> None:
    found = diagnosed(bench, without)
    assert [c.site.key for c in material(found)] == [(f"pneumatic.{cause}", part)]
    assert material(found)[0].rivals == ()
    value, _ = value_of(found, parameter)
    nominal = {"gain": 1.0, "scale": 1.0}.get(parameter, 0.0)
    assert value - nominal == pytest.approx(truth - nominal, rel=0.05)
    # Only noise is left.
    assert loss(found) < 1.3 * found.system.count


@pytest.mark.every(2)
@pytest.mark.parametrize("without", [(), ("torque_sensor",), ("link_position",), ("pressure_2",), ("valve_1",)])
def test_nothing_is_found_where_nothing_is_wrong(without: tuple[str, ...]) -> None:
    found = diagnosed(Bench(), without)
    assert material(found) == []
    assert loss(found) < 1.3 * found.system.count


def test_friction_that_the_rig_has_as_a_level_is_reported_as_a_level() -> None:
    found = diagnosed(Bench(level=0.035), friction=LEVEL)
    assert [c.site.key for c in material(found)] == [("pneumatic.muscle_friction", "friction")]
    assert value_of(found, "torque") == (pytest.approx(0.035, rel=0.05), "N*m")


def test_friction_where_the_rig_has_none_and_where_it_breaks_away() -> None:
    joint = msgspec.structs.replace(joint_of(Bench()), friction=None)
    signals = signals_of(Bench(level=0.02))
    system = build_system(joint, channels_of(signals), balance_for(joint))
    (site,) = catalogue()["pneumatic.muscle_friction"].sites(setting_of(joint, system))
    assert site.apply(joint, (0.02,)).friction == SimpleFriction(level=0.02)
    breaking = msgspec.structs.replace(joint, friction=TonduFriction(static=0.05, kinetic=0.03, speed=0.1))
    assert site.apply(breaking, (0.04,)).friction == TonduFriction(static=pytest.approx(0.06), kinetic=0.04, speed=0.1)
    found = select(system, joint, setting_of(joint, system), frozenset(), {})
    assert [c.site.cause for c in material(found)] == ["pneumatic.muscle_friction"]


@pytest.mark.parametrize(
    ("without", "causes"),
    [
        (("valve_1", "valve_2"), {"force_gain", "pressure_offset", "muscle_friction"}),
        (("valve_2",), {"leak", "orifice_area", "valve_offset", "force_gain", "pressure_offset", "muscle_friction"}),
    ],
)
def test_causes_stand_only_where_their_equations_do(without: tuple[str, ...], causes: set[str]) -> None:
    joint = joint_of(Bench())
    system = build_system(joint, channels_of(signals_of(Bench(), without)), balance_for(joint))
    setting = setting_of(joint, system)
    sites = {site.key for cause in catalogue().values() for site in cause.sites(setting)}
    there = {name.removeprefix("pneumatic.") for name, _ in sites if name.startswith("pneumatic.")}
    assert there == causes
    assert not {
        part for name, part in sites if name in ("pneumatic.leak", "pneumatic.orifice_area") and part.endswith("_2")
    }
    # What the log does not hold cannot be late or off.
    assert not {part for _, part in sites if part in without}


def test_a_clamped_seesaw_has_no_friction_to_find_but_leaks() -> None:
    bench = Bench(held=0.1, leak=(0.01, 0.0))
    found = diagnosed(bench, ("link_position",))
    assert [c.site.key for c in material(found)] == [("pneumatic.leak", "muscle_1")]
    joint = joint_of(bench)
    setting = setting_of(joint, found.system)
    assert not list(catalogue()["pneumatic.muscle_friction"].sites(setting))


def test_one_scale_of_two_muscles_is_not_distinguished_from_the_scale_of_the_meter() -> None:
    # Clamped, and without valves, only the meter's equation is left: both muscles stronger is the meter's gain. The tolerance of
    # muscles is wider.
    found = diagnosed(Bench(held=0.0, gain=(1.1, 1.1)), ("valve_1", "valve_2", "link_position"))
    (choice,) = material(found)
    assert choice.site.cause == "pneumatic.force_gain"
    assert "sensor.torque_gain" in {r.cause for r in choice.rivals}


def test_where_the_seesaw_tells_a_pressure_one_muscle_stronger_is_the_other_weaker() -> None:
    # Without valves nothing is left to be compared with it.
    assert names(Bench(), ("pressure_2", "torque_sensor", "valve_1", "valve_2")) == ()
    found = diagnosed(Bench(gain=(1.1, 1.0)), ("pressure_2", "torque_sensor", "valve_1"))
    choice = material(found)[0]
    told = {choice.site.key, *(r.key for r in choice.rivals)}
    assert ("pneumatic.force_gain", "muscle_1") in told or ("pneumatic.force_gain", "muscle_2") in told


def test_the_meter_is_judged_by_the_seesaw() -> None:
    found = diagnosed(Bench(meter=1.1))
    assert [c.site.key for c in material(found)] == [("sensor.torque_gain", "torque_sensor")]


def test_an_angle_that_nothing_tells_is_reported() -> None:
    with pytest.raises(DiagnosisError, match="muscles needs their pressures with the angle, or with the torque meter"):
        diagnose_joint("arm", joint_of(Bench()), signals_of(Bench(), ("link_position", "torque_sensor")), None)


@pytest.mark.parametrize(("away", "known"), [(0.018, False), (0.025, True)])
def test_the_direction_is_not_known_for_two_hundredths_of_a_second_about_a_reversal(away: float, known: bool) -> None:
    """The filter's window is 0.03 s long, and what it saw of the reversal within seven tenths of that is smeared."""
    time = np.arange(-500, 501) * 1e-3
    about = _least_about(np.where(time < 0.0, -1.0, 1.0), time)
    assert [bool(about[np.searchsorted(time, at)]) for at in (-away, away)] == [known, known]


@pytest.mark.parametrize(("share", "moves"), [(0.07, False), (0.14, True)])
def test_what_is_slower_than_a_tenth_of_its_usual_velocity_may_stick(share: float, moves: bool) -> None:
    time = np.arange(2000) * 1e-3
    rate = np.sign(np.sin(2.0 * np.pi * time))
    rate[200:300] = share * np.std(rate)
    assert bool(_least_about(rate, time)[250]) is moves
