"""Sweeps over operating points: one model, one compilation, any number of points, progress on the way."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import ArrayLike
from rich.console import Console

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.simulation.simulate import steps_of
from jaxmuscle.sweeps import outputs
from jaxmuscle.sweeps.executors import compute_here, compute_on, platform_of
from jaxmuscle.sweeps.job import FAILED, Cut, Job, Plan, cut, default_devices
from jaxmuscle.sweeps.operating_points import points_of
from jaxmuscle.sweeps.outputs import Column, Reductions, columns_of
from jaxmuscle.sweeps.scenario import Bench, bench_of
from jaxmuscle.sweeps.store import Memory, Store

Tell = Callable[[int, int], None]
"""Called with the points done and all points."""
LINES = 10
"""Lines at most where there is no terminal."""


@contextmanager
def shown(progress: bool | Tell, total: int) -> Iterator[Callable[[int], None]]:
    """A function to be given the number of points that have just been done.

    Args:
        progress: a function of (done, total); or whether to show a bar with the remaining time in a
            terminal, a line each tenth elsewhere.
        total: number of points that are to be computed.
    """
    done = 0
    with _told(progress, total) as tell:

        def add(points: int) -> None:
            nonlocal done
            done += points
            tell(done, total)

        yield add


@contextmanager
def _told(progress: bool | Tell, total: int) -> Iterator[Tell]:
    if callable(progress):
        yield progress
    elif not progress:
        yield lambda done, total: None
    else:
        console = Console(stderr=True)
        yield from _bar(console, total) if console.is_terminal else _lines(console)


def _bar(console: Console, total: int) -> Iterator[Tell]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    parts = (TextColumn("points"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*parts, console=console) as bar:
        task = bar.add_task("points", total=total)
        yield lambda done, total: bar.update(task, completed=done)


def _lines(console: Console) -> Iterator[Tell]:
    begun, told = time.monotonic(), 0

    def tell(done: int, total: int) -> None:
        nonlocal told
        parts = done * LINES // total
        if parts <= told:
            return
        told = parts
        left = (time.monotonic() - begun) * (total - done) / done
        console.print(f"{done} of {total} points, {left:.0f} s left", highlight=False, soft_wrap=True)

    yield tell


GIB = 2**30
COPIES = 8
"""Arrays of the size of a run's samples that lie in memory beside each other, for each that is asked for."""


class FailedPoints(UserWarning):
    """Some runs of a sweep hold values that are not finite."""


def sweep(
    actuator: AbstractActuator,
    over: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    command: Callable[..., Any] | ArrayLike | Recording | None = None,
    times: ArrayLike | Sequence[float] | None = None,
    start: Mapping[str, Any] | None = None,
    outputs: Sequence[str] | None = None,
    reductions: Reductions = None,
    method: str | None = None,
    substeps: int | None = None,
    memory: float = GIB,
    progress: bool | Tell = False,
    store: Any = None,
    client: Any = None,
) -> xr.Dataset:
    """Simulate `actuator` at many operating points, all in one compilation and on all cores or GPUs.

    Args:
        over: a mapping from names to values spans a grid; a list of mappings from names to a value is a
            list of points. A name is a path of the machine (``"muscle.end_factor"``,
            ``"effects.creep.strength"``), a quantity of its card (``"mass"``, ``"load.mass"``), a parameter
            of the command (``"command.frequency"``) or a state at the start (``"start.pressure"``). SI.
        command: a module of `jaxmuscle.commands` or a function ``f(time, **parameters)`` of JAX
            operations; a table with one row a sample; or a recording, which is replayed from its first
            measured state. ``Sine()``, of 1 Hz and one unit, for a rig with one command.
        times: sampling instants [s], uniform; 2 s in the rig's largest step when not given.
        start: measured states at the first sample; an empty muscle at rest when not given.
        outputs: readings of the rig; all when not given.
        reductions: what to keep of each run: names of ``jaxmuscle.sweeps.reductions.CATALOGUE`` (of each
            output: "maximum", "rms", "settling_time", …), functions of a `Trajectory`, or a mapping from
            names to functions or (function, unit). The whole runs when not given.
        method, substeps: steps between two samples, as for :func:`jaxmuscle.simulate`; fixed ones.
        memory: limit for the blocks at work, and for the results if they stay in memory [B].
        progress: show on standard error how far it is; or a function of (points done, all points).
        store: path or URL of a Zarr store that takes the results block by block. A sweep that was
            interrupted goes on where it was when it is called again.
        client: a `dask.distributed.Client`, whose workers compute the blocks; the numbers are those of
            one machine of the same kind, to the last bit.

    Returns:
        a dataset over the grid, or over ``point``: a variable for each output and reduction, and `failed`,
        true where a run holds values that are not finite. Units are in the attributes; SI, pressures
        absolute. From a `store`, arrays are read when they are used.

    Warns:
        FailedPoints: some runs failed; the others are not affected.

    Raises:
        InputError: an unknown name, values that do not fit, results beyond `memory`, a store that holds
            something else; the message says what to do.
    """
    bench = bench_of(actuator, over, command, times, start or {})
    points = points_of(bench, over)
    columns = columns_of(bench, outputs, reductions)
    steps = steps_of(actuator, float(bench.step), method, substeps)
    plan = Plan(tuple(column.variable for column in columns), steps.substeps, steps.method)
    working, kept = _bytes_a_point(bench, columns)
    platform = default_devices()[0].platform if client is None else platform_of(client)
    division = cut(points.shape, working, kept, memory, platform)
    job = Job(bench, plan, points, division)
    if store is None:
        found = _in_memory(job, columns, kept, memory, progress, client)
    else:
        found = _stored(job, columns, memory, progress, client, Store(store))
    _warn_of_failures(found)
    return found


