"""Logs at addresses, in fsspec's memory and behind a local server."""

from __future__ import annotations

import json
import shutil
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import fsspec
import numpy as np
import pytest
from click.testing import CliRunner
from finding_codes import values_of
from write_logs import joints_mcap

from vsalog.cli import cli
from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read, remote

ELBOW = "/joint_states.position[elbow]"


@pytest.fixture
def memory(tmp_path):
    """A log in fsspec's memory, where no other test's is."""
    remote._fetched.cache_clear()
    raw = joints_mcap(tmp_path / "log.mcap", 50).read_bytes()
    system = fsspec.filesystem("memory")
    system.pipe(f"/{tmp_path.name}/log.mcap", raw)
    yield f"memory://{tmp_path.name}/log.mcap"
    if system.exists(f"/{tmp_path.name}"):
        system.rm(f"/{tmp_path.name}", recursive=True)


@pytest.mark.parametrize("as_path", [str, Path])
def test_an_address_is_read_as_the_file_is(memory, tmp_path, as_path):
    recording, same = read(as_path(memory)), read(tmp_path / "log.mcap")
    assert recording.path == Path(memory)
    assert recording.channels.keys() == same.channels.keys()
    np.testing.assert_array_equal(recording.channel(ELBOW).values, same.channel(ELBOW).values)
    assert values_of(recording, "recording.downloaded") == [(tmp_path / "log.mcap").stat().st_size / 2**20]
    assert read(as_path(memory), [ELBOW], start="0.01", end="0.02").channel(ELBOW).values.tolist() == list(
        range(10, 21)
    )
    assert list(open_reader(as_path(memory)).catalogue().channels) == list(same.channels)


def test_it_is_downloaded_once(memory, monkeypatch):
    read(memory)
    fsspec.filesystem("memory").rm(memory)
    assert read(Path(memory)).channel(ELBOW).values.size == 50


def test_the_folder_of_a_bag(memory, tmp_path):
    system = fsspec.filesystem("memory")
    folder = memory.removesuffix("/log.mcap")
    text = "rosbag2_bagfile_information:\n  relative_file_paths:\n    - log.mcap\n"
    system.pipe(f"{folder}/metadata.yaml", text.encode())
    assert read(folder).channel(ELBOW).values.size == 50


def test_commands_take_addresses(memory, tmp_path):
    done = CliRunner().invoke(cli, ["inspect", memory, "--json", "--repair", str(tmp_path / "out.mcap")])
    assert done.exit_code == 0, done.output
    (report,) = json.loads(done.stdout)["logs"]
    assert report["findings"][0]["code"] == "recording.downloaded"
    assert read(tmp_path / "out.mcap").channel(ELBOW).values.size == 50


def test_over_http(tmp_path):
    pytest.importorskip("aiohttp")
    remote._fetched.cache_clear()
    joints_mcap(tmp_path / "log.mcap", 20)
    quiet = type("Quiet", (SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(quiet, directory=str(tmp_path))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}"
        assert read(Path(f"{address}/log.mcap?a=b")).channel(ELBOW).values.size == 20
        with pytest.raises(ReadError, match="there is no such file"):
            read(f"{address}/none.mcap")
        server.shutdown()


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("memory://nothing/here.mcap", "there is no such file"),
        ("nonsense://x/y", "cannot be downloaded: Protocol not known"),
        ("http://127.0.0.1:9/log.mcap", "cannot be downloaded|there is no such file"),
    ],
)
def test_what_cannot_be_is_reported(address, words):
    assert isinstance(CliRunner().invoke(cli, ["inspect", address]).exception, ReadError)
    with pytest.raises(ReadError, match=words):
        read(address)


def test_a_damaged_log_is_named_by_its_address(memory):
    fsspec.filesystem("memory").pipe(memory, b"")
    with pytest.raises(ReadError, match=r"log\.mcap: is empty") as caught:
        read(memory)
    assert str(caught.value).startswith("memory:/")


def test_more_than_the_disk_holds_is_refused(memory, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 0))
    fsspec.filesystem("memory").pipe(memory, bytes(2**21))
    with pytest.raises(ReadError, match=r"has 2 MiB, and .* only 0 MiB left"):
        read(memory)


def test_results_of_an_address_are_named_after_its_log_and_lie_in_the_current_folder(tmp_path, monkeypatch):
    remote._fetched.cache_clear()
    sample = Path(__file__).parents[2] / "sample_logs" / "vsa2_exp1.mcap"
    fsspec.filesystem("memory").pipe(f"/{tmp_path.name}/run.7.mcap", sample.read_bytes())
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["estimate", f"memory://{tmp_path.name}/run.7.mcap"])
    fsspec.filesystem("memory").rm(f"/{tmp_path.name}", recursive=True)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.7.model.toml", "run.7.stiffness.parquet"]
