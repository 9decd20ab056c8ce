"""Joint accelerations out of an arm's accelerometers, and acceleration-observer as a user runs it (De Luca 2007 eq. 8–12)."""

import json
from dataclasses import replace as with_fields

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from vsalog.core.errors import EstimatorError
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.estimators.acceleration_group import group_of
from vsalog.estimators.device import device_of
from vsalog.filters.acceleration_arm import Arm, arm_start, axis_rows, observe_arm
from vsalog.filters.acceleration_observer import ElasticMotor, characteristic, observer_gains, sampled_observer
from vsalog.mechanics.kinematics import chain_motion, rotation_of, specific_force
from vsalog.rig import Rig
from vsalog.rig.schema import Accelerometer, Chain, ChainLink
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate
from vsalog.writers.recording_mcap import write_mcap

STATES = ("link_position", "link_velocity", "motor_position", "motor_velocity", "deflection", "flexibility_torque")
MOTOR = ElasticMotor(B=40.0, K=2e5, D=300.0, D_theta=0.0)


def arm_of(chain, noise=0.01, reach=0.05, period=1e-3):
    """All axes of all accelerometers of a chain, each joint with the same observer."""
    count, axes = len(chain.link), []
    for k, link in enumerate(chain.link):
        if link.accelerometer is not None:
            turn = rotation_of(link.accelerometer.orientation)
            axes += [(k, link.accelerometer.position, turn[:, i]) for i in range(3)]
    place, point, axis = (np.array(part) for part in zip(*axes, strict=True))
    observer = sampled_observer(MOTOR, observer_gains(MOTOR, characteristic(200.0, 1.0)), period)
    parts = [np.stack([part] * count) for part in observer]
    links = [(k.length, k.offset, np.cos(k.twist), np.sin(k.twist), k.angle) for k in chain.link]
    return Arm(
        np.array(links), np.array(chain.gravity), place, np.zeros_like(place), point, axis, np.full(len(axes), noise),
        *parts, np.full(count, MOTOR.K), np.full(count, np.inf), np.zeros((count, count)), reach, noise, period,
    )  # fmt: skip


