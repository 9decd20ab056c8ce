"""Store results of batteries and write their tables into docs/performance/diagnosis: ``python -m docs.make_battery [BATTERY …]``.

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
KEPT, PAGES = HERE / "battery", HERE / "performance" / "diagnosis"
BEGIN, END = "<!-- written by python -m docs.make_battery -->", "<!-- end of what docs.make_battery writes -->"
# What each family is, in the order of the page.
FAMILIES = {
    "messy": ("Several faults at once", "Three to eight causes at once in one machine."),
    "model-error": (
        "Model error",
        "Three to five causes, together with one or two effects that the catalogue lacks (a flexible base, torque ripple,\n"
        "friction that depends on position or warms up, jittering stamps, a filter in the drive), far above the sensors' noise.",
    ),
    "closed-loop": ("Closed loop", "Position servos with a quantised command."),
    "low-rate": ("Low sample rate", "100 to 250 Hz."),
    "coarse": ("Coarse encoders", "2000 counts per turn."),
    "short": ("Short logs", "Five seconds."),
    "stick-slip": ("Stick-slip", "Friction that sticks repeatedly, at low speed."),
    "gaps": ("Gaps and irregular rates", "Several causes; missing samples and irregular stamps."),
    "current": ("Motor currents", "A current, and an unknown torque constant."),
    "rigid": ("Rigid joints", "One encoder and the motor's torque."),
    "bench": ("Benches", "Only deflection and torque sensor."),
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


def _kept() -> dict[str, Any]:
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(KEPT.glob("*.json"))}


def section(kept: dict[str, Any]) -> str:
    """Return the tables of all families together and of single effects, as Markdown."""
    families = [found for found in kept.values() if "reliability" in found]
    return "\n".join([BEGIN, "", *_confidence(families), *_alone(kept.get("alone")), END])


def _confidence(families: list[dict[str, Any]]) -> Iterator[str]:
    families = [found for found in families if "class_reliability" in found]
    machines = sum(found["count"] for found in families)
    sizes = np.repeat(*np.array([[int(k), n] for f in families for k, n in f["class_sizes"].items()]).T)
    names = sorted({found["family"] for found in families})
    yield f"## Confidence of {machines} machines\n"
    yield f"Of the families {', '.join(names)}. Classes have {np.median(sizes):g} member in the median, at most {sizes.max()}.\n"
    yield f"A cause is right if it is the hidden one:\n\n{curve(pooled([found['reliability'] for found in families]))}"
    together = pooled([found["class_reliability"] for found in families])
    yield f"A class is right if one of its members is hidden (a cause without a class is a class of one):\n\n{curve(together)}"


def _alone(found: dict[str, Any] | None) -> Iterator[str]:
    if found:
        yield f"## One effect, two, none, fewer roles\n\n    make battery SEED={found['seed']}\n"
        yield numbers_table(found["numbers"])


def family_page(family: str, kept: dict[str, Any]) -> str:
    """Return the page of a family: its machines, by each engine that simulated them."""
    title, what = FAMILIES[family]
    parts = [f"# {title}\n\nWritten by `python -m docs.make_battery`. {what}\n"]
    for own in (found for found in kept.values() if found.get("family") == family):
        engine = "" if own["engine"] == "own" else f" ENGINE={own['engine']}"
        parts.append(f"## Simulated by {'MuJoCo' if engine else 'equations of the test'}\n")
        parts.append(
            f"    make battery FAMILY={family} SEED={own['seed']} CASES={own['count']}{engine}\n\n{table(own)}"
        )
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """Return the pages with the tables of the stored results: name → Markdown."""
    kept = _kept()
    before, rest = (PAGES / "index.md").read_text(encoding="utf-8").split(BEGIN)
    index = before + section(kept) + rest.split(END)[1]
    return {"index": index, **{family: family_page(family, kept) for family in FAMILIES}}


if __name__ == "__main__":
    for folder in sys.argv[1:]:
        keep(Path(folder))
    for stem, text in pages().items():
        (PAGES / f"{stem}.md").write_text(text, encoding="utf-8")
