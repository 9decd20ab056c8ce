"""The sample logs: made by their command, small enough, each with a rig that fits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from vsalog.core.errors import ReadError
from vsalog.core.recording import Recording
from vsalog.readers import read
from vsalog.rig import Rig
from vsalog.rig.schema import SerialJoint, Signal
from vsalog.simulation import samples
from vsalog.simulation.samples import DESR_SETTINGS, make_samples

SAMPLES = Path(__file__).parents[2] / "sample_logs"
LOGS = {
    "vsa2_exp1.mcap": 20001,
    "vsa2_exp2.mcap": 10001,
    "awas_exp1.mcap": 20001,
    "awas_exp2.mcap": 10001,
    "sea_exp1.csv": 10001,
    "sea_exp2.bag": 10001,
}


def rig_of(recording: Recording) -> Rig:
    if recording.rig_text is not None:
        return Rig.from_toml(recording.rig_text)
    return Rig.load(recording.path.with_suffix(".rig.toml"))


def test_all_samples_together_are_small() -> None:
    assert sum(p.stat().st_size for p in SAMPLES.rglob("*") if p.is_file()) < 6_000_000


@pytest.mark.parametrize(("name", "count"), LOGS.items())
def test_a_sample_holds_all_channels_of_its_rig(name: str, count: int) -> None:
    recording = read(SAMPLES / name)
    (joint,) = rig_of(recording).joints.values()
    for role in joint.signals.__struct_fields__:
        spec = getattr(joint.signals, role)
        channel = spec.channel if isinstance(spec, Signal) else spec
        if channel is not None:
            values = recording.channel(channel).values
            assert values.shape == (count,)
            assert np.all(np.isfinite(values))
            assert np.ptp(values) > 0.0
    assert not recording.findings


def test_the_csv_states_its_units() -> None:
    recording = read(SAMPLES / "sea_exp1.csv")
    assert {c.name: c.unit for c in recording.channels.values()} == {
        "motor position": "deg",
        "link position": "deg",
        "motor torque": "N·mm",
        "torque sensor": "N·mm",
    }


def test_the_real_sample_has_nine_settings() -> None:
    folder = SAMPLES / "desr_foot"
    joint = Rig.load(folder / "desr_foot.rig.toml").joints["ankle"]
    assert isinstance(joint, SerialJoint)
    assert [run.name for run in joint.run] == list(DESR_SETTINGS)
    recording = read(folder / "desr_foot.mat")
    for setting in DESR_SETTINGS:
        for column in ("angleJIM", "torque"):
            assert recording.channel(f"DESR_N.{setting}.{column}").values.shape == (3000,)
    assert (folder / "LICENSE").read_text().startswith("MIT License")


def test_the_command_makes_every_sample_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "SECONDS", {1: 0.2, 2: 0.1})
    source = tmp_path / "source"
    source.mkdir()
    whole = {s: {c: np.arange(40.0) for c in samples.DESR_COLUMNS} for s in DESR_SETTINGS}
    savemat(str(source / "d.mat"), {"DESR_N": whole})
    (source / "LICENSE").write_text("MIT License")
    for folder in ("a", "b"):
        make_samples(tmp_path / folder, source / "d.mat")
    made, again = (sorted(p for p in (tmp_path / f).rglob("*") if p.is_file()) for f in ("a", "b"))
    recorded = SAMPLES / "so101_servo"  # a cut of a recording, which nothing makes
    files = [p for p in SAMPLES.rglob("*") if p.is_file() and recorded not in p.parents]
    documented = {str(p.relative_to(SAMPLES)) for p in files} - {"README.md"}
    assert {str(p.relative_to(tmp_path / "a")) for p in made} == documented
    assert [p.read_bytes() for p in made] == [p.read_bytes() for p in again]
    cut = read(tmp_path / "a" / "desr_foot" / "desr_foot.mat").channel("DESR_N.x33.torque").values
    np.testing.assert_array_equal(cut, np.arange(0.0, 40.0, 4.0))


def test_a_wrong_source_is_reported(tmp_path: Path) -> None:
    savemat(str(tmp_path / "d.mat"), {"other": 1.0})
    with pytest.raises(ReadError, match="not the recording"):
        make_samples(tmp_path / "out", tmp_path / "d.mat")
