"""The package itself: one run, batches, slopes; and what needs a process of its own.

python benchmarks/peers_ours.py run|jacobian|reverse   seconds of a cold compilation
python benchmarks/peers_ours.py points                 cost a point and peak memory of sweeps
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from peers_model import CLOCK, COMMAND, FREE, PATHS, VALUES, masses

import jaxmuscle as jm

TRIED = (("heun", 1), ("bogacki-shampine", 1), ("chebyshev", 1), ("heun", 2), ("bogacki-shampine", 2),
         ("chebyshev", 2), ("heun", 4), ("chebyshev", 4), ("heun", 8))  # fmt: skip
"""Methods and steps a sample, from few evaluations to many."""
COUNTS = (1, 16, 256, 4096, 32768, 100_000)
Steps = tuple[str, int]


def machine() -> Any:
    """The model of `peers_model.py`, put together from the package's parts."""
    parts, one = (jm.components, jm.effects), jnp.ones(())
    valve = parts[0].FlowValve(one, one, one, one)
    muscle = parts[0].McKibben(one, one, one, one)
    bare = jm.actuators.Isotonic(valve=valve, muscle=muscle, mass=one)
    whole = bare.with_effects(
        thread_friction=parts[1].ThreadFriction(),
        load_friction=parts[1].LoadFriction(),
        length_hysteresis=parts[1].LengthHysteresis(),
    )
    return jm.replace(whole, dict(zip(PATHS, VALUES, strict=True)))


def position(model: Any, command: Any, steps: Steps) -> jax.Array:
    """Position at the samples, by `jm.simulate`."""
    return jm.simulate(model, command, CLOCK, method=steps[0], substeps=steps[1]).readings["position"]


def batch(model: Any, runs: int, steps: Steps, **where: Any) -> Callable[[], np.ndarray]:
    """A function that makes `runs` runs of different masses by `jm.sweep`: largest positions."""
    over = {"mass": masses(runs)}

    def go() -> np.ndarray:
        found = jm.sweep(
            model, over, command=COMMAND, times=CLOCK, outputs=["position"], reductions=["maximum"],
            method=steps[0], substeps=steps[1], **where,
        )  # fmt: skip
        return found["position_maximum"].values

    return go


def functions(model: Any, steps: Steps) -> dict[str, tuple[Callable[[Any], Any], Any]]:
    """A run, the Jacobian of 12 parameters and the gradient of 100 levels of the command; with arguments."""
    names = [PATHS[i] for i in FREE]

    def run(values: Any) -> Any:
        return position(jm.replace(model, dict(zip(names, values, strict=True))), COMMAND, steps)

    def misfit(levels: Any) -> Any:
        return jnp.sum((position(model, jnp.repeat(levels, 10), steps) - 0.02) ** 2)

    free, levels = jnp.asarray(VALUES[list(FREE)]), jnp.asarray(COMMAND[::10])
    return {"run": (run, free), "jacobian": (jax.jacfwd(run), free), "reverse": (jax.grad(misfit), levels)}


def compiled(name: str, steps: Steps) -> tuple[Callable[[], Any], float]:
    """A compiled function without arguments, and the seconds that tracing and compiling took."""
    function, given = functions(machine(), steps)[name]
    begin = time.perf_counter()
    ready = jax.jit(function).lower(given).compile()
    return lambda: jax.block_until_ready(ready(given)), time.perf_counter() - begin


def peak_memory() -> float:
    """Largest memory of this process so far [MiB]; its parent's is not counted where Linux says so."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text().split("VmHWM:")[1].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def points(steps: Steps) -> list[dict[str, float]]:
    """Seconds a point and peak memory of warm sweeps of more and more points."""
    found, model = [], machine()
    for count in COUNTS:
        go = batch(model, count, steps)
        go()
        begin = time.perf_counter()
        go()
        took = time.perf_counter() - begin
        peak = peak_memory()
        found.append({"points": count, "us_a_point": 1e6 * took / count, "peak_MiB": peak})
    return found


def shared_out(steps: Steps, runs: int) -> dict[int, float]:
    """Seconds of a sweep on one dask worker and on two, of one thread each."""
    from distributed import Client, LocalCluster

    found = {}
    for workers in (1, 2):
        with (
            LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs=50
            ) as cluster,
            Client(cluster) as client,
        ):
            go = batch(machine(), runs, steps, client=client)
            go()
            times = []
            for _ in range(2):
                begin = time.perf_counter()
                go()
                times.append(time.perf_counter() - begin)
            found[workers] = min(times)
    return found


def main() -> None:
    """One measurement, as a line of JSON."""
    what, steps = sys.argv[1], (sys.argv[2], int(sys.argv[3]))
    print(json.dumps(points(steps) if what == "points" else compiled(what, steps)[1]))


if __name__ == "__main__":
    main()
