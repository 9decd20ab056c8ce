"""Rigid joints: their equations and simulation against equations written apart, and what is hidden in their logs is named."""

import numpy as np
import pytest
from msgspec.structs import replace as changed
from restated import recorded
from rigid_machine import RIGID, Truth, drive, log, moved
from scipy.integrate import solve_ivp
from written_out import derived, signals

from vsalog.core.errors import DiagnosisError, SimulationError
from vsalog.diagnosis.causes.base import with_part
from vsalog.diagnosis.run import Options, diagnose
from vsalog.effects.cogging import Cogging
from vsalog.mechanics.rigid_joint import as_one
from vsalog.report.diagnosis_sentences import worded
from vsalog.residuals.balance_rigid import balance_rigid
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import player_of, shoot, windows_of
from vsalog.rig import Rig
from vsalog.rig.schema import Friction, Link, Motor
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

pytestmark = pytest.mark.share(5)

PERIOD = 2e-3


def joint_of(text=RIGID):
    return next(iter(Rig.from_toml(text).joints.values()))


def full():
    """A rigid joint with everything that a rig may state of one."""
    joint = with_part(joint_of(), "motor", friction=Friction(coulomb=0.2, static=0.3, stribeck_velocity=0.4, load=0.1),
                      cogging=(Cogging(torque=0.08, order=6.0, phase=0.4),))  # fmt: skip
    return with_part(joint, "link", damping=0.03, gravity_angle=0.2)


def test_motor_and_link_are_one():
    motor = Motor(inertia=1e-4, damping=2e-4, side="rotor", gear_ratio=10.0, friction=Friction(coulomb=0.01))
    link = Link(
        inertia=0.05, damping=0.03, friction=Friction(coulomb=0.2, static=0.3, stribeck_velocity=0.1, load=0.02)
    )
    one = as_one(motor, link)
    assert one.inertia == pytest.approx(0.06)
    assert one.damping == pytest.approx(0.05)
    assert one.friction == Friction(
        coulomb=pytest.approx(0.3), static=pytest.approx(0.4), stribeck_velocity=0.1, load=0.02
    )
    assert as_one(motor, None).inertia == pytest.approx(0.01)


def test_its_equation_is_what_the_torque_lacks():
    """On a motion by formula, with the torque that it takes written out here."""
    time = np.arange(0.0, 4.0, PERIOD)
    q = derived(0.9 * np.sin(2.1 * time) + 0.3 * np.sin(5.3 * time + 0.3), time)
    weight = 1.5 * np.sin(q[0] - 0.2)
    level = 0.2 + 0.1 * np.exp(-((q[1] / 0.4) ** 2)) + 0.1 * np.abs(weight)
    needed = 0.07 * q[2] + 0.08 * q[1] + level * np.sign(q[1]) + weight - 0.08 * np.sin(60.0 * q[0] + 0.4)
    torque = np.stack([needed - 0.25, np.zeros_like(time), np.zeros_like(time)])
    (equation,) = balance_rigid(full(), {"motor_position": q, "motor_torque": torque}, time, {})
    assert (equation.name, equation.unit) == ("motor", "N*m")
    np.testing.assert_allclose(equation.whole, 0.25, atol=1e-12)


def test_a_torque_sensor_parts_it_into_the_motors_and_the_links():
    time = np.arange(0.0, 4.0, PERIOD)
    q = derived(0.9 * np.sin(2.1 * time), time)
    sensor = np.stack([0.4 * np.cos(time), np.zeros_like(time), np.zeros_like(time)])
    torque = np.zeros_like(q)
    roles = {"link_position": q, "motor_torque": torque, "torque_sensor": sensor}
    motor, link = balance_rigid(joint_of(), roles, time, {})
    rubbed = 0.02 * q[2] + 0.05 * q[1] + 0.2 * np.sign(q[1])
    np.testing.assert_allclose(motor.whole, rubbed - sensor[0], atol=1e-12)
    np.testing.assert_allclose(link.whole, 0.05 * q[2] + 1.5 * np.sin(q[0]) + sensor[0], atol=1e-12)


