"""Nothing is decided by the words of a message: not by those of an error, a finding or a note."""

import ast
from pathlib import Path

import pytest

import vsalog

SOURCE = Path(vsalog.__file__).parent
TEXTS = {
    "note",
    "notes",
    "warning",
    "warnings",
    "time_reason",
    "says",
    "advice",
    "sentence",
    "sentences",
}
"""Names of variables and attributes that hold words for people."""
MATCHES = {
    "endswith",
    "startswith",
    "replace",
    "removeprefix",
    "removesuffix",
    "find",
    "rfind",
    "index",
    "partition",
    "match",
}
ALLOWED = {
    "readers/tables/source.py": "zlib tells a wrong checksum in words alone",
    "rig/load.py": "the TOML library tells the end of the document in words alone",
    "estimators/tuning.py": "msgspec names the field in words alone",
    "comparison/run.py": "prints sentences of several runs once",
    "diagnosis/joint.py": "takes the joint's name out of an error",
    "diagnosis/run.py": "takes the joint's name out of an error",
}
"""Files that read words, and why. No others are to be added."""


def caught(tree):
    """Return the names that errors are caught by."""
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.name}


class Words:
    """Tells which expressions of a file are words for people."""

    def __init__(self, tree):
        self._errors = caught(tree)
        self._names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and self.of_error(node.value):
                self._names |= {target.id for target in node.targets if isinstance(target, ast.Name)}

    def of_error(self, node):
        """Tell whether an expression is an error's text, perhaps changed, or a finding's sentence."""
        for one in ast.walk(node):
            if isinstance(one, ast.Call) and isinstance(one.func, ast.Name):
                if one.func.id == "sentence":
                    return True
                if one.func.id == "str" and one.args and getattr(one.args[0], "id", None) in self._errors:
                    return True
        return False

    def of(self, node):
        """Tell whether an expression is words for people."""
        named = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else None
        if named in self._names or (isinstance(node, ast.Name | ast.Call) and self.of_error(node)):
            return True
        return named in TEXTS


def decisions(source):
    """Yield the lines that compare, search or change words for people."""
    tree = ast.parse(source)
    words = Words(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            kinds = ast.In | ast.NotIn | ast.Eq | ast.NotEq
            found = isinstance(node.ops[0], kinds) and any(map(words.of, sides))
            found = found and not any(isinstance(side, ast.Constant) and side.value in (None, "") for side in sides)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            searched = isinstance(node.func.value, ast.Name) and node.func.value.id == "re"
            found = (
                any(map(words.of, node.args)) if searched else node.func.attr in MATCHES and words.of(node.func.value)
            )
            once = node.func.attr == "fromkeys" and any(
                words.of(one) for arg in node.args for one in ast.walk(arg) if isinstance(one, ast.Name | ast.Attribute)
            )
            found = found or once
        else:
            continue
        if found:
            yield ast.get_source_segment(source, node)


@pytest.mark.parametrize(
    "text",
    [
        "doubts = [note for note in report.notes if note.endswith(DOUBTFUL)]",
        "try: pass\nexcept ReadError as error: raise ReadError(str(error).replace(str(a), str(b)))",
        "if any('backlash' in warning for warning in warnings): pass",
        "plain = stream.time_reason.startswith(('it has no', ASKED_FOR))",
        "if note not in self.notes: pass",
        "key = re.sub(r'\\d', '', warning)",
        "notes = tuple(dict.fromkeys(notes))",
        "if 'prior' in sentence(finding): pass",
    ],
)
def test_what_decides_by_words_is_found(text):
    assert list(decisions(text))


def test_no_code_decides_by_words():
    found = {
        (name, text)
        for path in sorted(SOURCE.rglob("*.py"))
        if (name := path.relative_to(SOURCE).as_posix()) not in ALLOWED
        for text in decisions(path.read_text(encoding="utf-8"))
    }
    assert not found
