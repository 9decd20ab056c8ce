"""References that an estimator does not read, sensors or the motor: where they differ from the estimate, that is a finding."""

import json

import numpy as np
import pytest
from command_line import vsalog_run
from elastic_arm import RIG
from hypothesis import given
from hypothesis import strategies as st

from vsalog.checks.cross_check import _is_noise

pytestmark = pytest.mark.share(4)

PERIOD, COUNT = 2e-3, 10_000
SCALE, UNRELATED, INERTIA = "cross_check.torque_scale", "cross_check.torque_unrelated", "link.inertia_differs"
MOTOR = "the motor's side by residual-rls"


def log(path, motor_scale=1.0, sensor_scale=1.0, seed=0, columns=("q", "theta", "tau", "sensor")):
    """A spring of 40 N·m/rad and 3000 N·m/rad³ between a motor and a link that are moved; scales multiply what is recorded."""
    t, rng = np.arange(COUNT) * PERIOD, np.random.default_rng(seed)

    def moved(*sines):
        waves = [(a, w, w * t + seed) for a, w in sines]
        values = [(a * np.sin(p), a * w * np.cos(p), -a * w * w * np.sin(p)) for a, w, p in waves]
        return np.sum(values, axis=0)

    (phi, dphi, ddphi), (q, dq, ddq) = moved((0.05, 2.1), (0.03, 5.3)), moved((0.4, 1.3), (0.2, 3.7))
    spring, step = 40.0 * phi + 3000.0 * phi**3, 2 * np.pi / 36_000
    motor = 0.05 * (ddq - ddphi) + 0.3 * (dq - dphi) - spring
    recorded = {
        "q": step * np.round(q / step),
        "theta": step * np.round((q - phi) / step),
        "tau": motor_scale * motor + 0.01 * rng.standard_normal(COUNT),
        "sensor": sensor_scale * spring + 0.02 * rng.standard_normal(COUNT),
    }
    table = np.column_stack([t, *(recorded[name] for name in columns)])
    np.savetxt(path, table, delimiter=",", header=",".join(("time", *columns)), comments="")
    path.with_suffix(".rig.toml").write_text(RIG)


def found(folder, estimator, *names):
    """Return the findings by code, the cross-check's and the link's."""
    done = vsalog_run(
        "estimate", *(names or ["arm.csv"]), "-e", estimator, "-o", "arm.parquet", "--json", "--force", cwd=folder
    )
    assert done.returncode == 0, done.stderr
    findings = json.loads(done.stdout)["joints"][0]["findings"]
    return {f["code"]: f for f in findings if f["code"].startswith("cross_check.") or f["code"] == INERTIA}


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "estimator", ["residual-rls", "qr-rls", "batch-ls", "algebraic", "direct", "grioli-parametric"]
)
def test_a_sound_log_agrees(tmp_path, estimator):
    log(tmp_path / "arm.csv")
    assert not found(tmp_path, estimator)


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls", "batch-ls"])
@pytest.mark.parametrize(("motor", "sensor"), [(1.2, 1.0), (1.0, 0.8)])
def test_a_scale_that_is_off_is_found_with_its_size(tmp_path, estimator, motor, sensor):
    log(tmp_path / "arm.csv", motor, sensor)
    scale = found(tmp_path, estimator)[SCALE]
    assert (scale["part"], scale["evidence"]["reference"], scale["evidence"]["estimator"]) == (
        "1",
        "torque_sensor",
        estimator,
    )
    # A residual takes the rig's inertia, which goes with the right torque only: there a wrong torque bends it.
    rel = 0.03 if estimator != "residual-rls" or motor == 1.0 else 0.1
    assert scale["value"] == pytest.approx(sensor / motor, rel=rel)
    assert scale["value"] < scale["limit"] < 1.0


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["direct", "grioli-parametric"])
@pytest.mark.parametrize(("motor", "sensor"), [(1.0, 0.8), (1.0, 1000.0)])
def test_a_sensor_s_scale_is_found_by_the_motor_s_side(tmp_path, estimator, motor, sensor):
    log(tmp_path / "arm.csv", motor, sensor)
    scale = found(tmp_path, estimator)[SCALE]
    assert scale["evidence"]["reference"] == MOTOR
    assert scale["value"] == pytest.approx(1.0 / sensor, rel=0.03)