def test_its_simulation_is_that_of_its_equation():
    """Against scipy, with a late drive of its own gain and offset, dry friction with the load, and cogging."""
    joint = with_part(full(), "motor", torque_gain=1.1, torque_offset=0.05, torque_delay=0.013)
    time, torque = np.arange(0.0, 3.0, PERIOD), drive(3)

    def equations(t, x):
        q, dq = x
        weight = 1.5 * np.sin(q - 0.2)
        level = 0.2 + 0.1 * np.exp(-((dq / 0.4) ** 2)) + 0.1 * abs(weight)
        acts = 1.1 * torque(max(t - 0.013, 0.0)) + 0.05 + 0.08 * np.sin(60.0 * q + 0.4)
        return [dq, (acts - 0.08 * dq - level * np.tanh(dq / 1e-4) - weight) / 0.07]

    start = [0.2, 2.0]
    found = solve_ivp(equations, (0, time[-1]), start, "LSODA", time, rtol=1e-9, atol=1e-11, max_step=2e-3)
    truth = play(build({"arm": joint}), {"arm": {"motor_torque": torque}}, time, start={"arm": np.array(start)})["arm"]
    # Friction that changes its sign over 1e-4 rad/s creeps where ideal friction sticks: so far in three seconds.
    np.testing.assert_allclose(truth["motor_position"], found.y[0], atol=1e-3)
    np.testing.assert_array_equal(truth["motor_position"], truth["link_position"])


def test_windows_answer_with_the_position():
    """From the true states: the residual is the encoder's steps."""
    time, said = log(loud=1.0)
    said["motor_torque"] = drive(0)(time)
    channels = channels_of(signals(said, PERIOD))
    windows = windows_of(joint_of(), channels, False)
    q = moved(Truth(), 12.0, PERIOD, 0)[1]
    states = np.stack([q, np.gradient(q, time)], axis=-1)[windows.spans[:, 0]]
    assert windows.roles == ("motor_position",)
    errors = shoot(joint_of(), windows, states).errors["motor_position"]
    assert np.sqrt(np.nanmean(errors**2)) < 2e-3
    assert player_of(joint_of(), channels).driving() == ["motor_torque"]


def test_a_link_that_is_not_in_the_rig_pulls_with_what_the_sensor_says():
    """B q̈ + D q̇ + friction = τ + τ_sensor, and the sensor says −(M q̈ + G sin q)."""
    time, said = log()
    q = derived(moved(Truth(), 12.0, PERIOD, 0)[1], time)
    said["motor_torque"] = drive(0)(time)
    said["torque_sensor"] = -(0.05 * q[2] + 1.5 * np.sin(q[0]))
    bare = changed(joint_of(), link=None)
    windows = windows_of(bare, channels_of(signals(said, PERIOD)), False)
    states = q[:2].T[windows.spans[:, 0]]
    errors = shoot(bare, windows, states).errors["motor_position"]
    assert np.sqrt(np.nanmean(errors**2)) < 2e-3


def test_without_its_motors_torque_it_is_not_simulated():
    _, said = log(roles=("motor_position",))
    with pytest.raises(SimulationError, match="torque of the motor is not recorded"):
        windows_of(joint_of(), channels_of(signals(said, PERIOD)), False)


HIDDEN = {
    "link.inertia": (Truth(inertia=0.08), {"inertia": 0.06}),
    "motor.viscous_friction": (Truth(damping=0.09), {"damping": 0.09}),
    "motor.coulomb_friction": (Truth(coulomb=0.3), {"torque": 0.3}),
    "motor.stribeck_friction": (Truth(excess=0.2), {"torque": 0.2, "static": 0.4}),
    "motor.load_dependent_friction": (Truth(load=0.15), {"share": 0.15}),
    "motor.cogging": (Truth(cogging=(0.1, 6.0, 0.4)), {"torque": 0.1, "order": 6.0}),
    "motor.torque_constant": (Truth(constant=1.1), {"gain": 1.1}),
    "motor.torque_offset": (Truth(torque_offset=0.1), {"torque": 0.1}),
    "link.gravity": (Truth(gravity=1.8), {"torque": 1.8}),
    "link.payload": (
        Truth(inertia=0.07 + 0.3 * 0.2**2, gravity=1.5 + 0.3 * 9.81 * 0.2),
        {"mass": 0.3, "distance": 0.2},
    ),
    "link.contact": (Truth(push=(5.0, 0.4, 0.8)), {"start": 5.0, "torque": 0.8}),
    "sensor.encoder_offset": (Truth(offset=0.05), {"offset": 0.05}),
    "sensor.encoder_scale": (Truth(scale=1.03), {"gain": 1.03}),
    "sensor.encoder_eccentricity": (Truth(eccentricity=(0.02, 0.5)), {"amplitude": 0.02, "phase": 0.5}),
    "sensor.clock_skew": (Truth(late=-4e-3), {"delay": -4e-3}),
}


