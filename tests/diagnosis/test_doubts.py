"""What a diagnosis refuses, doubts, or hints at: logs that tell nothing, signs and units, chains, channels that are not there."""

import numpy as np
import pytest
from written_out import ELASTIC, ROLES, Truth, joint_of, log, write_csv

from vsalog.cli import _run
from vsalog.core.errors import DiagnosisError
from vsalog.diagnosis.run import Options, diagnose
from vsalog.report.diagnosis_sentences import worded

pytestmark = pytest.mark.share(7)

CHAIN = """
[chain]
[[chain.link]]
joint = "arm"
length = 0.3
mass = 1.0
centre = [-0.15, 0.0, 0.0]
inertia = [0.01, 0.01, 0.01]
"""


def lay(folder, truth=None, change=None, rig=ELASTIC, name="log", seed=0, duration=6.0, rows=slice(None)):
    """Write a log, changed by a function of its samples, and its rig; return the log's path."""
    time, said = log(truth or Truth(), duration=duration, seed=seed, roles=ROLES)
    said = {role: values.copy() for role, values in said.items()}
    if change is not None:
        change(said)
    path = folder / f"{name}.csv"
    write_csv(path, time[rows], {role: values[rows] for role, values in said.items()})
    (folder / f"{name}.rig.toml").write_text(rig, encoding="utf-8")
    return path


def scaled(*roles, by):
    def change(said):
        for role in roles:
            said[role] *= by

    return change


def exchanged(one, other):
    def change(said):
        said[one], said[other] = said[other], said[one]

    return change


TURNED = {
    "sign": ("rig.sign", "torque_sensor", scaled("torque_sensor", by=-1.0)),
    "sign of a torque that acts": ("rig.sign", "motor_torque", scaled("motor_torque", by=-1.0)),
    "degrees": ("rig.unit", "all positions", scaled("motor_position", "link_position", by=180.0 / np.pi)),
    "positions": (
        "rig.exchanged",
        "link_position and motor_position",
        exchanged("link_position", "motor_position"),
    ),
    "torques": ("rig.exchanged", "motor_torque and torque_sensor", exchanged("motor_torque", "torque_sensor")),
    "a thousand times": ("rig.unit", "torque_sensor", scaled("torque_sensor", by=1e3)),
}


def codes(found):
    return [finding.code for finding in found.findings]


@pytest.mark.parametrize("what", TURNED)
def test_a_sign_a_unit_or_a_channel_that_is_wrong_is_hinted_at(tmp_path, what):
    code, part, change = TURNED[what]
    diagnosis = worded(diagnose(lay(tmp_path, change=change, duration=3.0), None, Options()))
    (hint,) = (f for f in diagnosis.findings if f.severity == "invalidates")
    assert (hint.code, hint.part) == (code, part)
    assert diagnosis.next_experiment == ""
    assert diagnosis.verdict in ("unexplained", "partly explained")


def test_a_channel_that_stands_still_has_no_unit(tmp_path):
    """A drive that records nothing: any factor of nothing is nothing."""
    outcome = diagnose(lay(tmp_path, change=scaled("motor_torque", by=0.0), duration=1.0), None, Options())
    assert not [code for code in codes(outcome.diagnosis) if code.startswith("rig.")]


def test_what_is_unexplained_otherwise_brings_no_hint_and_no_rig(tmp_path):
    """A detent of the motor at one angle."""
    detent = Truth(at_motor=lambda a, da: 0.3 * np.exp(-(((a - 0.3) / 0.1) ** 2)))
    outcome = diagnose(lay(tmp_path, detent), None, Options())
    assert outcome.diagnosis.verdict == "unexplained"
    assert outcome.diagnosis.unexplained.where == "motor"
    assert outcome.extended is None
    assert not [code for code in codes(outcome.diagnosis) if code.startswith("rig.")]


def rest(said):
    for role in ("motor_position", "link_position"):
        said[role][:] = 0.25


@pytest.mark.parametrize(
    ("change", "rows", "words"),
    [(rest, slice(None), "no position changes"), (None, slice(0, 10), "10 samples, 0.02 s, are too few")],
)
def test_logs_that_tell_nothing_are_refused(tmp_path, change, rows, words):
    with pytest.raises(DiagnosisError, match=words):
        diagnose(lay(tmp_path, change=change, rows=rows), None, Options())


def test_a_log_is_not_held_out_from_itself(tmp_path):
    path = lay(tmp_path)
    (tmp_path / "again.csv").write_bytes(path.read_bytes())
    with pytest.raises(DiagnosisError, match="is the log itself"):
        diagnose(path, tmp_path / "again.csv", Options())


def test_a_gap_in_every_channel_leaves_the_rest_to_be_simulated(tmp_path):
    def change(said):
        for values in said.values():
            values[1000:1100] = np.nan

    outcome = diagnose(lay(tmp_path, Truth(damping=0.08), change), None, Options())
    assert [c.cause for c in outcome.diagnosis.causes] == ["motor.viscous_friction"]
    assert outcome.diagnosis.gain.signals
    assert all(np.isfinite(e.nrmse) for e in outcome.diagnosis.simulation_error)


