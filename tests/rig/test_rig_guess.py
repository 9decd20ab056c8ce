import numpy as np
import pytest
from finding_codes import codes, found, values_of
from rig_logs import (
    DEFLECTION,
    JOINT_STATE,
    LINK,
    MOTOR,
    MOTOR_TORQUE,
    RNG,
    TIME,
    TORQUE,
    channels_of,
    joint_states,
    recording,
    table,
)

from vsalog.binding.joint import offered_roles
from vsalog.core.recording import Recording
from vsalog.core.units import split_header
from vsalog.rig import Rig
from vsalog.rig.guess import guess_roles
from vsalog.rig.guess_names import split_unit, words_of
from vsalog.rig.template import rig_template
from vsalog.simulation import awas_experiment, elastic_experiment, vsa2_experiment


def only_joint(log):
    guess = guess_roles(log)
    (joint,) = guess.joints
    return joint


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (("motor_position", "link_position", "motor_torque", "torque_sensor"), {}),
        (("theta", "q", "tau_m", "tau_sensor"), {}),
        (("MotorAngle", "JointAngle", "MotorTorque", "SpringTorque"), {}),
        (("rotor_enc", "output_enc", "actuator_effort", "loadcell_moment"), {}),
        (("motor", "link", "motor torque", "sensor torque"), {"motor": "deg", "link": "deg"}),
        (("elbow_motor_pos", "elbow_link_pos", "elbow_motor_trq", "elbow_sensor_trq"), {}),
        (("phi_m", "phi_l", "tau_m", "tau_s"), {}),
        (("phi_motor", "phi_link", "tau_motor", "tau_spring"), {}),
        (("φ_mot", "φ_load", "tau_mot", "LoadCell"), {"φ_mot": "deg", "φ_load": "deg"}),
    ],
)
def test_names_in_tables(names, units):
    joint = only_joint(table(dict(zip(names, (MOTOR, LINK, MOTOR_TORQUE, TORQUE), strict=True)), units=units))
    assert joint.kind == "elastic"
    assert joint.name == ("elbow" if names[0].startswith("elbow") else "joint")
    roles = ("motor_position", "link_position", "motor_torque", "torque_sensor")
    assert channels_of(joint) == dict(
        zip(sorted(roles), [n for _, n in sorted(zip(roles, names, strict=True))], strict=True)
    )
    assert all(0.0 < guess.confidence <= 1.0 and guess.reasons for guess in joint.roles.values())


@pytest.mark.parametrize("angle", ["alpha", "beta", "psi", "th", "Winkel"])
@pytest.mark.parametrize("torque", ["T", "M", "tau"])
@pytest.mark.parametrize("ends", ["mot load mot se", "m l m s"])
def test_the_symbol_of_a_quantity_names_no_joint(angle, torque, ends):
    symbols = (angle, angle, torque, torque)
    parts = tuple(f"{symbol}_{end}" for symbol, end in zip(symbols, ends.split(), strict=True))
    names = dict(zip(parts, ("motor_position", "link_position", "motor_torque", "torque_sensor"), strict=True))
    units = dict(zip(parts, ("rad", "rad", "Nm", "Nm"), strict=True))
    values = dict(zip(parts, (MOTOR, LINK, MOTOR_TORQUE, TORQUE), strict=True))
    joint = only_joint(table(values, units=units))
    assert joint.name == "joint"
    assert {name: role for role, name in channels_of(joint).items()} == names
    # A number in front of the part, or a word in front of the symbol, is the joint's.
    for prefix, number, name in (("", "1", "joint_1"), ("hip_", "", "hip")):
        renamed = {part: prefix + part.replace("_", f"{number}_") for part in parts}
        joint = only_joint(table({renamed[p]: values[p] for p in parts}, units={renamed[p]: units[p] for p in parts}))
        assert joint.kind == "elastic"
        assert joint.name in (name, "joint")
        assert set(channels_of(joint).values()) == set(renamed.values())


