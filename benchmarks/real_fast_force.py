"""What is the fast part of the force that a static model of a measured muscle leaves over, after a switch?

After each pulse of a valve the force of muscles held at fixed length comes later than the measured pressure.
Three explanations (`fast_force_models`) are fitted to every other switch and judged on the switches in
between, on the first 150 ms as sampled (1.9 ms): a first-order lag of the force reading, a pure delay, and
an air line between gauge and muscle. They also differ in what they say of the ringing that follows: how far
the force is behind the pressure, how much larger or smaller it is, at which frequency.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from typing import Any

import fast_force_models as models
import numpy as np
import psu_isometric as psu
from fast_force_findings import EXPLANATIONS, RINGING, Row, conclusion, findings
from fast_force_switches import Switch, switches

from jaxmuscle.components import McKibben

MUSCLES = ("10", "15", "25", "30", "45", "52", "27")
EARLIER = "27"
"""The muscle that was measured ten months before the others, on another rig."""
FEWEST = 8
"""Switches that a recording, or a direction in it, needs."""


def studied(every: list[Switch]) -> Row:
    """All explanations of one muscle at one length: errors in N on switches not fitted, times in ms."""
    even, odd = every[::2], every[1::2]
    judged = sum(int(s.judged.sum()) for s in even)
    delays, delayed = models.DELAYS, np.array([models.delay_errors(s) for s in every])
    lags, lagged = models.LAGS, np.array([models.lag_errors(s) for s in every])
    delay, lag = models.with_error(delays, delayed[1::2]), models.with_error(lags, lagged[1::2])
    line = models.fitted_line(odd)
    by_direction = {}
    for name, filling in (("filling", True), ("venting", False)):
        rows = [s.filling is filling for s in every]
        if sum(rows) >= FEWEST:
            left = models.line_residuals(line, [s for s in even if s.filling is filling])
            by_direction[name] = {"delay": _ms(models.with_error(delays, delayed[rows])), "line": _rms(left)}
    return {
        "switches": len(every),
        "settled": float(np.sqrt(np.mean([s.settled_error for s in every]))),
        "rms": {
            "before": models.rms_at(delays, delayed[::2], 0.0, judged),
            "lag": models.rms_at(lags, lagged[::2], lag[0], judged),
            "delay": models.rms_at(delays, delayed[::2], delay[0], judged),
            "line": _rms(models.line_residuals(line, even)),
        },
        "lag": _ms(lag),
        "delay": _ms(delay),
        "line": {"transit": 1e3 * line[0], "filling": 1e3 * line[1], "loss": line[2]},
        "by_direction": by_direction,
        **ringing(every, lag[0], delay[0], line),
    }


def ringing(every: list[Switch], lag: float, delay: float, line: list[float]) -> Row:
    """Frequency of the ringing [Hz]; how far the force is behind [°] and its size, measured and said."""
    frequency, measured = models.ringing(every)
    s, at = 2j * np.pi * frequency, np.array([frequency])
    lossy, lossless = (models.air_line(at, (*line[:2], loss))[0] for loss in (line[2], 0.0))
    said = (measured, 1 / (1 + s * lag), np.exp(-s * delay), lossy, lossless)
    behind = [float(np.mod(90 - np.degrees(np.angle(one)), 360) - 90) for one in said]
    size = [float(abs(one)) for one in said]
    return {
        "ring": frequency,
        "behind": dict(zip(RINGING, behind, strict=True)),
        "size": dict(zip(RINGING, size, strict=True)),
    }


def named(muscle: str, number: int) -> Row:
    """Length [mm] and inner volume [cm³] of a muscle: a cylinder 10 mm wide at rest, under a braid of 25°."""
    resting, ratio = psu.size(muscle, number)
    length, radius, angle, end = (np.asarray(v) for v in (resting, 5e-3, np.deg2rad(25.0), 1.0))
    cylinder = McKibben(length, radius, angle, end)  # type: ignore[arg-type]
    return {
        "muscle": f"{'~' if muscle in psu.LENGTHS_UNKNOWN else ''}{1e3 * resting:.0f}",
        "rig": "earlier" if muscle == EARLIER else "later",
        "length": 1e3 * resting * (1 - ratio),
        "volume": 1e6 * float(cylinder.volume(np.asarray(ratio * resting))),  # type: ignore[arg-type]
    }


def _ms(seconds: tuple[float, float]) -> list[float]:
    return [1e3 * value for value in seconds]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def print_tables(rows: list[Row]) -> None:
    print(
        "RMS of the force in the first 150 ms, switches not fitted [N]; fitted times [ms] ± bootstrap error"
    )
    heads = [f"{name:>6s}" for name in EXPLANATIONS]
    print("muscle length   n settled", *heads, "      lag          delay       line: T    τ    R")
    for r in rows:
        errors = [f"{r['rms'][name]:6.1f}" for name in EXPLANATIONS]
        fits = [f"{r[name][0]:6.1f} ± {r[name][1]:3.1f}" for name in ("lag", "delay")]
        line = [f"{r['line'][name]:5.{n}f}" for name, n in (("transit", 1), ("filling", 1), ("loss", 2))]
        count = f"{r['switches']:3d} {r['settled']:7.1f}"
        print(f"{r['muscle']:>6s} {r['length']:6.0f}", count, *errors, " ", *fits, "    ", *line)
    print(
        "\nDelay by direction [ms]; ringing [Hz], how far the force is behind in it [°] and how large it is,"
    )
    print("as a pressure over that of the gauge: measured, and said by the explanations")
    heads = [f"{name:^10s}" for name in RINGING]
    print("muscle length  cm³   filling      venting     ring ", *heads)
    for r in rows:
        ways = [r["by_direction"].get(name, {}).get("delay") for name in ("filling", "venting")]
        delays = [f"{way[0]:5.1f} ± {way[1]:3.1f}" if way else " " * 11 for way in ways]
        ring = [f"{r['behind'][name]:5.0f}° {r['size'][name]:4.2f}" for name in RINGING]
        print(f"{r['muscle']:>6s} {r['length']:6.0f} {r['volume']:4.0f}", *delays, f"{r['ring']:6.1f}", *ring)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    root = psu.folder()
    if root is None:
        print("the measured data are not here: name their folder in JAXMUSCLE_DATA", file=sys.stderr)
        return 2
    begin, rows = time.perf_counter(), []
    for muscle in MUSCLES:
        files = psu.raw(root, muscle)
        for number in range(4):
            every = [s for n, samples in files if n == number for s in switches(samples)]
            if len(every) >= FEWEST:
                rows.append({**named(muscle, number), **studied(every)})
    print_tables(rows)
    found = findings(rows)
    print("", *conclusion(found), sep="\n")
    if arguments.json:
        result: dict[str, Any] = {"benchmark": "real_fast_force", "rows": rows, "findings": found}
        machine, seconds = platform.processor() or platform.machine(), time.perf_counter() - begin
        print(json.dumps({**result, "machine": machine, "seconds": seconds}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