@pytest.mark.parametrize("estimator", ["direct", "grioli-parametric"])
def test_encoders_in_degrees_are_found_by_the_motor_s_side(tmp_path, estimator):
    log(tmp_path / "arm.csv")
    table = np.loadtxt(tmp_path / "arm.csv", delimiter=",", skiprows=1)
    table[:, 1:3] = np.degrees(table[:, 1:3])
    np.savetxt(tmp_path / "arm.csv", table, delimiter=",", header="time,q,theta,tau,sensor", comments="")
    (finding,) = found(tmp_path, estimator).values()
    assert finding["evidence"]["reference"] == MOTOR


@pytest.mark.parametrize("lacking", ["tau", "inertia"])
def test_without_the_motor_s_torque_or_inertia_its_side_is_no_reference(tmp_path, lacking):
    log(tmp_path / "arm.csv", sensor_scale=0.8, columns=[c for c in ("q", "theta", "tau", "sensor") if c != lacking])
    rig = "\n".join(line for line in RIG.splitlines() if not line.startswith(lacking))
    (tmp_path / "arm.rig.toml").write_text(rig)
    assert not found(tmp_path, "direct")


def test_logs_with_the_same_clock_are_compared_each_with_its_own_sensor(tmp_path):
    log(tmp_path / "arm.csv")
    log(tmp_path / "other.csv", seed=2)
    assert not found(tmp_path, "qr-rls", "arm.csv", "other.csv")
    log(tmp_path / "other.csv", seed=2, sensor_scale=0.4)
    assert found(tmp_path, "qr-rls", "arm.csv", "other.csv")


@pytest.mark.every(3)
@pytest.mark.parametrize("estimator", ["algebraic", "direct"])
@pytest.mark.parametrize("seed", range(3))
def test_a_reference_in_which_nothing_moves_differs_from_nothing(tmp_path, seed, estimator):
    """A constant torque: what was compared was the noise of both."""
    still = '[[joint.sea.motor_torque]]\ntype = "constant"\nvalue = 2\n'
    (tmp_path / "still.toml").write_text(f'name = "still"\nduration = "20 s"\nperiod = "2 ms"\n{still}')
    log = ("simulate", "sea", "--scenario", "still.toml", "--seed", str(seed), "-o", "still.parquet")
    assert vsalog_run(*log, cwd=tmp_path).returncode == 0
    assert not found(tmp_path, estimator, "still.parquet")


@given(seed=st.integers(0, 2**32), hertz=st.floats(0.1, 3.0), phase=st.floats(0, 6))
def test_noise_and_motion_are_separated(seed, hertz, phase):
    """Averages of a twentieth of a second."""
    noise = np.random.default_rng(seed).standard_normal(400)
    assert _is_noise(noise)
    assert not _is_noise(5.0 * np.sin(2 * np.pi * hertz * 0.05 * np.arange(400) + phase) + noise)


