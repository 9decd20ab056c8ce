"""`vsalog simulate` as a user runs it: every preset and scenario, every format, and what is refused."""

import re

import numpy as np
import pytest

from vsalog.binding.joint import bind
from vsalog.readers import open_reader, read
from vsalog.rig import Rig, presets
from vsalog.rig.find import find_rig
from vsalog.rig.load import preset_text
from vsalog.simulation.scenario import built_in
from vsalog.simulation.scenario_generic import GENERIC

pytestmark = pytest.mark.share(3)

OUTPUTS = ["a.mcap", "a.bag", "a.csv", "a.parquet", "a/"]
ELASTIC = """
name = "bench"
[joint.elbow]
kind = "elastic"
[joint.elbow.motor]
inertia = 0.01
damping = 0.05
[joint.elbow.transmission]
type = "linear"
stiffness = 5
[joint.elbow.link]
inertia = 0.02
gravity_torque = 1
"""


@pytest.fixture
def bench(tmp_path):
    (tmp_path / "rig.toml").write_text(ELASTIC)
    return tmp_path


def bound(log, name, joint):
    roles = [role for role in joint.signals.__struct_fields__ if getattr(joint.signals, role) is not None]
    return bind([log], name, joint, roles)


def carried_rig(log):
    return find_rig(log, open_reader(log).rig_text)


