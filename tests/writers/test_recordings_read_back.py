"""What is written is what the readers read: names, stamps, units and every bit of the values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vsalog.core.recording import Recording
from vsalog.readers import read
from vsalog.simulation import Experiment, awas_experiment, elastic_experiment, vsa2_experiment
from vsalog.writers.recording_mcap import write_mcap
from vsalog.writers.recording_rosbags import write_rosbag1
from vsalog.writers.recording_tables import write_csv

EXPERIMENTS = [vsa2_experiment, awas_experiment, elastic_experiment]
FORMATS = [(write_mcap, "mcap"), (write_rosbag1, "rosbag1"), (write_csv, "csv")]


@pytest.mark.parametrize("run", EXPERIMENTS)
@pytest.mark.parametrize(("write", "kind"), FORMATS)
def test_every_channel_comes_back(
    run: Callable[..., Experiment], write: Callable[[Recording, Path], None], kind: str, tmp_path: Path
) -> None:
    written = run(duration=0.5).recording(truth=True)
    # The name's ending must not matter.
    path = tmp_path / "log.dat"
    write(written, path)
    found = read(path)
    assert found.format == kind
    assert found.absolute_time
    for name, channel in written.channels.items():
        assert found.channels[name].values.tobytes() == channel.values.tobytes(), name
        np.testing.assert_array_equal(found.channels[name].stamps, channel.stamps)
        if kind == "csv":
            assert found.channels[name].unit == channel.unit


def test_the_rig_comes_back_and_is_kept_by_a_copy(tmp_path: Path) -> None:
    text = "# Größe\nname = 'x'\n"
    write_mcap(vsa2_experiment(duration=0.1).recording(), tmp_path / "a.mcap", text)
    first = read(tmp_path / "a.mcap")
    assert first.rig_text == text
    write_mcap(first, tmp_path / "b.mcap")
    assert read(tmp_path / "b.mcap").rig_text == text


def test_header_stamps_are_the_time_of_joint_states(tmp_path: Path) -> None:
    for write, name in ((write_mcap, "a.mcap"), (write_rosbag1, "a.bag")):
        write(vsa2_experiment(duration=0.1).recording(truth=True), tmp_path / name)
        streams = read(tmp_path / name).streams
        assert streams["/joint_states"].time_source == "header"
        assert streams["/truth/stiffness_1"].time_source == "log"
        assert all(stream.conflicts == stream.duplicates == 0 for stream in streams.values())


def test_a_log_goes_from_format_to_format(tmp_path: Path) -> None:
    write_mcap(awas_experiment(duration=0.2).recording(), tmp_path / "a")
    first = read(tmp_path / "a")
    write_csv(first, tmp_path / "b")
    write_rosbag1(read(tmp_path / "b"), tmp_path / "c")
    last = read(tmp_path / "c")
    for name, channel in first.channels.items():
        assert last.channels[name].values.tobytes() == channel.values.tobytes(), name
        np.testing.assert_array_equal(last.channels[name].stamps, channel.stamps)
