"""`vsalog identify` on machines that are integrated here: numbers within their intervals, and what a log cannot tell."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import vsalog_run
from scipy.integrate import solve_ivp

from vsalog.rig import Rig

pytestmark = pytest.mark.share(5)

SEA = """
[joint.a]
kind = "elastic"
[joint.a.motor]
inertia = {inertia}
damping = {damping}
side = "rotor"
gear_ratio = 10.0
[joint.a.transmission]
type = "linear"
stiffness = {stiffness}
[joint.a.link]
inertia = {link}
damping = 0.05
[joint.a.signals]
motor_position = {{ channel = "theta", unit = "rad" }}
motor_torque = {{ channel = "torque", unit = "N*m" }}
link_position = {{ channel = "q", unit = "rad" }}
"""
TRUE = {"inertia": 5e-4, "damping": 3e-3, "stiffness": 30.0, "link": 0.04}
GUESS = {"inertia": 3.5e-4, "damping": 5e-3, "stiffness": 40.0, "link": 0.03}
SERVO = """
[joint.a]
kind = "rigid"
[joint.a.motor]
inertia = 0.05
damping = 0.4
[joint.a.drive]
kind = "position-servo"
kp = 30.0
kd = 0.5
[joint.a.signals]
commanded_position = {{ channel = "command", unit = "rad" }}
link_position = {{ channel = "q", unit = "rad" }}
"""


def rotor_torque(t):
    return 0.06 * np.sin(3.1 * t) + 0.05 * np.sin(11.0 * t) + 0.03 * np.sin(29.0 * t + 1.0)


@pytest.fixture(scope="module")
def sea(tmp_path_factory):
    """A motor behind a gear of 10, a spring and a link; two logs with the noise of their encoders."""
    folder = tmp_path_factory.mktemp("sea")
    for seed, name in enumerate(("one.csv", "two.csv")):
        write_sea(folder / name, seed, TRUE["damping"])
    (folder / "guess.rig.toml").write_text(SEA.format(**GUESS))
    return folder


def write_sea(path, seed, damping, dry=0.0, r=10.0):
    """Write the log of a rotor with viscous and dry friction; the latter is blurred over 0.2 mrad/s."""

    def rates(t, x):
        theta, omega, q, v = x
        spring = TRUE["stiffness"] * (q - theta)
        rotor = rotor_torque(t) - damping * r * omega - dry * np.tanh(omega / 2e-4)
        return omega, (r * rotor + spring) / (r**2 * TRUE["inertia"]), v, (-spring - 0.05 * v) / TRUE["link"]

    time = np.arange(0.0, 12.0, 0.002)
    begin = np.array([0.1 * seed, 0.0, 0.1 * seed, 0.0])
    method = {"method": "LSODA", "max_step": 0.01} if dry else {}
    x = solve_ivp(rates, (0.0, 12.0), begin, t_eval=time, rtol=1e-9, atol=1e-11, **method).y
    rng = np.random.default_rng(seed)
    columns = [time, x[0] + 2e-4 * rng.standard_normal(time.size), r * rotor_torque(time)]
    columns.append(x[2] + 2e-4 * rng.standard_normal(time.size))
    header = "time [s],theta,torque,q"
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=header, comments="", fmt="%.9g")


def identified(folder, *arguments):
    done = vsalog_run("identify", *arguments, "--json", "--force", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_numbers_are_found_within_their_intervals_and_written_as_the_rig_has_them(sea):
    found = identified(sea, "one.csv", "--rig", "guess.rig.toml", "--holdout", "two.csv", "-o", "found.toml")
    numbers = {n["key"]: n for n in found["numbers"]}
    keys = {
        "inertia": "motor.inertia",
        "damping": "motor.damping",
        "stiffness": "transmission.stiffness",
        "link": "link.inertia",
    }
    for name, key in keys.items():
        n = numbers[key]
        assert n["determined"] == "alone", key
        # 95 % intervals of four numbers: twice their width holds all of them in all but one log of many.
        assert abs(n["value"] - TRUE[name]) < n["high"] - n["low"], key
        assert n["value"] == pytest.approx(TRUE[name], rel=0.03)
    for error in found["errors"]:
        assert error["where"] == "two.csv"
        assert error["identified"] < 0.1 * error["rig"]
        assert error["identified"] < 2.0 * error["noise_floor"]
    rig = Rig.load(sea / "found.toml")
    motor = rig.joints["a"].motor
    assert motor.side == "rotor"
    assert motor.inertia == pytest.approx(TRUE["inertia"], rel=0.03)
    assert 0.0 < rig.tolerances["a"]["motor.inertia"] < 0.05 * TRUE["inertia"]


UNDAMPED = SEA.replace("damping = {damping}\n", "").replace("damping = 0.05\n", "")


@pytest.mark.parametrize(("damping", "dry"), [(3e-3, 0.0), (0.0, 0.0), (3e-3, 0.02)])
def test_damping_and_friction_that_the_rig_does_not_give_are_identified(tmp_path, damping, dry):
    """Behind a gear, where sizes of torque and velocity are those of the rotor."""
    write_sea(tmp_path / "log.csv", 3, damping, dry)
    (tmp_path / "rig.toml").write_text(UNDAMPED.format(**GUESS))
    numbers = {n["key"]: n for n in identified(tmp_path, "log.csv", "--rig", "rig.toml")["numbers"]}
    truth = {"motor.damping": damping, "transmission.stiffness": TRUE["stiffness"], "link.damping": 0.05}
    truth |= {"motor.friction.coulomb": dry} if dry else {}
    assert {key for key in numbers if "friction" in key} == {key for key in truth if "friction" in key}
    for key, true in truth.items():
        n = numbers[key]
        assert n["determined"] == "alone", key
        # As above: 95 % intervals of several numbers.
        assert abs(n["value"] - true) <= n["high"] - n["low"], key
        assert n["high"] - n["low"] < 0.1 * max(true, 1e-3), key


def test_damping_that_the_rig_states_exactly_or_that_is_fixed_stays(sea):
    """And so does friction: what is kept is not looked for."""
    exact = SEA.format(**GUESS | {"damping": '"0 N*m*s/rad ± 0"'})
    (sea / "stated.rig.toml").write_text(exact.replace("damping = 0.05", 'damping = "0.05 N*m*s/rad ± 0"'))
    found = identified(sea, "one.csv", "--rig", "stated.rig.toml", "--fix", "*.friction.coulomb", "-o", "stated.toml")
    assert {n["key"] for n in found["numbers"]} == {"motor.inertia", "transmission.stiffness", "link.inertia"}
    assert "identification.misfit" in {f["code"] for f in found["findings"]}


def test_what_is_exact_or_fixed_stays(sea):
    text = SEA.format(**GUESS | {"stiffness": '"30 N*m/rad ± 0"'})
    (sea / "exact.rig.toml").write_text(text)
    found = identified(sea, "one.csv", "--rig", "exact.rig.toml", "--fix", "link.*", "-o", "exact.toml")
    assert {n["key"] for n in found["numbers"]} == {"motor.inertia", "motor.damping"}
    joint = Rig.load(sea / "exact.toml").joints["a"]
    assert joint.transmission.stiffness == 30.0
    assert joint.link.inertia == GUESS["link"]
    assert {e["part"] for e in found["errors"]} == {"last third"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--fix", "motor.weight"), "motor.weight"),
        (("--free", "motor.gear_rato"), "gear_ratio"),
        (("--fix", "*"), "no number"),
        (("--holdout", "none.csv"), "none.csv"),
        (("--set", "joint.a.link.inertia=-1"), "inertia"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(sea, arguments, said):
    done = vsalog_run("identify", "one.csv", "--rig", "guess.rig.toml", *arguments, "-o", "refused.toml", cwd=sea)
    assert done.returncode == 2
    assert said in done.stderr
    assert not (sea / "refused.toml").exists()


def test_a_log_does_not_judge_the_fit_to_itself(sea):
    arguments = ("one.csv", "--rig", "guess.rig.toml", "--holdout", "one.csv", "-o", "new.toml")
    done = vsalog_run("identify", *arguments, cwd=sea)
    assert (done.returncode, done.stdout) == (2, "")
    assert not (sea / "new.toml").exists()


def test_files_that_are_there_or_read_are_kept(sea):
    (sea / "there.toml").write_text("mine")
    done = vsalog_run("identify", "one.csv", "--rig", "guess.rig.toml", "-o", "there.toml", cwd=sea)
    assert done.returncode == 2
    assert (sea / "there.toml").read_text() == "mine"
    done = vsalog_run("identify", "one.csv", "--rig", "guess.rig.toml", "-o", "guess.rig.toml", "--force", cwd=sea)
    assert done.returncode == 2
    assert "inertia" in (sea / "guess.rig.toml").read_text()


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    """A drive that holds its command for 20 ms, an inertia and viscous friction: nothing but angles is recorded."""
    folder = tmp_path_factory.mktemp("servo")
    write_servo(folder / "log.csv", 26.0, 0.7 + 0.3)
    (folder / "rig.toml").write_text(SERVO.format())
    return folder


def write_servo(path, kp, damping, n=1500, period=0.02):
    """Write the log of a drive with an inertia of 0.05 kg·m²."""
    time = np.arange(n) * period
    command = 0.4 * np.sin(2.0 * time) + 0.15 * np.sin(9.0 * time) + 0.1 * np.sign(np.sin(1.3 * time))
    x, out = np.array([command[0], 0.0]), np.empty(n)
    for k in range(n):
        out[k] = x[0]

        def rates(_, s, k=k):
            return s[1], (kp * (command[k] - s[0]) - damping * s[1]) / 0.05

        x = solve_ivp(rates, (0.0, period), x, rtol=1e-9, atol=1e-11).y[:, -1]
    rng = np.random.default_rng(0)
    columns = np.stack([time, command, out + 3e-4 * rng.standard_normal(n)], axis=1)
    np.savetxt(path, columns, delimiter=",", header="time [s],command,q", comments="", fmt="%.9g")


def test_a_fit_that_is_worse_than_the_rig_elsewhere_is_reported(servo):
    """The held-out log is of the machine that the rig has, the log is of another one."""
    write_servo(servo / "rigs.csv", 30.0, 0.4 + 0.5, n=800)
    asked = ("log.csv", "--rig", "rig.toml", "--fix", "motor.inertia", "-o", "worse.toml", "--holdout")
    found = identified(servo, *asked, "rigs.csv")
    (error,) = found["errors"]
    (finding,) = [f for f in found["findings"] if f["code"] == "identification.worse_elsewhere"]
    assert (finding["joint"], finding["part"]) == ("a", "link_position")
    assert (finding["value"], finding["limit"]) == (error["identified"], error["rig"])
    assert error["identified"] > 2.0 * error["rig"]
    write_servo(servo / "same.csv", 26.0, 0.7 + 0.3, n=800)
    found = identified(servo, *asked, "same.csv")
    assert "identification.worse_elsewhere" not in [f["code"] for f in found["findings"]]


def test_a_fit_that_leaves_more_than_noise_is_reported(run, tmp_path):
    """A friction that the rig lacks is in no number that is fitted: intervals of noise alone exclude the truth."""
    codes = {}
    for torque in ("0", "0.1"):
        friction = f"joint.sea.motor.friction.coulomb={torque} N*m"
        done = run("simulate", "sea", "--actual", friction, "-o", f"{torque}.mcap", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        asked = ("--fix", "motor.friction.coulomb", "--json", "-o", f"{torque}.toml")
        done = run("identify", f"{torque}.mcap", *asked, cwd=tmp_path)
        codes[torque] = {f["code"]: f for f in json.loads(done.stdout)["findings"]}
    assert "identification.misfit" not in codes["0"]
    assert codes["0.1"]["identification.misfit"]["value"] > 5.0


def test_without_a_torque_numbers_are_reported_relative_to_one(servo):
    """Inertia, gains and damping have a factor in common, and of kd and damping only the sum is reported."""
    found = identified(servo, "log.csv", "--rig", "rig.toml", "-o", "all.toml")
    assert {n["key"]: n["determined"] for n in found["numbers"]} == dict.fromkeys(
        ("motor.inertia", "motor.damping", "drive.kp", "drive.kd"), "in combination"
    )
    assert any({"motor.inertia", "drive.kp"} <= set(c["keys"]) for c in found["combinations"])
    values = {n["key"]: n["value"] for n in found["numbers"]}
    assert values["drive.kp"] / values["motor.inertia"] == pytest.approx(26.0 / 0.05, rel=0.02)
    found = identified(
        servo, "log.csv", "--rig", "rig.toml", "--fix", "motor.inertia", "--fix", "drive.kd", "-o", "some.toml"
    )
    numbers = {n["key"]: n for n in found["numbers"]}
    assert {n["determined"] for n in numbers.values()} == {"alone"}
    assert numbers["drive.kp"]["value"] == pytest.approx(26.0, rel=0.02)
    assert numbers["motor.damping"]["value"] == pytest.approx(1.0 - 0.5, rel=0.05)


def test_damping_that_a_log_does_not_determine_is_reported_so(servo):
    """Without a torque the drive's gain of velocity acts as damping does, and the rig gives that of a machine without any."""
    (servo / "undamped.toml").write_text(SERVO.format().replace("damping = 0.4\n", ""))
    found = identified(servo, "log.csv", "--rig", "undamped.toml", "--fix", "motor.inertia", "-o", "undetermined.toml")
    numbers = {n["key"]: n for n in found["numbers"]}
    for key, true in (("motor.damping", 0.7), ("drive.kd", 0.3)):
        assert numbers[key]["determined"] == "in combination"
        assert numbers[key]["low"] <= true <= numbers[key]["high"]
    assert numbers["motor.damping"]["value"] + numbers["drive.kd"]["value"] == pytest.approx(1.0, rel=0.05)


def test_the_document_is_as_its_schema_says(servo):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((Path(__file__).parents[2] / "docs" / "identification.schema.json").read_text())
    found = identified(servo, "log.csv", "--rig", "rig.toml", "--fix", "motor.inertia", "-o", "s.toml")
    jsonschema.validate(found, schema)
    assert found["correlations"]["a"][0][0] == pytest.approx(1.0)
