"""Every estimator has a page, every page tells all there is to tune and nothing else, and links lead somewhere."""

import re
import unicodedata
from pathlib import Path

import pytest

from vsalog.core.trace import EXTRA_UNITS, UNITS
from vsalog.estimators.device import device_of
from vsalog.estimators.registry import built_in, method
from vsalog.rig.load import Rig

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = DOCS / "explanation" / "estimators"
SECTIONS = (
    "What it estimates",
    "What it needs",
    "What it assumes",
    "Equations",
    "Columns it adds",
    "Tuning",
    "How it fails",
    "Uncertainty",
    "Example",
)


def page(name):
    return (PAGES / f"{name}.md").read_text(encoding="utf-8")


def section(text, title):
    return text.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]


def table(text):
    """Return the cells of the rows of all tables of a text, without their heads."""
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in re.findall(r"^\|(.*)\|$", text, re.M)]
    return [row for i, row in enumerate(rows) if not set(row[0]) <= set("- ") and not _is_head(rows, i)]


def _is_head(rows, i):
    return i + 1 < len(rows) and set(rows[i + 1][0]) <= set("- ") and rows[i + 1][0] != "" and "-" in rows[i + 1][0] * 2


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


def anchors(path):
    """Return what links into a page may point to, as GitHub makes it of headings."""
    found = set()
    for title in re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M):
        kept = "".join(
            c
            for c in title.lower()
            if c in "-_ " or unicodedata.category(c)[0] in "LN" or unicodedata.category(c) == "Mn"
        )
        found.add(kept.replace(" ", "-"))
    return found


def test_every_estimator_has_a_page_and_every_page_an_estimator():
    assert {path.stem for path in PAGES.glob("*.md")} == {*built_in(), "index"}


@pytest.mark.parametrize("name", built_in())
def test_a_page_has_the_sections_of_all_pages(name):
    text = page(name)
    assert text.startswith(f"# {name}\n")
    assert tuple(re.findall(r"^## (.*)$", text, re.M)) == SECTIONS


@pytest.mark.parametrize("name", built_in())
def test_a_page_tells_all_there_is_to_tune_and_nothing_else(name):
    told = [n for row in table(section(page(name), "Tuning")) for n in names(row[0])]
    kind = method(name).TUNING
    assert sorted(told) == sorted(set(kind.__struct_fields__) - set(kind.unused))


@pytest.mark.parametrize("name", built_in())
def test_a_page_s_default_values_are_those_of_the_code(name):
    """Where a default is a plain number, word or truth value; one that is derived from the log is reported in words."""
    kind = method(name).TUNING
    defaults = dict(zip(kind.__struct_fields__, kind.__struct_defaults__, strict=True))
    checked = 0
    for row in table(section(page(name), "Tuning")):
        for field in names(row[0]):
            default, told = defaults[field], row[1].strip("`").removesuffix(" s")
            if default is None or told == "–":
                continue
            checked += 1
            if isinstance(default, bool):
                assert told == str(default).lower(), field
            elif isinstance(default, int | float):
                assert float(told) == default, field
            else:
                assert told == default, field
    assert checked


@pytest.mark.parametrize("name", built_in())
def test_a_page_has_what_the_paper_prints(name):
    """Each printed value stands in its row; a page of a method that offers none says that `--preset-tuning paper` is refused."""
    printed = getattr(method(name), "printed", None)
    text = section(page(name), "Tuning")
    if printed is None:
        assert "`--preset-tuning paper` is refused" in text
        return
    rows = {field: row[3] for row in table(text) for field in names(row[0])}
    for preset, joint in (("sea", "sea"), ("awas", "awas")):
        for field, value in printed(device_of(joint, Rig.preset(preset).joints[joint])).items():
            told = {word.strip("`,;.:") for word in rows[field].split()}
            assert value in told or any(_equal(value, word) for word in told), (field, value, rows[field])


def _equal(value, word):
    try:
        return float(value) == float(word)
    except ValueError:
        return False


@pytest.mark.parametrize("name", built_in())
def test_a_page_s_columns_exist_and_have_their_units(name):
    for row in table(section(page(name), "Columns it adds")):
        for column in names(row[0]):
            if column in ("_std", "coefficient_0"):
                continue
            assert column in EXTRA_UNITS or column in UNITS, column
            unit = {**UNITS, **EXTRA_UNITS}[column].replace("*", "·").replace("^2", "²") or "–"
            assert row[1] == unit, column


def test_every_further_column_stands_on_a_page():
    sections = [section(page(name), "Columns it adds") for name in built_in()]
    sections.append(section(page("index"), "Columns that all add"))
    told = {c for text in sections for row in table(text) for c in names(row[0])}
    assert {column.removesuffix("_std") for column in EXTRA_UNITS} <= {column.removesuffix("_std") for column in told}


@pytest.mark.parametrize("name", built_in())
def test_an_example_runs_the_estimator_on_what_comes_with_vsalog(name):
    commands = re.findall(r"^    vsalog (.*)$", section(page(name), "Example"), re.M)
    assert any(f"-e {name}" in command for command in commands)
    for log in re.findall(r"sample_logs/\S+", " ".join(commands)):
        assert (ROOT / log).exists(), log


@pytest.mark.parametrize("name", built_in())
def test_the_table_of_methods_and_the_readme_have_it(name):
    assert f"[{name}]({name}.md)" in page("index")
    assert f"`{name}`" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "path", [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))], ids=lambda p: str(p.relative_to(ROOT))
)
def test_relative_links_lead_somewhere(path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        assert target.exists(), link
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), link
