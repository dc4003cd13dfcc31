"""How a sweep is cut: every point once, one size of batch, within the memory that is allowed."""

import math
from typing import Any

import jax
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.sweeps.job import BATCH_SHARE, BLOCK_SHARE, LANES, Job, Plan, _batch, cut, default_devices
from jaxmuscle.sweeps.operating_points import points_of
from jaxmuscle.sweeps.outputs import columns_of
from jaxmuscle.sweeps.scenario import bench_of
from jaxmuscle.sweeps.sweep import _bytes_a_point

SHAPES = [(1,), (7,), (100,), (4097,), (3, 10007), (1000, 600), (97, 101, 11), (5, 1, 2, 3), (1, 1)]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("memory", [2**30, 2**20])
def test_every_point_is_in_one_block(shape, memory):
    division = cut(shape, 2000, 100, memory)
    seen = np.zeros(shape, int)
    for block in division.blocks(shape):
        seen[block] += 1
    assert (seen == 1).all()
    assert division.batch * 2000 <= BATCH_SHARE * memory
    assert math.prod(division.block) * 100 <= BLOCK_SHARE * memory


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_little_is_computed_in_vain(shape):
    division = cut(shape, 2000, 100, 2**30)
    sizes = [math.prod(part.stop - part.start for part in block) for block in division.blocks(shape)]
    computed = sum(math.ceil(size / division.batch) * division.batch for size in sizes)
    assert computed <= max(1.35 * math.prod(shape), math.prod(shape) + LANES)


def test_the_cut_is_that_of_the_sweep_not_of_the_machine():
    division = cut((64, 32), 1000, 100, 2**30)
    assert division == cut((64, 32), 1000, 100, 2**30)
    assert division.batch == 256 and division.block == (8, 32)


def test_a_batch_is_made_smaller_for_long_runs():
    assert cut((10_000,), 2**23, 8, 2**30).batch == 32
    assert cut((10_000,), 2**28, 8, 2**30).batch == 1
    with pytest.raises(jm.InputError, match=r"one point takes 1.02e\+03 MiB, the limit is 512 MiB"):
        cut((10_000,), 2**30, 8, 2**29)


@pytest.mark.slow
@pytest.mark.parametrize("reductions", [None, ["maximum", "bandwidth", "gain"]], ids=["whole", "reduced"])
def test_memory_is_not_more_than_estimated(machine, sine, reductions):
    """XLA's own account of what a compiled batch takes."""
    times = np.arange(1000) * 0.002
    bench = bench_of(machine, {}, sine, times, {})
    columns = columns_of(bench, None, reductions)
    working, kept = _bytes_a_point(bench, columns)
    points = points_of(bench, {"mass": np.linspace(1, 20, 512), "command.frequency": [1.0]})
    division = cut(points.shape, working, kept, 2**30)
    job = Job(bench, Plan(tuple(c.variable for c in columns), 1), points, division)
    rows = {path: values[: division.batch] for path, values in points.inside(job.blocks[0]).items()}
    given = {path: jax.device_put(values) for path, values in rows.items()}
    batch: Any = _batch
    compiled = batch.lower(bench, given, job.plan, default_devices()).compile()
    account = compiled.compiled.memory_analysis()
    needed = account.temp_size_in_bytes + account.output_size_in_bytes
    assert 0.1 * division.batch * working < needed <= division.batch * working
