"""A batch divided over several devices, and the threads of one."""

import subprocess
import sys

import pytest

CODE = """
import jax, numpy as np, jaxmuscle as jm
from jaxmuscle.sweeps import job, operating_points, outputs, scenario
from jaxmuscle.sweeps.job import cut
assert len(jax.devices()) == 2
machine, clock = jm.actuator(jm.read(jm.sample("lift")).card), np.arange(60) * 0.002
bench = scenario.bench_of(machine, {}, jm.commands.Sine(amplitude=2.0), clock, {})
asked = outputs.columns_of(bench, None, ["maximum"])
grid = operating_points.points_of(bench, {"mass": np.linspace(1, 20, 61)})
plan = job.Plan(tuple(c.variable for c in asked), 1)
division = cut(grid.shape, 1000, 8, 2**30)
assert len(job.default_devices()) == 1
one, two = (job.Job(bench, plan, grid, division, tuple(jax.devices()[:n])) for n in (1, 2))
for number in range(len(one.blocks)):
    a, b = one.compute(number), two.compute(number)
    assert set(a) == {"pressure_maximum", "position_maximum", "failed"}
    for name in a:
        np.testing.assert_allclose(a[name], b[name], rtol=1e-12)
print("the same")
"""


@pytest.mark.slow
def test_two_devices_give_the_numbers_of_one():
    environment = {"JAX_NUM_CPU_DEVICES": "2", "PATH": "", "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, timeout=120, env=environment
    )
    assert done.stdout == "the same\n", done.stderr