def test_two_symbols_with_the_same_part_name_two_joints():
    columns = {"alpha_m": MOTOR, "alpha_l": LINK, "beta_m": 2 * MOTOR, "beta_l": 2 * LINK}
    joints = guess_roles(table(columns, units=dict.fromkeys(columns, "rad"))).joints
    assert [(j.name, j.kind) for j in joints] == [("alpha", "elastic"), ("beta", "elastic")]


def test_phi_without_a_part_is_the_deflection():
    columns = {"theta_m": MOTOR, "theta_l": LINK, "phi": DEFLECTION, "tau_s": TORQUE}
    assert channels_of(only_joint(table(columns)))["deflection"] == "phi"
    both = channels_of(only_joint(table({"phi_m": MOTOR, "phi_l": LINK, "phi_m_des": PUSH})))
    assert both["commanded_position"] == "phi_m_des"


@pytest.mark.parametrize(
    ("experiment", "kind"),
    [(vsa2_experiment, "antagonistic"), (awas_experiment, "serial"), (elastic_experiment, "elastic")],
)
def test_simulated_machines_are_recognised_with_their_truth_beside(experiment, kind):
    played = experiment(duration=4.0)
    joint = only_joint(played.recording(truth=True))
    believed = {role: signal.channel for role, signal in offered_roles(played.rig.joint[played.joint]).items()}
    assert joint.kind == kind
    assert joint.gear_ratio is None
    assert channels_of(joint) == believed
    assert all(guess.sign == 1 and guess.side == "joint" for guess in joint.roles.values())


PUSH = np.sin(5.0 * TIME)


@pytest.mark.parametrize(
    ("name", "unit", "role"),
    [
        ("external_torque", None, "external_torque"),
        ("tau_ext", "N*m", "external_torque"),
        ("link acceleration", "rad/s^2", "link_acceleration"),
        ("joint_link_acc", None, "link_acceleration"),
        ("accelerometer_y", "m/s^2", "accelerometer_y"),
        ("motor_velocity", "rad/s", "motor_velocity"),
        ("velocity", None, "link_velocity"),
        ("link_speed", "deg/s", "link_velocity"),
        # what could be something else is left alone
        ("deflection_velocity", "rad/s", None),
        ("velocity_error", "rad/s", None),
        ("imu.angular_velocity.z", "rad/s", None),
        ("link_velocity", "m/s", None),
        ("accelerometer_y", "V", None),
        ("accelerometer", None, None),
        ("link acceleration", "m/s^2", None),
        ("motor_acceleration", None, None),
        ("link_acceleration_cmd", None, None),
        ("imu.linear_acceleration.x", None, None),
    ],
)
def test_roles_next_to_the_estimators_are_taken_by_name_only(name, unit, role):
    columns = {"motor_position": MOTOR, "link_position": LINK, "torque_sensor": TORQUE}
    joint = only_joint(table({**columns, name: PUSH}, units={name: unit}))
    assert channels_of(joint) == {**{c: c for c in columns}, **({role: name} if role else {})}
    assert not {"external_torque", "link_acceleration", "accelerometer_x", "secondary_torque"} & set(joint.missing)


def test_the_secondary_motor_s_torque_is_its_own():
    columns = {"motor_position": MOTOR, "link_position": LINK, "motor_torque": MOTOR_TORQUE}
    secondary = {"secondary_motor_position": 0.3 * LINK, "secondary_motor_torque": PUSH}
    found = channels_of(only_joint(table({**columns, **secondary})))
    assert (found["setpoint"], found["secondary_torque"]) == tuple(secondary)
    assert found["motor_torque"] == "motor_torque"


def test_joints_of_an_arm_are_separated():
    columns = {}
    for name in ("shoulder", "left elbow"):
        columns |= {
            f"position[{name}_motor]": MOTOR,
            f"position[{name}_link]": LINK,
            f"effort[{name}_motor]": MOTOR_TORQUE,
        }
    guess = guess_roles(joint_states(columns))
    assert [(j.name, j.kind) for j in guess.joints] == [("shoulder", "elastic"), ("left_elbow", "elastic")]
    assert channels_of(guess.joints[1])["motor_position"] == "/joint_states.position[left elbow_motor]"


