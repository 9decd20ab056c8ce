"""What is found about a log, a joint's signals or a fit: a code and numbers. The words are in `finding_texts`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

Severity = Literal["info", "warning", "invalidates"]
Evidence = Mapping[str, float | int | str]


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """Something that a person who uses an estimate should know.

    Attributes
    ----------
    code : what it is, stable, `FAMILY.NAME`; docs/findings.md lists all
    joint : the joint's name; "" where it is about the whole log
    part : the transmission or the roles that it is about; "" where it is about the whole joint
    severity : `invalidates` where the estimate is not to be used
    value : the number that was compared
    limit : what it was compared with; None where nothing was
    unit : of both; "" where they have none
    evidence : what else was measured, by name
    """

    code: str
    joint: str = ""
    part: str = ""
    severity: Severity = "warning"
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    evidence: Evidence = {}
