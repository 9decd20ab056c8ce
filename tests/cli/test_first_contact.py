"""From logs as labs have them to a figure: `inspect`, `init`, a few edits of the rig, the command that `init` names, and a PDF.

Each machine lists all its edits; three at most. The logs are made by equations, of a spring of known stiffness; the last one is
that of real servos, which have none.
"""

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

pytestmark = pytest.mark.share(3)

TIME = np.arange(0.0, 8.0, 0.004)
LINK = ((0.5, 2.1, 0.3), (0.2, 5.3, 1.0))
DEFLECTION = ((0.04, 3.1, 0.0), (0.02, 7.7, 0.5), (0.01, 13.0, 0.2))
INERTIA, DAMPING = 0.05, 0.4
MOST_EDITS = 3
START = 1_700_000_000_123_456_789
JOINT_STATE = "sensor_msgs/msg/JointState"


def sines(waves, derivative=0):
    return sum(a * w**derivative * np.sin(w * TIME + p + derivative * np.pi / 2) for a, w, p in waves)


@dataclass(frozen=True)
class Joint:
    """A motor with inertia and damping, a linear spring, and a link that is moved: B θ̈ + D θ̇ = τ + k (q − θ)."""

    stiffness: float
    seed: int = 0

    @property
    def link(self):
        return sines(LINK) + self.noise(1e-5)

    @property
    def motor(self):
        return sines(LINK) - sines(DEFLECTION) + self.noise(1e-5, 1)

    @property
    def spring_torque(self):
        return self.stiffness * sines(DEFLECTION) + self.noise(0.02, 2)

    @property
    def motor_torque(self):
        motion = [sines(LINK, d) - sines(DEFLECTION, d) for d in (1, 2)]
        return INERTIA * motion[1] + DAMPING * motion[0] - self.stiffness * sines(DEFLECTION) + self.noise(0.02, 3)

    def noise(self, size, of=0):
        return size * np.random.default_rng((self.seed, of)).standard_normal(TIME.size)


def write_csv(path, columns):
    rows = np.column_stack(list(columns.values()))
    formats = ["%.6f"] + ["%.9g"] * (len(columns) - 1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt=formats)
    return path


def counts_and_amperes(folder):
    """A bench: encoders in counts, one in front of a gear of 50; a servo drive's current; a load cell."""
    joint = Joint(120.0)
    turn = 2.0 * np.pi
    columns = {
        "t [s]": TIME,
        "Enc1 [counts]": np.round(50.0 * joint.motor * 4096 / turn),
        "Enc2 [counts]": np.round(joint.link * 262144 / turn),
        "Iq_meas [A]": joint.motor_torque / 50.0 / 0.06,
        "LoadCell (Nm)": joint.spring_torque,
    }
    return write_csv(folder / "bench.csv", columns), {"joint": 120.0}


def ros_of_two_joints(folder):
    """An arm: encoders behind the springs in /joint_states, those of the motors in /motor_states."""
    joints = {"shoulder": Joint(300.0, 1), "elbow": Joint(120.0, 2)}
    topics = {
        "/joint_states": ([j.link for j in joints.values()], [j.spring_torque for j in joints.values()]),
        "/motor_states": ([j.motor for j in joints.values()], [j.motor_torque for j in joints.values()]),
    }
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(folder / "arm", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {topic: bag.add_connection(topic, JOINT_STATE, typestore=store) for topic in topics}
        for i, time in enumerate(TIME):
            stamp = START + round(time * 1e9)
            header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "base")
            for topic, both in topics.items():
                position, effort = (np.array([values[i] for values in kind]) for kind in both)
                message = types[JOINT_STATE](header, list(joints), position, np.empty(0), effort)
                bag.write(connections[topic], stamp, store.serialize_cdr(message, JOINT_STATE))
    return folder / "arm" / "arm.mcap", {name: joint.stiffness for name, joint in joints.items()}


def simulink(folder):
    """A Simulink scope saved as a structure with time; angles in degrees, which its labels say."""
    joint = Joint(80.0, 3)
    labelled = {
        "q_motor_deg": np.rad2deg(joint.motor),
        "q_load_deg": np.rad2deg(joint.link),
        "tau_se": joint.spring_torque,
    }
    signals = [
        {"values": v[:, None], "dimensions": 1, "label": k, "blockName": "plant/scope"} for k, v in labelled.items()
    ]
    path = folder / "scope.mat"
    savemat(path, {"ScopeData": {"time": TIME[:, None], "signals": signals, "blockName": "plant/scope"}})
    return path, {"joint": 80.0}


def plotjuggler(folder):
    """What PlotJuggler exports of two topics; no sensor at the spring, so that the motor's torque and inertia have to do."""
    joint = Joint(150.0, 4)
    columns = {
        "__time": START * 1e-9 + TIME,
        "/joint_states/elbow/position": joint.link,
        "/motor_states/elbow/position": joint.motor,
        "/motor_states/elbow/effort": joint.motor_torque,
    }
    return write_csv(folder / "export.csv", columns), {"elbow": 150.0}