def test_a_joint_of_a_chain_is_looked_at_without_its_link(tmp_path):
    outcome = diagnose(lay(tmp_path, Truth(damping=0.08), rig=ELASTIC + CHAIN), None, Options())
    assert {e.equation for e in outcome.diagnosis.equations} == {"motor", "transmission"}
    assert [c.cause for c in outcome.diagnosis.causes] == ["motor.viscous_friction"]
    assert "diagnosis.link_of_chain" in codes(outcome.diagnosis)
    assert outcome.extended.joints["arm"].link == joint_of().link
    assert outcome.extended.joints["arm"].motor.damping == pytest.approx(0.08, rel=0.02)


def test_a_channel_that_is_not_there_is_reported(tmp_path):
    path = lay(tmp_path, rig=ELASTIC.replace('"torque sensor"', '"torque sensr"'))
    outcome = diagnose(path, None, Options())
    (found,) = (f for f in outcome.diagnosis.findings if f.code == "channel.misnamed")
    assert (found.joint, found.part) == ("arm", "torque_sensor")
    assert found.evidence == {"channel": "torque sensr", "near": "'torque sensor'"}


def test_equations_that_close_while_the_simulation_does_not_are_doubted(tmp_path):
    """A pull at the link that comes and goes, which no cause makes, without a link encoder and next to a noisy torque sensor."""

    def loud(said):
        said["torque_sensor"] += 0.3 * np.random.default_rng(1).standard_normal(said["torque_sensor"].size)

    pull = Truth(extra=lambda t, a, phi: 0.03 * np.sin(11.0 * t + 3.0 * np.sin(0.7 * t)))
    rig = ELASTIC.replace('link_position = "link position"\n', "")
    found = worded(diagnose(lay(tmp_path, pull, loud, rig=rig), None, Options()))
    assert found.verdict == "unexplained"
    assert not found.causes
    # No equation stands out of its noise, and the report names no side after the verdict.
    assert found.unexplained.where is None
    assert len(found.sentences) == 2
    (doubt,) = (f for f in found.findings if f.code == "diagnosis.simulation_off")
    assert doubt.part == "motor_position"
    assert doubt.value > doubt.limit


def without_link_encoder(folder, monkeypatch, *hidden):
    """Simulate the preset with something hidden in it, and diagnose the log with a rig that has no link encoder."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(
        "sys.argv", ["vsalog", "simulate", "sea", *hidden, "--duration", "20 s", "--seed", "7", "-o", "log.csv"]
    )
    assert _run() == 0
    text = (folder / "log.rig.toml").read_text(encoding="utf-8")
    rig = "\n".join(line for line in text.splitlines() if not line.startswith("link_position"))
    (folder / "log.rig.toml").write_text(rig, encoding="utf-8")
    return diagnose(folder / "log.csv", None, Options()).diagnosis


WITHOUT = {"nothing": ((), []), "gravity": (("--actual", "joint.sea.link.gravity_torque=3.1"), ["link.gravity"])}


@pytest.mark.parametrize("what", WITHOUT)
def test_without_a_link_encoder_a_stiffer_spring_is_no_cause(what, tmp_path, monkeypatch):
    """The torque sensor tells the deflection: a spring that is taken for stiffer makes its noise small, and explains nothing."""
    hidden, expected = WITHOUT[what]
    found = without_link_encoder(tmp_path, monkeypatch, *hidden)
    assert found.verdict == ("explained" if expected else "consistent as far as checked")
    assert [c.cause for c in found.causes] == expected


def test_what_could_not_be_simulated_is_not_called_right(tmp_path, run):
    run("simulate", "sea", "--duration", "0.4 s", "-o", "short.mcap")
    done = run("diagnose", "short.mcap")
    assert done.returncode == 0, done.stderr
    assert "nothing could be simulated" in done.stdout
    assert "is consistent with the rig" not in done.stdout


def test_what_is_reported_alike_of_all_joints_of_an_arm_is_reported_once(tmp_path, run):
    run("simulate", "kuka-kr15", "--duration", "2 s", "-o", "arm.mcap")
    done = run("diagnose", "arm.mcap")
    assert done.returncode == 2
    assert done.stderr.count("allow no equation") == 1
    assert "joints 'axis1', 'axis2', 'axis3'" in done.stderr


def test_a_held_out_log_of_another_machine_is_doubted(tmp_path):
    """The log itself is explained; nothing that explains it explains a link of twice the inertia."""
    own = lay(tmp_path, truth=Truth(damping=0.1))
    other = lay(tmp_path, truth=Truth(damping=0.1, link_inertia=0.06), name="other", seed=1)
    same = lay(tmp_path, truth=Truth(damping=0.1), name="same", seed=2)
    doubts = [codes(diagnose(own, held, Options()).diagnosis) for held in (other, same)]
    assert ["diagnosis.holdout_contradicts" in found for found in doubts] == [True, False]
