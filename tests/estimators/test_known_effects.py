"""An extended rig is estimated with like any other: with each effect on and known, as good as without it; not known, worse."""

import itertools
from functools import cache

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from vsalog.binding.joint import bind, offered_roles
from vsalog.cli import cli
from vsalog.core.errors import EstimatorError
from vsalog.core.trace import Trace
from vsalog.effects.cogging import Cogging
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.estimators.device import device_of
from vsalog.estimators.registry import method
from vsalog.estimators.torque import residual_block
from vsalog.estimators.tuning import read_tuning
from vsalog.rig import Rig
from vsalog.rig.schema import BoucWen, Friction, SlipElement
from vsalog.simulation import simulate, sine, sum_of

pytestmark = pytest.mark.share(6)

SEA = Rig.preset("sea").file
PLAIN = SEA.joint["sea"]
MOTION = sum_of(sine(2.0, 0.2), sine(1.0, 1.3))
DURATION = 20.0

# By the causes' names: what the rig has of each. Inertia, viscous friction, stiffness and nonlinearity are the rig's own numbers.
MOTOR = {
    "coulomb_friction": {"friction": Friction(coulomb=0.3)},
    "stribeck_friction": {"friction": Friction(coulomb=0.2, static=0.35, stribeck_velocity=0.3)},
    "load_dependent_friction": {"friction": Friction(coulomb=0.1, load=0.15)},
    "presliding": {"friction": Friction(coulomb=0.3, presliding_stiffness=40.0)},
    "lugre": {
        "friction": Friction(
            coulomb=0.2, static=0.3, stribeck_velocity=0.3, presliding_stiffness=60.0, presliding_damping=0.3
        )
    },
    "cogging": {"cogging": (Cogging(torque=0.3, order=6.0, phase=0.3),)},
    "torque_constant": {"torque_gain": 1.15},
    "torque_offset": {"torque_offset": 0.3},
    "torque_delay": {"torque_delay": 0.015},
}
TRANSMISSION = {
    "damping": {"damping": 2.0},
    "hysteresis": {"bouc_wen": BoucWen(torque=0.4, width=0.02, exponent=1.5)},
    "slip": {"slip": (SlipElement(stiffness=30.0, limit=0.2), SlipElement(stiffness=10.0, limit=0.2))},
    "damping in a gap": {"damping": 2.0, "backlash": 0.02},
}
METHODS = {"residual-rls": {}, "qr-rls": {}, "direct": {}, "SENSOR": {"modality": "SENSOR"}}
CASES = [
    *((e, m) for e in MOTOR for m in ("residual-rls", "qr-rls")),
    *((e, m) for e in ("damping", "hysteresis", "slip") for m in METHODS),
]


def extended(effect):
    return replace(
        PLAIN,
        motor=replace(PLAIN.motor, **MOTOR.get(effect, {})),
        transmission=replace(PLAIN.transmission, **TRANSMISSION.get(effect, {})),
    )


@cache
def played(effect):
    rig = replace(SEA, joint={"sea": extended(effect)})
    return simulate(rig, {"sea": {"motor_torque": MOTION}}, DURATION, period=2e-3)


@cache
def errors(effect, believed, name):
    """Share by which torque fed, fitted torque and stiffness are off, and the stiffness' error in its own standard deviations."""
    joint, experiment = extended(believed), played(effect)
    estimator = "residual-rls" if name == "SENSOR" else name
    choice = choose("sea", joint, estimator, METHODS[name])
    trace = estimate_joint([experiment.recording()], "sea", joint, choice).trace
    at = {n: np.interp(trace.time, experiment.time, experiment.truth[n]) for n in ("flexibility_torque", "stiffness")}
    found, settled = trace["1"], trace.time > 0.5 * DURATION
    assert found["excited"][settled].mean() > 0.9 or effect != believed
    told = settled & np.isfinite(found["flexibility_torque"])
    size = np.std(at["flexibility_torque"])
    fed = np.std((found["flexibility_torque"] - at["flexibility_torque"])[told]) / size
    fitted = np.std((found["flexibility_torque_fit"] - at["flexibility_torque"])[settled]) / size
    true = at["stiffness"][settled]
    off = found["stiffness"][settled] - true
    ratio = np.sqrt(np.mean((off / found["stiffness_std"][settled]) ** 2))
    share = np.sqrt(np.mean((off[true > 0.0] / true[true > 0.0]) ** 2))
    return {"fed": fed, "fitted": fitted, "stiffness": share, "stds": ratio}


