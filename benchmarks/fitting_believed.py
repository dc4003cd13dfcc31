"""Do the 95 % intervals of a fit hold the truth, and do starts that are 50 % off arrive?"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from fitting_cases import CASES, Case

import jaxmuscle as jm

LEAST, MOST = 0.90, 0.98
OFF = 0.5
ARRIVED = 0.95
FIRST_SEED = 1000
"""Of the recordings for the coverage: how standard deviations are made was tried on those below 100."""


def value_of(result: jm.FitResult, name: str) -> Any:
    """A parameter by the name that it was asked for."""
    found = result.parameters
    return found[name] if name in found else found[f"effects.{name}"]


def coverage(case: Case, repeats: int) -> dict[str, Any]:
    """Part of the intervals that hold the truth; one compilation serves all repeats."""
    true, begin = case.truth(), time.perf_counter()
    hits: dict[str, list[bool]] = {name: [] for name in true}
    for number in range(repeats * case.draws):
        recording = case.recording(FIRST_SEED + number)
        result = jm.fit(case.machine, recording, case.free, masks=case.masks, starts=case.starts)
        for name, value in true.items():
            low, high = value_of(result, name).interval()
            hits[name].append(low <= value <= high)
    each = {name: float(np.mean(values)) for name, values in hits.items()}
    ours = float(np.mean(list(each.values())))
    # Intervals of one recording hit or miss together.
    chance = np.std(np.mean(list(hits.values()), axis=0)) / np.sqrt(repeats * case.draws)
    row = {
        "figure": f"{case.rig}: part of the 95 % intervals that hold the truth",
        "goal": f"{LEAST} to {MOST}",
        "ours": ours,
        "of": repeats * case.draws * len(true),
        "by_chance": float(chance),
        "each": each,
        "ok": LEAST <= ours <= MOST,
        "seconds": time.perf_counter() - begin,
    }
    why = "the standard deviations are too small" if ours < LEAST else (
        "wider than need be: the largest of four standard deviations is taken"
    )  # fmt: skip
    return row if row["ok"] else {**row, "why": why}


def arriving(case: Case, starts: int) -> dict[str, Any]:
    """Part of the starts, every parameter 50 % too small or too large, that reach the best minimum."""
    true, rng, begin = case.truth(), np.random.default_rng(1), time.perf_counter()
    machine, recording = case.machine, case.recording(0)
    known = {name: name if name in machine.quantities else f"effects.{name}" for name in true}
    given = [
        {known[name]: value * (1 + OFF * rng.choice([-1, 1])) for name, value in true.items()}
        for _ in range(starts)
    ]
    result = jm.fit(machine, recording, case.free, masks=case.masks, starts=given)
    reached = sum(start.reached for start in result.starts)
    codes = [start.code for start in result.starts]
    best = min(start.cost for start in result.starts)
    row = {
        "figure": f"{case.rig}: part of the starts 50 % off that reach the best minimum",
        "goal": f">= {ARRIVED}",
        "ours": reached / starts,
        "of": starts,
        "ends": {code: codes.count(code) for code in dict.fromkeys(codes)},
        "costs_over_best": sorted(round(start.cost / best, 3) for start in result.starts),
        "ok": reached / starts >= ARRIVED,
        "seconds": time.perf_counter() - begin,
    }
    return row if row["ok"] else {**row, "why": "other minima, or places where no step lowers the cost"}


def chosen(rigs: Sequence[str] | None) -> list[Case]:
    """The cases of these rigs, of all when `None`."""
    unknown = set(rigs or ()) - set(CASES)
    if unknown:
        raise SystemExit(f"--rig: unknown {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    return [CASES[rig] for rig in rigs or CASES]


def believed(repeats: int, rigs: Sequence[str] | None = None) -> Iterator[dict[str, Any]]:
    """A row for every rig, or for some."""
    return (coverage(case, repeats) for case in chosen(rigs))


def arrived(starts: int, rigs: Sequence[str] | None = None) -> Iterator[dict[str, Any]]:
    """A row for every rig, or for some."""
    return (arriving(case, starts) for case in chosen(rigs))
