"""The work of a sweep on one machine: a batch of points in one call, compiled once."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import threading
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array

from jaxmuscle.parameters import replace
from jaxmuscle.sweeps.bench import Bench, Trajectory
from jaxmuscle.sweeps.blocks import Cut
from jaxmuscle.sweeps.points import Block, Points

FAILED = "failed"
"""The variable that says where a run holds something that is not a number."""

Results = dict[str, np.ndarray]
Devices = tuple[jax.Device, ...]


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of the result: a function of the run, or of the run and one of its readings."""

    name: str
    function: Callable[..., Array]
    reading: str | None

    def __call__(self, run: Trajectory) -> Array:
        """Its value for one run."""
        arguments = (run,) if self.reading is None else (run, run.readings[self.reading])
        return jnp.asarray(self.function(*arguments), dtype=float)


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is computed at each point: variables, with `substeps` steps of a method between two samples."""

    variables: tuple[Variable, ...]
    substeps: int
    method: str | None = None


def point(bench: Bench, values: dict[str, Array], plan: Plan) -> dict[str, Array]:
    """The variables of one point, and whether its run failed."""
    run = replace(bench, values).trajectory(plan.substeps, plan.method)
    finite = [jnp.isfinite(reading).all() for reading in run.readings.values()]
    found = {variable.name: variable(run) for variable in plan.variables}
    return {**found, FAILED: ~jnp.stack(finite).all()}


COMPILER = {
    # Each batch has a core of its own: XLA would cut its short loops into pieces for all cores, and wait.
    "xla_disable_hlo_passes": "cpu-parallel-task-assigner",
    # Half as long with AVX-512; narrower vectors where a CPU has no others.
    "xla_cpu_prefer_vector_width": 512,
}
"""Settings under which a batch is compiled: a third of the time of a run of a muscle."""


@eqx.filter_jit(compiler_options=COMPILER)  # pyright: ignore[reportCallIssue]
def _batch(bench: Bench, values: dict[str, Array], plan: Plan, devices: Devices) -> dict[str, Array]:
    """The variables of many points, divided over the devices."""
    fixed, static = eqx.partition(bench, eqx.is_array)

    def each(fixed, values):
        return jax.vmap(lambda one: point(eqx.combine(fixed, static), one, plan))(values)

    if len(devices) == 1:
        return each(fixed, values)
    mesh, share = Mesh(np.array(devices), ("points",)), PartitionSpec("points")
    divided = jax.shard_map(
        each, mesh=mesh, in_specs=(PartitionSpec(), share), out_specs=share, check_vma=False
    )
    return divided(fixed, values)


class Job:
    """A sweep cut into blocks, each of which can be computed on its own, here or on another machine."""

    def __init__(
        self, bench: Bench, plan: Plan, points: Points, cut: Cut, devices: Devices | None = None
    ) -> None:
        """See :func:`jaxmuscle.sweeps.sweep`; `devices` are the default ones of the machine when `None`."""
        self.bench, self.plan, self.points, self.cut = bench, plan, points, cut
        self.blocks = cut.blocks(points.shape)
        self._devices = devices
        self._compiled, self._lock = False, threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        """What travels to another machine: NumPy arrays, no devices."""
        arrays = jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, self.bench)
        return {"bench": arrays, "plan": self.plan, "points": self.points, "cut": self.cut}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """On the machine where it arrives."""
        dynamic, static = eqx.partition(state["bench"], lambda leaf: isinstance(leaf, np.ndarray))
        self.__init__(**{**state, "bench": eqx.combine(jax.device_put(dynamic), static)})

    def size(self, number: int) -> int:
        """Number of points of a block."""
        return math.prod(part.stop - part.start for part in self.blocks[number])

    def compute(self, number: int) -> Results:
        """The variables at the points of a block, each of the block's shape and then its own."""
        if not self._compiled:
            with self._lock:
                # Threads that begin together would each compile.
                if not self._compiled:
                    found = self._compute(self.blocks[number])
                    self._compiled = True
                    return found
        return self._compute(self.blocks[number])

    def _compute(self, block: Block) -> Results:
        devices = self._devices or default_devices()
        shape = tuple(part.stop - part.start for part in block)
        values, total = self.points.inside(block), int(np.prod(shape))
        size = -(-self.cut.batch // len(devices)) * len(devices)
        parts: list[Results] = []
        for begin in range(0, total, size):
            rows = np.minimum(np.arange(begin, begin + size), total - 1)
            given = {path: jax.device_put(array[rows]) for path, array in values.items()}
            parts.append({k: np.asarray(v) for k, v in _batch(self.bench, given, self.plan, devices).items()})
        return {
            name: np.concatenate([part[name] for part in parts])[:total].reshape(
                *shape, *parts[0][name].shape[1:]
            )
            for name in parts[0]
        }

    def fingerprint(self) -> str:
        """What tells this sweep from any other: the compiled function of one point, and all numbers."""
        fixed, static = eqx.partition(self.bench, eqx.is_array)
        first = {path: values[0] for path, values in self._values().items()}
        lowered = jax.jit(lambda f, v: point(eqx.combine(f, static), v, self.plan)).lower(fixed, first)
        found = hashlib.sha256(lowered.as_text().encode())
        for leaf in [*jax.tree.leaves(fixed), *self._values().values()]:
            array = np.ascontiguousarray(leaf)
            found.update(repr((array.shape, str(array.dtype))).encode() + array.tobytes())
        found.update(repr((self.points.dims, self.points.along, list(self.points.leaves))).encode())
        return found.hexdigest()

    def _values(self) -> dict[str, np.ndarray]:
        return {leaf.path: self.points.values[name] for name, leaf in self.points.leaves.items()}


def default_devices() -> Devices:
    """All GPUs of this machine; on a CPU one device, whose cores are shared out by threads."""
    devices = tuple(jax.local_devices())
    return devices[:1] if devices[0].platform == "cpu" else devices