@pytest.mark.every(2)
@pytest.mark.parametrize(("effect", "name"), CASES)
def test_an_extended_rig_is_estimated_as_well_as_a_plain_one(effect, name):
    plain, known, unknown = errors("none", "none", name), errors(effect, effect, name), errors(effect, "none", name)
    assert known["fed"] < 2.0 * plain["fed"] + 5e-3
    assert known["fitted"] < 3.0 * plain["fitted"] + 1e-3
    assert known["stiffness"] < 0.02
    assert known["stds"] < 2.5
    if effect == "torque_offset":
        # A steady offset is no part of the spread; it shows in the fit, which has no constant to take it up.
        assert unknown["stiffness"] > 5.0 * known["stiffness"]
    else:
        assert unknown["fed"] > 3.0 * known["fed"]
        assert unknown["fitted"] > 2.0 * known["fitted"]


@pytest.mark.every(3)
@pytest.mark.parametrize("effect", MOTOR)
def test_a_torque_sensor_does_not_ask_what_the_motor_does(effect):
    assert errors(effect, effect, "direct") == errors(effect, "none", "direct")


def test_inside_a_gap_nothing_damps():
    """With a basis that cannot follow a gap only the torque fed can be compared with the truth."""
    known, unknown = (errors("damping in a gap", b, "direct") for b in ("damping in a gap", "none"))
    assert unknown["fed"] > 4.0 * known["fed"]


ALL = replace(
    PLAIN,
    motor=replace(
        PLAIN.motor,
        friction=Friction(coulomb=0.1, static=0.2, stribeck_velocity=0.2, load=0.05),
        cogging=(Cogging(torque=0.1, order=6.0),),
        torque_gain=1.1,
        torque_delay=0.003,
    ),
    transmission=replace(
        PLAIN.transmission,
        damping=0.2,
        bouc_wen=BoucWen(torque=0.2, width=0.01),
        slip=(SlipElement(stiffness=30.0, limit=0.1),),
    ),
)
BRISTLES = replace(ALL, motor=replace(ALL.motor, friction=Friction(coulomb=0.1, load=0.05, presliding_stiffness=40.0)))


def cut(signals, sizes):
    """Cut signals into blocks of the sizes, over and over."""
    first = 0
    for size in itertools.cycle(sizes):
        if first >= len(signals):
            return
        yield signals[first : first + size]
        first += size


def trace_of(fold, signals, *sizes):
    state, parts = fold.start(), []
    for last in reversed(range(fold.passes)):
        parts = []
        for block in cut(signals, sizes):
            state, traces = fold.step(state, block)
            parts += traces
        state, traces = fold.finish(state)
        parts += traces
        if last:
            state = fold.freeze(state)
    return Trace.concatenate(parts), fold.findings(state)


@pytest.mark.every(5)
@pytest.mark.parametrize("kind", ["savitzky-golay", "kinematic", "pair"])
@pytest.mark.parametrize("name", ["residual-rls", "qr-rls", "batch-ls", "SENSOR"])
@pytest.mark.parametrize("joint", [ALL, BRISTLES], ids=["ideal", "bristles"])
def test_blocks_of_any_size_give_the_same_bits(joint, name, kind):
    experiment = simulate(replace(SEA, joint={"sea": joint}), {"sea": {"motor_torque": MOTION}}, 3.0, period=2e-3)
    signals = bind([experiment.recording()], "sea", joint, tuple(offered_roles(joint)))
    signals.starts[[400, 407, 430]] = True
    for values in signals.roles.values():
        values[800:803] = np.nan
    module = method("residual-rls" if name == "SENSOR" else name)
    tune = {"filter": kind} | METHODS.get(name, {})
    tuning = read_tuning(module.TUNING, name, tune)
    fold = module.build(device_of("sea", joint, signals.roles), signals, tuning)
    whole, said = trace_of(fold, signals, 10**9)
    np.testing.assert_array_equal(whole.stamps, signals.stamps)
    # Single samples about the gaps and the missing samples, and about a filter's window before and after them.
    sizes = [250, *[1] * 60, *[2] * 20, 7, 13, *[1] * 70, 340, *[1] * 60]
    found, found_said = trace_of(fold, signals, *sizes)
    np.testing.assert_array_equal(found.stamps, whole.stamps)
    assert found_said == said
    for transmission, columns in whole.transmissions.items():
        for column, values in columns.items():
            np.testing.assert_array_equal(found[transmission][column], values, err_msg=f"{transmission} {column}")


