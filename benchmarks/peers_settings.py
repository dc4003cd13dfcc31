"""The loosest setting of each peer that is accurate enough, and how long a call takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import peers_c
import peers_casadi
import peers_diffrax
import peers_ours
import peers_scipy
from peers_model import ACCURACY, COMMAND, KNOTS, VALUES, deviation


def best(function: Callable[[], Any], least: float = 0.5, repeats: int = 5) -> float:
    """Shortest of several times [s], after a first call that does not count."""
    function()
    times, begin = [], time.perf_counter()
    while len(times) < repeats or time.perf_counter() - begin < least:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


class Peers:
    """Every peer at the loosest setting that is accurate enough, found when it is first asked for."""

    def __init__(self) -> None:
        """Compute the reference."""
        self.exact = peers_scipy.reference(COMMAND, VALUES, 4000)
        self.model = peers_ours.machine()
        self.accuracy = {"reference": deviation(peers_scipy.reference(COMMAND, VALUES, 2000), self.exact)}

    def choose(self, name: str, tried: Iterable[Any], run: Callable[[Any], Any], most: int = 1) -> Any:
        """The fastest of the first `most` settings that are accurate enough."""
        found = []
        for setting in tried:
            try:
                error = deviation(run(setting), self.exact)
            except RuntimeError as failed:
                print(f"{name:<10} {setting!s:<28} fails: {str(failed).splitlines()[-1]}", flush=True)
                continue
            if error <= ACCURACY:
                took = best(lambda s=setting: jax.block_until_ready(run(s)), 0.1, 3)
                found.append((took, error, setting))
            if len(found) == most:
                break
        took, error, setting = min(found)
        self.accuracy[name] = error
        print(f"{name:<10} {setting!s:<28} error {error:.1e}  {1e3 * took:.2f} ms", flush=True)
        return setting

    @cached_property
    def steps(self) -> peers_ours.Steps:
        """Our method and substeps."""
        return self.choose("ours", peers_ours.TRIED, lambda s: peers_ours.position(self.model, COMMAND, s), 2)

    @cached_property
    def lsoda(self) -> float:
        """SciPy's tolerance."""
        return self.choose("scipy", peers_scipy.TOLERANCES, lambda tol: peers_scipy.run(KNOTS, tol))

    @cached_property
    def cvodes(self) -> Any:
        """CasADi's integrator, its right-hand side compiled if there is a compiler."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[float, str]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_casadi.integrator(*setting, compiled=peers_c.compiler() is not None)
            return peers_casadi.position(solvers[setting])

        tried = [(tol, method) for tol in peers_casadi.TOLERANCES for method in ("bdf", "adams")]
        return solvers[self.choose("cvodes", tried, run, 3)]

    @cached_property
    def diffrax(self) -> Any:
        """The compiled solve of plain diffrax."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[str, float]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_diffrax.solver(*setting)
            return solvers[setting](jnp.asarray(VALUES))

        return solvers[self.choose("diffrax", peers_diffrax.TRIED, run)]