def test_numbered_links_are_joints_and_numbered_motors_are_antagonists():
    arm = guess_roles(table({"q1": LINK, "theta1": MOTOR, "q2": 2 * LINK, "theta2": 2 * MOTOR}))
    assert [(j.name, channels_of(j)) for j in arm.joints] == [
        ("joint_1", {"motor_position": "theta1", "link_position": "q1"}),
        ("joint_2", {"motor_position": "theta2", "link_position": "q2"}),
    ]
    pair = only_joint(table({"q": LINK, "theta1": MOTOR, "theta2": -MOTOR, "tau1": TORQUE, "tau2": MOTOR_TORQUE}))
    assert pair.kind == "antagonistic"
    assert channels_of(pair)["motor_position_2"] == "theta2"


def test_a_number_after_a_subscript_counts_joints():
    columns = {"theta_m": MOTOR, "theta_l": LINK, "tau_m": MOTOR_TORQUE, "tau_s": TORQUE}
    arm = guess_roles(table({f"{name}{i}": i * values for i in (1, 2) for name, values in columns.items()}))
    assert [(j.name, j.kind) for j in arm.joints] == [("joint_1", "elastic"), ("joint_2", "elastic")]
    roles = {
        "motor_position": "theta_m2",
        "motor_torque": "tau_m2",
        "link_position": "theta_l2",
        "torque_sensor": "tau_s2",
    }
    assert channels_of(arm.joints[1]) == roles


def test_an_arm_with_one_position_per_joint_is_rigid_and_says_what_is_missing():
    fields = {"position": LINK, "effort": TORQUE, "velocity": MOTOR}
    columns = {f"{field}[arm_{i}_joint]": v + i for i in range(3) for field, v in fields.items()}
    guess = guess_roles(joint_states(columns))
    assert [j.name for j in guess.joints] == ["arm_0_joint", "arm_1_joint", "arm_2_joint"]
    for joint in guess.joints:
        assert joint.kind == "rigid"
        assert "a second position" in joint.missing["motor_position"]
        assert set(joint.roles) == {"link_position", "link_velocity", "motor_torque"}


def test_a_geared_motor_is_recognised_by_its_range_and_side():
    joint = only_joint(table({"position": LINK, "motor_position": -120.0 * MOTOR + 3.0, "motor_current": MOTOR_TORQUE}))
    assert joint.gear_ratio == pytest.approx(120.0, rel=0.01)
    motor = joint.roles["motor_position"]
    assert (motor.side, motor.sign) == ("rotor", -1)
    current = joint.roles["motor_torque"]
    assert (current.channel, current.unit, current.is_current) == ("motor_current", "A", True)
    assert values_of(joint, "guess.gear_ratio") == [joint.gear_ratio]


def inertial(seed, slow):
    """Return a link that swings under gravity on a spring, its motor, and the spring's torque, in SI, with sensors' noise."""
    rng = np.random.default_rng(seed)
    times = [0.15, 0.4] if slow else rng.uniform(0.3, 3.0, 4)
    q, acceleration = np.zeros(TIME.size), np.zeros(TIME.size)
    for f in 2.0 * np.pi * np.asarray(times):
        size, phase = rng.uniform(0.1, 0.5), rng.uniform(0.0, 6.0)
        q, acceleration = q + size * np.sin(f * TIME + phase), acceleration - size * f**2 * np.sin(f * TIME + phase)
    torque = -rng.uniform(2.0, 20.0) * np.sin(q) - 0.05 * acceleration
    noise = rng.standard_normal((3, TIME.size))
    theta = q - torque / rng.uniform(100.0, 900.0)
    return theta + 1e-4 * noise[0], q + 1e-4 * noise[1], torque + 0.1 * noise[2]


