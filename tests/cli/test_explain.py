"""Explanations: of every finding and cause, the same texts as the reference, by the names that messages print."""

import json
import re
import shlex

import pytest

from docs.make_causes import pages as causes
from docs.make_findings import pages as findings
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import TEXTS, merged

pytestmark = pytest.mark.share(2)


@pytest.mark.parametrize("pages", [findings, causes], ids=["findings", "causes"])
def test_the_command_says_what_the_reference_says(command, tmp_path, pages):
    text = "\n".join(page for name, page in pages().items() if name != "index")
    names = re.findall(r"^## (.+)$", text, re.MULTILINE)
    code, out, err = command("explain", *names, "--json", cwd=tmp_path)
    assert (code, err) == (0, "")
    found = json.loads(out)["explanations"]
    assert [one["name"] for one in found] == names
    for one, entry in zip(found, re.split(r"^## .+$", text, flags=re.MULTILINE)[1:], strict=True):
        for words in (*one["texts"], *one["facts"].values()):
            assert words in entry


def test_it_prints_for_people_as_well(command, tmp_path):
    code, out, _ = command("explain", "motor.cogging", "sensor.stuck", cwd=tmp_path)
    assert code == 0
    assert "motor.cogging" in out
    assert "{" not in out
    code, out, _ = command("explain", "--list", cwd=tmp_path)
    assert code == 0
    assert {"motor.cogging", "sensor.stuck"} <= {line.split()[0] for line in out.splitlines() if line.strip()}


@pytest.mark.parametrize("words", [(), ("motor.coging",), ("../../etc/passwd",)])
def test_what_is_not_known_is_refused(command, tmp_path, words):
    code, out, err = command("explain", *words, cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "explain --list" in err


def test_the_command_that_a_message_names_can_be_run(command, tmp_path):
    cause = next(code for code, text in TEXTS.items() if text.explains)
    follows = TEXTS[cause].explains[0]

    every = [Finding(code=code, value=1.0, limit=1.0, evidence=_evidence(code)) for code in (cause, follows)]
    ((_, words),) = merged(every)
    (suggested,) = re.findall(r"'(vsalog explain [^']+)'", words)
    code, out, _ = command(*shlex.split(suggested)[1:], "--json", cwd=tmp_path)
    assert code == 0
    assert [one["name"] for one in json.loads(out)["explanations"]] == [follows]


def _evidence(code):
    return dict.fromkeys(re.findall(r"{(\w+)", TEXTS[code].says + TEXTS[code].advice), 1.0)
