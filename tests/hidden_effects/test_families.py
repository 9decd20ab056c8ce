"""Families of cases as they lie on disk, the second engine against the first, and the scoring of several effects at once."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.ndimage import uniform_filter1d

from tests.hidden_effects import _plant, family_report, motion, mujoco_engine
from tests.hidden_effects.battery import judge, lay_out, write
from tests.hidden_effects.cases import Plan, _bench, make_case, nominal_values, write_case
from tests.hidden_effects.devices import ALL_DEVICES
from tests.hidden_effects.effects import EFFECTS
from tests.hidden_effects.families import COMMON, ENGINES, FAMILIES
from tests.hidden_effects.family_report import pooled, reliability, summary
from tests.hidden_effects.family_scoring import agree, covers, score_family
from tests.hidden_effects.generate import family_plans
from tests.hidden_effects.machines import random_machine
from tests.hidden_effects.rig_file import CHANNELS
from vsalog.readers import read
from vsalog.rig.load import Rig

pytestmark = pytest.mark.share(5)

ROOT = Path(__file__).parents[2]

# ── Cases ──────────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """One case of each family, of the engine that all families have."""
    out = tmp_path_factory.mktemp("families")
    made = {name: make_case(family_plans(name, 1, 7)[0]) for name in FAMILIES}
    return {name: (case, write_case(case, out)) for name, case in made.items()}


@pytest.mark.every(2)
@pytest.mark.parametrize("name", FAMILIES)
def test_a_case_is_what_vsalog_reads(cases, name):
    case, folder = cases[name]
    rig = Rig.load(folder / "rig.toml")
    (joint,) = rig.file.joint.values()
    kind = {"bench": "elastic"}.get(case.plan.device, case.plan.device)
    assert type(joint).__name__.lower().startswith(kind)
    for file, stamps in zip(("log.parquet", "holdout.parquet"), case.stamps, strict=True):
        table = pq.read_table(folder / file)
        assert set(table.column_names[1:]) == {CHANNELS[role] for role in case.log}
        assert set(table.column_names[1:]) <= set(read(folder / file).channels)
        time = table["time"].to_numpy()
        np.testing.assert_array_equal(time, stamps)
        assert np.all(np.diff(time) > 0.0)
        assert all(np.isfinite(table[c].to_numpy()).all() for c in table.column_names)


@pytest.mark.parametrize("name", FAMILIES)
def test_the_true_rig_is_a_rig_and_says_what_was_hidden(cases, name):
    case, folder = cases[name]
    path = folder.parent / "sealed" / f"{folder.name}.rig.toml"
    Rig.load(path)
    (joint,), text = tomllib.loads(path.read_text())["joint"].values(), (folder / "rig.toml").read_text()
    assert path.read_text() != text
    for reported in case.truth["effects"]:
        cause, part, values = reported["cause"], reported["part"], reported["parameters"]
        if cause in ("motor.inertia", "motor.viscous_friction", "link.viscous_friction"):
            key = next(iter(values))
            assert joint[part][key] == pytest.approx(values[key])
        if cause == "motor.coulomb_friction":
            assert joint[part]["friction"]["coulomb"] == pytest.approx(values["torque"])
        if cause.startswith("sensor.") and cause not in ("sensor.clock_skew", "sensor.torque_delay"):
            (key,) = values
            assert joint["signals"][part][{"rate": "drift"}.get(key, key)] == pytest.approx(values[key])
        if cause == "transmission.stiffness":
            (nominal,) = tomllib.loads(text)["joint"].values()
            key = next(k for k in ("stiffness", "spring_stiffness") if k in joint[part])
            assert joint[part][key] == pytest.approx(values["factor"] * nominal[part][key])


@pytest.mark.parametrize("name", FAMILIES)
def test_the_truth_is_what_was_drawn_and_shows(cases, name):
    case, folder = cases[name]
    sealed = json.loads((folder.parent / "sealed" / f"{folder.name}.json").read_text())
    assert sealed["family"] == name
    machine, sensors = case.bench.changed(case.hidden)
    assert len(sealed["effects"]) + len(sealed["outside"]) == len(case.hidden) > 0
    for reported in sealed["effects"]:
        assert reported["parameters"] == pytest.approx(read_off(reported, machine, sensors)), reported["cause"]
        assert reported["parameters"] != reported["nominal"]
        assert reported["size"] >= 0.0
    assert max(e["size"] for e in sealed["effects"] + sealed["outside"]) >= 3.0
    assert case.bench.size(case.hidden) > 3.0
    # What the nominal machine would have done differs from the log by more than noise, once that is averaged.
    nominal = ALL_DEVICES[case.plan.device].happened(case.bench.nominal, case.bench.follow)
    if case.stamps[0].size == nominal.inside.stop - nominal.inside.start:
        off = {
            r: rms(uniform_filter1d(v - nominal.roles[r][nominal.inside], 50)) / case.bench.qualities[r].deviation
            for r, v in case.log.items()
        }
        assert max(off.values()) > 2.0 / np.sqrt(50.0)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def read_off(reported, machine, sensors):
    """What the machine and its sensors have become, for the causes that are easily read off."""
    cause, part = reported["cause"], reported["part"]
    motor = machine.motors[1 if part in ("motor_2", "secondary_motor") else 0]
    spring, link = machine.springs[1 if part.endswith("_2") else 0], machine.link[0]
    known = {
        "motor.inertia": lambda: {"inertia": motor["inertia"]},
        "motor.viscous_friction": lambda: {"damping": motor["damping"]},
        "motor.torque_constant": lambda: {"gain": motor["gain"]},
        "motor.torque_offset": lambda: {"torque": motor["offset"]},
        "motor.coulomb_friction": lambda: {"torque": motor["level"]},
        "transmission.stiffness": lambda: {"factor": spring["factor"]},
        "link.viscous_friction": lambda: {"damping": link["damping"]},
        "sensor.torque_gain": lambda: {"gain": sensors.flaws[part].gain},
        "sensor.torque_offset": lambda: {"offset": sensors.flaws[part].offset},
        "sensor.encoder_offset": lambda: {"offset": sensors.flaws[part].offset},
        "sensor.clock_skew": lambda: {"delay": sensors.flaws[part].delay},
    }
    return known[cause]() if cause in known else reported["parameters"]


def drawn(device, count):
    """What the messy family hides in machines of a device, with their nominal values."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        bench = _bench(Plan("messy-0000", device, seed, family="messy"), rng)
        hidden = FAMILIES["messy"].hide(bench, rng)
        bench.changed(hidden)
        yield [(h, nominal_values(h, bench)) for h in hidden]


