"""Several logs of one machine: causes that all share, causes of each log, rates that differ, dates."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from command_line import vsalog_run
from scipy.integrate import solve_ivp

from vsalog.core.errors import DiagnosisError
from vsalog.diagnosis.run import Options, diagnose
from vsalog.rig import Rig

pytestmark = pytest.mark.share(7)

RIG = """
[joint.a]
kind = "elastic"
{more}
[joint.a.motor]
inertia = 0.06
damping = 0.3
[joint.a.transmission]
type = "linear"
stiffness = 40.0
[joint.a.link]
inertia = 0.05
damping = 0.1
gravity_torque = 2.0
[joint.a.signals]
motor_position = {{ channel = "theta", unit = "rad" }}
motor_torque = {{ channel = "torque", unit = "N*m" }}
link_position = {{ channel = "q", unit = "rad" }}
torque_sensor = {{ channel = "spring", unit = "N*m" }}
"""
RIGHT = {"damping": 0.3, "stiffness": 40.0, "weight": 2.0, "load": 0.0, "inertia": 0.05}
MONTH = 30.0 * 86400.0


def torque(t):
    return 1.5 * np.sin(3.1 * t) + 1.0 * np.sin(11.0 * t + 0.4) + 0.6 * np.sin(23.0 * t + 1.0)


def log(path, seed, rate=500.0, month=0.0, **changed):
    """A motor, a spring, a link in the plane of gravity, integrated by scipy; `load` is an inertia with its weight."""
    m = RIGHT | changed
    time = np.arange(0.0, 5.0, 1.0 / rate)
    inertia, weight = m["inertia"] + 0.04 * m["load"], m["weight"] + 1.96 * m["load"]

    def rates(t, x):
        theta, omega, q, v = x
        spring = m["stiffness"] * (q - theta)
        return (
            omega,
            (torque(t) - m["damping"] * omega + spring) / 0.06,
            v,
            (-spring - 0.1 * v - weight * np.sin(q)) / inertia,
        )

    x = solve_ivp(rates, (0.0, time[-1] + 1e-9), np.zeros(4), t_eval=time, rtol=1e-9, atol=1e-11).y
    rng = np.random.default_rng(seed)
    begin = datetime(2026, 1, 5, tzinfo=UTC).timestamp() + month * MONTH
    columns = [
        np.round((begin + time) * 1e6), x[0] + 1e-4 * rng.standard_normal(time.size),
        torque(time) + 0.01 * rng.standard_normal(time.size), x[2] + 1e-4 * rng.standard_normal(time.size),
        m["stiffness"] * (x[2] - x[0]) + 0.01 * rng.standard_normal(time.size),
    ]  # fmt: skip
    np.savetxt(
        path,
        np.stack(columns, axis=1),
        delimiter=",",
        header="timestamp [us],theta,torque,q,spring",
        comments="",
        fmt="%.17g",
    )
    return path


def held_log(path, seed, rate):
    """The same joint under a torque that its drive holds from sample to sample, by Runge and Kutta's method within each."""
    time, m, parts = np.arange(0.0, 6.0, 1.0 / rate), RIGHT, 4
    step, held = 1.0 / rate / parts, torque(time)

    def rates(x, u):
        theta, omega, q, v = x
        spring = m["stiffness"] * (q - theta)
        pull = -spring - 0.1 * v - m["weight"] * np.sin(q)
        return np.array([omega, (u - m["damping"] * omega + spring) / 0.06, v, pull / 0.05])

    x, states = np.zeros(4), []
    for u in held:
        states.append(x)
        for _ in range(parts):
            a = rates(x, u)
            b = rates(x + 0.5 * step * a, u)
            c = rates(x + 0.5 * step * b, u)
            d = rates(x + step * c, u)
            x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    states, rng = np.array(states), np.random.default_rng(seed)
    begin = datetime(2026, 1, 5, tzinfo=UTC).timestamp() + seed * MONTH
    columns = [
        np.round((begin + time) * 1e6), states[:, 0] + 1e-5 * rng.standard_normal(time.size), held,
        states[:, 2] + 1e-5 * rng.standard_normal(time.size),
        m["stiffness"] * (states[:, 2] - states[:, 0]) + 0.01 * rng.standard_normal(time.size),
    ]  # fmt: skip
    header = "timestamp [us],theta,torque,q,spring"
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def rig(more=""):
    return Rig.from_toml(RIG.format(more=more))


def test_a_shared_cause_has_one_value_and_each_log_is_reported(tmp_path):
    logs = [log(tmp_path / f"{k}.csv", k, rate=rate, damping=0.45) for k, rate in enumerate((500.0, 450.0))]
    found = diagnose(logs, None, Options(rig=rig())).diagnosis
    (cause,) = (c for c in found.causes if c.material)
    assert cause.cause == "motor.viscous_friction"
    assert cause.log is None
    assert cause.parameters["damping"].value == pytest.approx(0.45, rel=0.02)
    assert found.verdict == "explained"
    assert {e.log for e in found.logs} == {"0.csv", "1.csv"}
    assert all(e.rmse_after < 0.3 * e.rmse_before for e in found.logs if e.signal != "torque_sensor")
    assert not found.trends


