"""Work of a sweep: batches that are computed side by side in one compiled call, blocks that are tasks and
chunks of a store.

All batches have one size, so that a sweep is compiled once; the last batch of a block is filled up with
copies. A block is a box of the grid, so that it is exactly one chunk of every array in a store. The cut
depends on the sweep and on the memory limit only, never on how many cores or workers there are: the same
numbers to the last bit wherever it runs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
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

from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace
from jaxmuscle.sweeps.operating_points import Block, Points
from jaxmuscle.sweeps.scenario import Bench, Trajectory

LARGEST_BATCH = {"cpu": 256, "gpu": 65536}
"""Points side by side. A run of a muscle takes a core 65 us among 64, 47 among 128, 37 among 256, 36 among
384, and from 512 on twice as long."""
LARGEST_BLOCK = {"cpu": 4096, "gpu": 4 * 65536}
"""Points of a task: about a second of work."""
FEWEST_BLOCKS = 32
"""Blocks that a sweep is cut into if it is large enough: for progress, and to share them out evenly."""
FEWEST_BATCHES = 4
LANES = 8
"""A batch is a multiple of this: no point is left for a loop over the remainder of a vector."""
BATCH_SHARE, BLOCK_SHARE = 0.25, 0.125
"""Parts of the memory limit that one batch at work and the results of one block may take."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """Points in a batch, shape of a block, and the memory that a block takes while it is computed [B]."""

    batch: int
    block: tuple[int, ...]
    working: int

    def blocks(self, shape: tuple[int, ...]) -> list[Block]:
        """All blocks of a grid, in C order."""
        starts = [range(0, n, b) for n, b in zip(shape, self.block, strict=True)]
        return [
            tuple(slice(a, min(a + b, n)) for a, b, n in zip(corner, self.block, shape, strict=True))
            for corner in itertools.product(*starts)
        ]


def cut(shape: tuple[int, ...], working: int, kept: int, memory: float, platform: str = "cpu") -> Cut:
    """How to cut a grid of points.

    Args:
        shape: length of each dimension.
        working: memory that a point takes while it is computed [B].
        kept: memory of its results [B].
        memory: limit [B].
        platform: kind of device.

    Raises:
        InputError: a single point takes more than the limit.
    """
    if working + kept > memory:
        raise InputError(
            f"memory: one point takes {_shown(working + kept)}, the limit is {_shown(memory)}; "
            f"raise memory=, take fewer samples with times="
        )
    kind = platform if platform in LARGEST_BATCH else "gpu"
    total = math.prod(shape)
    batch = min(LARGEST_BATCH[kind], _up(math.ceil(total / FEWEST_BATCHES), LANES))
    fits = int(BATCH_SHARE * memory // working)
    batch = batch if batch <= fits else max(1, fits // LANES * LANES or fits)
    largest = max(batch, min(LARGEST_BLOCK[kind], math.ceil(total / FEWEST_BLOCKS)))
    largest = max(1, min(_up(largest, batch), int(BLOCK_SHARE * memory // max(kept, 1))))
    block = _block(shape, largest, batch)
    return Cut(batch, block, batch * working + math.prod(block) * kept)


def _block(shape: tuple[int, ...], largest: int, batch: int) -> tuple[int, ...]:
    """The box of at most `largest` points that takes the fewest batches, the larger one of two equals.

    It spans the last dimensions, a part of one, and a single entry of those before it.
    """
    inner, axis = 1, len(shape)
    while axis and inner * shape[axis - 1] <= largest:
        axis -= 1
        inner *= shape[axis]
    if axis == 0:
        return shape
    most = largest // inner
    candidates = range(max(1, most // 2), most + 1)
    split = min(candidates, key=lambda size: (_batches(shape[axis - 1], size, inner, batch), -size))
    return (*[1] * (axis - 1), split, *shape[axis:])


def _batches(length: int, size: int, inner: int, batch: int) -> int:
    """Batches along one dimension that is cut into parts of `size`."""
    whole, rest = divmod(length, size)
    return whole * math.ceil(size * inner / batch) + math.ceil(rest * inner / batch)


def _up(number: int, step: int) -> int:
    return math.ceil(number / step) * step


def _shown(size: float) -> str:
    return f"{size / 2**20:.3g} MiB"


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