def test_friction_that_grows_with_the_torque_is_the_residual_s_own():
    """The closed form solves its equation: with that friction taken off the torque, the plain residual is the same."""
    rng = np.random.default_rng(3)
    count, load, setting = 2000, 0.3, (0.02, 0.1)
    theta, rate, tau, beside = np.cumsum(rng.standard_normal((4, count)), axis=1) * 0.01
    way, use = np.clip(3.0 * np.sin(np.arange(count) * 0.01), -1.0, 1.0), np.ones(count, bool)
    use[700:705] = False
    start = np.full(3, np.nan)
    _, r = residual_block(start, theta, rate, tau, use, *setting, 300.0, 1e-3, load, beside, way)
    _, plain = residual_block(start, theta, rate, tau - load * np.abs(r + beside) * way, use, *setting, 300.0, 1e-3)
    np.testing.assert_allclose(plain, r, atol=1e-9)
    assert np.sign(r[use]).min() < 0.0 < np.sign(r[use]).max()


def standing():
    """A motor that moves for four seconds, is held by its friction for eight, and moves on."""
    joint = extended("coulomb_friction")
    torque = lambda t: np.where((t > 4.0) & (t < 12.0), 0.0, MOTION(t))  # noqa: E731
    experiment = simulate(replace(SEA, joint={"sea": joint}), {"sea": {"motor_torque": torque}}, 16.0, period=2e-3)
    return joint, experiment


@pytest.mark.parametrize("name", ["residual-rls", "qr-rls"])
def test_where_friction_holds_the_motor_nothing_is_reported_of_the_torque(name):
    joint, experiment = standing()
    found = estimate_joint([experiment.recording()], "sea", joint, choose("sea", joint, name, {}))
    rest = (found.trace.time > 8.0) & (found.trace.time < 11.5)
    assert np.abs(np.interp(found.trace.time, experiment.time, experiment.truth["motor_velocity"])[rest]).max() < 1e-3
    part = found.trace["1"]
    assert np.isnan(part["flexibility_torque"][rest]).all()
    # What was learnt before is not touched by it.
    assert np.ptp(part["coefficient_0"][rest]) == 0.0
    late = found.trace.time > 13.0
    true = np.interp(found.trace.time, experiment.time, experiment.truth["stiffness"])
    assert np.sqrt(np.mean(((part["stiffness"] - true) / true)[late] ** 2)) < 0.02
    assert "friction.unknown_direction" in [finding.code for finding in found.findings]


def test_a_friction_too_small_to_matter_does_not_keep_slow_motion_from_being_learnt_from():
    joint = replace(PLAIN, motor=replace(PLAIN.motor, friction=Friction(coulomb=1e-3)))
    coarse = {r: with_resolution(getattr(joint.signals, r), 0.1) for r in ("motor_position", "link_position")}
    joint = replace(joint, signals=replace(joint.signals, **coarse))
    rig = replace(SEA, joint={"sea": joint})
    experiment = simulate(rig, {"sea": {"motor_torque": sine(2.5, 0.05)}}, 20.0, period=2e-3)
    found = estimate_joint([experiment.recording()], "sea", joint, choose("sea", joint, "residual-rls", {}))
    assert np.isfinite(found.trace["1"]["flexibility_torque"][found.trace.time > 1.0]).mean() > 0.99


def with_resolution(signal, degrees):
    return replace(signal, resolution=np.deg2rad(degrees))