def test_what_differs_has_a_value_in_each_log_a_beginning_and_a_rate(tmp_path):
    """A spring that softens by 2 N·m/rad a month from the third month on."""
    stiffness = [40.0, 40.0, 38.0, 36.0]
    logs = [log(tmp_path / f"{k}.csv", k, month=k, stiffness=s) for k, s in enumerate(stiffness)]
    found = diagnose(logs, None, Options(rig=rig('differs = ["transmission.stiffness"]'))).diagnosis
    assert {c.cause for c in found.causes if c.material} == {"transmission.stiffness"}
    (trend,) = found.trends
    for value, (low, high), true in zip(trend.values, trend.intervals, stiffness, strict=True):
        assert value == pytest.approx(true / 40.0, abs=0.004)
        assert low - 0.002 < true / 40.0 < high + 0.002
    assert trend.since == "2.csv"
    assert trend.since_interval[0] in ("1.csv", "2.csv")
    low, high = trend.per_day_interval
    assert low < -2.0 / 40.0 / 30.0 < high


def test_a_payload_of_each_log_leaves_the_other_causes_right(tmp_path):
    logs = [log(tmp_path / f"{k}.csv", k, damping=0.45, load=load) for k, load in enumerate((0.0, 1.0, 0.4))]
    found = diagnose(logs, None, Options(rig=rig(), differs=("link.payload",))).diagnosis
    causes = {(c.cause, c.log): c for c in found.causes if c.material}
    assert set(causes) == {("motor.viscous_friction", None), ("link.payload", "1.csv"), ("link.payload", "2.csv")}
    assert causes["motor.viscous_friction", None].parameters["damping"].value == pytest.approx(0.45, rel=0.02)
    # 0.04 kg·m² and 1.96 N·m are 1 kg at 0.2 m.
    assert causes["link.payload", "1.csv"].parameters["mass"].value == pytest.approx(1.0, rel=0.05)
    assert causes["link.payload", "1.csv"].parameters["distance"].value == pytest.approx(0.2, rel=0.05)


def test_payloads_in_all_logs_are_no_surer_than_the_links_inertia(tmp_path):
    """What of the link's inertia is wrong may be part of each payload: 1 kg, and 0.4 kg, at 0.2 m."""
    logs = [log(tmp_path / f"{k}.csv", k, load=load, inertia=0.055) for k, load in enumerate((1.0, 0.4))]
    found = diagnose(logs, None, Options(rig=rig(), differs=("link.payload",))).diagnosis
    trends = {t.number: t for t in found.trends}
    for (low, high), mass in zip(trends["mass"].intervals, (1.0, 0.4), strict=True):
        assert low < mass < high
    assert all(low < 0.2 < high for low, high in trends["distance"].intervals)
    for cause in found.causes:
        number = cause.parameters["distance"]
        assert abs(number.value - 0.2) < 1.96 * number.std


def test_logs_that_are_right_have_no_causes(tmp_path):
    logs = [log(tmp_path / f"{k}.csv", k) for k in range(3)]
    found = diagnose(logs, None, Options(rig=rig(), differs=("link.payload", "motor.coulomb_friction"))).diagnosis
    assert found.verdict.startswith("consistent")


def test_a_log_given_twice_and_a_cause_that_is_none_are_refused(tmp_path):
    one = log(tmp_path / "a.csv", 0)
    with pytest.raises(DiagnosisError, match="twice"):
        diagnose([one, one], None, Options(rig=rig()))
    with pytest.raises(DiagnosisError, match=r"link\.payload"):
        diagnose(one, None, Options(rig=rig(), differs=("link.payloads",)))


