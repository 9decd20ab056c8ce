"""Logs of every format come back bit for bit with their rig; what cannot be written leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from vsalog.core.errors import WriteError
from vsalog.core.recording import Channel, Recording, Stamps
from vsalog.readers import open_reader, read
from vsalog.rig.find import find_rig
from vsalog.writers.recording_files import MARK, LogFiles, write_log
from vsalog.writers.recording_rosbags import write_rosbag2
from vsalog.writers.recording_tables import write_parquet

Array = NDArray[np.float64]
START = 1_767_225_600_000_000_123
OUTPUTS = ["a.mcap", "a.bag", "a.csv", "a.parquet", "a", "b/"]
RIG = 'name = "Größe"\n[joint.elbow]\nkind = "elastic"\n'


def recording(**channels: tuple[Stamps, Array] | tuple[Stamps, Array, str]) -> Recording:
    made = {}
    for key, (stamps, values, *unit) in channels.items():
        made[key] = Channel(key, stamps, values, unit[0] if unit else None, key.partition(".")[0], "")
    return Recording(Path("x"), "simulation", made, {})


def odd_numbers(count: int) -> Array:
    """Numbers of all magnitudes, and those that text or a sloppy cast would lose."""
    values = np.random.default_rng(5).standard_normal(count) * 10.0 ** np.linspace(-300, 300, count)
    values[:5] = [0.1, -0.0, np.inf, 5e-324, 1.7976931348623157e308]
    return values


def one_clock() -> Recording:
    stamps = START + np.arange(9000) * 1_000_001
    return recording(
        **{
            "/js.position[m]": (stamps, odd_numbers(9000), "rad"),
            "/js.effort[m]": (stamps, odd_numbers(9000)[::-1].copy(), "N·mm"),
            "/pressure.data": (stamps, np.arange(9000.0), "kPa"),
        }
    )


def two_clocks() -> Recording:
    """Two topics that share no stamp, and one that misses a tenth of another's."""
    fast, slow = START + np.arange(900) * 1_000_001, START + 17 + np.arange(300) * 3_000_003
    kept = np.arange(900) % 10 != 3
    return recording(
        **{
            "/js.position[m]": (fast, odd_numbers(900), "rad"),
            "/torque.effort[m]": (slow, odd_numbers(300), "N*m"),
            "/pressure.data": (fast[kept], odd_numbers(900)[kept], "Pa"),
        }
    )


def written(output: str, log: Recording, folder: Path, monkeypatch: pytest.MonkeyPatch) -> LogFiles:
    monkeypatch.chdir(folder)
    files = LogFiles.named(output)
    write_log(log, files, RIG)
    return files


