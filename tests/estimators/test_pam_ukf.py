"""pam-ukf and pam-model as a user runs them: on another machine than the rig states, with gaps, and where it cannot be."""

import json
from dataclasses import replace as with_fields

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run
from msgspec.structs import replace

from vsalog.core.errors import EstimatorError, OtherKindError
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.readers import read
from vsalog.rig import Rig

pytestmark = pytest.mark.share(2)


def vsalog(*args, cwd):
    done = vsalog_run(*args, cwd=cwd)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of a machine whose pressures are noisy, with the truth along with it."""
    folder = tmp_path_factory.mktemp("pam")
    code, _, err = vsalog("simulate", "pam", "--truth", "--duration", "12 s", "-o", "pam.mcap", cwd=folder)
    assert code == 0, err
    return folder


@pytest.fixture(scope="module")
def truth(folder):
    channels = read(folder / "pam.mcap").channels
    return {
        name: next(c for n, c in channels.items() if n.endswith(f"{name}.data")).values
        for name in ("link_position", "torque", "stiffness")
        if any(n.endswith(f"{name}.data") for n in channels)
    }


def test_the_command_writes_states_with_their_deviations(folder, truth):
    code, out, err = vsalog("estimate", "pam.mcap", "--json", cwd=folder)
    assert code == 0, err
    document = json.loads(out)
    (joint,) = document["joints"]
    assert joint["estimator"] == "pam-ukf"
    assert joint["settings"]["noise_pressure_1"] > 0.0
    table = pq.read_table(folder / "pam.stiffness.parquet").to_pandas()
    for name in ("link_position", "link_velocity", "pressure_1", "pressure_2"):
        assert np.isfinite(table[name]).mean() > 0.99
        assert (table[f"{name}_std"].dropna() >= 0.0).all()
    count = min(len(table), truth["link_position"].size)
    off = table["link_position"].to_numpy()[:count] - truth["link_position"][:count]
    assert np.nanmax(np.abs(off)) < 0.0613 * np.ptp(
        truth["link_position"]
    )  # printed, of real muscles (Shin 2021, §IV-A)
    believed = table["link_position_std"].to_numpy()[:count]
    assert np.nanmean(np.abs(off[2000:]) < 2.0 * believed[2000:]) > 0.85
    assert np.ptp(table["stiffness"].dropna()) > 0.0
    assert (table["stiffness"].dropna() > 0.0).all()


def test_constant_pressures_are_softer_than_trapped_air(folder):
    found = {}
    for air in ("trapped", "constant"):
        code, _, err = vsalog("estimate", "pam.mcap", "--tune", f"air={air}", "-o", f"{air}.parquet", cwd=folder)
        assert code == 0, err
        found[air] = pq.read_table(folder / f"{air}.parquet").to_pandas()["stiffness"].to_numpy()
    both = np.isfinite(found["trapped"]) & np.isfinite(found["constant"])
    assert (found["trapped"][both] > found["constant"][both]).all()


def joint_and_recording(folder):
    rig = Rig.from_toml(read(folder / "pam.mcap").rig_text, "here")
    return rig.joints["pam"], read(folder / "pam.mcap")


def changed(recording, name, change):
    (full,) = [n for n in recording.channels if n.endswith(name)]
    channel = recording.channels[full]
    channels = dict(recording.channels) | {full: with_fields(channel, values=change(channel.values.copy()))}
    return with_fields(recording, channels=channels)


def estimated(joint, recording, estimator="pam-ukf", **tune):
    return estimate_joint(
        [recording], "pam", joint, choose("pam", joint, estimator, {k: str(v) for k, v in tune.items()})
    )


def channel_of(joint, role):
    signal = getattr(joint.signals, role)
    return signal if isinstance(signal, str) else signal.channel


def test_missing_pressures_are_bridged_and_said_by_the_deviation(folder):
    joint, recording = joint_and_recording(folder)

    def lose(values):
        values[4000:5000] = np.nan
        return values

    with_all = estimated(joint, recording).trace["total"]
    lossy = changed(changed(recording, channel_of(joint, "pressure_1"), lose), channel_of(joint, "pressure_2"), lose)
    without = estimated(joint, lossy).trace["total"]
    middle = slice(4100, 4990)
    assert np.isfinite(without["stiffness"][middle]).all()
    at_the_end = slice(4950, 4990)
    assert without["link_position_std"][at_the_end].mean() > 2.0 * with_all["link_position_std"][at_the_end].mean()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_commands_that_are_missing_here_and_there_are_held(folder, truth, share):
    """A valve keeps its opening until the next command: a few that were not recorded change next to nothing, nor begin a run."""
    joint, recording = joint_and_recording(folder)
    rng = np.random.default_rng(2)

    def lose(values):
        values[rng.random(values.size) < share] = np.nan
        return values

    lossy = changed(changed(recording, channel_of(joint, "valve_1"), lose), channel_of(joint, "valve_2"), lose)
    found = {name: estimated(joint, r).trace["total"] for name, r in (("all", recording), ("lossy", lossy))}
    count = min(found["all"]["link_position"].size, truth["link_position"].size)
    off = {name: t["link_position"][:count] - truth["link_position"][:count] for name, t in found.items()}
    assert np.nanstd(off["lossy"]) < 1.5 * np.nanstd(off["all"])
    held = np.abs(off["lossy"]) < 1.96 * found["lossy"]["link_position_std"][:count]
    assert held.mean() > 0.9
    whole = estimated(joint, lossy).trace["total"]["link_position"]
    choice = choose("pam", joint, "pam-ukf", {})
    cut = estimate_joint([lossy], "pam", joint, choice, block=101).trace["total"]["link_position"]
    np.testing.assert_array_equal(whole, cut)


def test_swapped_pressures_are_no_numbers_but_a_warning(folder):
    joint, recording = joint_and_recording(folder)
    signals = joint.signals
    crossed = replace(joint, signals=replace(signals, valve_1=signals.valve_2, valve_2=signals.valve_1))
    found = estimated(crossed, recording)
    assert "pressure.not_explained" in [finding.code for finding in found.findings]
    assert np.isnan(found.trace["total"]["stiffness"]).mean() > 0.5
    assert not found.trace["total"]["excited"][np.isnan(found.trace["total"]["stiffness"])].any()


def test_blocks_of_any_size_give_the_same_bits(folder):
    joint, recording = joint_and_recording(folder)
    choice = choose("pam", joint, "auto", {})
    whole = estimate_joint([recording], "pam", joint, choice).trace
    cut = estimate_joint([recording], "pam", joint, choice, block=997).trace
    for column, values in whole["total"].items():
        np.testing.assert_array_equal(cut["total"][column], values, err_msg=column)


def test_the_model_alone_runs_on_the_valves(folder, truth):
    joint, recording = joint_and_recording(folder)
    found = estimated(joint, recording, "pam-model").trace["total"]
    count = min(found["link_position"].size, truth["link_position"].size)
    off = found["link_position"][:count] - truth["link_position"][:count]
    assert np.nanmax(np.abs(off)) < 0.02 * np.ptp(truth["link_position"])


def test_what_cannot_be_is_refused(folder):
    joint, _ = joint_and_recording(folder)

    with pytest.raises(OtherKindError):
        choose("pam", joint, "residual-rls", {})
    lacking = replace(joint, signals=replace(joint.signals, pressure_2=None))
    with pytest.raises(EstimatorError, match="pressure_2"):
        choose("pam", lacking, "auto", {})
    blind = replace(joint, signals=replace(joint.signals, valve_1=None))
    with pytest.raises(EstimatorError, match="valve_1"):
        choose("pam", blind, "pam-model", {})
    sea = Rig.preset("sea").joints["sea"]
    with pytest.raises(EstimatorError, match="kind 'pneumatic'"):
        choose("sea", sea, "pam-ukf", {})
    assert vsalog("estimate", "pam.mcap", "-o", "refused.parquet", cwd=folder)[0] == 0
    code, _, err = vsalog("validate", "refused.model.toml", "pam.mcap", cwd=folder)
    assert code == 2
    assert "pneumatic" in err


def test_pressures_that_cannot_be_absolute_are_refused_and_doubtful_ones_named(folder):
    least = float(np.nanmin(read(folder / "pam.mcap").channels["/muscle_2/pressure.data"].values))
    for target, code, words in ((0.5, 2, "it is not absolute"), (0.95, 0, "pressure.below_outside"), (1.05, 0, "")):
        offset = f"joint.pam.signals.pressure_2.offset={least - target * 101325.0}"
        asked = ("pam.mcap", "-e", "pam-ukf", "--set", offset, "-o", "g.parquet", "--json")
        got, out, err = vsalog("estimate", *asked, cwd=folder)
        assert got == code, err
        assert words in out + err
        assert ("outside" in out + err) == bool(words)


def test_a_pressure_that_stands_still_while_its_valve_moves_is_refused(folder):
    """A sensor that is off."""
    joint, recording = joint_and_recording(folder)
    off = changed(recording, channel_of(joint, "pressure_1"), lambda values: np.full_like(values, 150e3))
    with pytest.raises(EstimatorError, match="pressure_1 is 150000 Pa from beginning to end while its valve moves"):
        estimated(joint, off)
    closed = changed(off, channel_of(joint, "valve_1"), np.zeros_like)
    assert estimated(joint, closed).kept is not None


def test_a_pressure_at_the_end_of_its_sensors_range_is_reported(folder):
    joint, recording = joint_and_recording(folder)
    clipped = changed(recording, channel_of(joint, "pressure_1"), lambda v: np.minimum(v, np.nanquantile(v, 0.6)))
    saturated = [
        (f.part, f.evidence["end"]) for f in estimated(joint, clipped).findings if f.code == "sensor.saturated"
    ]
    assert saturated == [("pressure_1", "highest")]
    assert "sensor.saturated" not in {f.code for f in estimated(joint, recording).findings}


def test_pressures_without_any_reference_are_a_finding(folder):
    joint, recording = joint_and_recording(folder)
    assert "cross_check.none" not in {f.code for f in estimated(joint, recording).findings}
    alone = replace(joint, signals=replace(joint.signals, link_position=None, torque_sensor=None))
    (none,) = (f for f in estimated(alone, recording).findings if f.code == "cross_check.none")
    assert none.evidence == {"estimator": "pam-ukf"}


def test_what_neither_pressure_nor_valve_tells_is_null(folder):
    """Half a second of everything is lost: a number would look like an estimate."""
    joint, recording = joint_and_recording(folder)

    def lose(values):
        values[4000:4500] = np.nan
        return values

    lossy = recording
    for role in ("pressure_1", "valve_1"):
        lossy = changed(lossy, channel_of(joint, role), lose)
    trace = estimated(joint, lossy).trace["total"]
    lost = slice(4001, 4500)
    assert np.isnan(np.asarray(trace["stiffness"], dtype=float)[lost]).all()
    assert not np.any(np.asarray(trace["excited"])[lost])
    assert np.isfinite(np.asarray(trace["stiffness"], dtype=float)[3000:3999]).all()
    assert np.mean(np.asarray(trace["excited"])[5000:7000]) > 0.9
