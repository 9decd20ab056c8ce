"""The catalogue of findings and what the code finds are the same."""

import ast
from pathlib import Path
from string import Formatter

import pytest

import vsalog
from vsalog.checks import checks
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import TEXTS, add_texts, merged, sentence

checks()  # their files add texts to the catalogue


def codes_made():
    """Return the codes that stand in the source, wherever a finding is made, with all strings of those files."""
    made = {}
    for path in Path(vsalog.__file__).parent.rglob("*.py"):
        if path.name == "finding_texts.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        tree.body = [
            n
            for n in tree.body
            if not (isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") in ("TEXTS", "SYMPTOMS"))
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


def test_what_one_cause_makes_is_reported_with_it():
    def of(code, joint="a", **more):
        fields = {f for _, f, _, _ in Formatter().parse(TEXTS[code].says + TEXTS[code].advice) if f}
        evidence = dict.fromkeys(fields - {"part", "value", "limit", "unit", "joint"}, 1.0)
        return Finding(
            **{"code": code, "joint": joint, "part": "1", "value": 1.0, "limit": 1.0, "evidence": evidence} | more
        )

    cause, one, other = of("signal.sign"), of("stiffness.changed"), of("sampling.too_slow")
    void = of("estimate.never_excited", severity="invalidates")
    elsewhere = of("stiffness.changed", joint="b")
    told = merged([one, void, other, cause, elsewhere])
    assert [severity for severity, _ in told] == ["invalidates", "warning", "warning"]
    (words,) = [words for _, words in told if words.startswith("joint 'a': 1 has")]
    assert "stiffness.changed sampling.too_slow" in words
    assert any(words.startswith("joint 'b'") for _, words in told)
    # Without a cause each stands for itself.
    assert len(merged([one, other, elsewhere])) == 3 - 1  # of two joints alike


def test_what_several_joints_have_alike_is_reported_once():
    def of(joint, left):
        return Finding(code="signal.sign", joint=joint, part="motor_torque", evidence={"left": left})

    ((_, words),) = merged([of("a", 0.1), of("b", 0.2)])
    assert words.startswith("joints 'a', 'b': motor_torque has")
    assert "10.0%" in words
    assert "20.0%" not in words
    # Two of one joint are two.
    assert len(merged([of("a", 0.1), of("a", 0.2), of("b", 0.3)])) == 2


def test_what_may_follow_from_a_finding_is_a_finding():
    for code, text in TEXTS.items():
        assert set(text.explains) <= TEXTS.keys() - {code}
