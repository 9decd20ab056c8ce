"""Which rig a command used, in words."""

from __future__ import annotations

from vsalog.core.printable import printable
from vsalog.rig.find import RigFound


def rig_words(found: RigFound, verbose: bool = False) -> str:
    """Return which rig is used, and where it is from; with its whole path on request."""
    path = "" if found.path is None else printable(str(found.path.resolve() if verbose else found.path))
    if found.place == "given":
        # A user who names a rig knows the others.
        also = f"; {_named(found)} not used" if found.others else ""
        return f"rig: {path or found.where}{also}"
    origin = {
        "next to log": f"{path} (found next to the log)",
        "log": found.where.removeprefix("rig "),
        "model": f"{found.where} (none in or next to the log)",
        "guessed": "guessed from the names of the channels (none in or next to the log)",
    }
    return f"rig: {origin[found.place]}"


def unused_rigs_words(found: RigFound) -> str:
    """Return a warning that another rig than the used one was found; "" where there is none."""
    if not found.others or found.place == "given":
        return ""
    first = printable(str(found.others[0]))
    return f"{_named(found)} there and differs from the rig that is used; --rig {first} uses it"


def _named(found: RigFound) -> str:
    names = " and ".join(printable(str(path)) for path in found.others)
    return f"{names} {'is' if len(found.others) == 1 else 'are'}"
