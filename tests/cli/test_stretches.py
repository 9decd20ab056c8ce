"""`--start` and `--end`: part of a log, in every command the same."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from vsalog.cli import cli

S = 10**9


@pytest.fixture
def folder(tmp_path, samples):
    shutil.copy(samples / "vsa2_exp1.mcap", tmp_path / "log.mcap")
    return tmp_path


def test_a_part_is_estimated_and_repeated(run, folder):
    done = run("estimate", "log.mcap", "--start", "2", "--end", "0.1 min", "-e", "qr-rls")
    assert done.returncode == 0, done.stderr
    assert run("estimate", "--from", "log.stiffness.parquet", "-o", "again.parquet").returncode == 0
    trace, again = (pq.read_table(folder / name) for name in ("log.stiffness.parquet", "again.parquet"))
    inspected = json.loads(run("inspect", "log.mcap", "--json").stdout)["logs"][0]
    begin = min(stream["start"] for stream in inspected["streams"])
    stamps = trace["stamp"].to_numpy()
    assert abs(int(stamps[0]) - begin - 2 * S) <= S // 100
    assert abs(int(stamps[-1]) - begin - 6 * S) <= S // 100
    np.testing.assert_array_equal(again["stamp"].to_numpy(), stamps)
    np.testing.assert_array_equal(again["stiffness"].to_numpy(), trace["stiffness"].to_numpy())
    assert again.schema.metadata == trace.schema.metadata


@pytest.mark.parametrize("command", ["estimate", "compare", "diagnose", "inspect", "init"])
@pytest.mark.parametrize(
    ("moment", "words"),
    [
        ("1 h", "has no sample from"),
        ("2001-01-01", "has no sample to 2001-01-01"),
        ("tomorrow", "'tomorrow' is no time"),
    ],
)
def test_what_is_no_part_of_the_log_is_reported(command, moment, words, folder, monkeypatch):
    monkeypatch.chdir(folder)
    option = "--end" if moment.startswith("2001") else "--start"
    done = CliRunner().invoke(cli, [command, "log.mcap", option, moment])
    assert done.exit_code != 0
    assert words in str(done.exception)
    assert not list(folder.glob("*.parquet"))
