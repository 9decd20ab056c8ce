"""Names that mean harm, everywhere a log and its rig can carry one: no markup, no script, no order to the terminal, no path."""

import json
import os
from html.parser import HTMLParser

import numpy as np
import pytest
from command_line import vsalog_run

MARKUP = "</script><script>alert(1)</script><img src=x onerror=alert(2)> \"'` <!-- ]]> &lt; ../../x"
RIG = """
name = {name}
[joint.{joint}]
kind = "elastic"
[joint.{joint}.motor]
inertia = 0.1
[joint.{joint}.signals]
motor_position = {theta}
motor_torque = {tau}
link_position = {q}
torque_sensor = {sensor}
"""
PLAIN = {
    "name": "rig",
    "joint": "knee",
    "theta": "theta",
    "tau": "tau",
    "q": "q",
    "sensor": "sensor",
    "log": b"log.csv",
}
HOSTILE = {key: f"{key}{MARKUP}" for key in PLAIN} | {"log": b"log\n\xff\x1b[31m<img src=x onerror=alert(3)>\"'&.csv"}
COMMANDS = {
    "estimate": ["estimate", "LOG", "-e", "direct", "--report", "page.html", "-o", "out.stiffness.parquet"],
    "validate": ["validate", "out.model.toml", "LOG", "--no-modalities"],
    "diagnose": ["diagnose", "LOG"],
    "inspect": ["inspect", "LOG"],
    "inspect --json": ["inspect", "LOG", "--json", "--head", "2"],
    "init": ["init", "LOG", "-o", "new.rig.toml"],
    "repair": ["inspect", "LOG", "--repair", "repaired.mcap"],
}
WRITES = {"estimate": "page.html", "validate": "report.html", "diagnose": "diagnosis.html"}
LIKE_PLAIN = ("estimate", "validate")  # to diagnose takes long


class Elements(HTMLParser):
    """The elements of a page and the names of their attributes, without what they say."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, *(name for name, _ in attrs)))


def lay(folder, names):
    folder.mkdir()
    t = np.arange(1000) * 2e-3
    theta, q = 0.3 * np.sin(6.0 * t) + 0.05 * np.sin(17.0 * t), 0.4 * np.sin(6.0 * t + 0.3)
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((4, t.size)) * 1e-4
    spring = 20.0 * (q - theta)
    torque = -0.1 * (36 * 0.3 * np.sin(6.0 * t) + 289 * 0.05 * np.sin(17.0 * t)) - spring
    columns = np.array([theta, torque, q, spring]) + noise
    header = ",".join(["time", *('"{}"'.format(names[k].replace('"', '""')) for k in ("theta", "tau", "q", "sensor"))])
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.column_stack([t, *columns]))
    (folder / os.fsdecode(names["log"])).write_text(f"{header}\n{rows}\n")
    quoted = {key: json.dumps(names[key]) for key in names if key != "log"}
    (folder / "rig.toml").write_text(RIG.format(**quoted))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What the commands say and write of a log with plain names and of one with hostile ones: code, stdout, stderr, files."""
    found = {}
    top = tmp_path_factory.mktemp("names")
    for kind, names in (("plain", PLAIN), ("hostile", HOSTILE)):
        lay(top / kind, names)
        for name, words in COMMANDS.items():
            if kind == "plain" and name not in LIKE_PLAIN:
                continue
            found[kind, name] = run([os.fsdecode(names["log"]) if w == "LOG" else w for w in words], top / kind)
    return found, top


def run(words, folder):
    """Run a command as a user does."""
    before = set(folder.rglob("*"))
    done = vsalog_run(*words, cwd=folder)
    return done.returncode, done.stdout, done.stderr, sorted(set(folder.rglob("*")) - before)


@pytest.mark.parametrize("name", COMMANDS)
def test_it_works_and_the_terminal_gets_nothing_to_obey(ran, name):
    code, out, err, files = ran[0]["hostile", name]
    assert code == 0, err
    assert "Traceback" not in err
    for text in (out, err):
        assert not [c for c in text if not c.isprintable() and c != "\n"]
    if name in LIKE_PLAIN:
        plain = ran[0]["plain", name]
        assert plain[0] == 0, plain[2]
        assert [p.name for p in files] == [p.name for p in plain[3]]
    assert all(p.is_relative_to(ran[1] / "hostile") for p in files)
    assert not list(ran[1].glob("x*"))


@pytest.mark.parametrize("name", WRITES)
def test_names_are_text_in_pages(ran, name):
    """The page has the same elements with the same attributes as one of plain names, and the names are in it."""
    hostile = (ran[1] / "hostile" / WRITES[name]).read_text(encoding="utf-8")
    elements = Elements(hostile).found
    if name in LIKE_PLAIN:
        assert elements == Elements((ran[1] / "plain" / WRITES[name]).read_text(encoding="utf-8")).found
    assert not [attribute for _, *attributes in elements for attribute in attributes if attribute.startswith("on")]
    assert not {tag for tag, *_ in elements} & {"img", "iframe", "object", "base", "form", "link"}
    assert "&lt;script&gt;alert(1)" in hostile
    assert "<script>alert" not in hostile
    assert "onerror=alert(3)>" not in hostile
    assert "\x1b" not in hostile
    assert "\x00" not in hostile
