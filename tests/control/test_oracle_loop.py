"""A joint in closed loop beside the rig on two pages, RK4 with sharp friction, under the same controller."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from oracles.joint import joint

from jaxmuscle.control import PID, closed_loop, feedback_on

STEP, MEAN = bench.STEPS["joint"], 2.5e5
TIMES = STEP * np.arange(250)
WANTED = 0.25 * (1 - np.cos(10 * TIMES))
THREADS = {"thread_friction": bench.THREADS}


@pytest.mark.parametrize("gains", [(4e5, 1e6, 2e4), (2e6, 0.0, 1e5)], ids=["within limits", "saturated"])
def test_a_joint_under_pid_is_that_of_the_oracle(gains):
    machine = bench.model("joint", **THREADS)
    loop = feedback_on(machine, built(PID, *gains), mean_pressure=MEAN)
    rest = bench.AMBIENT + np.full(2, MEAN)
    ours = closed_loop(machine, loop, WANTED, TIMES, start={"pressure": rest}, substeps=4)
    update = jax.jit(
        lambda state, wanted, angle: loop.update(state, wanted, {"angle": angle}, jnp.asarray(STEP))
    )
    state, given = loop.start(), []

    def answer(_first, _second, angle):
        nonlocal state
        state, command = update(state, WANTED[len(given)], angle)
        given.append(np.asarray(command).tolist())
        return given[-1]

    idle = np.tile(rest, (len(TIMES), 1))
    *_, angle, _ = joint(bench.CARDS["joint"], THREADS, idle, STEP, rest, 0.0, 8, answer)
    saturated = np.asarray(given).max() >= bench.AMBIENT + 2 * MEAN
    assert saturated == (gains[0] > 1e6) and np.ptp(angle) > 0.2
    np.testing.assert_allclose(ours.readings["angle"], angle, atol=2e-3 * np.ptp(angle))
    np.testing.assert_allclose(ours.commands, given, atol=5e-3 * np.ptp(given))