@pytest.mark.parametrize("slow", [False, True])
def test_the_interval_of_a_gear_ratio_holds_the_true_one_and_no_other_whole_number(slow):
    """Also of a slow lift, where the deflection follows the motor and the torque hardly shows it."""
    wholes = []
    for seed in range(10):
        theta, q, torque = inertial(seed, slow)
        true = 20 + 14 * seed
        joint = only_joint(table({"motor_position": true * theta, "link_position": q, "torque_sensor": torque}))
        for bounded in found(joint, "guess.gear_ratio_bounded"):
            assert bounded.evidence["low"] < true < bounded.evidence["high"]
        assert joint.whole_gear_ratio in (true, None)
        wholes.append(joint.whole_gear_ratio)
    assert sum(whole is not None for whole in wholes) >= (1 if slow else 5)
    without = only_joint(table({"motor_position": true * theta, "link_position": q}))
    assert (without.whole_gear_ratio, codes(without).count("guess.gear_ratio")) == (None, 1)


def test_a_motor_in_degrees_has_no_gear():
    theta, q, torque = inertial(1, slow=False)
    columns = {"motor_position": np.degrees(theta), "link_position": q, "torque_sensor": torque}
    joint = only_joint(table(columns, units=dict.fromkeys(("motor_position", "link_position"), "rad")))
    motor = joint.roles["motor_position"]
    assert (motor.unit, motor.side, joint.gear_ratio) == ("deg", "joint", None)


def test_a_torque_computed_from_the_deflection_is_no_measurement():
    joint = only_joint(
        table({"position": LINK, "motor_position": MOTOR, "deflection": DEFLECTION, "effort": -40.0 * DEFLECTION})
    )
    assert joint.roles["torque_sensor"].sign == -1
    assert joint.roles["torque_sensor"].confidence < 0.5
    (computed,) = found(joint, "torque.computed")
    assert computed.evidence == {"factor": pytest.approx(-40.0), "source": "'deflection'"}
    measured = only_joint(
        table({"position": LINK, "motor_position": MOTOR, "deflection": DEFLECTION, "effort": TORQUE})
    )
    assert "torque.computed" not in codes(measured)


def test_a_sensor_that_counts_the_other_way_round_gets_a_sign():
    joint = only_joint(
        table({"link": LINK, "motor": MOTOR, "spring_torque": -TORQUE}, units={"link": "rad", "motor": "rad"})
    )
    assert joint.roles["torque_sensor"].sign == -1


@pytest.mark.parametrize("spoilt", ["motor", "link", "spring_torque", "deflection"])
def test_one_outlier_changes_no_sign_and_no_gear(spoilt):
    signs = {"motor": -1, "spring_torque": -1}
    for gear, third in ((30.0, {"deflection": DEFLECTION}), (1.0, {}), (1.0, {"deflection": DEFLECTION})):
        columns = {"motor": -gear * MOTOR, "link": LINK, "spring_torque": -TORQUE, **third}
        if spoilt not in columns:
            continue
        columns[spoilt] = np.where(np.arange(TIME.size) == 1700, 1e6, columns[spoilt])
        joint = only_joint(table(columns, units=dict.fromkeys(("motor", "link", "deflection"), "rad")))
        assert {guess.channel: guess.sign for guess in joint.roles.values() if guess.sign < 0} == signs
        assert (joint.gear_ratio is not None) == (gear > 1.0)


def test_what_never_changes_is_no_role_and_commands_and_rates_are_their_own():
    still = np.zeros(TIME.size)
    joint = only_joint(
        table(
            {
                "position_command": LINK, "desired_position": LINK, "position_setpoint": LINK, "torque_ref": TORQUE,
                "velocity": MOTOR, "motor_velocity": MOTOR, "dq": MOTOR, "motor_temperature": MOTOR, "seq": TIME,
                "motor_position": MOTOR, "link_position": LINK, "motor_torque": still, "gyro": LINK,
            }
        )
    )  # fmt: skip
    assert channels_of(joint) == {
        "motor_position": "motor_position", "link_position": "link_position", "commanded_position": "position_command",
        "motor_velocity": "motor_velocity", "link_velocity": "dq",
    }  # fmt: skip
    assert joint.missing["motor_torque"] == "not found: 'motor_torque' never changes"
    assert "guess.no_torque" in codes(joint)


