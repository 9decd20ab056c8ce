"""The documentation keeps up with the code."""

import re
import runpy
from pathlib import Path

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


def test_every_command_and_option_is_in_the_reference():
    """`python docs/make_cli.py` writes it; click's own wording may differ from version to version."""
    text = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    for name, command in cli.commands.items():
        section = text.split(f"## vsalog {name}\n")[1].split("\n## ")[0]
        for option in command.params:
            assert option.param_type_name == "argument" or option.opts[-1] in section, (name, option.name)


def test_every_column_is_documented():
    text = (ROOT / "docs" / "output.md").read_text(encoding="utf-8")
    for column in [*UNITS, *(c.removesuffix("_std") for c in EXTRA_UNITS)]:
        assert f"`{column}`" in text, column


def test_layouts_have_the_versions_that_readers_of_the_documents_know():
    """Raise a number here, and in the page on the document, when fields change their meaning."""
    assert (records.VERSION, diagnosis.VERSION, validation.VERSION) == (1, 2, 2)
    assert f"| `version` | {diagnosis.VERSION}," in (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")


def test_every_preset_and_its_joints_are_in_the_rig_reference():
    text = (ROOT / "docs" / "rig.md").read_text(encoding="utf-8")
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


def test_every_public_name_has_a_docstring():
    import vsalog

    for name in vsalog.__all__:
        if not name.startswith("__"):
            assert getattr(vsalog, name).__doc__, name


def test_the_tables_of_batteries_are_those_that_are_kept():
    made = runpy.run_path(str(ROOT / "docs" / "make_battery.py"))["page"]()
    assert (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8") == made, "run: python -m docs.make_battery"


def test_the_table_of_plans_is_what_is_kept():
    made = runpy.run_path(str(ROOT / "docs" / "make_plan.py"))["page"]()
    assert (ROOT / "docs" / "plan.md").read_text(encoding="utf-8") == made, "run: python -m docs.make_plan --causes 0"


def test_every_finding_is_documented():
    made = runpy.run_path(str(ROOT / "docs" / "make_findings.py"))["reference"]()
    assert (ROOT / "docs" / "findings.md").read_text(encoding="utf-8") == made, "run: python docs/make_findings.py"


def test_the_page_on_clocks_names_findings_that_there_are():
    named = re.findall(r"`((?:clock|recording)\.\w+)`", (ROOT / "docs" / "clocks.md").read_text(encoding="utf-8"))
    assert len(named) > 8
    assert set(named) <= set(TEXTS)


def test_the_page_on_models_names_every_key_that_has_a_counterpart():
    text = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    for effect in effects().values():
        for key in (key for told in effect.counterparts for key in told.keys):
            assert f"`{key}`" in text, key
