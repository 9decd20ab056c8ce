"""Store results of batteries and write their tables into docs/diagnosis.md: ``python -m docs.make_battery [BATTERY …]``.

Each BATTERY is a folder that ``make battery`` wrote. Its result replaces the one of the same family in docs/battery; without a
BATTERY the tables are made from the stored results.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.hidden_effects.family_report import curve, pooled, table
from tests.hidden_effects.report import numbers_table

HERE = Path(__file__).parent
KEPT, PAGE = HERE / "battery", HERE / "diagnosis.md"
BEGIN, END = "<!-- written by python -m docs.make_battery -->", "<!-- end of what docs.make_battery writes -->"
# What each family is, in the order of the page.
FAMILIES = {
    "messy": ("Several things wrong at once", "Three to eight causes at once in one machine."),
    "model-error": (
        "Model error",
        "Three to five causes, together with one or two effects that the catalogue lacks (a flexible base, torque ripple,\n"
        "friction that depends on position or warms up, jittering stamps, a filter in the drive), far above the sensors' noise.",
    ),
    "closed-loop": ("Closed loop", "Position servos with a quantised command."),
    "low-rate": ("Low sample rate", "100 to 250 Hz."),
    "coarse": ("Coarse encoders", "2000 counts per turn."),
    "short": ("Short logs", "Five seconds."),
    "stick-slip": ("Stick-slip", "Friction that holds for moments, at low speed."),
    "gaps": ("Gaps and irregular rates", "Several causes; samples are missing, and stamps are not even."),
    "current": ("Motor currents", "A current, and a torque constant that is not known."),
    "rigid": ("Rigid joints", "One encoder and the motor's torque."),
    "bench": ("Benches", "Deflection and torque sensor only."),
}  # fmt: skip


def keep(battery: Path) -> None:
    """Keep what a battery found, without its cases."""
    found = json.loads((battery / "battery.json").read_text(encoding="utf-8"))
    about = {"seed": found["seed"], "version": found["version"]}
    for own in found["families"]:
        name = own["family"] if own["engine"] == "own" else f"{own['family']}-{own['engine']}"
        _write(name, about | {k: v for k, v in own.items() if k != "cases"})
    if found["cases"]:
        _write("alone", about | {"count": len(found["cases"]), "numbers": found["numbers"]})


def _write(name: str, found: dict[str, Any]) -> None:
    KEPT.mkdir(exist_ok=True)
    text = json.dumps(found, indent=1, ensure_ascii=False)
    (KEPT / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def section() -> str:
    """Return the tables of all that is kept, as Markdown."""
    kept = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(KEPT.glob("*.json"))}
    families = [found for found in kept.values() if "reliability" in found]
    return "\n".join([BEGIN, "", *_confidence(families), *_alone(kept.get("alone")), *_families(kept), END])


def _confidence(families: list[dict[str, Any]]) -> Iterator[str]:
    families = [found for found in families if "class_reliability" in found]
    machines = sum(found["count"] for found in families)
    sizes = np.repeat(*np.array([[int(k), n] for f in families for k, n in f["class_sizes"].items()]).T)
    names = sorted({found["family"] for found in families})
    yield f"### Confidence of {machines} machines\n"
    yield f"Of the families {', '.join(names)}. Classes have {np.median(sizes):g} member in the median, at most {sizes.max()}.\n"
    yield f"A cause is right where it is hidden itself:\n\n{curve(pooled([found['reliability'] for found in families]))}"
    together = pooled([found["class_reliability"] for found in families])
    yield f"A class is right where one of its members is hidden (a cause without a class is a class of one):\n\n{curve(together)}"


def _alone(found: dict[str, Any] | None) -> Iterator[str]:
    if found:
        yield f"### One effect, two, none, fewer roles\n\n    make battery SEED={found['seed']}\n"
        yield numbers_table(found["numbers"])


def _families(kept: dict[str, dict[str, Any]]) -> Iterator[str]:
    for family, (title, what) in FAMILIES.items():
        for own in kept.values():
            if own.get("family") != family:
                continue
            engine = "" if own["engine"] == "own" else f" ENGINE={own['engine']}"
            yield f"### {title}{', simulated by MuJoCo' if engine else ''}\n"
            yield f"    make battery FAMILY={family} SEED={own['seed']} CASES={own['count']}{engine}\n"
            yield f"{what}\n\n{table(own)}"


def page() -> str:
    """Return the text of docs/diagnosis.md with the tables of the stored results."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return before + section() + rest.split(END)[1]


if __name__ == "__main__":
    for folder in sys.argv[1:]:
        keep(Path(folder))
    PAGE.write_text(page(), encoding="utf-8")