def test_a_preset_needs_nothing_but_its_name(run, tmp_path):
    process = run("simulate", "vsa2", "--duration", "0.2", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stdout == ""
    assert "vsa2-exp1.mcap: 0.2 s at 1000 Hz" in process.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["vsa2-exp1.mcap"]
    log = read(tmp_path / "vsa2-exp1.mcap")
    assert "/joint_states.position[motor_1]" in log.channels


def test_what_was_written_as_json(done, tmp_path):
    document = done("sea", "--duration", "100 ms", "--rate", "250", "--seed", "4", "--json", cwd=tmp_path)
    assert (document["log"], document["format"], document["rig_file"]) == ("sea-exp1.mcap", "mcap", None)
    assert (document["scenario"], document["duration"], document["rate"]) == ("sea-exp1", 0.1, 250.0)
    assert (document["samples"], document["seed"], document["joints"]) == (26, 4, ["sea"])
    log = read(tmp_path / "sea-exp1.mcap")
    for channel in document["channels"]:
        assert log.channels[channel["name"]].values.size == channel["samples"]


def test_a_page_shows_the_channels_over_time(done, simulate, tmp_path):
    done("sea", "--duration", "1", "-o", "log.mcap", "--report", "page.html", cwd=tmp_path)
    page = (tmp_path / "page.html").read_text()
    assert page.count('class="plot"') == 1
    assert "/joint_torque.effort[transmission]" in page
    code, _, err = simulate("sea", "-o", "other.mcap", "--report", "page.html", cwd=tmp_path)
    assert (code, "--force" in err) == (2, True)
    assert not (tmp_path / "other.mcap").exists()


def test_the_list(done, tmp_path):
    text = done("--list", cwd=tmp_path)
    for name in [*presets(), *built_in(), *GENERIC]:
        assert re.search(rf"^ *{name} ", text, re.MULTILINE), name


@pytest.mark.parametrize("output", OUTPUTS)
def test_every_format_carries_the_same_numbers_and_the_rig(output, done, tmp_path):
    """The rig found is the one that was simulated; the numbers are those of the first format, bit for bit."""
    done("vsa2", "--duration", "0.3", "--seed", "3", "--truth", "-o", "reference.mcap", cwd=tmp_path)
    document = done("vsa2", "--duration", "0.3", "--seed", "3", "--truth", "-o", output, "--json", cwd=tmp_path)
    reference, found = read(tmp_path / "reference.mcap"), read(tmp_path / output)
    # A JointState has no room for a motor without a torque: other formats lack such columns of NaN.
    for name in (channel["name"] for channel in document["channels"]):
        channel = reference.channels[name]
        assert found.channels[name].values.tobytes() == channel.values.tobytes(), name
        np.testing.assert_array_equal(found.channels[name].stamps, channel.stamps)
    if document["format"] in ("csv", "parquet"):
        assert found.channels["/joint_states.effort[motor_1]"].unit == "N*m"
    assert carried_rig(tmp_path / output).file == Rig.preset("vsa2").file
    assert (document["rig_file"] is not None) == (tmp_path / "a.rig.toml").exists()


@pytest.mark.parametrize("output", OUTPUTS)
def test_one_seed_makes_one_log_and_another_seed_another(output, done, tmp_path):
    contents = []
    for folder, seed in (("one", 5), ("two", 5), ("three", 6)):
        (tmp_path / folder).mkdir()
        done("rig.toml", "--duration", "0.2", "--seed", seed, "-o", output, cwd=noisy(tmp_path / folder))
        files = [p for p in (tmp_path / folder).rglob("*") if p.is_file()]
        contents.append({str(p.relative_to(tmp_path / folder)): p.read_bytes() for p in files})
    assert contents[0] == contents[1]
    assert contents[0] != contents[2]


def noisy(folder):
    signals = '[joint.elbow.signals]\nlink_position = {channel = "/q.data", noise = 1e-4}\n'
    (folder / "rig.toml").write_text(ELASTIC + signals)
    return folder


def test_an_ideal_log_has_no_noise(done, tmp_path):
    noisy(tmp_path)
    for seed in (1, 2):
        done("rig.toml", "--duration", "0.2", "--ideal", "--seed", seed, "-o", f"{seed}.csv", cwd=tmp_path)
    assert (tmp_path / "1.csv").read_bytes() == (tmp_path / "2.csv").read_bytes()


@pytest.mark.every(2)
@pytest.mark.parametrize("preset", presets())
def test_every_preset_plays_every_scenario_for_it(preset, done, tmp_path):
    mine = [name for name in built_in() if re.fullmatch(rf"{preset}-exp\d", name)]
    for name in [*mine, *GENERIC]:
        options = ("--scenario", name, "--duration", "2.5", "--rate", "250", "--truth", "-o", "a.parquet", "--json")
        document = done(preset, *options, cwd=tmp_path)
        log, rig = read(tmp_path / "a.parquet"), carried_rig(tmp_path / "a.parquet")
        recorded = {channel["name"]: log.channels[channel["name"]].values for channel in document["channels"]}
        assert all(np.isfinite(values).all() for values in recorded.values()), name
        driven = [v for n, v in recorded.items() if "/truth" in n and ("motor_torque" in n or "valve" in n)]
        assert any(np.abs(values).max() > 0.0 for values in driven), name
        moved = [v for n, v in recorded.items() if "/truth" in n and n.endswith("link_position.data")]
        assert len(moved) == len(rig.joints)
        assert all(np.ptp(values) > 1e-4 for values in moved), name
        for joint_name, joint in rig.joints.items():
            assert bound(log, joint_name, joint).period == pytest.approx(1.0 / document["rate"], rel=1e-3)


def test_a_rig_without_channels_gets_them_in_its_log(done, bench):
    document = done("rig.toml", "--duration", "0.2", "--json", cwd=bench)
    assert document["scenario"] == "sines"
    rig = carried_rig(bench / document["log"])
    log = read(bench / document["log"])
    signals = bound(log, "elbow", rig.joints["elbow"])
    assert {"motor_position", "link_position", "motor_torque", "torque_sensor"} <= set(signals.roles)


def test_a_log_carries_its_rig_as_it_was_written(done, tmp_path):
    (tmp_path / "mine.toml").write_text(
        "# of my own\n" + ELASTIC.lstrip() + '[joint.elbow.signals]\nlink_position = "/q.data"\n'
    )
    done("mine.toml", "--duration", "0.1", "-o", "a.mcap", cwd=tmp_path)
    assert read(tmp_path / "a.mcap").rig_text == (tmp_path / "mine.toml").read_text()
    done("vsa2", "--duration", "0.1", "-o", "a.mcap", cwd=tmp_path)
    assert read(tmp_path / "a.mcap").rig_text == preset_text("vsa2")
    # A preset may change from version to version: what a file takes from one is written out.
    (tmp_path / "mine.toml").write_text('preset = "vsa2"\nname = "mine"\n')
    done("mine.toml", "--duration", "0.1", "-o", "a.mcap", cwd=tmp_path)
    assert "preset" not in read(tmp_path / "a.mcap").rig_text
    assert carried_rig(tmp_path / "a.mcap").joints == Rig.preset("vsa2").joints


def test_joints_without_channels_do_not_share_any(done, tmp_path):
    names = ["elbow", "el bow", "el[bow]"]
    rig = "".join(ELASTIC.replace('name = "bench"', "").replace("joint.elbow", f'joint."{name}"') for name in names)
    (tmp_path / "rig.toml").write_text(rig)
    done("rig.toml", "--duration", "0.1", "-o", "a.mcap", cwd=tmp_path)
    log, carried = read(tmp_path / "a.mcap"), carried_rig(tmp_path / "a.mcap")
    torques = {name: bound(log, name, joint).roles["motor_torque"] for name, joint in carried.joints.items()}
    assert list(torques) == names
    assert len({torque.tobytes() for torque in torques.values()}) == len(names)
    for output in ("b.mcap", "b.csv"):
        done("rig.toml", "--duration", "0.1", "--truth", "-o", output, cwd=tmp_path)
        truth = [name for name in read(tmp_path / output).channels if name.endswith("/link_position.data")]
        assert len(truth) == len(names), truth


@pytest.mark.parametrize("output", OUTPUTS)
def test_names_that_no_topic_can_have_are_found_again(output, done, tmp_path):
    """Messages have no place for some names: the log's rig then says what the channel is called there."""
    names = {"motor_position": "motor position", "link_position": "/a.b.c", "motor_torque": "/raw.x[3]"}
    signals = "".join(f'{role} = "{name}"\n' for role, name in names.items())
    (tmp_path / "rig.toml").write_text(f"{ELASTIC}[joint.elbow.signals]\n{signals}")
    document = done("rig.toml", "--duration", "0.1", "-o", output, "--json", cwd=tmp_path)
    log, rig = read(tmp_path / output), carried_rig(tmp_path / output)
    assert {channel["name"] for channel in document["channels"]} == set(log.channels)
    assert set(bound(log, "elbow", rig.joints["elbow"]).roles) == set(names)


def test_a_setting_is_in_the_log_and_an_actual_value_is_not(done, bench):
    key = "joint.elbow.motor.friction.coulomb"
    for option, output in (("--set", "told.mcap"), ("--actual", "hidden.mcap")):
        done("rig.toml", option, f"{key}=200 N·mm", "--duration", "2", "--truth", "-o", output, cwd=bench)
    done("rig.toml", "--duration", "2", "--truth", "-o", "plain.mcap", cwd=bench)
    told, hidden, plain = (carried_rig(bench / f"{n}.mcap") for n in ("told", "hidden", "plain"))
    assert told.joints["elbow"].motor.friction.coulomb == pytest.approx(0.2)
    assert hidden.file == plain.file
    moved = {
        n: read(bench / f"{n}.mcap").channels["/truth/motor_position.data"].values for n in ("told", "hidden", "plain")
    }
    assert np.array_equal(moved["told"], moved["hidden"])
    assert not np.allclose(moved["told"], moved["plain"])


def test_settings_that_need_each_other_come_in_any_order(done, bench):
    friction = "joint.elbow.motor.friction"
    settings = [f"{friction}.static=20 N·mm", f"{friction}.coulomb=10 N·mm", f"{friction}.stribeck_velocity=0.1"]
    for order in (settings, settings[::-1]):
        for option in ("--set", "--actual"):
            options = [word for setting in order for word in (option, setting)]
            done("rig.toml", *options, "--duration", "0.1", "-o", "a.mcap", cwd=bench)


def test_the_truth_is_recorded_only_when_asked_for(done, bench):
    for option in ((), ("--truth",)):
        done("rig.toml", *option, "--duration", "0.1", "-o", "a.mcap", cwd=bench)
        truth = [name for name in read(bench / "a.mcap").channels if name.startswith("/truth/")]
        assert bool(truth) == bool(option)
    assert "/truth/stiffness.data" in truth
    np.testing.assert_allclose(read(bench / "a.mcap").channels["/truth/stiffness.data"].values, 5.0)


def test_a_scenario_of_ones_own_with_a_table_next_to_it(done, bench):
    (bench / "runs").mkdir()
    (bench / "runs" / "tau.csv").write_text("time [s],tau [N·mm]\n0,0\n0.1,300\n0.2,300\n0.4,-300\n")
    (bench / "runs" / "mine.toml").write_text(
        'duration = "0.4 s"\n[[joint.elbow.motor_torque]]\ntype = "csv"\nfile = "tau.csv"\ncolumn = "tau"\n'
    )
    document = done("rig.toml", "--scenario", "runs/mine.toml", "--ideal", "--json", cwd=bench)
    assert document["log"] == "rig-mine.mcap"
    log = read(bench / "rig-mine.mcap")
    torque = bound(log, "elbow", carried_rig(bench / "rig-mine.mcap").joints["elbow"]).roles["motor_torque"]
    at = np.arange(401) * 1e-3
    np.testing.assert_allclose(torque, np.interp(at, [0, 0.1, 0.2, 0.4], [0, 0.3, 0.3, -0.3]), atol=1e-9)


def test_names_are_never_paths(done, tmp_path):
    """A joint, a rig and a scenario may be called anything; the log is where it was asked for, and nothing else is."""
    inside = tmp_path / "here"
    inside.mkdir()
    name = "../../x/\\u001b[31m'; rm -rf ~; $(id)"
    printable = name.replace("\\u001b", "")
    (inside / "rig.toml").write_text(ELASTIC.replace("joint.elbow", f'joint."{printable}"').replace("bench", name))
    (inside / "s.toml").write_text(f'name = "{name}"\nduration = 0.1\n')
    done("rig.toml", "--truth", "--duration", "0.1", "-o", "a.mcap", cwd=inside)
    document = done("rig.toml", "--scenario", "s.toml", "--json", cwd=inside)
    assert re.fullmatch(r"[\w.-]+\.mcap", document["log"])
    assert sorted(p.name for p in inside.iterdir()) == sorted(["a.mcap", "rig.toml", "s.toml", document["log"]])
    assert [p.name for p in tmp_path.iterdir()] == ["here"]
    assert list(carried_rig(inside / "a.mcap").joints) == [printable]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((), "name a rig file or a preset"),
        (("nowhere.toml",), "there is no rig file 'nowhere.toml'"),
        (("vsa3",), "did you mean 'vsa2'"),
        (("rig.toml", "--scenario", "sinus"), "did you mean 'sines'"),
        (("rig.toml", "--scenario", "vsa2-exp1"), "rig 'bench' has no such joint; it has elbow"),
        (("rig.toml", "--scenario", "rig.toml"), "joint.elbow.kind: there is no such key"),
        (("rig.toml", "--duration", "-1"), "not a time longer than zero"),
        (("rig.toml", "--duration", "0 s"), "not a time longer than zero"),
        (("rig.toml", "--duration", "nan"), "not a time longer than zero"),
        (("rig.toml", "--duration", "3 m"), "'m' is a length"),
        (("rig.toml", "--duration", "soon"), "does not begin with a number"),
        (("rig.toml", "--duration", "1e-6"), "less than two samples"),
        (("rig.toml", "--duration", "1e9"), "take a shorter duration or a lower rate"),
        (("rig.toml", "--duration", "1e300"), "take a shorter duration or a lower rate"),
        (("rig.toml", "--rate", "0"), "rate"),
        (("rig.toml", "--rate", "nan"), "nan Hz cannot be simulated"),
        (("rig.toml", "--rate", "1e9"), "1e+09 Hz cannot be simulated"),
        (("rig.toml", "--seed", "-1"), "seed"),
        (("rig.toml", "--set", "joint.elbow.transmission.stiffness=1e308"), "fastest mode"),
        (("rig.toml", "--set", "joint.elbow.motor.inertia=1e-320"), "fastest mode"),
        (("rig.toml", "--set", "joint.elbow.link.gravity_torque=1e9"), "fastest mode"),
        (("rig.toml", "--scenario", "short.toml"), "1e+13 Hz cannot be simulated"),
        (("rig.toml", "--set", "joint.elbow.motor.inertai=1"), "did you mean 'inertia'"),
        (("rig.toml", "--actual", "joint.elbow.motor.inertai=1"), "--actual: joint.elbow.motor.inertai"),
        (("rig.toml", "--set", "joint.elbow.motor.inertia"), "is not NAME=VALUE"),
        (("rig.toml", "-o", "a.db3"), "no log format has the suffix '.db3'"),
        (("rig.toml", "-o", ".mcap"), "is a suffix without a name"),
        (("rig.toml", "-o", "no/a.mcap"), "the folder no does not exist"),
        (("rig.toml", "-o", "no/a/"), "the folder no does not exist"),
        (("rig.toml", "-o", "there/"), "exists already"),
        (("rig.toml", "-o", "/dev/null"), "dev/null"),
        (("lame.toml",), "inertia"),
        (("there.rig.toml", "-o", "there.csv"), "choose another name"),
        (("rig.toml", "--scenario", "own.csv.toml", "-o", "own.csv"), "is read by the simulation"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(args, words, simulate, bench):
    (bench / "there").mkdir()
    (bench / "there.rig.toml").write_text(ELASTIC)
    (bench / "lame.toml").write_text(ELASTIC.replace("inertia = 0.01", ""))
    (bench / "short.toml").write_text("duration = 1e-12\nperiod = 1e-13\n")
    (bench / "own.csv").write_text("time [s],tau\n0,0\n1,1\n")
    (bench / "own.csv.toml").write_text(
        '[[joint.elbow.motor_torque]]\ntype = "csv"\nfile = "own.csv"\ncolumn = "tau"\n'
    )
    before = {p: p.read_bytes() for p in bench.iterdir() if p.is_file()}
    code, out, err = simulate(*args, cwd=bench)
    assert (code, out) == (2, "")
    assert words in err
    assert {p: p.read_bytes() for p in bench.iterdir() if p.is_file()} == before


def test_a_scenario_that_breaks_the_machine_leaves_nothing(refused, tmp_path):
    (tmp_path / "s.toml").write_text(
        'duration = "2 s"\n[[joint.vsa2.motor_torque_1]]\ntype = "constant"\nvalue = "50 N·m"\n'
    )
    assert "singularity" in refused("simulate", "vsa2", "--scenario", "s.toml", "-o", "a.csv", cwd=tmp_path)
