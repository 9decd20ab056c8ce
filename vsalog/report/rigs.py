"""Which rig a command used, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vsalog.core.errors import ReadError, VsalogError, WriteError
from vsalog.core.printable import printable
from vsalog.core.progress import watched
from vsalog.rig.find import RigFound


def rig_words(found: RigFound, verbose: bool = False) -> str:
    """Return which rig is used, and where it is from; with its whole path on request."""
    path = found.where if found.path is None else printable(str(found.path.resolve() if verbose else found.path))
    if found.place == "given":
        # A user who names a rig knows the others.
        also = f"; {_named(found)} not used" if found.others else ""
        return f"rig: {path}{also}"
    origin = {
        "next to log": f"{path} (found next to the log)",
        "log": found.where.removeprefix("rig "),
        "model": f"{found.where} (none in or next to the log)",
        "guessed": "guessed from the names of the channels (none in or next to the log)",
    }
    return f"rig: {origin[found.place]}"


@contextmanager
def rig_in_errors(words: Callable[[RigFound], str] = rig_words) -> Iterator[None]:
    """Note on the errors within which rig was used: it may be another experiment's.

    A log that cannot be read and a file that cannot be written are no fault of a rig.
    """
    used: list[RigFound] = []

    def hear(event: object) -> None:
        if isinstance(event, RigFound):
            used.append(event)

    with watched(hear):
        try:
            yield
        except VsalogError as error:
            if used and not isinstance(error, ReadError | WriteError):
                error.add_note(words(used[-1]))
            raise


def unused_rigs_words(found: RigFound) -> str:
    """Return a warning that another rig than the used one was found; "" where there is none."""
    if not found.others or found.place == "given":
        return ""
    first = printable(str(found.others[0]))
    return f"{_named(found)} there and differs from the rig that is used; --rig {first} uses it"


def _named(found: RigFound) -> str:
    names = " and ".join(printable(str(path)) for path in found.others)
    return f"{names} {'is' if len(found.others) == 1 else 'are'}"