def laid(folder, truth, rig=RIGID, **options):
    """Two logs of a machine in a folder."""
    recorded(folder, *log(truth, **options), rig)
    recorded(folder, *log(truth, seed=1, **options), rig, name="held")
    return folder / "log.csv", folder / "held.csv"


# A push that is over within a part of a block is model error to the weights that the search begins with.
PUSHED = pytest.mark.xfail(reason="a short push is not yet told from model error", strict=True)


UNMET = {"link.contact": PUSHED}


@pytest.mark.every(3)
@pytest.mark.parametrize("cause", [pytest.param(c, marks=UNMET.get(c, ())) for c in HIDDEN])
def test_what_is_hidden_is_named_with_its_numbers_and_its_gain(tmp_path, cause):
    truth, expected = HIDDEN[cause]
    outcome = diagnose(*laid(tmp_path, truth), Options())
    document = outcome.diagnosis
    assert document.causes[0].cause == cause
    for name, value in expected.items():
        # What acts is smooth here, and a drive's would be held: half a sample of delay.
        own = 0.5 * PERIOD if name == "delay" else 0.0
        number = document.causes[0].parameters[name]
        assert abs(number.value - value) < own + max(4 * number.std, 0.02 * abs(value)), name
    (signal,) = document.gain.signals
    assert signal.signal == "motor_position"
    assert signal.rmse_after < 0.3 * signal.rmse_before
    assert outcome.extended is not None
    (tmp_path / "extended.rig.toml").write_text(outcome.extended.to_toml(), encoding="utf-8")
    again = diagnose(tmp_path / "log.csv", None, Options(rig=tmp_path / "extended.rig.toml"))
    assert not [c for c in again.diagnosis.causes if c.material]


@pytest.mark.parametrize("seed", [2, 3])
def test_a_sound_one_is_consistent_and_simulated_to_its_noise(seed, tmp_path):
    """Where noise lets a joint at rest go earlier, one half second may be ten times off: in one of thirteen such logs."""
    recorded(tmp_path, *log(Truth(), seed=seed), RIGID)
    recorded(tmp_path, *log(Truth(), seed=seed + 100), RIGID, name="held")
    document = diagnose(tmp_path / "log.csv", tmp_path / "held.csv", Options()).diagnosis
    assert document.verdict == "consistent"
    (error,) = document.simulation_error
    assert error.rmse < 1.5 * error.noise_floor


def test_a_held_out_log_of_another_state_is_reported_with_its_error(tmp_path):
    recorded(tmp_path, *log(Truth()), RIGID)
    recorded(tmp_path, *log(Truth(coulomb=0.4), seed=1), RIGID, name="held")
    document = worded(diagnose(tmp_path / "log.csv", tmp_path / "held.csv", Options()))
    (signal,) = document.gain.signals
    assert signal.rmse_after == signal.rmse_before > 2.0 * signal.noise_floor
    assert document.verdict == "unexplained"
    assert f"{signal.rmse_before:.3g}" in document.sentences[0]


def test_what_moves_as_one_has_one_inertia_and_says_so(tmp_path):
    document = diagnose(*laid(tmp_path, Truth(inertia=0.08)), Options()).diagnosis
    assert document.causes[0].indistinguishable_from == ("motor.inertia",)


