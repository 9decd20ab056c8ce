"""Values that a shell completes: names that vsalog knows, and joints of the rig that a command would use."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import rich_click as click
from click.shell_completion import CompletionItem, split_arg_string

Completed = list[CompletionItem]
Completion = Callable[[click.Context, click.Parameter, str], Completed]


def names(known: Callable[[], Iterable[str]], or_file: bool = False, listed: bool = False) -> Completion:
    """Return a click callback that completes names.

    Parameters
    ----------
    known : returns all of them
    or_file : a file is accepted as well
    listed : several with commas between
    """

    def complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> Completed:
        before, comma, last = incomplete.rpartition(",") if listed else ("", "", incomplete)
        found = [CompletionItem(f"{before}{comma}{name}") for name in known() if name.startswith(last)]
        return found or ([CompletionItem(incomplete, type="file")] if or_file else [])

    return complete


def joints(context: click.Context, parameter: click.Parameter, incomplete: str) -> Completed:
    """Complete the joints of the rig that the line names, or that is in or next to a log that it names."""
    # While the value of an option is missing click has not parsed the arguments.
    words = split_arg_string(os.environ.get("COMP_WORDS", ""))[2:]
    after_rig = [value for option, value in pairwise(words) if option == "--rig"]
    for word in (*after_rig, *words):
        if found := [CompletionItem(name) for name in _joints_by(word) if name.startswith(incomplete)]:
            return found
    return []


def _joints_by(word: str) -> Iterable[str]:
    """Return the joints of a word of the command line: a preset, a rig file or a log; none for other words."""
    from vsalog.core.errors import VsalogError
    from vsalog.readers import open_reader
    from vsalog.rig.find import find_rig
    from vsalog.rig.load import Rig

    with suppress(VsalogError, OSError):
        if word in presets() or word.endswith(".toml"):
            return Rig.load(word).joints
        path = Path(word)
        rig = find_rig(path, open_reader(path).rig_text) if path.exists() else None
        return () if rig is None else rig.joints
    return ()


def estimators() -> Iterable[str]:
    """Return the names of all estimators."""
    from vsalog.estimators.registry import methods

    return methods()


def presets() -> Iterable[str]:
    """Return the names of the rigs that come with vsalog."""
    from vsalog.rig.load import presets as known

    return known()


def scenarios() -> Iterable[str]:
    """Return the names of the scenarios that come with vsalog."""
    from vsalog.simulation.scenario import built_in
    from vsalog.simulation.scenario_generic import GENERIC

    return [*built_in(), *GENERIC]


def causes() -> Iterable[str]:
    """Return the names of all causes."""
    from vsalog.diagnosis.causes import catalogue

    return catalogue()


def codes() -> Iterable[str]:
    """Return the codes of all findings."""
    from vsalog.checks import checks
    from vsalog.core.finding_texts import TEXTS

    checks()  # their files add texts to the catalogue
    return TEXTS


def reproducible() -> Iterable[str]:
    """Return the names of what can be reproduced."""
    from vsalog.reproduce.catalogue import ITEMS

    return ITEMS
