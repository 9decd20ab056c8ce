"""TOML of others is parsed, or refused in a line, in little time and memory."""

import time
import tomllib
import tracemalloc
from contextlib import suppress

import pytest
from command_line import vsalog_run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vsalog.core.toml import parse_toml

LONG = ".".join(["a"] * 4000)


def test_a_key_of_thousands_of_parts_is_refused_before_it_is_parsed():
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=r"a key has more than 32 parts \(at line 2"):
            parse_toml(f"x = 1\njoint.{LONG} = 1")
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "form", ["{} = 1", "[{}]", "[[{}]]", "x = {{ {} = 1 }}", "x = [{{ {} = 1 }}]", "x.'y' . {} = 1"]
)
@pytest.mark.parametrize("parts", [["a"], ['"a.b"'], ["'#'"], ["a", '"\\""'], ["1", "b c".replace(" ", " . ")]])
def test_such_keys_are_found_wherever_they_stand(form, parts):
    with pytest.raises(ValueError, match="more than 32 parts"):
        parse_toml(form.format(" . ".join(parts * 40)))


@pytest.mark.parametrize(
    "text",
    [
        f"# {LONG}",
        f'x = "{LONG}"',
        f"x = '{LONG}'",
        f'x = """\n{LONG}\n"""',
        f"x = '''\n{LONG}\n'''",
        f'x = """\n\\"""{LONG} " {LONG}"""',
        "x = [" + "1.5, " * 1000 + "]",
        ".".join(["a"] * 32) + " = 1",
        f'"{LONG}" = 1',
    ],
)
def test_what_only_looks_like_one_is_read(text):
    assert parse_toml(text) == tomllib.loads(text)


@pytest.mark.parametrize(
    "piece",
    ['"""', '\\"', '"\\"', "'''", '"""\\', "a.", "a .\t", "a ", ". ", '"a".', "'", "#", "\n", "[", "{a=", "[[a.b]]\n"],
)
@pytest.mark.parametrize("begin", ["", '"', "x = ", 'x = """'])
def test_a_quarter_of_a_mebibyte_of_anything_takes_seconds(begin, piece):
    text = (begin + piece * 2**20)[: 2**18]
    before = time.process_time()
    with suppress(ValueError):
        parse_toml(text)
    assert time.process_time() - before < 10


BITS = st.sampled_from(
    [
        *"a.[]{}=,#'\" \n\\x1-:",
        '"""',
        "'''",
        "joint",
        "elbow",
        "kind",
        "[joint.elbow]\n",
        " = ",
        "1.5",
        "true",
        "\u00e4",
        "\x1b",
    ]
)


@settings(max_examples=300, deadline=None)
@given(st.lists(BITS, max_size=40).map("".join))
def test_what_is_read_is_what_the_standard_library_reads(text):
    try:
        expected = tomllib.loads(text)
    except ValueError:
        with pytest.raises(ValueError, match=r"."):
            parse_toml(text)
    else:
        assert parse_toml(text) == expected


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(BITS, min_size=1, max_size=40).map("".join), st.sampled_from(["rig", "scenario", "model"]))
def test_odd_structure_ends_with_one_line(tmp_path, text, what):
    path = tmp_path / f"odd.{what}.toml"
    path.write_text(f"odd = 1\n{text}", encoding="utf-8")  # a scenario may be empty
    command = {
        "rig": ("simulate", str(path), "-o", "out.csv"),
        "scenario": ("simulate", "vsa2", "--scenario", str(path), "-o", "out.csv"),
        "model": ("validate", str(path), str(path)),
    }[what]
    done = vsalog_run(*command, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out.csv").exists()
