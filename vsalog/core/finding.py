"""A finding about a log, a joint's signals or a fit: a code and numbers. The words are in `finding_texts`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import msgspec

Severity = Literal["info", "warning", "invalidates"]
Evidence = Mapping[str, float | int | str]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A fact that matters to the user of an estimate.

    Attributes
    ----------
    code : stable name, `FAMILY.NAME`; docs/reference/findings lists all
    log : the log's name; "" where it is about all of them
    joint : the joint's name; "" where it is about the whole log
    part : the transmission or the roles that it is about, of a log the stream, column or file; "" where it is about the whole
    severity : `invalidates` where the estimate is not to be used
    value : the number that was compared
    limit : of the comparison; None where there was none
    unit : of both; "" where they have none
    evidence : what else was measured, by name
    """

    code: str
    log: str = ""
    joint: str = ""
    part: str = ""
    severity: Severity = "warning"
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    evidence: Evidence = {}


class Findings(list[Finding]):
    """Findings in the order in which they were made, each of them once."""

    def add(self, *found: Finding) -> None:
        """Add those that are missing."""
        known = {_key(one) for one in self} if found else set()
        for one in found:
            if (key := _key(one)) not in known:
                known.add(key)
                self.append(one)


def _key(one: Finding) -> tuple[object, ...]:
    return (one.code, one.log, one.joint, one.part, one.severity, one.value, one.limit, one.unit, *one.evidence.items())


@dataclass(frozen=True, slots=True)
class Text:
    """The words of a code.

    Attributes
    ----------
    says : what was found, sentences with the fields of the finding and of its evidence in braces; `{value:n row}` is
        "1 row" or "2 rows", `{name:q}` a word for a shell, quoted if it needs to be
    advice : what to do, or what follows from it, sentences too
    false_alarm : probability of the finding for a joint or a channel without the fault; None where none is derived
    explains : codes of findings that may follow from it: reported with it, in one sentence
    """

    says: str
    advice: str = ""
    false_alarm: float | None = None
    explains: tuple[str, ...] = ()


def of_log(log: str, findings: Iterable[Finding]) -> list[Finding]:
    """Return findings about a log with its name."""
    return [msgspec.structs.replace(one, log=log) for one in findings]
