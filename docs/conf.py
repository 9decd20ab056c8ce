"""Settings of the documentation's site: `make docs` builds it."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

import vsalog  # noqa: E402

project = "vsalog"
author = copyright = "the vsalog developers"
release = version = vsalog.__version__

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_llms_txt",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
# Indented blocks are commands and their output: no language has all of it.
highlight_language = "none"

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc sections say the types
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_preprocess_types = False
# References in Markdown are checked by MyST; types in docstrings are words, as numpydoc has them.
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]

# Addresses outside are tested by `make linkcheck` alone, which needs a network.
linkcheck_timeout = 20
linkcheck_anchors = False

# furo: one column of text that fits a phone, tables that scroll by themselves, dark and light, five small packages.
html_theme = "furo"
html_title = f"vsalog {version}"
html_theme_options = {"navigation_with_keys": True}
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["site.css"]

# The site has no fixed address: links of llms.txt are relative to it.
llms_txt_uri_template = "_sources/{docname}{suffix}{sourcelink_suffix}"
llms_txt_title = "vsalog"
llms_txt_summary = (
    "vsalog turns recordings of compliant robot joints (MCAP, ROS bags, CSV, Parquet, MATLAB) into stiffness with its"
    " uncertainty, checks a fitted model against a second experiment, and finds what a simulation of the joint gets wrong."
)

ENTRY = re.compile(r"([*\w]+(?:, [*\w]+)*) : (.*)")
TYPE = re.compile(r"\w+(?: \w+){0,4}(?:, optional)?")


def describe(app, what, name, obj, options, lines):
    """Let `name : words` of a docstring be a description where numpydoc would take the words for a type."""
    for i in range(len(lines) - 1, -1, -1):
        entry = ENTRY.fullmatch(lines[i])
        typed = entry and TYPE.fullmatch(entry[2]) and i + 1 < len(lines) and lines[i + 1].startswith("    ")
        if entry and not typed:
            lines[i : i + 1] = [entry[1], f"    {entry[2]}"]


def setup(app):
    """Run before napoleon, which reads the sections."""
    app.connect("autodoc-process-docstring", describe, priority=400)
