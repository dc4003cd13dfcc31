"""Is a diagnosis right on recordings that nobody has seen? Hundreds of fresh random ones, of known truth.

Rigs, constants, motions, effects and their sizes, pairs of effects, white and coloured noise are drawn from
a seed (`blind_recordings.py`). Every diagnosis is a line of a file; a run that is interrupted goes on where
it was, and several may fill one file together. Then the file is summed up: which effect was taken for which,
how small an effect is still found, how often nothing at all was taken for something, whether intervals hold
the truth.

With `--outside` every recording lacks something that no effect of the catalogue is (cogging, a frame that
shakes, a sensor whose zero jumps): a diagnosis has to say that something is missing, and name nothing.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from blind_file import Row, claimed, keep, kept, key
from blind_ranges import OUTSIDE, RANGES, label, offered
from blind_recordings import Blind, drawn

import jaxmuscle as jm
from jaxmuscle.effects import CATALOGUE, EXTENSION, Presliding
from jaxmuscle.effects.readings import KINDS
from jaxmuscle.errors import InputError
from jaxmuscle.formatting import aligned

CLEAN_SHARE, PAIR_SHARE, COLOURED_SHARE = 0.4, 0.15, 0.25
"""Parts of all recordings that lack nothing, that lack two effects, and whose noise is coloured."""
SEEN = 5.0
"""Change of a reading that no uncertain parameter of the card, and none of another effect that is there, can
take over, root mean square in units of its noise, from which an effect has to be found."""
SOUGHT = {effect.name for effect in (*CATALOGUE, *EXTENSION, Presliding)} | {*KINDS}
"""Effects that a diagnosis seeks; errors of sensors by what they are drawn as."""
INTERVAL = 1.96
WORSE = 1.05
"""Held-out error after over before from which a diagnosis has done harm."""


def tasks(
    count: int, rigs: Sequence[str], names: Sequence[str] = (), only: bool = False, begin: int = 0
) -> Iterator[tuple[int, str, int, bool]]:
    """Seed, rig, number of effects, and whether the noise is coloured; the same for the same numbers.

    With `names`, of the rigs that have one of them, and no more effects than those; `only`: always one.
    `begin`: the first seed.
    """
    rigs = [rig for rig in rigs if offered(rig, names)]
    for seed in range(begin, begin + count if rigs else begin):
        # Steps that fill the unit interval evenly, whatever the count.
        kind, colour = (seed * 0.6180339887) % 1, (seed * 0.7548776662) % 1
        rig = rigs[seed % len(rigs)]
        effects = 0 if kind < CLEAN_SHARE else 2 if kind > 1 - PAIR_SHARE else 1
        most = len(offered(rig, names)) if names else 2
        yield seed, rig, 1 if only else min(effects, most), colour < COLOURED_SHARE


def diagnosed(blind: Blind) -> Row:
    """A line of the file; a recording that is refused counts as such."""
    row: Row = {
        "truth": blind.truth,
        "noise": blind.noise,
        "bristles": blind.bristles,
        "shift": round(blind.shift, 2),
        "left": round(blind.left, 2),
        "most": round(blind.most, 2),
    }
    begin = time.perf_counter()
    try:
        found = jm.diagnose(blind.recording)
    except InputError as error:
        return row | {"refused": str(error).splitlines()[0]}
    return row | {
        "found": {
            effect.name: {
                "p": effect.p_value,
                **{name: [p.value, p.std] for name, p in effect.parameters.items()},
            }
            for effect in found.effects
        },
        "verdict": found.verdict,
        "before": {c: round(e.in_noise, 3) for c, e in found.before["held_out"].items()},
        "after": {c: round(e.in_noise, 3) for c, e in found.after["held_out"].items()},
        "patterns": [str(left.pattern) for left in found.unexplained if left.pattern],
        "runners_up": [[a.name, round(a.gain, 3)] for a in found.alternatives[:2]],
        "seconds": round(time.perf_counter() - begin, 1),
    }


def run(
    count: int,
    rigs: Sequence[str],
    path: Path,
    names: Sequence[str] = (),
    only: bool = False,
    begin: int = 0,
) -> list[Row]:
    """Diagnose what the file does not have yet and no other run is at; all rows of these tasks by now."""
    path.parent.mkdir(parents=True, exist_ok=True)
    keys = []
    for seed, rig, effects, coloured in tasks(count, rigs, names, only, begin):
        task = key(seed, rig, effects, "coloured" if coloured else "white", tuple(names))
        keys.append(task)
        with claimed(path, task) as mine:
            if not mine or task in kept(path):
                continue
            row = {"seed": seed, "rig": rig, **({"names": sorted(names)} if names else {})}
            row |= diagnosed(drawn(seed, rig, effects, coloured, names))
            keep(path, row)
            print(line(row), flush=True)
    rows = kept(path)
    elsewhere = sum(task not in rows for task in keys)
    if elsewhere:
        print(f"{elsewhere} of {len(keys)} recordings are left to runs that are still at them")
    return [rows[task] for task in keys if task in rows]


def line(row: Row) -> str:
    """One diagnosis in a line."""
    truth, found = "+".join(there(row)) or "nothing", "+".join(row.get("found", {})) or "-"
    told = row.get("verdict", row.get("refused"))
    errors = ", ".join(f"{c} {b:.3g} → {row['after'][c]:.3g}" for c, b in row.get("before", {}).items())
    bench = "rough" if row.get("bristles") else "sharp"
    return (
        f"{row['seed']:4d} {row['rig']:9s} {row['noise']:8s} {bench} {truth:45s} "
        f"by {row['shift']:7.2f}, {row['left']:7.2f} of its own: "
        f"{found:40s} {told}; {errors}; {row.get('seconds', 0)} s"
    )


def figures(rows: Sequence[Row]) -> list[Row]:
    """The figures that are to be reached, each as a count of how many; none of what was not drawn."""
    told = [row for row in rows if "found" in row]
    clean = [row for row in told if not row["truth"]]
    within = [row for row in told if row["truth"] and not outside(row)]
    clear = [row for row in within if row["left"] >= SEEN]
    one = [row for row in within if row["most"] >= SEEN]
    strange = [row for row in told if outside(row) and len(row["truth"]) == 1 and row["left"] >= SEEN]
    covered = [inside for row in told for inside in coverage(row)]
    effects = [row for row in told if row["verdict"] == "effects found"]

    def figure(name: str, goal: float, over: Sequence[Any], right: Callable[[Any], bool]) -> Row:
        count = sum(map(right, over))
        share = count / max(len(over), 1)
        return {"figure": name, "goal": goal, "ours": share, "count": count, "of": len(over),
                "ok": share >= goal}  # fmt: skip

    every = [
        figure("first effect right, where one can be seen", 0.95, one, lambda r: first(r) in there(r)),
        figure("exactly the true effects, where all can be seen", 0.85, clear, exact),
        figure("nothing named in place of what is not sought", 0.95, strange, lambda r: not superfluous(r)),
        figure("nothing found where nothing is missing", 0.99, clean, lambda r: not superfluous(r)),
        figure("nothing added that is not there", 0.99, told, lambda r: not superfluous(r)),
        figure("95 % intervals of effects that hold the truth", 0.90, covered, bool),
        figure("no held-out error worse where effects were found", 1.0, effects, harmless),
        figure("recordings that are not refused", 1.0, rows, lambda r: "found" in r),
    ]
    return [each for each in every if each["of"]]


def first(row: Row) -> str | None:
    """The effect that was added first, but for the bristles of a rough bench, which are there."""
    real = _bristles(row) - set(row["truth"])
    return next((name for name in row["found"] if name not in real), None)


def _bristles(row: Row) -> set[str]:
    """Name of what is on a rough bench, though not to be found at any size."""
    return {"presliding"} if row.get("bristles") else set()


def there(row: Row) -> list[str]:
    """The true effects, by the names that a result has for them."""
    return [label(name, parameters) for name, parameters in row["truth"].items()]


def outside(row: Row) -> set[str]:
    """True effects that a diagnosis does not seek, unless they are asked for by name: it has to admit that
    something is missing, as for any cause that is outside the catalogue.
    """
    return set(row["truth"]) - SOUGHT


def superfluous(row: Row) -> set[str]:
    """What was found and is not there."""
    return set(row["found"]) - set(there(row)) - _bristles(row)


def exact(row: Row) -> bool:
    """Whether the effects found are those that are there."""
    return set(there(row)) <= set(row["found"]) and not superfluous(row)


def harmless(row: Row) -> bool:
    """Whether no held-out error grew."""
    return all(row["after"][c] <= WORSE * max(before, 1.0) for c, before in row["before"].items())


def coverage(row: Row) -> Iterator[bool]:
    """For each parameter of effects that were rightly found, whether its interval holds the truth.

    Of a parameter that the data do not determine the interval is that of its prior: it is left out.
    """
    for value, found in compared(row):
        if found is not None and 0 < found[1] < abs(found[0]):
            yield abs(found[0] - value) <= INTERVAL * found[1]


def compared(row: Row) -> Iterator[tuple[float, list[float] | None]]:
    """True and found value of each parameter of an effect that was rightly found; None if it has none."""
    for name, truth in row["truth"].items():
        if (found := row["found"].get(label(name, truth))) is not None:
            found = same_sprocket(found, truth) if name == "eccentric_sprocket" else found
            yield from ((value, found.get(each)) for each, value in truth.items() if each != "column")


def same_sprocket(found: Row, truth: Row) -> Row:
    """An eccentric sprocket with a positive eccentricity, as drawn, its angles within half a turn of the true
    ones: the other sign is the same sprocket half a turn on.
    """

    def nearest(name: str, more: float = 0.0) -> list[float]:
        angle, std = found[name]
        angle += more
        return [angle - 2 * math.pi * round((angle - truth[name]) / (2 * math.pi)), std]

    size, size_std = found["eccentricity"]
    phase = nearest("phase", math.pi if size < 0 else 0.0)
    return found | {
        "eccentricity": [abs(size), size_std],
        "phase": phase,
        "wrap_angle": nearest("wrap_angle"),
    }


def uncompared(rows: Sequence[Row]) -> str:
    """Parameters that true effects have and findings of the same effect don't: they count nowhere."""
    missing = {
        f"{name}.{parameter}"
        for row in rows
        for name, truth in row["truth"].items()
        for parameter in truth
        if parameter != "column" and parameter not in row.get("found", {}).get(label(name, truth), truth)
    }
    return ", ".join(sorted(missing))