def test_the_command_takes_several_logs_and_several_held_out_ones(tmp_path):
    for k in range(4):
        log(tmp_path / f"{k}.csv", k, damping=0.45)
    (tmp_path / "rig.toml").write_text(RIG.format(more=""))
    done = vsalog_run(
        "diagnose",
        "0.csv",
        "1.csv",
        "--holdout",
        "2.csv",
        "--holdout",
        "3.csv",
        "--rig",
        "rig.toml",
        "--json",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["holdout"] == "2.csv, 3.csv"
    assert found["verdict"] == "explained"
    assert found["gain"]["holdout"]
    assert "motor.viscous_friction" in {c["cause"] for c in found["causes"]}


def test_one_log_has_no_other_that_it_could_differ_from(tmp_path):
    found = diagnose(
        log(tmp_path / "0.csv", 0, damping=0.45), None, Options(rig=rig('differs = ["motor.viscous_friction"]'))
    ).diagnosis
    assert [(c.cause, c.log) for c in found.causes if c.material] == [("motor.viscous_friction", None)]
    assert not found.trends


def test_logs_that_are_runs_of_the_rig_are_explained_together(tmp_path):
    runs = "".join(f'[[joint.a.run]]\nname = "run{k}"\nfile = "{k}.csv"\n' for k in range(2))
    own = Rig.from_toml(RIG.format(more="") + runs)
    logs = [log(tmp_path / f"{k}.csv", k, damping=damping) for k, damping in enumerate((0.3, 0.45))]
    found = diagnose(logs, None, Options(rig=own, differs=("motor.viscous_friction",))).diagnosis
    assert [(c.cause, c.log) for c in found.causes if c.material] == [("motor.viscous_friction", "1.csv")]
    (trend,) = found.trends
    assert trend.since == "1.csv"
    assert trend.per_day is None


def test_the_next_experiment_is_for_the_machine_as_it_is_in_the_last_log(tmp_path):
    logs = [log(tmp_path / f"{k}.csv", k, load=load) for k, load in enumerate((0.0, 1.0))]
    outcome = diagnose(logs, None, Options(rig=rig(), differs=("link.payload",), suggest=True))
    assert outcome.proposed is not None
    present = {(s.cause, s.log) for q in outcome.proposed.questions.asked for s, _ in q.other.fit}
    assert ("link.payload", None) in present


def test_logs_without_dates_have_an_onset_in_their_order_and_no_rate(tmp_path):
    """A relative clock: seconds from 0 on."""
    logs = []
    for k, damping in enumerate((0.3, 0.3, 0.4, 0.5)):
        dated = np.loadtxt(log(tmp_path / f"{k}.csv", k, damping=damping), delimiter=",", skiprows=1)
        dated[:, 0] -= dated[0, 0]
        header = "time [us],theta,torque,q,spring"
        np.savetxt(tmp_path / f"{k}.csv", dated, delimiter=",", header=header, comments="", fmt="%.17g")
        logs.append(tmp_path / f"{k}.csv")
    found = diagnose(logs, None, Options(rig=rig(), differs=("motor.viscous_friction",))).diagnosis
    (trend,) = found.trends
    assert trend.begins == (None,) * 4
    assert trend.since == "2.csv"
    assert trend.per_day is None


def without_torque_sensor(folder):
    """Write two logs and their rig; the second log has no torque sensor."""
    for k in range(2):
        log(folder / f"{k}.csv", k)
    values = np.loadtxt(folder / "1.csv", delimiter=",", skiprows=1)[:, :4]
    np.savetxt(
        folder / "1.csv", values, delimiter=",", header="timestamp [us],theta,torque,q", comments="", fmt="%.17g"
    )
    (folder / "rig.toml").write_text(RIG.format(more=""))


@pytest.mark.parametrize("first", [0, 1])
def test_logs_are_looked_at_with_the_roles_that_all_have(tmp_path, first):
    without_torque_sensor(tmp_path)
    names = [f"{k}.csv" for k in (first, 1 - first)]
    done = vsalog_run("diagnose", *names, "--rig", "rig.toml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert "torque_sensor" not in {e["signal"] for e in found["logs"]}
    assert "spring" in {f["evidence"].get("channel") for f in found["findings"] if f["code"].startswith("channel.")}


def test_a_held_out_log_needs_the_roles_of_the_others(tmp_path):
    without_torque_sensor(tmp_path)
    done = vsalog_run("diagnose", "0.csv", "--holdout", "1.csv", "--rig", "rig.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "1.csv" in done.stderr
    assert "torque_sensor" in done.stderr
    assert not list(tmp_path.glob("diagnosis.*"))


def test_the_last_log_is_the_one_of_the_latest_date(tmp_path):
    logs = [log(tmp_path / f"{k}.csv", k, month=k, damping=damping) for k, damping in enumerate((0.3, 0.45))]
    held_out = log(tmp_path / "2.csv", 2, month=2, damping=0.45)
    outcome = diagnose(logs[::-1], held_out, Options(rig=rig(), differs=("motor.viscous_friction",)))
    assert outcome.diagnosis.log == "0.csv, 1.csv"
    assert all(g.rmse_after < 0.3 * g.rmse_before for g in outcome.diagnosis.gain.signals if g.unit == "rad")


def test_torques_that_drives_hold_for_other_times_are_no_delay(tmp_path):
    logs = [held_log(tmp_path / f"{k}.csv", k, rate) for k, rate in enumerate((500.0, 250.0))]
    for differs in ((), ("link.payload",)):
        found = diagnose(logs, None, Options(rig=rig(), differs=differs)).diagnosis
        assert found.causes == ()
        assert found.verdict.startswith("consistent")