def so101(folder):
    """Hobby servos: a folder of tables, with the position commanded and that of the only encoder. No spring."""
    return Path(__file__).parents[2] / "sample_logs" / "so101_servo" / "chirp_sweep", {}


@dataclass(frozen=True)
class Case:
    """A machine: what writes its log, the edits of its rig, the command that suits it, and more words for it."""

    write: object
    edits: tuple[tuple[str, str], ...]
    command: str
    more: Sequence[str] = ()


CASES = [
    Case(
        counts_and_amperes,
        (
            (
                r'motor_position = \{ channel = "Enc1", unit = "counts" \}',
                'motor_position = { channel = "Enc1", counts_per_turn = 4096, side = "rotor" }',
            ),
            (
                r'link_position = \{ channel = "Enc2", unit = "counts" \}',
                'link_position = { channel = "Enc2", counts_per_turn = 262144 }',
            ),
            (r"# gear_ratio = 50.0", "gear_ratio = 50"),
        ),
        "estimate",
    ),
    Case(ros_of_two_joints, (), "estimate"),
    Case(simulink, (), "estimate"),
    Case(plotjuggler, (), "identify"),
    Case(
        so101,
        (),
        "identify",
        ("--joint", "Rotation", "--end", "4s", "--fix", "link.*", "--fix", "motor.*", "--fix", "drive.a*"),
    ),
]


def edited(rig, edits):
    """Make the edits of a rig, each of one place."""
    assert len(edits) <= MOST_EDITS
    text = rig.read_text(encoding="utf-8")
    for was, new in edits:
        text, count = re.subn(was, new, text)
        assert count == 1, was
    rig.write_text(text, encoding="utf-8")


def drawn(case, log, folder):
    """Return the PDF files of a machine: its stiffness, joint by joint, or the numbers of a rig that has none over time."""
    if case.command == "estimate":
        plotted = vsalog_run("plot", f"{log.stem}.stiffness.parquet", "-o", "stiffness.pdf", "--json", cwd=folder)
        assert plotted.returncode == 0, plotted.stderr
        figures = [folder / one["file"] for one in json.loads(plotted.stdout)["figures"]]
    else:
        figures = sorted((folder / "figures").glob("*.pdf"))
    assert figures
    return figures


def pages(figure):
    """Return how many pages a PDF file of matplotlib's has; it writes their objects as they are."""
    content = figure.read_bytes()
    assert content.startswith(b"%PDF-")
    return len(re.findall(rb"/Type /Page\b", content))


def drive(case, log, folder):
    """Go from a log to numbers and a figure, as its owner would; return the joints that `inspect` found."""
    looked = vsalog_run("inspect", log, "--json", cwd=folder)
    assert looked.returncode == 0, looked.stderr
    made = vsalog_run("init", log, "-o", "my.toml", cwd=folder)
    assert made.returncode == 0, made.stderr
    assert f"'vsalog {case.command} " in made.stderr
    edited(folder / "my.toml", case.edits)
    more = (*case.more, "--figures", "figures") if case.command == "identify" else case.more
    done = vsalog_run(case.command, log, "--rig", "my.toml", *more, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert all(pages(figure) == 1 for figure in drawn(case, log, folder))
    return [joint["name"] for joint in json.loads(looked.stdout)["logs"][0]["joints"]]


def estimated(folder, log):
    """Return the median stiffness of each joint's trace [N·m/rad]."""
    rows = pq.read_table(folder / f"{log.stem}.stiffness.parquet").to_pydict()
    names, excited, stiffness = (np.array(rows[key]) for key in ("joint", "excited", "stiffness"))
    return {name: float(np.median(stiffness[excited & (names == name)])) for name in rows["joint"]}


def identified(folder):
    return tomllib.loads((folder / "identified.rig.toml").read_text(encoding="utf-8"))["joint"]


@pytest.mark.parametrize("case", CASES[:3], ids=lambda case: case.write.__name__)
def test_a_log_with_a_torque_sensor_is_estimated(case, tmp_path):
    log, truth = case.write(tmp_path)
    assert set(drive(case, log, tmp_path)) == set(truth)
    assert estimated(tmp_path, log) == pytest.approx(truth, rel=2e-3)


def test_a_log_with_the_motor_s_torque_alone_is_identified(tmp_path):
    (case,) = (case for case in CASES if case.write is plotjuggler)
    log, truth = case.write(tmp_path)
    assert set(drive(case, log, tmp_path)) == set(truth)
    found = {name: float(joint["transmission"]["stiffness"].split()[0]) for name, joint in identified(tmp_path).items()}
    assert found == pytest.approx(truth, rel=0.02)


def test_real_servos_have_their_drive_identified(tmp_path):
    (case,) = (case for case in CASES if case.write is so101)
    log, _ = case.write(tmp_path)
    assert drive(case, log, tmp_path) == ["Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw"]
    before = tomllib.loads((tmp_path / "my.toml").read_text(encoding="utf-8"))["joint"]["Rotation"]["drive"]
    after = identified(tmp_path)["Rotation"]["drive"]
    assert after["kind"] == before["kind"] == "position-servo"
    assert after["kp"] != before["kp"]
