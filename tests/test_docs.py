"""The documentation keeps up with the code."""

import doctest
import inspect
import pkgutil
import re
import runpy
from importlib import import_module
from pathlib import Path

import pytest

from vsalog.batch import records
from vsalog.cli import cli
from vsalog.core.finding_texts import TEXTS
from vsalog.core.trace import EXTRA_UNITS, UNITS
from vsalog.diagnosis import document as diagnosis
from vsalog.effects import effects
from vsalog.rig import Rig
from vsalog.rig.load import presets
from vsalog.validation import document as validation

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def test_every_command_and_option_is_in_the_reference():
    """`python docs/make_cli.py` writes it; click's own wording may differ from version to version."""
    folder = DOCS / "reference" / "cli"
    assert {path.stem for path in folder.glob("*.md")} == {"index", *cli.commands}
    for name, command in cli.commands.items():
        section = (folder / f"{name}.md").read_text(encoding="utf-8")
        for option in command.params:
            assert option.param_type_name == "argument" or option.opts[-1] in section, (name, option.name)


def test_every_column_is_documented():
    text = (DOCS / "reference" / "output.md").read_text(encoding="utf-8")
    for column in [*UNITS, *(c.removesuffix("_std") for c in EXTRA_UNITS)]:
        assert f"`{column}`" in text, column


def test_layouts_have_the_versions_that_readers_of_the_documents_know():
    """Raise a number here, and in the page on the document, when fields change their meaning."""
    assert (records.VERSION, diagnosis.VERSION, validation.VERSION) == (1, 2, 2)
    assert f"| `version` | {diagnosis.VERSION}," in (DOCS / "reference" / "diagnosis_json.md").read_text(
        encoding="utf-8"
    )


def test_every_preset_and_its_joints_are_in_the_rig_reference():
    text = (DOCS / "reference" / "rig" / "index.md").read_text(encoding="utf-8")
    listed = text.split("\nPresets: ")[1].split("\n\n")[0]
    for preset in presets():
        assert f"`{preset}`" in listed, preset
        for joint in Rig.load(preset).joints:
            assert f"`{joint}`" in listed, (preset, joint)


def test_the_links_of_the_readme_lead_somewhere():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert len(links) > 5
    for link in links:
        assert (ROOT / link).exists(), link


def test_every_public_name_has_a_docstring_and_is_in_the_reference():
    import vsalog

    reference = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "reference" / "api").glob("*.md"))
    for name in vsalog.__all__:
        if not name.startswith("__"):
            assert getattr(vsalog, name).__doc__, name
            assert reference.count(f":: vsalog.{name}\n") == 1, name


def examples():
    """Return the modules whose docstrings have examples."""
    found = (path for path in ROOT.glob("vsalog/**/*.py") if "\n    >>> " in path.read_text(encoding="utf-8"))
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in found]


@pytest.mark.parametrize("module", examples())
def test_examples_of_docstrings_print_what_they_say(module):
    tried = doctest.testmod(import_module(module))
    assert tried.attempted
    assert not tried.failed


def with_docstrings(page):
    """Return a page with the docstrings that the site puts into it."""
    for dotted in re.findall(r"^\.\. auto\w+:: (\S+)$", page, re.MULTILINE):
        thing = pkgutil.resolve_name(dotted)
        members = [m for name, m in vars(thing).items() if not name.startswith("_")] if isinstance(thing, type) else []
        page += "\n".join(inspect.getdoc(one) or "" for one in (thing, *members))
    return page


def test_no_page_is_longer_than_a_person_reads():
    texts = {path.relative_to(DOCS): path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md")}
    lengths = {path: len(with_docstrings(text).split()) for path, text in texts.items()}
    assert {path: words for path, words in lengths.items() if words > 2500} == {}


def test_no_line_begins_with_a_percent_sign():
    """MyST takes such a line for a comment, and leaves it out of the site."""
    lines = {path.relative_to(DOCS): path.read_text(encoding="utf-8").splitlines() for path in DOCS.rglob("*.md")}
    assert [path for path, found in lines.items() if any(line.lstrip().startswith("%") for line in found)] == []


@pytest.mark.parametrize(
    ("maker", "folder"), [("battery", "performance/diagnosis"), ("findings", "reference/findings")]
)
def test_generated_pages_are_current(maker, folder):
    made = runpy.run_path(str(DOCS / f"make_{maker}.py"))["pages"]()
    kept = {path.stem: path.read_text(encoding="utf-8") for path in (DOCS / folder).glob("*.md")}
    assert kept == made, f"run: python -m docs.make_{maker}"


def test_the_table_of_plans_is_what_is_kept():
    made = runpy.run_path(str(DOCS / "make_plan.py"))["page"]()
    kept = (DOCS / "performance" / "planning.md").read_text(encoding="utf-8")
    assert kept == made, "run: python -m docs.make_plan --causes 0"


def test_the_page_on_clocks_names_findings_that_there_are():
    named = re.findall(r"`((?:clock|recording)\.\w+)`", (DOCS / "reference" / "clocks.md").read_text(encoding="utf-8"))
    assert len(named) > 8
    assert set(named) <= set(TEXTS)


def test_the_page_on_models_names_every_key_that_has_a_counterpart():
    text = (DOCS / "how-to" / "export.md").read_text(encoding="utf-8")
    for effect in effects().values():
        for key in (key for told in effect.counterparts for key in told.keys):
            assert f"`{key}`" in text, key