def test_a_gear_that_its_own_load_blocks_tells_nothing_of_the_torque():
    joint = replace(PLAIN, motor=replace(PLAIN.motor, friction=Friction(load=1.0)))
    recording = played("none").recording()
    for name in ("residual-rls", "qr-rls"):
        with pytest.raises(EstimatorError, match=r"friction\.load of 1 .* use a torque sensor"):
            estimate_joint([recording], "sea", joint, choose("sea", joint, name, {}))
    estimate_joint([recording], "sea", joint, choose("sea", joint, "direct", {}))


def test_a_rotor_s_own_friction_goes_through_its_gear():
    geared = replace(
        PLAIN,
        motor=replace(
            PLAIN.motor, side="rotor", gear_ratio=20.0, inertia=0.08 / 400.0, damping=0.4 / 400.0,
            friction=Friction(coulomb=0.3 / 20.0), cogging=(Cogging(torque=0.1 / 20.0, order=1.0),),
        ),
    )  # fmt: skip
    joint = replace(
        PLAIN, motor=replace(PLAIN.motor, friction=Friction(coulomb=0.3), cogging=(Cogging(torque=0.1, order=20.0),))
    )
    recording = played("none").recording()
    a, b = (
        estimate_joint([recording], "sea", j, choose("sea", j, "residual-rls", {})).trace["1"] for j in (geared, joint)
    )
    np.testing.assert_allclose(a["stiffness"], b["stiffness"], rtol=1e-9)


def test_two_transmissions_under_one_sensor():
    rig = Rig.preset("vsa2").file
    joint = rig.joint["vsa2"]
    effects = {"damping": 0.02, "slip": (SlipElement(stiffness=0.1, limit=2e-3),)}
    real = replace(
        joint,
        transmission_1=replace(joint.transmission_1, **effects),
        transmission_2=replace(joint.transmission_2, **effects),
    )
    torques = {
        "motor_torque_1": sum_of(sine(0.05, 0.1), sine(0.02, 0.9)),
        "motor_torque_2": sum_of(sine(-0.05, 0.1), sine(0.02, 1.3)),
    }
    experiment = simulate(replace(rig, joint={"vsa2": real}), {"vsa2": torques}, 10.0, period=1e-3, ideal=True)
    off = {}
    for label, believed in (("known", real), ("unknown", joint)):
        found = estimate_joint([experiment.recording()], "vsa2", believed, choose("vsa2", believed, "direct", {}))
        total = found.trace["total"]["flexibility_torque"]
        true = np.interp(found.trace.time, experiment.time, experiment.truth["flexibility_torque_total"])
        told = np.isfinite(total) & (found.trace.time > 5.0)
        assert told.sum() > 0.4 * told.size
        off[label] = np.sqrt(np.mean((total - true)[told] ** 2)) / np.std(true)
    assert off["known"] < 0.01
    assert off["unknown"] > 5.0 * off["known"]


@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls"])
def test_the_commands(tmp_path, monkeypatch, estimator):
    """The same machine twice: once its log carries the rig that knows its friction and loop, once the plain one."""
    monkeypatch.chdir(tmp_path)
    effects = (
        "motor.friction.coulomb=300 N*mm", "motor.torque_offset=0.2", "motor.torque_delay=5 ms",
        'transmission.bouc_wen={ torque = 0.3, width = "0.5 deg" }',
    )  # fmt: skip
    runner = CliRunner()
    off = {}
    for option in ("--set", "--actual"):
        given = [a for e in effects for a in (option, f"joint.sea.{e}")]
        done = runner.invoke(cli, ["simulate", "sea", *given, "--force", "-o", "log.mcap"])
        assert done.exit_code == 0, done.output
        done = runner.invoke(cli, ["estimate", "log.mcap", "-e", estimator, "--force", "--json"])
        assert done.exit_code == 0, done.output
        table = pq.read_table("log.stiffness.parquet").to_pandas()
        rows = table[(table.transmission == "1") & (table.time > 0.5 * table.time.max())]
        true = 20.0 + 6000.0 * rows.deflection**2
        off[option] = np.sqrt(np.mean(((rows.stiffness - true) / true) ** 2))
        if option == "--set":
            assert '"torque.drive_model"' in done.output
    assert off["--set"] < 0.04
    assert off["--actual"] > 5.0 * off["--set"]
