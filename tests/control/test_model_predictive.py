"""Model predictive control: its plan by another optimiser, no error at rest, limits, slopes, what is told."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, fan
from oracles import bench
from oracles.bench import built
from scipy.optimize import minimize

from jaxmuscle import simulate
from jaxmuscle.control import PID, Reference, closed_loop, feedback_on, model_predictive
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace

TIMES = STEP * np.arange(120)
WAVE = 160.0 + 25.0 * np.sin(3 * TIMES)
START = {"speed": 160.0}
PLANNED = model_predictive(fan(), STEP, error=1.0, move=0.5, blocks=5, start=START)


def run(machine, controller, wanted):
    times = STEP * np.arange(len(wanted))
    found = closed_loop(machine, feedback_on(machine, controller), wanted, times, start=START)
    return np.asarray(found.readings["speed"]), np.asarray(found.commands)


@pytest.mark.slow
def test_the_plan_is_that_of_another_optimiser():
    settings = {"error": 1.0, "move": 0.5, "blocks": 4, "hold": 2, "iterations": 6, "start": START}
    controller = model_predictive(fan(), STEP, **settings)
    _, output = eqx.filter_jit(controller.update)(
        controller.start(), jnp.asarray(165.0), jnp.asarray(158.0), STEP
    )

    def cost(plan):
        # From 160 rad/s on by simulation; the model is wrong by -2 rad/s.
        command = 1.0 + np.append(np.repeat(plan, 2), 0.0)
        shown = np.asarray(simulate(fan(), command, STEP * np.arange(9), start=START).readings["speed"])[1:]
        return np.sum((shown - 2.0 - 165.0) ** 2) / 2 + np.sum(np.diff(plan, prepend=0.0) ** 2) / 0.25

    other = minimize(cost, np.zeros(4), method="BFGS", options={"gtol": 1e-6})
    assert float(output) == pytest.approx(other.x[0], rel=1e-3)


@pytest.mark.slow
def test_the_model_is_followed_as_closely_as_it_sees_ahead():
    pid, _ = run(fan(), built(PID, 0.05, 0.1), WAVE)
    found, _ = run(fan(), PLANNED, WAVE)
    ahead = np.minimum(np.arange(120)[:, None] + 1 + np.arange(5), 119)
    seen, _ = run(fan(), PLANNED, WAVE[ahead])
    late, now, early = (np.sqrt(np.mean((x - WAVE) ** 2)) for x in (pid, found, seen))
    assert now < 0.2 * late and early < 0.3 * now


@pytest.mark.parametrize("drag", [6e-7, 1e-6])
def test_no_error_is_left_on_a_machine_that_the_model_is_not(drag):
    speed, volts = run(fan(drag=drag), PLANNED, np.where(STEP * np.arange(400) < 0.3, 160.0, 190.0))
    assert abs(speed[-1] - 190.0) < 0.02 and speed.max() < 192.0
    assert volts.max() <= 12.0 and volts.min() >= 0.0


def test_behind_a_limit_nothing_winds_up():
    speed, volts = run(fan(), PLANNED, np.where(TIMES < 0.8, 600.0, 200.0))
    assert (volts[10:80] == 12.0).all() and volts[81] < 12.0 and np.isfinite(speed).all()


@pytest.mark.parametrize("iterations", [1, 2, 3])
def test_however_often_it_iterates_it_comes_off_a_limit(iterations):
    settings = {"error": 1.0, "move": 0.5, "blocks": 5, "iterations": iterations, "start": START}
    speed, volts = run(
        fan(), model_predictive(fan(), STEP, **settings), np.where(STEP * np.arange(400) < 0.3, 160.0, 260.0)
    )
    assert volts.max() == pytest.approx(12.0) and speed[-1] == pytest.approx(260.0, abs=0.1)


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences():
    @jax.jit
    def cost(both):
        controller = replace(PLANNED, {"move": both[0]})
        machine = fan(drag=1e-7 * both[1])
        loop = feedback_on(machine, controller)
        found = closed_loop(machine, loop, WAVE[:25], TIMES[:25], start=START)
        return jnp.mean((found.readings["speed"] - WAVE[:25]) ** 2)

    at, size = jnp.array([0.5, 9.0]), 1e-5
    for mode in (jax.grad, jax.jacfwd):
        slopes = jax.jit(mode(cost))(at)
        for i in range(2):
            difference = (cost(at.at[i].add(size)) - cost(at.at[i].add(-size))) / (2 * size)
            assert float(slopes[i]) == pytest.approx(float(difference), rel=1e-5)


HALF: Any = 1.5
RATES = Reference(*map(jnp.asarray, (160.0, 0.0, 0.0)))
BAD = {
    "move": (lambda: model_predictive(fan(), STEP, error=1.0, move=0.0), "expected move"),
    "blocks": (lambda: model_predictive(fan(), STEP, error=1.0, move=1.0, blocks=0), "blocks: expected"),
    "hold": (lambda: model_predictive(fan(), STEP, error=1.0, move=1.0, hold=HALF), "hold: expected"),
    "step": (lambda: model_predictive(fan(), -STEP, error=1.0, move=1.0), "time_step: expected"),
    "no channel": (
        lambda: model_predictive(bench.unsteered(), STEP, error=1.0, move=1.0),
        "declares no control channel",
    ),
    "short sight": (lambda: run(fan(), PLANNED, np.ones((120, 3))), "one number, or 5 at each sample"),
    "rates": (lambda: PLANNED.update(PLANNED.start(), RATES, jnp.asarray(160.0), STEP), "control.Reference"),
}  # fmt: skip


@pytest.mark.parametrize("why", BAD)
def test_wrong_input_is_told(why):
    make, told = BAD[why]
    with pytest.raises(InputError, match=told):
        make()