def confusion(rows: Sequence[Row]) -> str:
    """Which effect was added first where which one is there, single ones that can be seen."""
    pairs: Counter[tuple[str, str]] = Counter()
    for row in rows:
        if "found" in row and len(row["truth"]) <= 1 and (not row["truth"] or row["left"] >= SEEN):
            pairs[next(iter(there(row)), "nothing"), first(row) or f"({row['verdict']})"] += 1
    truths = dict.fromkeys(truth for truth, _ in sorted(pairs))
    table = []
    for truth in truths:
        own = {found: n for (lacking, found), n in pairs.most_common() if lacking == truth}
        table.append([truth, ", ".join(f"{found} {n}" for found, n in own.items())])
    return aligned(["there", "added first"], table)


def detection(rows: Sequence[Row]) -> str:
    """How many single effects were added first, by how much they change a reading beyond any imitation."""
    table = [[f"{low:g} to {high:g}", str(right), str(of)] for low, high, right, of in found_by_size(rows)]
    return aligned(["change in noise", "found", "of"], table)


def found_by_size(rows: Sequence[Row]) -> Iterator[tuple[float, float, int, int]]:
    """From which size to which, how many single effects of these were added first, and how many there are."""
    edges = [0, 0.3, 1, 2, 5, 10, 30, math.inf]
    singles = [row for row in rows if "found" in row and len(row["truth"]) == 1]
    for low, high in itertools.pairwise(edges):
        some = [row for row in singles if low <= row["left"] < high]
        yield low, high, sum(first(row) in there(row) for row in some), len(some)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="recordings in all (default 300)")
    parser.add_argument("--begin", type=int, default=0, metavar="SEED", help="the first seed (default 0)")
    parser.add_argument("--rigs", nargs="*", choices=list(RANGES), default=list(RANGES))
    parser.add_argument("--file", type=Path, default=Path("blind.jsonl"), help="where diagnoses are kept")
    every = sorted({name for effects in RANGES.values() for name in effects})
    drawing = parser.add_mutually_exclusive_group()
    drawing.add_argument("--names", nargs="+", choices=every, default=[], metavar="NAME",
                         help="draw effects from these only")  # fmt: skip
    drawing.add_argument("--only-effect", choices=every, metavar="NAME",
                         help="every recording lacks this effect and nothing else")  # fmt: skip
    drawing.add_argument("--outside", action="store_true",
                         help="every recording lacks one cause that is outside the catalogue")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    start = time.perf_counter()
    jm.configure(compile_cache=True)
    names, only = list(arguments.names), arguments.outside or arguments.only_effect is not None
    if arguments.outside:
        names = sorted({name for causes in OUTSIDE.values() for name in causes})
    elif only:
        names = [str(arguments.only_effect)]
    rows = run(arguments.count, arguments.rigs, arguments.file, names, only, arguments.begin)
    reached = figures(rows)
    print("\nSingle effects that change a reading by", f"{SEEN:g} times its noise, and clean recordings:")
    print(confusion(rows), detection(rows), sep="\n\n", end="\n\n")
    if nowhere := uncompared(rows):
        print("Parameters that findings do not have:", nowhere)
    for row in reached:
        share = f"{row['count']} of {row['of']}"
        print(f"{'ok' if row['ok'] else 'NO':3s} {row['figure']:55s} {share:12s} goal {row['goal']:.0%}")
    if arguments.json:
        print(json.dumps({"benchmark": "blind", "rows": reached, "reached": sum(r["ok"] for r in reached),
                          "of": len(reached), "machine": platform.processor() or platform.machine(),
                          "seconds": round(time.perf_counter() - start, 1)}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