def test_units_tell_what_names_do_not():
    joint = only_joint(table({"motor": MOTOR, "arm": LINK}, units={"motor": "deg", "arm": "°"}))
    assert channels_of(joint) == {"motor_position": "motor", "link_position": "arm"}
    heat = guess_roles(table({"motor": MOTOR, "link": LINK}, units={"motor": "degC", "link": "m"}))
    assert heat.joints == ()


@pytest.mark.parametrize(
    "name", ["theta_c", "lever_arm", "stiffness_setpoint", "pretension", "secondary_motor_position"]
)
def test_a_set_point_makes_a_serial_joint(name):
    joint = only_joint(
        table({"motor_position": MOTOR, "link_position": LINK, "torque_sensor": TORQUE, name: 0.05 + 0.0 * TIME})
    )
    assert joint.kind == "serial"
    assert joint.roles["setpoint"].channel == name


def test_a_lone_angle_whose_torque_follows_is_a_deflection_but_not_in_joint_states():
    joint = only_joint(table({"angleRig": DEFLECTION, "torque": TORQUE}))
    assert channels_of(joint) == {"deflection": "angleRig", "torque_sensor": "torque"}
    assert "fixed at its other end" in joint.roles["deflection"].reasons[0]
    assert only_joint(joint_states({"position[a]": DEFLECTION, "effort[a]": TORQUE})).kind == "rigid"
    assert only_joint(table({"angle": DEFLECTION, "torque": RNG.standard_normal(TIME.size)})).kind == "rigid"


def run_columns(names, group="tests"):
    return {f"{group}.{n}.{f}": v for n in names for f, v in (("angle", DEFLECTION), ("torque", TORQUE))}


def test_groups_with_a_number_in_their_names_are_runs():
    log = recording(
        {**run_columns(["k00", "k10", "k45"]), **run_columns(["k45"], "tests_one_cam")}, absolute=False, kind="matlab"
    )
    guess = guess_roles(log)
    (joint,) = guess.joints
    assert joint.kind == "serial"
    assert channels_of(joint) == {"deflection": "tests.{run}.angle", "torque_sensor": "tests.{run}.torque"}
    assert [(run.name, run.setpoint) for run in joint.runs] == [("k00", 0.0), ("k10", 10.0), ("k45", 45.0)]
    assert [one.evidence["streams"] for one in found(guess, "guess.runs_left_out")] == ["'tests_one_cam.k45'"]


def test_runs_that_only_count_have_no_set_point():
    joint = only_joint(recording(run_columns(["trial1", "trial2", "trial3"]), absolute=False, kind="matlab"))
    assert joint.kind == "elastic"
    assert [run.setpoint for run in joint.runs] == [None, None, None]


def test_topics_recorded_side_by_side_are_no_runs():
    log = recording({f"/leg{i}.{f}": v for i in (1, 2) for f, v in (("position", LINK), ("effort", TORQUE))})
    assert all(not joint.runs for joint in guess_roles(log).joints)


def test_streams_without_time_are_passed_over_unless_there_is_nothing_else():
    log = table({"motor_position": MOTOR, "link_position": LINK}, time_source="none")
    guess = guess_roles(log)
    assert guess.joints[0].kind == "elastic"
    assert codes(guess) == ["clock.missing"]


SENSED = {"motor_position": MOTOR, "link_position": LINK, "torque_sensor": TORQUE, "motor_torque": MOTOR_TORQUE}