@pytest.mark.every(2)
@pytest.mark.parametrize("device", ["elastic", "serial", "antagonistic"])
def test_messy_strengths_are_those_of_real_machines(device):
    for hidden in drawn(device, 8):
        assert 3 <= len({h.effect.cause for h, _ in hidden}) <= 8
        for h, nominal in hidden:
            cause, now = h.effect.cause, dict(h.parameters)
            if cause.endswith(".inertia"):
                assert 0.049 < abs(now["inertia"] / nominal["inertia"] - 1.0) < 0.151
            if cause.endswith(".viscous_friction"):
                assert 1.39 < now["damping"] / nominal["damping"] < 2.21
            if cause == "transmission.stiffness":
                assert 0.039 < abs(now["factor"] - 1.0) < 0.101
            if cause == "sensor.clock_skew":
                assert 0.001 <= abs(now["delay"]) <= 0.003


def test_parts_that_share_an_error_share_its_value():
    shared = {}
    for i, hidden in enumerate(drawn("antagonistic", 8)):
        for h, nominal in hidden:
            if h.shared:
                now, was = next(iter(h.parameters.values())), next(iter(nominal.values()))
                shared.setdefault((i, h.effect.cause), []).append(now / (was or 1.0))
    assert shared
    for both in shared.values():
        assert len(both) == 2
        assert both[0] == pytest.approx(both[1], rel=1e-9)


