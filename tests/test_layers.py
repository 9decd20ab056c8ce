"""What imports what: residuals are below the diagnosis."""

import ast
from pathlib import Path

import vsalog.residuals


def imported(path):
    """Modules that a file imports, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def test_residuals_know_no_cause():
    files = list(Path(vsalog.residuals.__file__).parent.glob("*.py"))
    assert len(files) > 10
    names = {name for file in files for name in imported(file)}
    assert "vsalog.residuals.balance" in names
    assert not [name for name in names if name.startswith("vsalog.diagnosis")]