@pytest.mark.parametrize(
    "names",
    [
        ("pos_mot", "pos_load", "tau_se", None),
        ("pos_mot", "pos_se", "LoadCell", "tau_cmd"),
        ("theta_m", "theta_l", "tau_s", "i_q"),
        ("q_motor", "q", "load cell torque", "Iq_meas [A]"),
        ("Enc1", "Enc2", "LoadCell (Nm)", "Iq_meas [A]"),
        ("motor_deg[0]", "link_deg[0]", "sensor_Nm[0]", "current_A[0]"),
        ("motorPosDeg", "gearOutputPosDeg", "springTorqueNm", "curr_mA"),
        ("pos_act", "encoder_link", "torque_measured", "curr"),
        ("joint_position", "joint_position_abs", "joint_torque_sensor", "motor_torque"),
        ("hipMotorAngle", "hipLegAngle", None, "hipMotorTorque"),
        ("/motor_states/elbow/position", "/joint_states/elbow/position", None, "/motor_states/elbow/effort"),
    ],
)
def test_names_of_labs(names):
    split = {role: split_header(name) for role, name in zip(SENSED, names, strict=True) if name}
    columns = {name: SENSED[role] for role, (name, _) in split.items()}
    joint = only_joint(table(columns, units=dict(split.values())))
    assert joint.kind == "elastic"
    assert channels_of(joint) == {role: name for role, (name, _) in split.items()}
    assert not {"deg", "nm", "a", "ma", "act"} & set(joint.name.lower().split("_"))


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("motor_deg[0]", "motor[0]", "deg"), ("jointAngleRad", "jointAngle", "rad"), ("torque_Nm", "torque", "N*m"),
        ("i_q_A", "i_q", "A"), ("speed_rad_s", "speed", "rad/s"), ("enc.ticks", "enc", "counts"),
        ("leg_A", "leg_A", None), ("theta_m", "theta_m", None), ("rotation", "rotation", None), ("deg", "deg", None),
        ("command", "command", None), ("sigma", "sigma", None), ("EpochTimestamp", "EpochTimestamp", None),
    ],
)  # fmt: skip
def test_units_at_the_end_of_names(name, bare, unit):
    assert split_unit(name) == (bare, unit)


@pytest.mark.parametrize("name", ["torque_counts", "torque_deg", "sensor_torque_A"])
def test_a_unit_that_does_not_fit_is_not_taken_from_a_name(name):
    log = table({"motor": MOTOR, "link_position": LINK, name: TORQUE}, units={"motor": "rad"})
    joint = only_joint(log)
    assert all(joint.roles[role].unit is None for role in joint.roles if "torque" in role)
    Rig.from_toml(rig_template(log, guess_roles(log)))


def arm(joints, motors):
    columns, streams = {}, {}
    for topic, names, position, effort in (
        ("/joint_states", joints, LINK, TORQUE),
        ("/motor_states", motors, MOTOR, MOTOR_TORQUE),
    ):
        for name in names:
            values = {"position": position, "velocity": np.gradient(position, TIME), "effort": effort}
            log = recording({f"{topic}.{f}[{name}]": v for f, v in values.items()}, stream=topic, kind=JOINT_STATE)
            columns |= log.channels
            streams |= log.streams
    return Recording(log.path, "mcap", columns, streams)


@pytest.mark.parametrize(
    ("joints", "motors", "names"),
    [
        (("elbow", "wrist"), ("elbow", "wrist"), ("elbow", "wrist")),
        (("elbow_joint", "wrist_joint"), ("elbow_motor", "wrist_motor"), ("elbow", "wrist")),
        (("joint_1", "joint_2"), ("motor_1", "motor_2"), ("joint_1", "joint_2")),
        (("joint_1", "joint_2"), ("joint_1", "joint_2"), ("joint_1", "joint_2")),
        (("0", "1"), ("0", "1"), ("joint_0", "joint_1")),
    ],
)
def test_a_motor_s_topic_and_a_joint_s_are_two_ends_of_a_spring(joints, motors, names):
    guess = guess_roles(arm(joints, motors))
    assert tuple(joint.name for joint in guess.joints) == names
    for joint, link, motor in zip(guess.joints, joints, motors, strict=True):
        assert joint.kind == "elastic"
        assert channels_of(joint) == {
            "motor_position": f"/motor_states.position[{motor}]", "motor_torque": f"/motor_states.effort[{motor}]",
            "motor_velocity": f"/motor_states.velocity[{motor}]", "link_position": f"/joint_states.position[{link}]",
            "link_velocity": f"/joint_states.velocity[{link}]", "torque_sensor": f"/joint_states.effort[{link}]",
        }  # fmt: skip


