"""Springs that the rig does not know: fitted to the joint's motion, whatever its sensors make of it."""

import numpy as np
import pytest
from restated import changes, recorded
from written_out import ELASTIC, Truth, log

from vsalog.diagnosis.run import Options, diagnose
from vsalog.diagnosis.unknown_spring import TAKEN_UP, with_springs
from vsalog.mechanics import flexibility_torque
from vsalog.residuals.sensing import at_joint
from vsalog.rig import Rig

pytestmark = pytest.mark.share(4)

UNKNOWN = ELASTIC.replace('type = "cubic"\nstiffness = 12.0\ncubic = 150.0', 'type = "unknown"').replace(
    "damping = 0.05", "damping = 0.05\ngear_ratio = 10.0"
)
WITH_DEFLECTION = UNKNOWN.replace('link_position = "link position"', 'deflection = "deflection"')
SECONDS = 4.0


@pytest.fixture(scope="module")
def said():
    """What the sensors say; the deflection too."""
    time, found = log(duration=SECONDS)
    return time, found | {"deflection": found["link_position"] - found["motor_position"]}


def fitted(folder, said, role="", change=None):
    rig = WITH_DEFLECTION if role == "deflection" else UNKNOWN
    left_out = "link_position" if role == "deflection" else "deflection"
    time, roles = said
    signals, joint = recorded(folder, time, {r: v for r, v in roles.items() if r != left_out}, rig, role, change)
    return with_springs(at_joint(joint), signals)[0]


ROLES = ("motor_position", "link_position", "deflection", "torque_sensor", "motor_torque")
CASES = [pytest.param(role, way, id=f"{role}-{name}") for role, name, way in changes(ROLES)]


@pytest.mark.parametrize(("role", "way"), CASES)
def test_the_spring_is_that_of_the_joint_however_a_role_is_recorded(tmp_path, said, role, way):
    """τ = 12 φ + 150 φ³ is what moved it."""
    spring = fitted(tmp_path, said, role, way).transmission
    phi = np.linspace(-0.8, 0.8, 9) * spring.scale
    torque = 12.0 * phi + 150.0 * phi**3
    # The largest torque's part that noise and encoders' steps leave open in so short a log.
    np.testing.assert_allclose(flexibility_torque(spring, phi), torque, atol=0.01 * np.max(np.abs(torque)))


def test_what_the_sensor_says_at_rest_is_added_to_its_offset(tmp_path, said):
    """A torque sensor that says 300 per N·m, with 60 of them, 0.2 N·m, at rest that the rig does not know."""
    changed = (lambda x, t: 300.0 * x + 60.0, "gain = 300.0", "")
    joint = fitted(tmp_path, said, "torque_sensor", changed)
    assert joint.signals.torque_sensor.offset == pytest.approx(0.2, abs=0.01)


@pytest.mark.every(2)
@pytest.mark.parametrize("role", ["motor_position", "torque_sensor"])
def test_a_sound_joint_whose_spring_is_unknown_is_consistent_in_counts_too(tmp_path, said, role):
    time, roles = said
    roles = {r: v for r, v in roles.items() if r != "deflection"}
    way = next(way for r, name, way in changes([role]) if name == "counts")
    recorded(tmp_path, time, roles, UNKNOWN, role, way)
    assert diagnose(tmp_path / "log.csv", None, Options()).diagnosis.verdict == "consistent as far as checked"


def test_next_to_an_unknown_spring_in_counts_the_right_cause_is_named(tmp_path):
    """Friction of the motor, with an encoder in counts."""
    time, roles = log(Truth(damping=0.1), duration=6.0)
    way = next(way for _, name, way in changes(["motor_position"]) if name == "counts")
    recorded(tmp_path, time, roles, UNKNOWN, "motor_position", way)
    document = diagnose(tmp_path / "log.csv", None, Options()).diagnosis
    assert [c.cause for c in document.causes][:1] == ["motor.viscous_friction"]
    assert document.causes[0].parameters["damping"].value == pytest.approx(0.1, rel=0.02)


