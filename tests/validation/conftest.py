"""Models fitted once for all tests of this folder."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from vsalog.cli import cli
from vsalog.core.errors import VsalogError

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def call(*arguments):
    """Run a command in this process; what it refuses is as `main` would say it."""
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    if isinstance(result.exception, VsalogError):
        return SimpleNamespace(exit_code=2, stdout="", stderr=str(result.exception), output=str(result.exception))
    return result


@pytest.fixture(scope="session")
def models(tmp_path_factory):
    """Models of the first sample of each device: name → path."""
    folder = tmp_path_factory.mktemp("models")
    for log in ("awas_exp1.mcap", "vsa2_exp1.mcap", "sea_exp1.csv"):
        assert call("estimate", SAMPLES / log, "-o", folder).exit_code == 0
    return {name: folder / f"{name}_exp1.model.toml" for name in ("awas", "vsa2", "sea")}
