"""`python -m tests.hidden_effects.generate --out DIR`: cases to look at, or to develop a diagnosis with.

A plan per case: clean logs, one effect, two effects, fewer roles, effects outside the catalogue.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from .cases import SIZES, VARIANTS, NotVisibleError, Plan, make_case, write_case
from .devices import ALL_DEVICES, DEVICES
from .effects import EFFECTS, OUTSIDE
from .families import ENGINES, FAMILIES

KINDS = ("clean", "single", "pair", "reduced", "outside")


@cache
def _applies(effect: str, device: str, roles: str = "full") -> bool:
    """Tell whether some machine of a device may have an effect, and whether it may be seen with those roles."""
    if device == "pneumatic" and roles == "no-link-encoder":
        return False
    machines = [DEVICES[device].random_machine(device, np.random.default_rng(seed)) for seed in range(8)]
    parts = {part for machine in machines for part in (EFFECTS | OUTSIDE)[effect].parts(machine)}
    return bool(parts - set(VARIANTS[roles]))


def plans(kind: str, count: int, seed: int, devices: tuple[str, ...] = tuple(DEVICES)) -> list[Plan]:
    """Lay out cases of a kind: every applicable cause of every device in turn, begun where the seed says.

    Parameters
    ----------
    kind : one of KINDS
    count : how many
    seed : of the battery
    devices : which
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    every = list(_every(kind, devices, rng))
    order = rng.permutation(len(every))
    chosen = islice(cycle(every[i] for i in order), count)
    drawn = rng.integers(0, 2**31, count)
    return [
        Plan(f"{kind}-{i:04d}", device, int(own), causes, outside, roles)
        for i, ((device, causes, outside, roles), own) in enumerate(zip(chosen, drawn, strict=True))
    ]


def family_plans(
    name: str, count: int, seed: int, devices: tuple[str, ...] | None = None, engine: str = "own"
) -> list[Plan]:
    """Lay out cases of a family: its devices in turn, of those that are asked for and the engine has."""
    family = FAMILIES[name]
    rng = np.random.default_rng([seed, len(KINDS), *name.encode()])
    own = [d for d in family.devices if (devices is None or d in devices) and d in ENGINES[engine]]
    drawn = [int(n) for n in rng.integers(0, 2**31, count)]
    out = []
    for i in range(count if own else 0):
        test, repeat = divmod(i, family.repeats)
        roles = family.roles[test // len(own) % len(family.roles)]
        more = {"roles": roles, "engine": engine, "family": name, "repeat": repeat}
        out.append(Plan(f"{name}-{i:04d}", own[test % len(own)], drawn[test], **more))
    return out


def _every(kind: str, devices: tuple[str, ...], rng: np.random.Generator) -> Iterator[tuple]:
    for device in devices:
        causes = [c for c in EFFECTS if _applies(c, device)]
        if kind == "clean":
            yield device, (), None, "full"
        elif kind == "single":
            yield from ((device, (c,), None, "full") for c in causes)
        elif kind == "reduced":
            for roles in list(VARIANTS)[1:]:
                yield from ((device, (c,), None, roles) for c in causes if _applies(c, device, roles))
        elif kind == "outside":
            yield from ((device, (), o, "full") for o in OUTSIDE if _applies(o, device))
        else:
            for first in causes:
                # Two effects of different families: both of one part of a joint may add up to the same thing.
                others = [c for c in causes if c.split(".")[0] != first.split(".")[0]]
                yield device, (first, str(rng.choice(others))), None, "full"


def make_and_write(plan: Plan, out: Path) -> str | None:
    """Make one case and write it; return why not."""
    try:
        write_case(make_case(plan), out)
    except NotVisibleError as error:
        return str(error)
    return None


def generate(all_plans: list[Plan], out: Path, workers: int = 2) -> list[str]:
    """Write all cases; return what could not be made."""
    out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(workers) as pool:
        outcomes = pool.map(make_and_write, all_plans, [out] * len(all_plans), chunksize=1)
        return [problem for problem in outcomes if problem is not None]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects.generate", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=[*KINDS, *FAMILIES], default="single")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--device", choices=list(ALL_DEVICES), action="append", help="default: all")
    parser.add_argument("--cause", choices=[*EFFECTS, *OUTSIDE], action="append", help="exactly these, one per case")
    parser.add_argument("--roles", choices=list(VARIANTS), default="full", help="with --cause")
    parser.add_argument("--size", type=float, nargs=2, default=SIZES, metavar=("LEAST", "MOST"), help="with --cause")
    parser.add_argument("--poor", action="store_true", help="with --cause: the machine hardly moves")
    parser.add_argument("--engine", choices=ENGINES, default="own", help="that simulates a family")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    given = parser.parse_args()
    devices = tuple(given.device or DEVICES)
    if given.cause:
        chosen = [
            Plan(
                f"{c}-{device}-{i}", device, given.seed * 1000 + i,
                (c,) if c in EFFECTS else (), None if c in EFFECTS else c, given.roles, tuple(given.size), given.poor,
            )
            for c in given.cause for device in devices for i in range(given.cases)
        ]  # fmt: skip
    elif given.kind in FAMILIES:
        chosen = family_plans(given.kind, given.cases, given.seed, given.device, given.engine)
    else:
        chosen = plans(given.kind, given.cases, given.seed, devices)
    problems = generate(chosen, given.out, given.workers)
    print(f"{len(chosen) - len(problems)} cases in {given.out}; the truth is in {given.out / 'sealed'}")
    for problem in problems:
        print(problem, file=sys.stderr)


if __name__ == "__main__":
    main()
