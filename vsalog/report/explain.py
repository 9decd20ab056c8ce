"""Document of `explain`: the catalogues' texts on findings and causes, of which the reference's pages are made, too."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.checks import checks
from vsalog.core.errors import VsalogError, did_you_mean
from vsalog.core.finding_texts import TEXTS
from vsalog.core.printable import plural
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Cause, Setting, Site
from vsalog.report.document import Block, Document, Facts, Section, Table, Words
from vsalog.residuals.sensing import at_joint
from vsalog.rig import Rig

FIELD = re.compile(r"{(\w+)(?::[^}]*)?}")
COUNTED = re.compile(r"{(\w+):n ([^}]*)}")
EQUATIONS = ("motor", "secondary_motor", "motor_1", "motor_2", "transmission", "link")
SERVO = """
[joint.servo]
kind = "rigid"
motor = { inertia = 0.01 }
drive = { kind = "position-servo", kp = 10.0 }
signals = { commanded_position = "command", link_position = "position" }
"""
MUSCLES = ("seesaw", "transmission", "pressure_1", "pressure_2")


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a catalogue has of a finding's code or of a cause.

    Attributes
    ----------
    name : the code, or the cause's name
    kind : "finding" or "cause"
    texts : paragraphs, with fields that a finding fills in as ⟨name⟩
    facts : what else, each with what it is
    """

    name: str
    kind: str
    texts: tuple[str, ...]
    facts: Mapping[str, str]


def explained_findings() -> dict[str, Explanation]:
    """Return code → explanation, by code."""
    checks()  # their files add texts to the catalogue
    return {code: _of_finding(code) for code in sorted(TEXTS)}


def explained_causes() -> dict[str, Explanation]:
    """Return name → explanation, by name."""
    return {name: _of_cause(cause) for name, cause in sorted(catalogue().items())}


def _of_finding(code: str) -> Explanation:
    text = TEXTS[code]
    facts = {} if text.false_alarm is None else {"False-alarm rate": f"{text.false_alarm:g}."}
    return Explanation(code, "finding", tuple(map(_plain, filter(None, (text.says, text.advice)))), facts)


def _plain(words: str) -> str:
    """Return a text with the names of its fields in place of formats."""
    return FIELD.sub(r"⟨\1⟩", COUNTED.sub(lambda found: f"⟨{found[1]}⟩ {plural(2, found[2])[2:]}", words))


def _of_cause(cause: Cause) -> Explanation:
    site = _first_site(cause)
    told = site.reported([p.start for p in site.parameters]) if site is not None else {}
    numbers = ", ".join(f"`{name}`" + ("" if unit == "1" else f" [{unit}]") for name, (_, unit) in told.items())
    part = {"sensor": "sensor", "pneumatic": "muscle"}.get(cause.name.split(".")[0], cause.name.split(".")[0])
    fields = {"part": part, **{name: f"the {name} found" for name in told}}
    title = _filled(cause.title, fields)
    facts = {
        "Shows so": f"{_filled(cause.says, fields)}.",
        "Signature": cause.signature,
        "Parameters": numbers or "none",
        "To confirm it": _filled(cause.confirm, fields),
        "Reference": cause.reference,
    }
    return Explanation(cause.name, "cause", (f"{title[0].upper()}{title[1:]}.",), facts)


def _filled(template: str, fields: Mapping[str, str]) -> str:
    for name, words in fields.items():
        template = template.replace(f"{{{name}}}", words)
    return template


def _settings() -> Iterator[Setting]:
    """Yield joints of each kind with all their roles recorded, so that every cause has a place somewhere."""
    rigs = {"sea": EQUATIONS, "awas": EQUATIONS, "vsa2": EQUATIONS, "pam": MUSCLES, SERVO: EQUATIONS}
    for rig, equations in rigs.items():
        joint = at_joint(next(iter(Rig.load(rig).joints.values())))
        wave = 1e5 * np.stack([np.sin(k + np.linspace(0.0, 6.0, 100)) + 2.0 for k in range(3)])
        roles = dict.fromkeys((*offered_roles(joint), "motor_torque", "secondary_torque"), wave)
        phi = dict.fromkeys(("", "_1", "_2"), wave[0])
        yield Setting(joint, roles, 1e-3, 0.1, phi, phi, equations)


def _first_site(cause: Cause) -> Site | None:
    """Return the cause at the first place where it may sit, in its simplest form."""
    return next((site for setting in _settings() for site in cause.sites(setting)), None)


def names_document() -> Document:
    """Return the names that can be explained, each with its first sentence."""
    blocks = []
    for title, found in (("Causes", explained_causes()), ("Findings", explained_findings())):
        blocks.append(Table(title, ("", ""), tuple((one.name, one.texts[0]) for one in found.values()), texts=2))
    return Document("Explanations", "What can be explained", tuple(blocks))


def explain_document(names: Sequence[str]) -> Document:
    """Return the explanations of codes and causes.

    Raises
    ------
    VsalogError
        There is no such finding or cause; the nearest names are suggested.
    """
    known = explained_findings() | explained_causes()
    for name in names:
        if name not in known:
            near = did_you_mean(name, known) or "."
            raise VsalogError(
                f"there is neither a finding nor a cause named '{name}'{near} 'vsalog explain --list' lists them"
            )
    found = [known[name] for name in dict.fromkeys(names)]
    blocks: list[Block] = [Section(e.name, (*map(Words, e.texts), Facts(tuple(e.facts.items())))) for e in found]
    return Document(
        ", ".join(e.name for e in found), "Explanation", tuple(blocks), {"explanations": [asdict(e) for e in found]}
    )