def test_of_two_unnamed_positions_the_larger_is_in_front_of_the_gear():
    joint = only_joint(table({"Enc1": LINK, "Enc2": np.rad2deg(-30.0 * MOTOR)}, units={"Enc2": "deg"}))
    assert channels_of(joint) == {"link_position": "Enc1", "motor_position": "Enc2"}
    assert joint.gear_ratio == pytest.approx(30.0, rel=0.02)
    assert (joint.roles["motor_position"].side, joint.roles["motor_position"].sign) == ("rotor", -1)


def test_two_positions_that_move_apart_are_not_called_the_only_one():
    joint = only_joint(table({"Enc1": np.sin(TIME), "Enc2": np.cos(7.3 * TIME)}))
    assert joint.kind == "rigid"
    assert not any("only" in reason for guess in joint.roles.values() for reason in guess.reasons)
    assert "one position" not in joint.reason


def test_a_series_encoder_is_the_deflection_where_it_does_not_move_with_the_motor():
    columns = {"pos_mot": MOTOR, "pos_se": DEFLECTION, "tau_se": TORQUE}
    assert channels_of(only_joint(table(columns)))["deflection"] == "pos_se"
    assert channels_of(only_joint(table({**columns, "pos_se": LINK})))["link_position"] == "pos_se"


@pytest.mark.parametrize(("turn", "wrapped"), [(4096, True), (65536, True), (4096, False)])
def test_an_encoder_that_wraps_tells_its_counts(turn, wrapped):
    counts = np.floor(turn * (0.9 + LINK / 6.0))
    joint = only_joint(
        table({"link": np.mod(counts, turn) if wrapped else counts, "motor": MOTOR}, units={"link": "counts"})
    )
    guess = joint.roles["link_position"]
    assert (guess.unit, guess.counts_per_turn) == ("counts", turn if wrapped else None)
    assert "guess.raw_counts" in codes(joint)
    assert joint.gear_ratio is None  # counts and radians have no ratio


def test_a_torque_of_a_joint_without_a_spring_is_what_moves_it():
    assert channels_of(only_joint(table({"position": LINK, "torque": MOTOR_TORQUE})))["motor_torque"] == "torque"
    assert (
        channels_of(only_joint(table({"position": LINK, "loadcell_torque": PUSH})))["torque_sensor"]
        == "loadcell_torque"
    )


@pytest.mark.parametrize("size", [1e-300, 1e300, np.inf])
def test_numbers_beyond_measure_give_none_to_begin_with(size):
    log = table({"motor_position": MOTOR, "link_position": LINK, "motor_torque": size * MOTOR_TORQUE})
    Rig.from_toml(rig_template(log, guess_roles(log)))


def test_raw_counts_are_doubted():
    counts = np.round(500.0 + 100.0 * LINK)
    joint = only_joint(table({"joint_angle": counts, "motor_position": MOTOR}))
    assert joint.roles["link_position"].confidence < 0.6
    assert "guess.raw_counts" in codes(joint)


def test_nothing_is_made_of_nothing():
    assert guess_roles(table({"temperature": LINK, "voltage": MOTOR})).joints == ()
    assert guess_roles(table({"torque": TORQUE})).joints == ()
    assert guess_roles(recording({})).joints == ()


def test_channels_on_two_clocks_and_with_nan_are_compared_where_both_are():
    log = recording({"/a.motor_position": MOTOR, "/b.link_position": LINK[:2000]})
    holes = log.channels["/b.link_position"].values
    holes[::7] = np.nan
    joint = only_joint(log)
    assert channels_of(joint) == {"motor_position": "/a.motor_position", "link_position": "/b.link_position"}


