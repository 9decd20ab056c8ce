"""What the commands say of the sample logs: the documents that they print, and the pages that they write."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

from vsalog.cli import cli
from vsalog.report import terminal
from vsalog.report.document import Document


@dataclass
class Said:
    document: Document
    page: Path | None


@pytest.fixture(scope="session")
def said(samples, tmp_path_factory):
    """Command → what it printed, before it was laid out, and its page."""
    folder = tmp_path_factory.mktemp("said")
    awas, second = (str(samples / f"awas_exp{i}.mcap") for i in (1, 2))
    one, two = (str(samples / f"vsa2_exp{i}.mcap") for i in (1, 2))
    model = "vsa2_exp1.model.toml"
    commands = {
        "estimate": (["estimate", awas, "-o", ".", "--report", "estimate.html"], "estimate.html"),
        "estimate two": (["estimate", one, "-o", "."], None),
        "validate": (["validate", "awas_exp1.model.toml", second, awas, "-o", "."], "report.html"),
        "validate two": (["validate", model, two, "-o", "2"], "2/report.html"),
        "diagnose": (["diagnose", awas, "--end", "5", "-o", "3"], "3/diagnosis.html"),
        "compare": (["compare", awas, "--end", "6", "--report", "compare.html"], "compare.html"),
        "inspect": (["inspect", awas, one, "--head", "2"], None),
        "simulate": (["simulate", "--list"], None),
        "reproduce": (["reproduce", "--list"], None),
    }  # fmt: skip
    found = {}
    for name, (arguments, page) in commands.items():
        printed = []
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)  # names of files are not broken into lines, however long
            patch.setattr(terminal, "print_document", lambda document, printed=printed: printed.append(document))
            done = CliRunner().invoke(cli, arguments)
        assert done.exit_code == 0, done.output
        found[name] = Said(printed[0], None if page is None else folder / page)
    return found