def test_a_sensor_of_another_sign_is_found(tmp_path):
    log(tmp_path / "arm.csv", sensor_scale=-1.0)
    assert found(tmp_path, "qr-rls")[UNRELATED]["value"] == 0.0


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["qr-rls", "batch-ls"])
@pytest.mark.parametrize(("motor", "differs"), [(1.0, False), (0.97, False), (0.93, True), (0.8, True), (1000.0, True)])
def test_a_motor_with_another_inertia_is_found(tmp_path, estimator, motor, differs):
    """Without any sensor of the joint's torque: the inertia in the rig is what there is."""
    log(tmp_path / "arm.csv", motor, columns=("q", "theta", "tau"))
    done = vsalog_run("estimate", "arm.csv", "-e", estimator, "-o", "arm.parquet", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    findings = json.loads(done.stdout)["joints"][0]["findings"]
    inertias = [f["evidence"]["inertia"] for f in findings if f["code"] == "motor.inertia_differs"]
    assert inertias == ([pytest.approx(0.05 * motor, rel=0.05)] if differs else [])


@pytest.mark.every(3)
@pytest.mark.parametrize(("sensor", "differs"), [(1.0, False), (1.3, True), (1000.0, True)])
def test_a_link_with_another_inertia_is_found(tmp_path, sensor, differs):
    """Without any motor: the link's inertia in the rig is what there is."""
    t, rng = np.arange(COUNT) * PERIOD, np.random.default_rng(0)
    waves = ((0.4, 1.3), (0.2, 3.7), (0.05, 9.1))
    q, dq, ddq = (sum(f(a, w) for a, w in waves) for f in (
        lambda a, w: a * np.sin(w * t), lambda a, w: a * w * np.cos(w * t), lambda a, w: -a * w * w * np.sin(w * t)
    ))  # fmt: skip
    torque = -(0.12 * ddq + 0.3 * dq)
    step = 2 * np.pi / 36_000
    theta = q - torque / 40.0
    table = np.column_stack([t, *(step * np.round(x / step) for x in (q, theta)), sensor * torque])
    table[:, 3] += sensor * 0.005 * rng.standard_normal(COUNT)
    np.savetxt(tmp_path / "arm.csv", table, delimiter=",", header="time,q,theta,sensor", comments="")
    link = "[joint.arm.link]\ninertia = 0.12\n[joint.arm.signals]"
    (tmp_path / "arm.rig.toml").write_text(
        RIG.replace("[joint.arm.signals]", link).replace('motor_torque = "tau"\n', "")
    )
    inertias = [f["evidence"]["inertia"] for f in found(tmp_path, "impedance").values() if f["code"] == INERTIA]
    assert inertias == ([pytest.approx(0.12 * sensor, rel=0.05)] if differs else [])


def test_a_sensor_that_is_read_is_no_reference(tmp_path):
    log(tmp_path / "arm.csv", sensor_scale=0.8)
    assert {f["evidence"]["reference"] for f in found(tmp_path, "direct").values()} == {MOTOR}


def test_a_sensor_that_is_not_in_the_log_is_not_missed(tmp_path):
    log(tmp_path / "arm.csv", columns=("q", "theta", "tau"))
    assert not found(tmp_path, "qr-rls")
    log(tmp_path / "arm.csv", sensor_scale=0.0)
    assert not found(tmp_path, "qr-rls")


@pytest.mark.parametrize(("strength", "differs"), [(1.0, False), (1.15, True)])
def test_muscles_that_are_stronger_than_the_rig_says_are_found_by_the_joint_s_sensors(tmp_path, strength, differs):
    """All four constants of both muscles, of which the rig in the log knows nothing."""
    force = {
        "1": {"area_slope": 7.045e-3, "area": -1.017e-3, "passive_slope": -556.8, "passive": 72.86},
        "2": {"area_slope": 6.423e-3, "area": -9.184e-4, "passive_slope": -197.8, "passive": 15.75},
    }
    stronger = [
        option
        for muscle, values in force.items()
        for key, value in values.items()
        for option in ("--actual", f"joint.pam.muscle_{muscle}.force.{key}={strength * value:.6g}")
    ]
    made = vsalog_run("simulate", "pam", "--duration", "8 s", *stronger, "-o", "pam.parquet", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    findings = found(tmp_path, "pam-ukf", "pam.parquet")
    assert any(f["evidence"]["reference"] == "torque_sensor" for f in findings.values()) == differs