def test_a_scale_that_no_weight_fixes_is_as_sure_as_the_priors_are(tmp_path):
    """Without gravity a torque constant scales inertia and frictions alike: ± 10 %, and ± 20 % of motor and link each."""
    rig = RIGID.replace("gravity_torque = 1.5\n", "")
    truth = Truth(gravity=0.0, constant=0.95, inertia=0.07, coulomb=0.35, damping=0.12)
    document = diagnose(*laid(tmp_path, truth, rig), Options()).diagnosis
    friction = next(c for c in document.causes if c.cause == "motor.coulomb_friction").parameters["torque"]
    constant, inertia = 0.1 / 1.96, 0.2 / 1.96 * np.hypot(0.02, 0.05) / 0.07
    scale = (constant**-2 + inertia**-2) ** -0.5
    assert friction.std / friction.value == pytest.approx(scale, rel=0.1)
    assert abs(friction.value - 0.35) < 1.96 * friction.std


def test_a_late_drive_is_a_late_encoder_and_it_says_so(tmp_path):
    document = diagnose(*laid(tmp_path, Truth(torque_delay=5e-3)), Options()).diagnosis
    (cause,) = document.causes
    assert (cause.cause, cause.indistinguishable_from) == ("sensor.clock_skew", ("motor.torque_delay",))
    assert cause.parameters["delay"].value == pytest.approx(5e-3, abs=0.55 * PERIOD)


def test_next_to_a_torque_sensor_a_late_drive_is_one(tmp_path):
    """The link's equation has the encoder's time."""
    rig = RIGID + 'torque_sensor = "torque sensor"\n'
    time, said = log(Truth(torque_delay=8e-3))
    q = derived(moved(Truth(torque_delay=8e-3), 12.0, PERIOD, 0)[1], time)
    noise = 5e-3 * np.random.default_rng(3).standard_normal(time.size)
    said["torque_sensor"] = -(0.05 * q[2] + 1.5 * np.sin(q[0])) + noise
    recorded(tmp_path, time, said, rig)
    document = diagnose(tmp_path / "log.csv", None, Options()).diagnosis
    assert [c.cause for c in document.causes] == ["motor.torque_delay"]
    assert document.causes[0].parameters["delay"].value == pytest.approx(8e-3, abs=0.55 * PERIOD)


def test_an_encoder_at_the_link_alone_will_do(tmp_path):
    rig = RIGID.replace('motor_position = "motor position"', 'link_position = "link position"')
    rig = rig.replace("coulomb = 0.2", "coulomb = 0.1")
    document = diagnose(*laid(tmp_path, Truth(), rig, roles=("link_position", "motor_torque")), Options()).diagnosis
    assert [c.cause for c in document.causes] == ["motor.coulomb_friction"]
    assert [g.signal for g in document.gain.signals] == ["link_position"]


def test_one_in_a_chain_is_left_out_where_nothing_says_what_its_link_does(tmp_path):
    chain = '[chain]\n[[chain.link]]\njoint = "arm"\nlength = 0.3\nmass = 1.0\ncentre = [-0.15, 0.0, 0.0]\n'
    laid(tmp_path, Truth(), RIGID + chain + "inertia = [0.01, 0.01, 0.01]\n")
    with pytest.raises(DiagnosisError, match="others of the chain move"):
        diagnose(tmp_path / "log.csv", None, Options())


def test_an_experiment_is_proposed_for_a_rigid_joint_too(tmp_path):
    outcome = diagnose(laid(tmp_path, Truth())[0], None, Options(suggest=True))
    assert outcome.proposed is not None
    assert outcome.proposed.joint == "arm"


def test_what_no_cause_makes_is_unexplained_and_over_the_position(tmp_path):
    """A torque at one angle alone, of a joint that swings to and fro."""
    truth = Truth(gravity=6.0, detent=(0.4, 0.2, 0.15))
    rig = RIGID.replace("gravity_torque = 1.5", "gravity_torque = 6.0")
    document = diagnose(laid(tmp_path, truth, rig)[0], None, Options()).diagnosis
    assert document.verdict in ("unexplained", "partly explained")
    assert document.unexplained.where == "motor"
    assert document.unexplained.depends_on[0] in ("motor_position", "link_position")
