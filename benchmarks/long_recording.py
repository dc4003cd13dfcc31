"""What does a diagnosis do with a recording of five million rows, and how much memory does it take?

A table of 83 min at 1 kHz is made by the package's own model of the sample `lift` with a load friction that
its card does not declare, under random levels of the command and with the noise of the sample's sensors. Then
``jaxmuscle diagnose`` runs on it in a process of its own, whose largest resident memory is read at its end.
The truth being the package's own model, nothing is said here of how well effects are found: `blind.py` does.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd

import jaxmuscle as jm

STEP, FRICTION = 1e-3, 13.84
"""Sampling step [s]; load friction that is put in [N]."""
LEVELS = (-5.0, -3.0, -2.0, -1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 5.0)
"""Commands [V], each held for 0.1 to 0.5 s."""
GOAL = 4.0
"""Memory that is allowed [GiB]."""
RUN = """
import sys
from pathlib import Path
from jaxmuscle.cli import main
try:
    main()
finally:
    # Not ru_maxrss: that begins with the peak of the process that started this one.
    told = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
    Path(sys.argv[2] + ".peak").write_text(told)
"""
"""The program; what it took at the most goes into a file beside the table [kB]."""


def write_recording(folder: Path, rows: int) -> Path:
    """A table ``long.csv`` with its card, in `folder`."""
    random = np.random.default_rng(7)
    card = jm.read(jm.sample("lift")).card
    rubbing = jm.actuator(card).with_effects(
        load_friction=jm.effects.LoadFriction(force=jnp.asarray(FRICTION))
    )
    changes = np.cumsum(random.integers(100, 500, size=rows // 100 + 1))
    levels = random.choice(LEVELS, size=changes.size)
    command = levels[np.searchsorted(changes, np.arange(rows), side="right")]
    clock = STEP * np.arange(rows)
    ran = jm.simulate(rubbing, command, clock).to_frame()
    pressure, position = (
        ran[name].to_numpy() + card.noise[name] * random.standard_normal(rows)
        for name in ("pressure", "position")
    )
    gauge = (pressure - card.ambient_pressure) / 1e5
    columns = {
        "t_s": clock.round(3),
        "valve_V": command,
        "p_bar": gauge.round(5),
        "x_mm": (1e3 * position).round(4),
    }
    table = folder / "long.csv"
    pd.DataFrame(columns).to_csv(table, index=False)
    shutil.copyfile(jm.sample("lift").with_suffix(".toml"), table.with_suffix(".toml"))
    return table


def _found(effect: dict[str, Any]) -> str:
    values = [
        f"{name} {e['value']:.4g} ± {e['std']:.2g} {e['unit']}" for name, e in effect["parameters"].items()
    ]
    return f"{effect['name']}: {', '.join(values)}"


def main() -> int:
    """Make the table, diagnose it, print what it took; exit status 1 when that is more than the goal."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rows", type=int, default=5_000_000, help="rows of the table (5,000,000)")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        table = write_recording(Path(place), asked.rows)
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        call = [sys.executable, "-c", RUN, "diagnose", str(table), "--out", f"{place}/found"]
        subprocess.run(call, check=True, stdout=sys.stderr)
        seconds, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        result = json.loads(Path(place, "found", "result.json").read_text(encoding="utf-8"))
        figures = {
            "rows": asked.rows,
            "table_MB": table.stat().st_size / 1e6,
            "peak_GiB": int(Path(f"{table}.peak").read_text()) / 2**20,
            "seconds": seconds,
            "processor_seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            "taken": result["recording"].get("left_out", "all of it"),
            "verdict": result["verdict"],
            "found": [_found(effect) for effect in result["effects"]],
        }
    if asked.json:
        print(json.dumps(figures, indent=2))
    else:
        for name, value in figures.items():
            print(f"{name:18} {f'{value:.2f}' if isinstance(value, float) else value}")
    return int(figures["peak_GiB"] > GOAL)


if __name__ == "__main__":
    sys.exit(main())