angles, lengths = st.floats(-3.0, 3.0), st.floats(-1.0, 1.0)
threes = st.tuples(lengths, lengths, lengths)
mountings = st.builds(Accelerometer, position=threes, orientation=threes)
some_links = st.lists(
    st.builds(
        ChainLink,
        joint=st.just("j"),
        length=lengths,
        offset=lengths,
        twist=angles,
        angle=angles,
        accelerometer=mountings,
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=30)
@given(some_links, threes, st.integers(0, 2**32 - 1))
def test_rows_are_what_the_kinematics_say(links, gravity, seed):
    """T q̈ + W is the specific force by recursion over the whole motion, on any chain."""
    chain = Chain(gravity=gravity, link=tuple(links))
    q, dq, ddq = np.random.default_rng(seed).normal(size=(3, len(links))) * 3.0
    T, W = axis_rows(arm_of(chain), q, dq)
    motion = chain_motion(chain, q, dq, ddq)
    expected = [specific_force(m, link.accelerometer, gravity) for m, link in zip(motion, links, strict=True)]
    np.testing.assert_allclose(
        T @ ddq + W, np.concatenate(expected), rtol=1e-9, atol=1e-9 * (1 + np.abs(T @ ddq).max())
    )


# A post that turns about the vertical with a beam on it, which nods; the accelerometer sits on the beam.
POST = (
    ChainLink(joint="a", offset=0.5, twist=-np.pi / 2),
    ChainLink(joint="b", length=0.6, accelerometer=Accelerometer(position=(0.0, 0.0, 0.0))),
)


def shaken(chain, q, seconds=0.4):
    """Rigid joints that swing a little about a position: motors move with the links, their torque is B θ̈."""
    time = np.arange(0.0, seconds, 1e-3)
    shape, rate = np.array([[0.05, 0.03]]), np.array([[9.0, 14.0]])
    motion = [q + shape * (1 - np.cos(rate * time[:, None])), shape * rate * np.sin(rate * time[:, None])]
    motion.append(shape * rate**2 * np.cos(rate * time[:, None]))
    felt = chain_motion(chain, *motion)
    y = np.concatenate(
        [
            specific_force(m, k.accelerometer, chain.gravity)
            for m, k in zip(felt, chain.link, strict=True)
            if k.accelerometer
        ],
        axis=-1,
    )
    return motion, y


def test_above_an_axis_the_accelerometer_sees_nothing_of_that_joint_and_all_of_the_other():
    chain = Chain(link=POST)
    arm = arm_of(chain)
    for nod, blind in ((0.0, False), (-np.pi / 2 + 0.02, True)):
        (q, _, ddq), y = shaken(chain, np.array([0.3, nod]), 0.1)
        # The beam stands up, a few degrees off the vertical at most: its end is above the first axis.
        x, found, deviation, since, _ = observe_arm(arm, arm_start(2), q, np.zeros_like(q), y)
        reach = 0.6 * np.abs(np.cos(q[:, 1]))
        np.testing.assert_allclose(0.01 / deviation[:, 0], reach, atol=2e-3)
        np.testing.assert_allclose(0.01 / deviation[:, 1], 0.6, rtol=1e-3)
        assert ((since[:, 0] < 0) == (0.01 / deviation[:, 0] < 0.05)).all()
        assert (since[:, 0] < 0).any() == blind
        assert (since[:, 1] == np.arange(len(q))).all()
        assert np.isfinite(x).all()
        np.testing.assert_allclose(found[50:, 1], ddq[50:, 1], atol=0.05 * np.abs(ddq[:, 1]).max())


def test_straight_above_the_axis_nothing_breaks():
    chain = Chain(link=(POST[0], replace(POST[1], length=0.0)))
    (q, _, _), y = shaken(chain, np.zeros(2), 0.05)
    x, found, deviation, since, _ = observe_arm(arm_of(chain), arm_start(2), q, np.zeros_like(q), y)
    assert np.isfinite(x).all()
    assert np.isfinite(found).all()
    assert (since == -1).all()
    assert (deviation > 1.0).all()


def test_what_is_missing_is_bridged_and_said():
    post = replace(POST[0], accelerometer=Accelerometer(position=(0.3, 0.1, 0.0)))
    chain = Chain(link=(post, POST[1]))
    arm = arm_of(chain)
    (q, _, _), y = shaken(chain, np.zeros(2))
    tau = np.zeros_like(q)
    whole = observe_arm(arm, arm_start(2), q, tau, y)
    lossy, theta, torque = y.copy(), q.copy(), tau.copy()
    lossy[100:110, 3:] = np.nan  # of the beam's accelerometer: the post's goes on alone
    theta[:3], theta[200, 1], torque[300, 0] = np.nan, np.nan, np.nan
    x, _, deviation, since, _ = observe_arm(arm, arm_start(2), theta, torque, lossy)
    assert np.isnan(x[:3]).all()
    assert since[3].tolist() == [0, 0]
    assert (deviation[100:110, 0] > 1.2 * whole[2][100:110, 0]).all()
    assert (since[100:110, 0] >= 0).all()  # the post's own accelerometer tells its joint
    assert (since[100:110, 1] == -1).all()  # and nothing of the beam's
    assert (since[200, 1], since[201, 1], since[300, 0]) == (-1, 0, -1)
    assert np.isfinite(x[3:]).all()
    np.testing.assert_allclose(x[-1], whole[0][-1], atol=2e-3)


@pytest.fixture(scope="module")
def rig():
    return Rig.preset("kuka-kr15").file


@pytest.fixture(scope="module")
def played(rig):
    """The arm through the first 3 s of its scenario, under the preset's noise."""
    scenario = Scenario.find("kuka-kr15-exp1", rig)
    return simulate(rig, scenario.inputs(rig), 3.0, seed=3)


def estimated(played, rig, name, recording=None, **tune):
    joint = rig.joint[name]
    choice = choose(name, joint, "auto", {k: str(v) for k, v in tune.items()}, rig)
    return estimate_joint([recording or played.recording()], name, joint, choice, rig=rig)


@pytest.fixture(scope="module")
def first(played, rig):
    return estimated(played, rig, "axis1")


@pytest.fixture(scope="module")
def third(played, rig):
    return estimated(played, rig, "axis3")


@pytest.mark.parametrize("name", ["first", "third"])
def test_the_state_is_found_within_what_is_reported_of_it(played, name, request):
    found = request.getfixturevalue(name)
    assert found.estimator == "acceleration-observer"
    assert 200.0 < found.settings["frequency"] <= 250.0
    truth, columns, settled = played.joints[found.joint].truth, found.trace["total"], slice(300, None)
    for state in STATES:
        off = (columns[state] - truth[state])[settled]
        ratio = float(np.sqrt(np.mean((off / columns[f"{state}_std"][settled]) ** 2)))
        assert 0.75 < ratio < 1.25, state
        assert np.abs(off).max() < 6.0 * columns[f"{state}_std"][settled].max(), state
    torque = (columns["flexibility_torque"] - truth["flexibility_torque"])[settled]
    assert np.std(torque) < 0.03 * np.std(truth["flexibility_torque"])
    off = (columns["link_acceleration"] - truth["link_acceleration"])[settled] / columns["link_acceleration_std"][
        settled
    ]
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.2
    # The rig's stiffness is reported, and not claimed to have been found.
    assert not columns["excited"].any()
    assert np.isnan(columns["stiffness_std"]).all()
    assert (columns["stiffness"] == (2e5 if found.joint == "axis1" else 1.5e5)).all()


FAULTS = {
    "upside down": (lambda x, y: (-x, -y), -1.0),
    "in g": (lambda x, y: (x / 9.80665, y / 9.80665), 1.0 / 9.80665),
    "turned by a right angle": (lambda x, y: (y, x), None),
}


def accelerometer_findings(found):
    return [finding for finding in found.findings if finding.code.startswith("accelerometer.")]


@pytest.mark.parametrize("fault", FAULTS)
def test_an_accelerometer_that_measures_something_else_is_reported(played, rig, fault):
    changed, factor = FAULTS[fault]
    recording = played.recording()
    x, y = (recording.channels[f"/accelerometer_axis2/{axis}.data"] for axis in "xy")
    x.values[:], y.values[:] = changed(x.values.copy(), y.values.copy())
    for name, role in (("axis1", "axis2/accelerometer_x"), ("axis2", "accelerometer_x")):
        found = accelerometer_findings(estimated(played, rig, name, recording))
        assert (found[0].joint, found[0].part) == (name, role)
        assert found[0].code == ("accelerometer.off" if factor is None else "accelerometer.scale")
        assert factor is None or found[0].evidence["factor"] == pytest.approx(factor, rel=0.02)
        assert not any("axis3" in finding.part for finding in found)


def test_accelerometers_that_are_as_the_rig_says_are_not_accused(first, third):
    for found in (first, third):
        assert accelerometer_findings(found) == []


def test_steps_that_are_taken_slowly_are_not_taken_for_white_noise(rig):
    """1000 steps per turn of the joint: by their variance alone the band held the positions 60 % of the time."""
    coarse = {
        name: replace(
            joint,
            signals=replace(
                joint.signals, motor_position=replace(joint.signals.motor_position, resolution=2 * np.pi / 1000)
            ),
        )
        for name, joint in rig.joint.items()
    }
    stepped = replace(rig, joint=coarse)
    played = simulate(stepped, Scenario.find("kuka-kr15-exp1", stepped).inputs(stepped), 3.0, seed=3)
    found = estimated(played, stepped, "axis1").trace["total"]
    truth, settled = played.joints["axis1"].truth, slice(500, None)
    for state in ("link_position", "motor_position", "link_velocity", "motor_velocity"):
        off = np.abs(found[state] - truth[state])[settled]
        held = np.mean(off < 1.96 * found[f"{state}_std"][settled])
        assert held > 0.85, state


def test_masses_of_the_links_play_no_part(played, rig, third):
    links = tuple(
        replace(k, mass=9.0 * k.mass, centre=(1.0, 2.0, 3.0), inertia=(7.0, 8.0, 9.0)) for k in rig.chain.link
    )
    heavy = replace(rig, chain=replace(rig.chain, link=links))
    other = estimated(played, heavy, "axis3").trace["total"]
    for column, values in third.trace["total"].items():
        np.testing.assert_array_equal(other[column], values, err_msg=column)


def test_blocks_of_any_size_give_the_same_bits(played, rig, third):
    joint = rig.joint["axis3"]
    cut = estimate_joint(
        [played.recording()], "axis3", joint, choose("axis3", joint, "auto", {}, rig), rig=rig, block=997
    )
    for column, values in third.trace["total"].items():
        np.testing.assert_array_equal(cut.trace["total"][column], values, err_msg=column)


def test_the_coupling_between_motor_and_link_is_accounted_for(played, rig, third):
    """Eq. 7: with a larger S in the rig than the arm has, axis 3 is found wrong; with none, axis 1 is as before."""

    def torque_error(found):
        true = played.joints["axis3"].truth["flexibility_torque"]
        return np.sqrt(np.mean((found.trace["total"]["flexibility_torque"] - true)[300:] ** 2))

    coupling = tuple(replace(c, inertia=40.0 * c.inertia) for c in rig.chain.coupling)
    wrong = estimated(played, replace(rig, chain=replace(rig.chain, coupling=coupling)), "axis3")
    assert torque_error(wrong) > 5.0 * torque_error(third)


def lone_tip(rig):
    """The arm as in the paper: one accelerometer, on the third link."""
    joints = {
        name: joint if name == "axis3" else replace(joint, signals=replace(joint.signals, accelerometer_x=None,
        accelerometer_y=None, accelerometer_z=None)) for name, joint in rig.joint.items()
    }  # fmt: skip
    return replace(rig, joint=joints)


def test_one_accelerometer_on_the_third_link_is_enough_for_the_first(played, rig):
    alone = lone_tip(rig)
    found = estimated(played, alone, "axis1")
    assert found.estimator == "acceleration-observer"
    columns, truth = found.trace["total"], played.joints["axis1"].truth
    ratio = (columns["link_position"] - truth["link_position"])[300:] / columns["link_position_std"][300:]
    assert 0.7 < np.sqrt(np.mean(ratio**2)) < 1.3


def test_near_a_singular_configuration_nothing_is_reported(played, rig):
    """Of a joint whose arm is shorter than the reach asked for, all is null but how little is known of its acceleration."""

    def arm(found):
        return found.settings["noise_acceleration"] / found.trace["total"]["link_acceleration_std"]

    reach = np.median(arm(estimated(played, lone_tip(rig), "axis1")))
    found = estimated(played, lone_tip(rig), "axis1", reach=reach)
    columns, masked = found.trace["total"], arm(found) < reach
    assert 0.3 < masked.mean() < 0.7
    for state in STATES:
        assert (np.isnan(columns[state]) == masked).all()
        assert (np.isnan(columns[f"{state}_std"]) == masked).all()
    again = np.flatnonzero(np.diff(masked.astype(int)) == -1) + 1
    if again.size:  # told again, at first with the deviation of a start
        assert columns["link_velocity_std"][again[0]] > 10.0 * np.nanmin(columns["link_velocity_std"])
    assert "acceleration.masked" in [finding.code for finding in found.findings]


def test_after_a_gap_it_begins_again_and_says_how_little_it_knows(played, rig):
    """A gap in the signals of a neighbour: the joint moves when the observer begins again, within what is reported of it."""
    recording = played.recording()
    (name,) = [n for n in recording.channels if "axis2/x" in n]
    channel, kept = recording.channels[name], np.r_[0:1000, 1200:3001]
    cut = with_fields(channel, stamps=channel.stamps[kept], values=channel.values[kept])
    lossy = with_fields(recording, channels={**recording.channels, name: cut})
    found = estimated(played, rig, "axis1", lossy)
    assert ("recording.gaps", 1.0) in [(f.code, f.value) for f in found.findings]
    columns, at = found.trace["total"], np.round(found.trace.time * 1000).astype(int)
    assert len(at) == kept.size
    for state in STATES[:4]:
        off = np.abs(columns[state] - played.joints["axis1"].truth[state][at])
        assert (off / columns[f"{state}_std"]).max() < 6.0, state
    assert columns["link_velocity_std"][1000] > 100.0 * columns["link_velocity_std"][999]
    assert columns["link_velocity_std"][1200] < 1.1 * columns["link_velocity_std"][999]


def test_an_observer_cannot_be_faster_than_the_samples(played, rig):
    with pytest.raises(EstimatorError, match="at most 2000"):
        estimated(played, rig, "axis1", frequency=2500)


def test_what_cannot_be_is_refused(rig):
    def refusal(rig, name="axis2", match="", **tune):
        with pytest.raises(EstimatorError, match=match):
            choose(name, rig.joint[name], "acceleration-observer", {k: str(v) for k, v in tune.items()}, rig)

    def with_joint(rig, name, **parts):
        return replace(rig, joint={**rig.joint, name: replace(rig.joint[name], **parts)})

    two = rig.joint["axis2"]
    refusal(with_joint(rig, "axis2", motor=replace(two.motor, inertia=None)), match="motor's inertia")
    cubic = Rig.preset("kuka-kr15").with_setting("joint.axis2.transmission.added_cubic", "5 N*m/rad^3").file
    refusal(cubic, match=r"joint 'axis2'.*is linear")
    refusal(cubic, "axis1", match=r"joint 'axis2'.*is linear")  # for axis 1 is looked at with axis 2
    refusal(with_joint(rig, "axis2", signals=replace(two.signals, motor_torque=None)), match="motor_torque")
    nowhere = tuple(replace(k, accelerometer=None) for k in rig.chain.link)
    refusal(replace(rig, chain=replace(rig.chain, link=nowhere)), match="its place is not stated")
    refusal(replace(rig, chain=None), match=r"with its place in a \[\[chain.link\]\]")
    two_axes = lone_tip(rig)
    tip = replace(two_axes.joint["axis3"].signals, accelerometer_x=None)
    refusal(
        with_joint(two_axes, "axis3", signals=tip),
        match="2 measured accelerations for the 3 joints axis1, axis2, axis3",
    )
    rubbing = Rig.preset("kuka-kr15").with_setting("joint.axis2.motor.friction.load", "0.1").file
    refusal(rubbing, match="friction.load")
    refusal(rig, match="'window' is of a filter", window=0.1)
    refusal(rig, match="reach", reach=0)
    vsa2 = Rig.preset("vsa2").file
    (name,) = vsa2.joint
    refusal(vsa2, name, match="needs the link's acceleration")
    pam = Rig.preset("pam").file
    refusal(pam, "pam", match="is for springs")


def test_auto_takes_it_only_where_nothing_tells_a_stiffness(rig):
    joint = rig.joint["axis1"]
    watched = replace(joint, signals=replace(joint.signals, link_position="/q.data"))
    assert choose("axis1", joint, "auto", {}, rig).name == "acceleration-observer"
    assert choose("axis1", watched, "auto", {}, rig).name == "smoother"
    deaf = replace(joint, signals=replace(joint.signals, motor_torque=None))
    with pytest.raises(EstimatorError, match="motor_torque"):
        choose("axis1", deaf, "auto", {}, replace(rig, joint={**rig.joint, "axis1": deaf}))


def test_a_measured_link_acceleration_asks_for_no_other_joint(rig):
    """But for those whose links carry the joint's motor."""
    joints = {n: replace(j, signals=replace(j.signals, link_acceleration=f"/{n}.data")) for n, j in rig.joint.items()}
    direct = replace(rig, joint=joints)

    def members(name):
        return [
            m.joint
            for m in group_of(
                device_of(name, joints[name], rig=direct), ("link_acceleration", "motor_position", "motor_torque")
            ).members
        ]

    assert members("axis1") == ["axis1"]
    assert members("axis3") == ["axis2", "axis3"]


SEA = """
preset = "sea"
[joint.sea.transmission]
type = "linear"
stiffness = "40 N*m/rad"
[joint.sea.motor.friction]
coulomb = "0.05 N*m"
[joint.sea.signals.link_acceleration]
channel = "/acceleration.data"
noise = "0.05 rad/s^2"
"""


def test_the_command_on_a_joint_alone_with_friction(tmp_path):
    """Eq. 6 with q̈ measured, from the command line: the file has the states, the friction of the rig is taken off."""
    bench = Rig.from_toml(SEA).file
    scenario = Scenario.find("sea-exp1", bench)
    played = simulate(bench, scenario.inputs(bench), 3.0, seed=1)
    write_mcap(played.recording(), tmp_path / "sea.mcap", Rig.from_toml(SEA).to_toml())
    command = ("estimate", "sea.mcap", "-e", "acceleration-observer", "--json", "--tune", "torque=linear")
    done = vsalog_run(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (joint,) = json.loads(done.stdout)["joints"]
    assert joint["settings"]["frequency"] > 10.0
    table = pq.read_table(tmp_path / "sea.stiffness.parquet")
    assert table.schema.field("link_velocity").metadata[b"unit"] == b"rad/s"
    columns = table.to_pandas()
    truth = played.joints["sea"].truth
    for state in ("link_position", "link_velocity", "motor_velocity", "flexibility_torque"):
        off = (columns[state].to_numpy() - truth[state])[300:]
        assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(truth[state]), state
