"""The catalogue of findings and what the code finds are the same."""

import ast
from pathlib import Path
from string import Formatter

import pytest

import vsalog
from vsalog.checks import checks
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import TEXTS, add_texts, sentence

checks()  # their files add texts to the catalogue


def codes_made():
    """Return the codes that stand in the source, wherever a finding is made, with all strings of those files."""
    made = {}
    for path in Path(vsalog.__file__).parent.rglob("*.py"):
        if path.name == "finding_texts.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        tree.body = [
            n for n in tree.body if not (isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "TEXTS")
        ]
        nodes = list(ast.walk(tree))
        strings = {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
        keywords = (k for n in nodes if isinstance(n, ast.Call) for k in n.keywords if k.arg == "code")
        words = {c.value for k in keywords for c in ast.walk(k.value) if isinstance(c, ast.Constant)}
        # Some stand in a table of codes, or are handed on.
        for word in (words & strings) | (strings & TEXTS.keys()):
            made[word] = made.get(word, set()) | strings
    return made


def test_every_code_has_its_text_and_every_text_is_used():
    assert set(codes_made()) == set(TEXTS)


def test_every_field_of_a_text_is_evidence_where_its_code_stands():
    for code, strings in codes_made().items():
        fields = {field for _, field, _, _ in Formatter().parse(TEXTS[code].says + TEXTS[code].advice) if field}
        # Which clock is used instead of a doubtful one is added where it is chosen.
        later = {"used"} if code.startswith("clock.") else set()
        assert fields <= strings | {"joint", "part", "value", "limit", "unit"} | later, code


def test_a_sentence_names_the_joint_and_fills_in_the_numbers():
    finding = Finding(code="estimate.partly_excited", joint="elbow", part="2", value=0.25, limit=0.5)
    words = sentence(finding)
    assert words.startswith("joint 'elbow': ")
    assert "25%" in words
    assert "{" not in words


def test_what_a_log_calls_its_joint_is_no_format():
    assert "{value.__class__}" in sentence(Finding(code="deflection.still", joint="{value.__class__}", part="1"))


def test_a_code_has_one_text():
    with pytest.raises(ValueError, match=r"stiffness\.scale"):
        add_texts({"stiffness.scale": Text("another one")})
