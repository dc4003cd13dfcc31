"""The setting of each peer: the fastest that is accurate enough, of as many for each; how long a call takes.

One rule for all: of `CANDIDATES` settings every one is tried, and of those that keep the position within the
accuracy the fastest is taken. CasADi is offered the same methods and steps a sample as this package.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cached_property, partial
from multiprocessing import get_context
from typing import Any

import jax
import jax.numpy as jnp
import peers_casadi
import peers_cvodes
import peers_diffrax
import peers_numbalsoda
import peers_ours
import peers_scipy
from peers_build import built, caller, compiler
from peers_model import ACCURACY, COMMAND, KNOTS, VALUES, deviation

from jaxmuscle._config import cores

CANDIDATES = 9
CORES = cores()
NO_COMPILER = "no C compiler"


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

    def choose(self, name: str, tried: Sequence[Any], run: Callable[[Any], Any]) -> Any:
        """The fastest of the settings that are accurate enough."""
        assert len(tried) == CANDIDATES, f"{name} has {len(tried)} candidates, the others {CANDIDATES}"
        found = []
        for place, setting in enumerate(tried):
            try:
                error = deviation(run(setting), self.exact)
            except RuntimeError as failed:
                print(f"{name:<11} {setting!s:<28} fails: {str(failed).splitlines()[-1]}", flush=True)
                continue
            if error <= ACCURACY:
                took = best(lambda s=setting: jax.block_until_ready(run(s)), 0.1, 3)
                found.append((took, place, error))
        took, place, error = min(found)
        self.accuracy[name] = error
        accurate = f"{len(found)} of {len(tried)} accurate"
        print(
            f"{name:<11} {tried[place]!s:<28} error {error:.1e}  {1e3 * took:.2f} ms, {accurate}", flush=True
        )
        return tried[place]

    @cached_property
    def steps(self) -> peers_ours.Steps:
        """Our method and substeps."""
        return self.choose("ours", peers_ours.TRIED, lambda s: peers_ours.position(self.model, COMMAND, s))

    @cached_property
    def lsoda(self) -> float:
        """SciPy's tolerance."""
        return self.choose("scipy", peers_scipy.TOLERANCES, lambda tol: peers_scipy.run(KNOTS, tol))

    def __enter__(self) -> Peers:
        """Processes that are begun end with the block."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the processes that were begun."""
        if "pool" in self.__dict__:
            self.pool.shutdown()

    @cached_property
    def pool(self) -> ProcessPoolExecutor:
        """A process for every core; by spawning: JAX has threads."""
        return ProcessPoolExecutor(CORES, get_context("spawn"))

    @cached_property
    def numbalsoda(self) -> tuple[Callable[[], Any], Callable[[int], Callable[[], Any]]]:
        """A run, and a batch of so many, at the chosen tolerance."""
        one, batch = peers_numbalsoda.solver(CORES)
        tolerance = self.choose("numbalsoda", peers_scipy.TOLERANCES, one)
        return partial(one, tolerance), lambda runs: batch(runs, tolerance)

    @cached_property
    def casadi(self) -> peers_casadi.Steps:
        """CasADi's method and substeps."""
        calls: dict[Any, Any] = {}

        def run(steps: peers_casadi.Steps) -> Any:
            if steps not in calls:
                calls[steps] = caller(built(peers_casadi.run(steps, 10), "-O3"), *peers_casadi.GIVEN)
            return calls[steps]()[0].ravel()

        return self.choose("casadi", peers_ours.TRIED, run)

    @cached_property
    def cvodes(self) -> Any:
        """CasADi's integrator, its right-hand side compiled if there is a compiler."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[float, str]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_cvodes.integrator(*setting, compiled=compiler() is not None)
            return peers_cvodes.position(solvers[setting])

        return solvers[self.choose("cvodes", peers_cvodes.TRIED, run)]

    @cached_property
    def diffrax(self) -> Any:
        """The compiled solve of plain diffrax."""
        solvers: dict[Any, Any] = {}

        def run(setting: tuple[str, float]) -> Any:
            if setting not in solvers:
                solvers[setting] = peers_diffrax.solver(*setting)
            return solvers[setting](jnp.asarray(VALUES))

        return solvers[self.choose("diffrax", peers_diffrax.TRIED, run)]
