"""How long until the first result: import, compile and run, with and without the compile cache?

Each figure is from fresh processes, the smallest of a few. `jaxmuscle --help` must answer without JAX.

    python benchmarks/compile_times.py [--repeats 2] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from typing import Any

CODE = """
import json, time
begin = time.perf_counter()
import numpy as np, jaxmuscle as jm, jax
machine = jm.actuator(jm.read(jm.sample("lift")).card)
clock = 0.002 * np.arange(1000)
command = np.where(clock % 0.5 < 0.2, 3.0, -2.0)
imported = time.perf_counter()
what = WHAT
if what == "run":
    call = lambda: jm.simulate(machine, command, clock).readings["position"]
elif what == "sweep":
    over = {"mass": np.linspace(4.0, 10.0, 256)}
    call = lambda: jm.sweep(machine, over, command=command, times=clock, reductions=["maximum"])
else:
    with_area = lambda area: jm.replace(machine, {"valve.area": area})
    end = lambda area: jm.simulate(with_area(area), command, clock).readings["position"]
    call = lambda: jax.jacfwd(end)(machine.valve.area)
jax.block_until_ready(call() if what != "sweep" else call()["position_maximum"].values)
first = time.perf_counter()
jax.block_until_ready(call() if what != "sweep" else call()["position_maximum"].values)
print(json.dumps([imported - begin, first - imported, time.perf_counter() - first]))
"""
HELP = """
import sys
from typer.testing import CliRunner
from jaxmuscle.cli import app
assert CliRunner().invoke(app, ["--help"]).exit_code == 0
print("jax" in sys.modules)
"""
WAYS = ("run", "jacobian", "sweep")


def fresh(code: str, environment: dict[str, str]) -> tuple[str, float]:
    """What a new process prints, and how long it took [s]."""
    begin = time.perf_counter()
    command, variables = [sys.executable, "-c", code], {**os.environ, **environment}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=variables)
    return done.stdout.splitlines()[-1], time.perf_counter() - begin


def measured(what: str, repeats: int, environment: dict[str, str]) -> dict[str, float]:
    """Smallest seconds of import, first call and second call."""
    code = CODE.replace("WHAT", repr(what))
    times = [json.loads(fresh(code, environment)[0]) for _ in range(repeats)]
    return dict(zip(("import", "first", "second"), map(min, zip(*times, strict=True)), strict=True))


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="end with one line of JSON")
    arguments = parser.parse_args()
    begin, rows = time.perf_counter(), []
    loads, took = fresh(HELP, {})
    rows.append({"figure": "--help without JAX [s]", "goal": "without", "ours": took, "ok": loads == "False"})
    for what in WAYS:
        off = measured(what, arguments.repeats, {"JAX_ENABLE_COMPILATION_CACHE": "false"})
        with tempfile.TemporaryDirectory() as folder:
            cache = {
                "JAX_COMPILATION_CACHE_DIR": folder,
                "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
                "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
            }
            measured(what, 1, cache)
            on: dict[str, Any] = measured(what, arguments.repeats, cache)
        goal: Any = {"run": 3.0, "jacobian": 5.0}.get(what)
        rows.append(
            {"figure": f"first {what}, cache off [s]", "goal": f"≤ {goal:g}" if goal else "told",
             "ours": off["first"], "ok": goal is None or off["first"] <= goal, **off}
        )  # fmt: skip
        rows.append(
            {"figure": f"first {what}, cache on [s]", "goal": "shorter", "ours": on["first"],
             "ok": on["first"] < off["first"], **on}
        )  # fmt: skip
    for row in rows:
        rest = "".join(f"   {name} {row[name]:.3g}" for name in ("import", "second") if name in row)
        figures = f"{row['figure']:<32} {row['ours']:.3g}   goal: {row['goal']}{rest}"
        print(f"{'ok  ' if row['ok'] else 'MISS'} {figures}")
    if arguments.json:
        summary = {
            "benchmark": "compile_times", "rows": rows, "reached": sum(row["ok"] for row in rows),
            "of": len(rows), "machine": platform.processor() or platform.machine(), "load": os.getloadavg(),
            "seconds": time.perf_counter() - begin,
        }  # fmt: skip
        print(json.dumps(summary))


if __name__ == "__main__":
    main()
