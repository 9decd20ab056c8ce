"""What all pages are: one HTML file that needs nothing else, and whose scripts are those whose checksums it names."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources

from vsalog.report.page_text import escaped


def framed(
    title: str, kind: str, policy: str, main: str, foot: str, scripts: str, style: str = "", tools: str = ""
) -> str:
    """Return a page's HTML.

    Parameters
    ----------
    title, kind : what the page is of and what it is, plain texts
    policy : the content security policy
    main, foot, tools : HTML of the page, below it, and next to its title
    scripts : elements
    style : CSS in addition to that of all pages
    """
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f"<title>{escaped(title)}</title>",
            f"<style>{asset('page.css')}{style}</style></head><body>",
            '<a class="skip" href="#main">Skip to the report</a>',
            f'<header><div><h1>{escaped(title)}</h1><p class="kind">{escaped(kind)}</p></div>{tools}</header>',
            f'<main id="main" tabindex="-1">{main}</main>',
            f"<footer>{foot}</footer>",
            f"{scripts}</body></html>\n",
        )
    )


def asset(file: str) -> str:
    """Return a file that pages are made of."""
    return resources.files("vsalog.report").joinpath(file).read_text(encoding="utf-8")


def checksum(text: bytes) -> str:
    """Return what a policy names a script or a style by."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text).digest()).decode('ascii')}'"
