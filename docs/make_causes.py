"""Writes docs/reference/causes from the classes of the catalogue: ``python docs/make_causes.py``."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Cause, Setting, Site
from vsalog.residuals.sensing import at_joint
from vsalog.rig import Rig

FOLDER = Path(__file__).parent / "reference" / "causes"
HEAD = """# Causes

Written by `python docs/make_causes.py` from the classes in `vsalog/diagnosis/causes`.
[Diagnosis](../../explanation/diagnosis.md) explains how causes are distinguished from one another.
"""
SIDES = {
    "motor": "Motor",
    "drive": "Drive",
    "transmission": "Transmission",
    "link": "Link",
    "sensor": "Sensors",
    "pneumatic": "Muscles",
}
EQUATIONS = ("motor", "secondary_motor", "motor_1", "motor_2", "transmission", "link")
SERVO = """
[joint.servo]
kind = "rigid"
motor = { inertia = 0.01 }
drive = { kind = "position-servo", kp = 10.0 }
signals = { commanded_position = "command", link_position = "position" }
"""
MUSCLES = ("seesaw", "transmission", "pressure_1", "pressure_2")


def settings() -> Iterator[Setting]:
    """Yield joints of each kind with all their roles recorded, so that every cause has a place somewhere."""
    rigs = {"sea": EQUATIONS, "awas": EQUATIONS, "vsa2": EQUATIONS, "pam": MUSCLES, SERVO: EQUATIONS}
    for rig, equations in rigs.items():
        joint = at_joint(next(iter(Rig.load(rig).joints.values())))
        wave = 1e5 * np.stack([np.sin(k + np.linspace(0.0, 6.0, 100)) + 2.0 for k in range(3)])
        roles = dict.fromkeys((*offered_roles(joint), "motor_torque", "secondary_torque"), wave)
        phi = dict.fromkeys(("", "_1", "_2"), wave[0])
        yield Setting(joint, roles, 1e-3, 0.1, phi, phi, equations)


def first_site(cause: Cause) -> Site | None:
    """Return the cause at the first place where it may sit, in its simplest form."""
    return next((site for setting in settings() for site in cause.sites(setting)), None)


def entry(cause: Cause) -> list[str]:
    """Return what is reported of a cause."""
    site = first_site(cause)
    told = site.reported([p.start for p in site.parameters]) if site is not None else {}
    numbers = ", ".join(f"`{name}`" + ("" if unit == "1" else f" [{unit}]") for name, (_, unit) in told.items())
    part = {"sensor": "sensor", "pneumatic": "muscle"}.get(cause.name.split(".")[0], cause.name.split(".")[0])
    filled = {name: f"the {name} found" for name in told}
    confirm = cause.confirm
    for name, words in filled.items():
        confirm = confirm.replace(f"{{{name}}}", words)
    title = cause.title.replace("{part}", part)
    return [
        f"## {cause.name}",
        "",
        f"{title[0].upper()}{title[1:]}.",
        "",
        f"- Shows so: {cause.says.replace('{part}', part)}.",
        f"- Signature: {cause.signature}",
        f"- Parameters: {numbers or 'none'}",
        f"- To confirm it: {confirm}",
        f"- Reference: {cause.reference}",
        "",
    ]


def page(side: str) -> str:
    """Return the causes of a side as Markdown."""
    own = [entry(cause) for name, cause in sorted(catalogue().items()) if name.startswith(f"{side}.")]
    return "\n".join([f"# Causes: {SIDES[side]}", "", *(line for lines in own for line in lines)])


def index() -> str:
    """Return the list of causes by side."""
    parts = [HEAD, "| side | causes |", "| --- | --- |"]
    for side, heading in SIDES.items():
        names = [name for name in sorted(catalogue()) if name.startswith(f"{side}.")]
        links = ", ".join(f"[{name.partition('.')[2]}]({side}.md#{name.replace('.', '')})" for name in names)
        parts.append(f"| [{heading}]({side}.md) | {links} |")
    return "\n".join([*parts, "", "```{toctree}", ":hidden:", "", *SIDES, "```", ""])


def pages() -> dict[str, str]:
    """Return the catalogue: name of a page → Markdown."""
    return {"index": index(), **{side: page(side) for side in SIDES}}


if __name__ == "__main__":
    for stem, text in pages().items():
        (FOLDER / f"{stem}.md").write_text(text, encoding="utf-8")