def test_a_sensor_that_an_unknown_spring_was_fitted_to_is_judged_by_motor_and_link(tmp_path):
    """What the spring takes up of the sensor's gain, motor and link do not have: else all numbers of theirs seem to be off."""
    time, roles = log(
        Truth(gain=1.06, damping=0.08),
        duration=10.0,
        roles=("motor_position", "link_position", "motor_torque", "torque_sensor"),
    )
    rig = UNKNOWN.replace("\ngear_ratio = 10.0", "")
    recorded(tmp_path, time, roles, rig)
    outcome = diagnose(tmp_path / "log.csv", None, Options())
    found = {c.cause: c.parameters for c in outcome.diagnosis.causes if c.material}
    assert set(found) == {"sensor.torque_gain", "motor.viscous_friction"}
    assert found["sensor.torque_gain"]["gain"].value == pytest.approx(1.06, rel=2e-3)
    assert found["motor.viscous_friction"]["damping"].value == pytest.approx(0.08, rel=2e-2)
    # The spring that was fitted is in the extended rig, with which nothing is wrong.
    (tmp_path / "extended.rig.toml").write_text(outcome.extended.to_toml(), encoding="utf-8")
    again = diagnose(tmp_path / "log.csv", None, Options(rig=tmp_path / "extended.rig.toml"))
    assert again.diagnosis.verdict == "consistent"
    (arm,) = again.rig.joints.values()
    phi = np.linspace(-0.1, 0.1, 5)
    truth = next(iter(Rig.from_toml(ELASTIC).joints.values())).transmission
    np.testing.assert_allclose(flexibility_torque(arm.transmission, phi), flexibility_torque(truth, phi), atol=0.02)


@pytest.mark.every(3)
@pytest.mark.parametrize("zero", ["motor_position", "link_position", "torque_sensor"])
def test_motor_and_link_tell_whose_the_torque_at_rest_is(tmp_path, zero):
    """What is 0.02 rad of an encoder, or 0.24 N·m of the sensor, for a spring, is that of no other for motor and link."""
    off = 0.24 if zero == "torque_sensor" else 0.02
    names = ("motor_position", "link_position", "motor_torque", "torque_sensor")
    time, roles = log(Truth(), duration=10.0, roles=names)
    rig = UNKNOWN.replace("\ngear_ratio = 10.0", "")
    recorded(tmp_path, time, roles | {zero: roles[zero] + off}, rig)
    outcome = diagnose(tmp_path / "log.csv", None, Options())
    assert (outcome.diagnosis.verdict, outcome.diagnosis.causes) == ("consistent as far as checked", ())
    offsets = [(f.part, f.value) for f in outcome.diagnosis.findings if f.code == "diagnosis.spring_fitted"]
    assert offsets == [(zero, pytest.approx(off, rel=0.02))]


def test_next_to_an_unknown_spring_a_late_encoder_is_reported_exactly(tmp_path):
    """A spring that is fitted to late positions alone is wrong, and takes up a part of the delay."""
    late = 0.003
    time, roles = log(
        Truth(), duration=10.0, roles=("motor_position", "link_position", "motor_torque", "torque_sensor")
    )
    roles = roles | {"motor_position": np.interp(time - late, time, roles["motor_position"])}
    recorded(tmp_path, time, roles, UNKNOWN.replace("\ngear_ratio = 10.0", ""))
    outcome = diagnose(tmp_path / "log.csv", None, Options())
    (cause,) = (c for c in outcome.diagnosis.causes if c.material)
    assert (cause.cause, cause.part) == ("sensor.clock_skew", "motor_position")
    delay = cause.parameters["delay"]
    assert abs(delay.value - late) < 4.0 * delay.std < 0.1 * late
    (tmp_path / "extended.rig.toml").write_text(outcome.extended.to_toml(), encoding="utf-8")
    again = diagnose(tmp_path / "log.csv", None, Options(rig=tmp_path / "extended.rig.toml"))
    assert again.diagnosis.verdict == "consistent"


def test_no_experiment_is_asked_for_what_the_spring_takes_up(tmp_path):
    """A spring that is fitted again takes up its own shape whatever the motion: no amplitude would show it."""
    time, roles = log(
        Truth(), duration=10.0, roles=("motor_position", "link_position", "motor_torque", "torque_sensor")
    )
    recorded(tmp_path, time, roles, UNKNOWN.replace("\ngear_ratio = 10.0", ""))
    proposed = diagnose(tmp_path / "log.csv", None, Options(suggest=True)).proposed
    assert not [q for q in proposed.questions.asked for h in (q.one, q.other) if h.site and h.site.cause in TAKEN_UP]