def test_a_battery_of_families_takes_their_devices_in_turn():
    found = lay_out(9, 1, None, ("messy", "rigid"))
    assert [p.device for p in found] == ["elastic", "serial", "antagonistic"] * 3 + ["rigid"] * 9
    assert {p.device for p in lay_out(4, 1, None, ("messy",), "mujoco")} == {"elastic"}
    assert len(lay_out(None, 1, None, ("short",))) == 60
    roles = {(p.device, p.roles) for p in lay_out(9, 1, None, ("model-error",))}
    assert len(roles) == 9
    assert all(c.cause in EFFECTS for c in COMMON)
    assert all(f.about and set(f.devices) <= set(ALL_DEVICES) for f in FAMILIES.values())


def test_the_command_writes_a_family(tmp_path):
    options = ["--kind", "bench", "--cases", "2", "--seed", "2", "--workers", "1", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "tests.hidden_effects.generate", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("2 cases in")
    assert {p.name for p in (tmp_path / "bench-0001").iterdir()} == {"log.parquet", "holdout.parquet", "rig.toml"}


def test_a_battery_judges_families_by_their_own_rules(tmp_path):
    plan = family_plans("bench", 1, 3)[0]
    folder = write_case(make_case(plan), tmp_path)
    out = folder / "diagnosis"
    out.mkdir()
    (out / "run.json").write_text(json.dumps({"seconds": 2.0, "problem": ""}))
    (out / "diagnosis.json").write_text(json.dumps(diagnosis(named("link.payload", "link", confidence=0.99))))
    outcomes = judge([folder], tmp_path / "sealed")
    text = write(outcomes, tmp_path, 3)
    assert text.startswith("Family bench, seed 3")
    found = json.loads((tmp_path / "battery.json").read_text())["families"]
    assert [f["family"] for f in found] == ["bench"]
    assert found[0]["cases"][0]["case"] == plan.name


def test_repeats_are_other_tests_of_one_machine():
    one, again = (make_case(p) for p in family_plans("bench", 2, 3))
    assert one.truth["machine"] == again.truth["machine"]
    assert one.truth["effects"] == again.truth["effects"]
    n = min(one.log["deflection"].size, again.log["deflection"].size)
    assert abs(np.corrcoef(one.log["deflection"][:n], again.log["deflection"][:n])[0, 1]) < 0.9


# ── Physics ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def test_on_a_flexible_base_energy_stays():
    machine = random_machine("elastic", np.random.default_rng(5))
    machine.motors["damping"] = machine.springs["damping"] = machine.link["damping"] = 0.0
    machine.servos["stiffness"] = machine.servos["damping"] = 0.0
    link, spring = machine.link[0], machine.springs[0]
    link["base_inertia"] = 3.0 * link["inertia"]
    link["base_stiffness"] = link["base_inertia"] * (2.0 * np.pi * 9.0) ** 2
    x0 = np.zeros(_plant.STATES)
    x0[4] = 0.5 * machine.deflection
    arrays = machine.motors, machine.springs, machine.link, machine.lever, machine.servos
    x, _, _ = _plant.play(machine.code, *arrays, np.zeros((1500, 2, 2)), 0.0, 1e-3, 5e-4, x0)
    phi, base, shaking = x[:, 4] - x[:, 0], x[:, _plant.BASE_AT], x[:, _plant.BASE_AT + 1]
    kinetic = 0.5 * (link["inertia"] * (x[:, 5] + shaking) ** 2 + machine.motors[0]["inertia"] * x[:, 1] ** 2)
    kinetic = kinetic + 0.5 * link["base_inertia"] * shaking**2
    stored = 0.5 * spring["k1"] * phi**2 + 0.25 * spring["k3"] * phi**4 + 0.5 * link["base_stiffness"] * base**2
    stored = stored - link["gravity"] * np.cos(x[:, 4] + base - link["hangs_at"])
    assert np.ptp(base) > 0.0
    assert np.ptp(kinetic + stored) < 2e-4 * np.ptp(kinetic)


def test_a_filter_in_the_drive_is_of_first_order():
    machine = random_machine("elastic", np.random.default_rng(4))
    machine.springs["k1"] = machine.springs["k3"] = machine.springs["damping"] = machine.motors["damping"] = 0.0
    machine.servos["limit"] = 1.0  # so that the command is a step of 1 N·m
    follow = np.zeros((400, 2, 2))
    follow[:, 0, 0] = 1e6
    inertia, lag = float(machine.motors[0]["inertia"]), 0.02
    machine.motors["lag"] = lag
    arrays = machine.motors, machine.springs, machine.link, machine.lever, machine.servos
    x, _, _ = _plant.play(machine.code, *arrays, follow, 0.0, 1e-3, 5e-4, np.zeros(_plant.STATES))
    time = np.arange(400) * 1e-3
    np.testing.assert_allclose(x[:, 1] * inertia, time - lag * (1.0 - np.exp(-time / lag)), atol=1e-9)


def test_a_command_is_quantised_and_recorded_so():
    case = make_case(family_plans("closed-loop", 1, 7)[0])
    quantum = float(case.bench.nominal.servos[0]["quantum"])
    truth = ALL_DEVICES[case.plan.device].happened(case.bench.nominal, case.bench.follow)
    role = "motor_torque" + case.bench.nominal.suffixes[0]
    np.testing.assert_allclose(np.remainder(truth.roles[role] / quantum + 0.5, 1.0), 0.5, atol=1e-6)


# ── The second engine ──────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("device", ENGINES["mujoco"])
@pytest.mark.parametrize("seed", [1, 2])
def test_mujoco_agrees_where_nothing_sticks(device, seed):
    rng = np.random.default_rng(seed)
    own = ALL_DEVICES[device]
    machine = own.random_machine(device, rng)
    machine.springs["k3"] = 0.0
    follow = own.wanted(machine, 3.0, 1e-3, rng)
    machine.motors["gain"], machine.motors["delay"] = 1.1, 0.0023
    one, other = own.happened(machine, follow), mujoco_engine.happened(machine, follow)
    assert set(one.roles) == set(other.roles)
    for role, values in one.roles.items():
        assert np.std(values) > 0.0
        assert np.std(values - other.roles[role]) < 2e-4 * np.std(values), role


def test_mujoco_has_friction_and_gaps():
    rng = np.random.default_rng(1)
    machine = random_machine("elastic", rng)
    machine.springs["damping"] = 0.0
    follow = motion.wanted(machine, 4.0, 1e-3, rng)
    machine.motors["level"] = machine.motors["breakaway"] = level = 0.05 * machine.torque
    machine.springs["gap"] = gap = 0.1 * machine.deflection
    truth = mujoco_engine.happened(machine, follow)
    roles = {role: values[truth.inside] for role, values in truth.roles.items()}
    phi = roles["link_position"] - roles["motor_position"]
    slack = np.abs(phi) < 0.45 * gap
    assert slack.any()
    np.testing.assert_allclose(roles["torque_sensor"][slack], 0.0, atol=1e-9)
    rate = np.gradient(roles["motor_position"], 1e-3)
    motor = machine.motors[0]
    held = 0.5 * (roles["motor_torque"] + np.roll(roles["motor_torque"], 1))
    rest = motor["inertia"] * np.gradient(rate, 1e-3) + motor["damping"] * rate - roles["torque_sensor"] - held
    moving = np.abs(rate) > 0.2 * np.max(np.abs(rate))
    assert -np.mean((rest * np.sign(rate))[moving]) == pytest.approx(level, rel=0.05)


def test_a_case_of_mujoco_is_a_case(tmp_path):
    plan = family_plans("rigid", 1, 7, engine="mujoco")[0]
    case = make_case(plan)
    folder = write_case(case, tmp_path)
    assert case.truth["engine"] == "mujoco"
    assert Rig.load(folder / "rig.toml").file.joint
    assert mujoco_engine.simulates(case.bench.nominal, case.hidden)


# ── Scoring ────────────────────────────────────────────────────────────────────────────────────────────────────────────

RIG = '[joint.knee]\nkind = "elastic"\n[joint.knee.motor]\ninertia = 0.1\n'


def truth(*effects, family="messy", **more):
    return {
        "case": f"{family}-0001", "family": family, "device": "elastic", "roles": "full", "effects": list(effects),
        "outside": [], **more,
    }  # fmt: skip


def effect(cause, part, size=20.0, alike=None, nominal=None, **parameters):
    return {
        "cause": cause, "part": part, "size": size, "alike": alike or {}, "nominal": nominal or {}, "parameters": parameters,
    }  # fmt: skip


def named(cause, part, others=(), confidence=0.95, material=True, **parameters):
    reported = {k: {"value": v, "std": s, "unit": ""} for k, (v, s) in parameters.items()}
    return {
        "cause": cause, "part": part, "parameters": reported, "indistinguishable_from": list(others), "confidence": confidence,
        "material": material,
    }  # fmt: skip


def diagnosis(*causes, verdict="explained", after=1.1, **more):
    signals = [
        {"joint": "knee", "signal": "link_position", "rmse_before": 9.0, "rmse_after": 1.0, "noise_floor": 1.0},
        {"joint": "knee", "signal": "torque_sensor", "rmse_before": 9.0, "rmse_after": after, "noise_floor": 1.0},
        {"joint": "knee", "signal": "stiffness", "rmse_before": 9.0, "rmse_after": 90.0, "noise_floor": 1.0},
    ]
    gain = {"holdout": True, "signals": signals}
    return {"verdict": verdict, "causes": list(causes), "gain": gain, "simulation_error": [], "rig": RIG, **more}


INERTIA = effect("motor.inertia", "motor", inertia=0.11, nominal={"inertia": 0.1})
SPRING = effect("transmission.stiffness", "transmission", factor=1.05, nominal={"factor": 1.0})
FAINT = effect("motor.cogging", "motor", size=1.0, torque=0.01, order=4.0, phase=0.0)


def value(outcomes, words, family="messy"):
    (found,) = [line for line in summary(family, outcomes) if words in line.what]
    return found.value


def test_only_what_is_visible_alone_has_to_be_named():
    reported = diagnosis(
        named("motor.inertia", "motor", inertia=(0.111, 0.001)),
        named("transmission.stiffness", "transmission", factor=(1.07, 0.001)),
    )
    outcome = score_family(truth(INERTIA, SPRING, FAINT), reported)
    assert outcome.asked == [True, True, False]
    assert outcome.right == [True, True, False]
    assert outcome.complete
    assert outcome.false == []
    assert [e.covered for e in outcome.estimates] == [True, False]
    assert outcome.worst == pytest.approx(1.1)
    assert value([outcome], "every cause visible") == 1.0
    assert value([outcome], "intervals that hold") == 0.5
    missed = score_family(truth(INERTIA, SPRING), diagnosis(named("motor.inertia", "motor")))
    assert not missed.complete
    assert value([outcome, missed], "every cause visible") == 0.5
    assert value([outcome, missed], "of these causes") == 0.75


@pytest.mark.parametrize(
    "member", ["transmission.stiffness", "transmission.stiffness (transmission)", "transmission.stiffness@transmission"]
)
def test_a_class_that_holds_what_was_hidden_is_right(member):
    reported = diagnosis(
        named("sensor.torque_gain", "torque_sensor", [member, "motor.torque_constant"], gain=(0.95, 0.01))
    )
    outcome = score_family(truth(SPRING), reported)
    assert outcome.complete
    assert outcome.false == []
    assert not outcome.first
    assert outcome.first_small
    assert outcome.estimates == []
    large = named("sensor.torque_gain", "torque_sensor", [member, "a.b", "c.d"])
    assert not score_family(truth(SPRING), diagnosis(large)).first_small


def test_a_number_that_two_hidden_effects_share_is_nobodys():
    gain = effect("sensor.torque_gain", "torque_sensor", gain=0.95, nominal={"gain": 1.0})
    reported = diagnosis(named("sensor.torque_gain", "torque_sensor", gain=(0.97, 0.001)))
    (estimate,) = score_family(truth(gain), reported).estimates
    assert not estimate.covered
    weight = effect("link.gravity", "link", alike={"sensor.torque_gain@torque_sensor": 0.0}, torque=0.1)
    assert score_family(truth(gain, weight), reported).estimates == []


def test_false_causes_count_where_they_are_material():
    right = named("transmission.stiffness", "transmission", factor=(1.05, 0.01))
    wrong = named("link.inertia", "link", ["link.payload (link)"], inertia=(0.3, 0.1))
    outcome = score_family(truth(SPRING), diagnosis(right, wrong))
    assert outcome.false == outcome.confident == ["link.inertia@link"]
    assert outcome.confidences == [(0.95, True), (0.95, False)]
    small = score_family(truth(SPRING), diagnosis(right, wrong | {"material": False}))
    assert small.false == []
    doubtful = score_family(truth(SPRING), diagnosis(right, wrong | {"confidence": 0.4}))
    assert doubtful.false
    assert not doubtful.confident
    assert value([outcome, small], "a false material cause") == 0.5
    same = effect("motor.inertia", "motor", alike={"link.inertia@link": 0.0}, inertia=0.2)
    assert score_family(truth(same), diagnosis(wrong)).false == []


def test_one_name_may_cover_both_parts_of_a_joint():
    both = [effect("transmission.stiffness", f"transmission_{i}", factor=1.05, nominal={"factor": 1.0}) for i in (1, 2)]
    for part in ("transmission", "transmissions", "transmission_1, transmission_2", "transmission_1+transmission_2"):
        outcome = score_family(truth(*both), diagnosis(named("transmission.stiffness", part, factor=(1.05, 0.01))))
        assert outcome.right == [True, True], part
        assert len(outcome.estimates) == 1
    half = score_family(truth(*both), diagnosis(named("transmission.stiffness", "transmission_1")))
    assert half.right == [True, False]
    assert not covers("motor", "link")
    assert not covers("motor_1", "motor_2")
    assert covers("encoders", "link_position")
    assert covers(None, "motor")


def test_absurd_values_are_those_far_from_the_rig():
    causes = [
        named("motor.inertia", "motor", inertia=(0.31, 0.01)),
        named("transmission.stiffness", "transmission", factor=(0.4, 0.01)),
        named("sensor.torque_gain", "torque_sensor", gain=(0.05, 0.01)),
    ]
    found = score_family(truth(INERTIA, SPRING), diagnosis(*causes)).absurd
    assert [f.split(".")[1].split("@")[0] for f in found] == ["inertia", "torque_gain"]


def test_what_is_called_explained_is_near_the_floor():
    near, far = (score_family(truth(SPRING), diagnosis(after=after)) for after in (1.9, 2.1))
    unmeasured = score_family(truth(SPRING), diagnosis() | {"gain": {"signals": []}})
    partly = score_family(truth(SPRING), diagnosis(verdict="partly explained", after=9.0))
    assert value([near, far, unmeasured, partly], "called explained") == pytest.approx(1.0 / 3.0)
    assert value([near, far], "at most 1.5 times") == 0.0


def test_next_to_model_error_only_larger_causes_are_asked_for():
    lost = {**INERTIA, "over_remainder": 0.4}
    clear = {**SPRING, "over_remainder": 3.0}
    outside = {"what": "filter in the drive", "part": "motor", "size": 50.0, "near": ["motor.torque_delay@motor"]}
    reported = diagnosis(
        named("transmission.stiffness", "transmission"),
        named("motor.torque_delay", "motor"),
        named("sensor.clock_skew", "motor_position", ["motor.torque_delay"]),
        verdict="partly explained",
    )
    outcome = score_family(truth(lost, clear, family="model-error", outside=[outside], remainder=50.0), reported)
    assert outcome.asked == [False, True]
    assert outcome.false == []
    assert value([outcome], "causes larger than", "model-error") == 1.0
    assert value([outcome], "partly explained", "model-error") == 1.0
    assert value([outcome], "over the noise, median", "model-error") == 50.0


def test_the_damping_of_a_gaps_walls_is_neither_right_nor_false():
    gap = effect("transmission.backlash", "transmission_1", gap=0.01)

    def false(*effects):
        damping = named("transmission.damping", "transmission_1", confidence=1.0)
        outcome = score_family(truth(*effects), diagnosis(damping))
        return outcome.false, outcome.confidences

    assert false(gap) == ([], [])
    assert false({**gap, "part": "transmission_2"}) == (["transmission.damping@transmission_1"], [(1.0, False)])
    assert false(SPRING) == (["transmission.damping@transmission_1"], [(1.0, False)])


def test_the_member_of_a_class_that_is_not_hidden_is_wrong_and_its_class_is_right():
    gain = named("sensor.torque_gain", "torque_sensor", ["transmission.stiffness (transmission)"], confidence=0.4)
    outcome = score_family(truth(SPRING), diagnosis(gain | {"class_confidence": 0.97}))
    assert outcome.confidences == [(0.4, False)]
    assert outcome.class_confidences == [(0.97, True)]
    assert outcome.false == []


def test_repeats_agree_on_verdict_and_causes():
    def test_of(machine, *causes, verdict="explained"):
        return score_family(truth(SPRING, family="bench", machine=machine), diagnosis(*causes, verdict=verdict))

    gain = named("sensor.torque_gain", "torque_sensor", ["transmission.stiffness (transmission)"])
    spring = named("transmission.stiffness", "transmission")
    outcomes = [
        test_of("a", gain), test_of("a", spring), test_of("b", spring), test_of("b", spring, verdict="partly explained"),
        test_of("c", spring), test_of("c", spring, named("link.inertia", "link")),
    ]  # fmt: skip
    assert agree(outcomes) == [True, False, False]


def test_a_command_that_failed_counts_against_every_number():
    outcome = score_family(truth(SPRING), None, problem="failed: bug")
    assert outcome.failed
    assert value([outcome], "every cause visible") == 0.0
    assert value([outcome], "a false material cause") == 1.0
    assert value([outcome], "no diagnosis") == 1.0
    assert score_family(truth(SPRING), diagnosis(verdict="consistent as far as checked")).failed is False


def test_confidence_is_held_against_how_often_it_is_right():
    certain = named("transmission.stiffness", "transmission", confidence=0.97)
    doubtful = named("link.inertia", "link", confidence=0.6)
    outcomes = [score_family(truth(SPRING), diagnosis(certain, doubtful)) for _ in range(3)]
    said = [c for o in outcomes for c in o.confidences]
    assert reliability(said) == [[0.5, 0.7, pytest.approx(0.6), 0.0, 3], [0.95, 0.99, pytest.approx(0.97), 1.0, 3]]
    (found,) = family_report.document(outcomes)
    assert pooled([reliability(said[:2]), reliability(said[2:])]) == [pytest.approx(r) for r in reliability(said)]
    text = family_report.markdown([found], 7, "0.1")
    assert "Family messy, seed 7, vsalog 0.1, 3 cases." in text
    assert "False: link.inertia@link 3." in text
    for family in FAMILIES:
        assert all(line.value is None for line in summary(family, []))
        assert summary(family, outcomes)
    assert len(found["cases"]) == 3
    assert "consistent: 0 (3 cases)" in family_report.true_rig_table(outcomes)
    json.dumps(found)
