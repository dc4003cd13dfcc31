"""Trajectories by tuning: knots of a command, beside another optimiser and a command by hand."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, fan
from oracles import bench
from oracles.bench import built
from scipy.optimize import minimize

import jaxmuscle as jm
from jaxmuscle.control import CommandKnots, closed_loop, command_knots, feedback_on
from jaxmuscle.errors import InputError

TIMES = STEP * np.arange(81)
START = {"speed": 150.0}
TARGET = np.full(81, 170.0)
THERE = jm.tuning.Scenario(TARGET, TIMES, start=START, name="there")
SIZES = {"arrival": 0.2, "effort": 1.0}


def run(values, knots=5):
    loop = feedback_on(fan(), command_knots(fan(), 0.8, knots, first=jnp.asarray(values)))
    return closed_loop(fan(), loop, TARGET, TIMES, start=START)


def test_a_command_goes_straight_from_knot_to_knot():
    found = run(np.array([0.0, 0.4, 0.1, -0.05, 0.2]))
    # Eleven volts above the idle one are the most that the fan takes.
    straight = np.interp(TIMES, np.linspace(0, 0.8, 5), [0.0, 0.4, 0.1, -0.05, 0.2])
    np.testing.assert_allclose(found.commands, 1.0 + 11.0 * straight, rtol=1e-12)


def cost(values):
    found = run(values)
    error = np.asarray(found.readings["speed"])[72:] - 170.0
    return np.mean(error**2) / 0.2**2 + np.mean((np.asarray(found.commands) - 1.0) ** 2)


@pytest.mark.slow
def test_the_least_effort_is_that_of_another_optimiser():
    tuned = jm.tune(fan(), command_knots(fan(), 0.8, 5), THERE, SIZES, starts=1)
    assert list(tuned.gains) == [f"values[{i}]" for i in range(5)]
    values = list(tuned.values.values())
    assert tuned.after.cost == pytest.approx(cost(values), rel=1e-9)
    other = minimize(cost, np.full(5, 0.15), method="Nelder-Mead", options={"maxfev": 1500, "fatol": 1e-5})
    assert tuned.after.cost <= other.fun * (1 + 1e-3) and tuned.after.value("arrival") < 0.2
    # To speed up late wastes least on the drag of the air, and a constant command that arrives costs more.
    assert np.argmax(values) > 0
    steady = min(cost(np.full(5, level)) for level in np.linspace(0.05, 0.6, 56))
    assert tuned.after.cost < 0.95 * steady


@pytest.mark.slow
def test_the_least_time_within_limits():
    knots = command_knots(fan(), 0.3, 11)
    bounds = {"values": (-1 / 11, 0.6)}
    first = jm.tune(fan(), knots, THERE, {"tracking": 1.0}, bounds=bounds, starts=1, steps=15)
    found = jm.tune(fan(), first.controller, THERE, {"settling": 0.1}, bounds=bounds, starts=1, steps=25)
    # The command of rest at the target, what a person would give, settles with the fan's own slowness.
    held = run(np.full(2, (8e-7 * 170.0**2 / 0.01 - 1.0) / 11.0), 2)
    slow = np.abs(np.asarray(held.readings["speed"]) - 170.0) > 0.02 * 20.0
    assert slow.all() and found.after.value("settling") < 0.13
    # No command brings the speed up faster than the largest one.
    torque = 0.01 * (1.0 + 0.6 * 11.0) - 8e-7 * 150.0**2
    assert found.after.value("settling") > 2e-4 * 19.6 / torque


@pytest.mark.slow
def test_one_command_for_machines_that_differ():
    several = [dataclasses.replace(THERE, changes={"inertia": inertia}) for inertia in (1.5e-4, 2.5e-4)]
    both = jm.tune(fan(), command_knots(fan(), 0.8, 5), several, SIZES, starts=1)
    assert both.after.cost < 0.5 * both.before.cost and len(both.after.terms) == 2


BAD = {
    "times": (lambda: built(CommandKnots, [0.0, 1.0], [1.0, 0.0]), "times that increase"),
    "lengths": (lambda: built(CommandKnots, [0.0, 1.0, 2.0], [0.0, 1.0]), "as many values as times"),
    "span": (lambda: built(CommandKnots, [0.0, 1.0], [0.0, 1.0], -1.0), "expected span"),
    "one": (lambda: command_knots(fan(), 1.0, 1), "at least two knots"),
    "time": (lambda: command_knots(fan(), 0.0), "time above zero"),
    "no limits": (lambda: command_knots(bench.model("elbow"), 1.0), "span="),
    "no channel": (lambda: command_knots(bench.unsteered(), 1.0), "declares no control channel"),
}


@pytest.mark.parametrize("why", BAD)
def test_wrong_input_is_told(why):
    make, told = BAD[why]
    with pytest.raises(InputError, match=told):
        make()