def test_a_wrench_gives_the_axis_that_moves():
    axes = {f"/ft.wrench.torque.{a}": s * TORQUE for a, s in (("x", 0.01), ("y", 0.02), ("z", 1.0))}
    forces = {f"/ft.wrench.force.{a}": TORQUE for a in "xyz"}
    base = recording({**axes, **forces}, stream="/ft", kind="geometry_msgs/msg/WrenchStamped")
    states = joint_states({"position[motor]": MOTOR, "position[link]": LINK})
    both = recording({})
    both.channels.update({**base.channels, **states.channels})
    both.streams.update({**base.streams, **states.streams})
    joint = only_joint(both)
    assert joint.roles["torque_sensor"].channel == "/ft.wrench.torque.z"
    assert states.channels["/joint_states.position[motor]"].type == JOINT_STATE


@pytest.mark.parametrize(
    ("plain", "variant"),
    [
        ("q_measured", "q_raw"), ("link_position", "link_pos_filt"), ("target_position", "goal_position"),
        ("SensorTorques", "SpringTorque"), ("position_deg", "position"),
    ],
)  # fmt: skip
def test_of_two_channels_for_one_role_the_plain_measured_one_with_a_unit_wins(plain, variant):
    columns = {"motor_position": MOTOR, "torque": TORQUE, variant: LINK, plain: LINK + 1e-4}
    assert plain in channels_of(only_joint(table(columns))).values()
    assert variant not in channels_of(only_joint(table(columns))).values()


@pytest.mark.parametrize(
    "name",
    [
        "tcp_position",
        "flange_angle",
        "pose.position.x",
        "xAngle",
        "target_tcp_velocity",
        "K_i",
        "r_enabled",
        "torsionVel",
    ],
)
def test_what_is_no_joint_s_has_no_role(name):
    joint = only_joint(table({"motor_position": MOTOR, name: LINK}))
    assert name not in channels_of(joint).values()


def test_an_r_in_front_of_a_name_is_the_right_side_and_alone_a_set_point():
    sides = {
        f"{side}_{part}": values for side in "RL" for part, values in (("motor_angle", MOTOR), ("link_angle", LINK))
    }
    assert [joint.name for joint in guess_roles(table(sides)).joints] == ["r", "l"]
    serial = channels_of(only_joint(table({"motor_angle": MOTOR, "link_angle": LINK, "r": PUSH})))
    assert serial["setpoint"] == "r"


def test_lists_of_actuators_and_joints_are_the_two_ends_of_each():
    columns = {}
    for i in range(2):
        columns |= {f"arm.actuators[{i}].position": MOTOR, f"arm.actuators[{i}].effort": MOTOR_TORQUE}
        columns |= {f"arm.joints[{i}].position": LINK, f"arm.joints[{i}].effort": TORQUE}
    for i, joint in enumerate(guess_roles(table(columns)).joints):
        assert channels_of(joint) == {
            "motor_position": f"arm.actuators[{i}].position", "motor_torque": f"arm.actuators[{i}].effort",
            "link_position": f"arm.joints[{i}].position", "torque_sensor": f"arm.joints[{i}].effort",
        }  # fmt: skip


def test_torsion_is_a_deflection():
    assert (
        channels_of(only_joint(table({"SEA.torsion": DEFLECTION, "SEA.motorPos": MOTOR})))["deflection"]
        == "SEA.torsion"
    )


def test_an_extended_state_is_not_external():
    assert (
        channels_of(
            only_joint(
                table({"stateExt.motorPosition": MOTOR, "stateExt.jointPosition": LINK, "stateExt.torque": TORQUE})
            )
        )["torque_sensor"]
        == "stateExt.torque"
    )


def test_words():
    assert words_of("servo1_positionRaw") == ["servo", "1", "position", "raw"]
    assert words_of("angleJIM") == ["angle", "jim"]
    assert words_of("motorposition") == ["motor", "position"]
    assert words_of("θ_1") == ["theta", "1"]
