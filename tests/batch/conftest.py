"""Logs for batches, and batches done in this process, which spares the workers' start."""

import pytest
from batch_bench import Here, make_logs

from vsalog.batch import run as whole_run


@pytest.fixture
def logs(tmp_path):
    """A folder of six logs in two folders below, with their rigs."""
    make_logs(tmp_path / "logs", 6)
    return tmp_path / "logs"


@pytest.fixture
def here(monkeypatch):
    """Let `run_batch` do its tasks one after the other in this process; returns who does them."""
    executor = Here()
    monkeypatch.setattr(whole_run, "_executor", lambda *_: executor)
    return executor