def _in_memory(
    job: Job, columns: Sequence[Column], kept: int, memory: float, progress: bool | Tell, client: Any
) -> xr.Dataset:
    size = kept * len(job.points)
    if size > memory:
        raise InputError(
            f"memory: the results take {size / 2**20:.3g} MiB, the limit is {memory / 2**20:.3g} MiB; "
            f"give reductions=, or a store= on disk, or raise memory="
        )
    shapes = {name: shape for name, (_, shape, _) in outputs.variables(job.points, columns).items()}
    sink = Memory(shapes, logical=[FAILED])
    _compute(job, sink, memory, progress, client)
    return outputs.in_memory(job.bench, job.points, columns, sink.arrays)


def _stored(
    job: Job, columns: Sequence[Column], memory: float, progress: bool | Tell, client: Any, store: Store
) -> xr.Dataset:
    fingerprint = job.fingerprint()
    held = store.block_shape(fingerprint)
    if held is None:
        frame = xr.Dataset(
            coords=outputs.coordinates(job.bench, job.points, columns), attrs=outputs.attributes(job.bench)
        )
        variables = outputs.variables(job.points, columns)
        store.create(fingerprint, job.cut.block, len(job.blocks), variables, frame)
    elif held != job.cut.block:
        # Begun under another memory limit: the chunks of the store stay as they are.
        job = Job(job.bench, job.plan, job.points, Cut(job.cut.batch, held, job.cut.working))
    _compute(job, store, memory, progress, client)
    return store.open()


def _compute(job: Job, sink: Memory | Store, memory: float, progress: bool | Tell, client: Any) -> None:
    todo = sum(job.size(number) for number in sink.missing(len(job.blocks)))
    with shown(progress, todo) as tell:
        if client is None:
            compute_here(job, sink, memory, tell)
        else:
            compute_on(client, job, sink, tell)


def _bytes_a_point(bench: Bench, columns: Sequence[Column]) -> tuple[int, int]:
    """Memory of a point while it is computed, and of its results [B]."""
    machine = bench.actuator
    series = max(1, len(machine.commands)) + sum(len(columns) for columns in machine.outputs.values())
    kept = 1 + 8 * sum(math.prod(column.shape) for column in columns)
    return 8 * len(bench.times) * series * COPIES + kept, kept


def _warn_of_failures(found: xr.Dataset) -> None:
    """Say how many runs failed, and where the first of them is."""
    failed = np.asarray(found[FAILED])
    if not failed.any():
        return
    first = dict(zip(found[FAILED].dims, (int(i[0]) for i in np.nonzero(failed)), strict=True))
    at = found[FAILED].isel(first)
    where = ", ".join(f"{name} = {np.asarray(value)}" for name, value in at.coords.items())
    warnings.warn(
        f"{int(failed.sum())} of {failed.size} points failed: their runs hold values that are not finite. "
        f"The first is at {where}; they are marked in the variable {FAILED!r}",
        FailedPoints,
        stacklevel=3,
    )