@pytest.mark.parametrize("output", OUTPUTS)
def test_every_bit_and_the_rig_come_back(output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = one_clock()
    files = written(output, log, tmp_path, monkeypatch)
    found = read(files.log)
    assert found.absolute_time
    assert not found.findings
    # A ROS 1 header counts its messages.
    assert [name for name in found.channels if not name.endswith(".header.seq")] == list(log.channels)
    for name, channel in log.channels.items():
        assert found.channels[name].values.tobytes() == channel.values.tobytes(), name
        np.testing.assert_array_equal(found.channels[name].stamps, channel.stamps)
        if files.format in ("csv", "parquet"):
            assert found.channels[name].unit == channel.unit
    rig = find_rig(files.log, open_reader(files.log).rig_text)
    assert rig is not None
    assert rig.name == "Größe"
    assert list(rig.joints) == ["elbow"]


@pytest.mark.parametrize("output", ["a.mcap", "a.bag", "a.parquet", "a"])
def test_topics_on_clocks_of_their_own_come_back(output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = two_clocks()
    found = read(written(output, log, tmp_path, monkeypatch).log)
    for name, channel in log.channels.items():
        assert found.channels[name].values.tobytes() == channel.values.tobytes(), name
        np.testing.assert_array_equal(found.channels[name].stamps, channel.stamps)


def test_a_table_of_several_clocks_loses_no_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A CSV cell is empty where a channel has no sample; how empty ones are read is the reader's business."""
    log = two_clocks()
    found = read(written("a.csv", log, tmp_path, monkeypatch).log)
    for name, channel in log.channels.items():
        there = np.isin(found.channels[name].stamps, channel.stamps)
        assert found.channels[name].values[there].tobytes() == channel.values.tobytes()
        assert np.isnan(found.channels[name].values[~there]).all()


@pytest.mark.parametrize("output", OUTPUTS)
def test_equal_recordings_make_equal_files(output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    contents = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        written(output, one_clock(), tmp_path / name, monkeypatch)
        files = [p for p in (tmp_path / name).rglob("*") if p.is_file()]
        contents.append({str(p.relative_to(tmp_path / name)): p.read_bytes() for p in files})
    assert contents[0] == contents[1]


@pytest.mark.parametrize("output", OUTPUTS)
def test_nothing_is_left_behind_when_the_disk_is_full(
    output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    for module in ("recording_mcap", "recording_rosbags"):
        monkeypatch.setattr(f"vsalog.writers.{module}.merged_messages", full)
    monkeypatch.setattr("vsalog.writers.recording_tables.pa_csv.write_csv", full)
    monkeypatch.setattr("vsalog.writers.recording_tables.pq.write_table", full)
    with pytest.raises(WriteError, match="No space left"):
        written(output, one_clock(), tmp_path, monkeypatch)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("a.db3", "no log format has the suffix '.db3'; write .mcap, .bag, .csv or .parquet"),
        ("a.txt", "no log format has the suffix '.txt'"),
        ("no/a.mcap", "the folder no does not exist"),
        ("no/a/", "the folder no does not exist"),
        ("there", "exists already"),
        ("there/", "exists already"),
        ("", "names no file"),
        ("..", "names no file"),
        ("/", "names no file"),
        ("folder.csv", "is a folder"),
        ("what?mode=memory", "must not contain any of ? # %"),
        ("a%2e/", "must not contain any of ? # %"),
    ],
)
def test_an_output_that_cannot_be(output: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(WriteError) as error:
        LogFiles.named(output)
    assert words in str(error.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.csv", "there"]


@pytest.mark.parametrize("output", ["a.csv", "a.bag", "a/"])
def test_a_rig_file_of_somebody_else_is_not_replaced(
    output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    beside = tmp_path / "a.rig.toml"
    beside.write_text("# mine\n")
    with pytest.raises(WriteError, match="exists already and is not of 'vsalog simulate'"):
        LogFiles.named(output)
    beside.write_text(f"{MARK}a.csv.\n")
    LogFiles.named(output)
    assert LogFiles.named("a.mcap").rig is None


def test_a_log_in_a_folder_with_an_odd_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    odd = tmp_path / "it's \n\x1b[31m $HOME"
    odd.mkdir()
    for output in ("-a b.csv", "$(x).mcap", "run;1/"):
        files = written(output, one_clock(), odd, monkeypatch)
        assert read(files.log).channels
    assert [p.name for p in tmp_path.iterdir()] == [odd.name]
    assert sorted(os.listdir(odd)) == ["$(x).mcap", "-a b.csv", "-a b.rig.toml", "run;1", "run;1.rig.toml"]  # noqa: PTH208


def test_a_bag_reads_with_its_own_library(tmp_path: Path) -> None:
    log = two_clocks()
    write_rosbag2(log, tmp_path / "bag")
    assert sorted(p.name for p in (tmp_path / "bag").iterdir()) == ["bag.db3", "metadata.yaml"]
    with AnyReader([tmp_path / "bag"]) as bag:
        rows = [(c.topic, stamp, bag.deserialize(raw, c.msgtype)) for c, stamp, raw in bag.messages()]
    position = log.channels["/js.position[m]"]
    assert [s for topic, s, _ in rows if topic == "/js"] == position.stamps.tolist()
    assert [m.position[0] for topic, _, m in rows if topic == "/js"] == position.values.tolist()
    pressure = log.channels["/pressure.data"]
    assert [m.data for topic, _, m in rows if topic == "/pressure"] == pressure.values.tolist()


def test_a_table_tells_units_and_rig_to_those_who_know_parquet(tmp_path: Path) -> None:
    write_parquet(two_clocks(), tmp_path / "a.parquet", RIG)
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.schema.metadata[b"vsalog.rig"].decode() == RIG
    assert table.schema.field("/torque.effort[m]").metadata == {b"stream": b"/torque", b"unit": b"N*m"}
    assert str(table.schema.field("stamp").type) == "int64"
    assert table["/torque.effort[m]"].null_count == table.num_rows - 300


@pytest.mark.parametrize("names", [["torque [N·m]"], ["a [deg]", "/js.position[m]"]])
def test_names_that_end_like_a_unit(names: list[str], tmp_path: Path) -> None:
    stamps = START + np.arange(20)
    log = recording(**{name: (stamps, odd_numbers(20), "mrad") for name in names})
    write_parquet(log, tmp_path / "a.parquet")
    found = read(tmp_path / "a.parquet")
    assert list(found.channels) == names
    assert {c.unit for c in found.channels.values()} == {"mrad"}


@pytest.mark.parametrize(("name", "unit"), [("stamp", "rad"), ("torque [N·m]", "")])
def test_names_that_no_column_can_have(name: str, unit: str, tmp_path: Path) -> None:
    log = recording(
        **{name: (START + np.arange(20), odd_numbers(20), unit) if unit else (START + np.arange(20), odd_numbers(20))}
    )
    with pytest.raises(WriteError, match="rename it in the rig"):
        write_parquet(log, tmp_path / "a.parquet")
    assert list(tmp_path.iterdir()) == []


def test_an_empty_recording_makes_a_valid_log(tmp_path: Path) -> None:
    none = np.zeros(0, dtype=np.int64)
    for i, empty in enumerate((recording(), recording(**{"/a.data": (none, np.zeros(0))}))):
        write_parquet(empty, tmp_path / f"{i}.parquet")
        write_rosbag2(empty, tmp_path / f"{i}")
        assert pq.read_table(tmp_path / f"{i}.parquet").num_rows == 0
        assert (tmp_path / f"{i}" / "metadata.yaml").stat().st_size > 0
