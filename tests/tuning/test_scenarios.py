"""Scenarios: grids and draws, noise and resolution, padding, and all that is told instead of being run."""

from types import SimpleNamespace
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from actuators.fan import STEP, fan
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, Attached, JointModel, Reference, SlidingMode, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.robot import robot_joint
from jaxmuscle.tuning import Scenario, drawn, grid, sample
from jaxmuscle.tuning.cases import Sensed, Told, stacked
from jaxmuscle.tuning.tune import prepared

TIMES = STEP * np.arange(40)
UP = np.where(TIMES < 0.1, 150.0, 160.0)
START = {"speed": 150.0}
CONTROLLER = built(PID, 0.05, 0.1)


def test_a_grid_has_every_combination_and_a_seed_each():
    found = grid([UP, UP + 1], TIMES, {"inertia": [1e-4, 2e-4], "drag": [8e-7]}, seed=3, start=START)
    assert [s.changes["inertia"] for s in found] == [1e-4, 2e-4] * 2
    assert [s.seed for s in found] == [3, 4, 5, 6] and all(s.start == START for s in found)
    assert (
        len(grid(UP, TIMES))
        == 1
        == len(grid(UP.tolist(), TIMES))
        == len(grid(built(Reference, UP, UP, UP), TIMES))
    )
    assert len(grid([jm.commands.Sine(), jm.commands.Ramp()], TIMES)) == 2


def test_draws_take_the_references_in_turn():
    found = drawn([UP, UP + 1], TIMES, [{"inertia": 1e-4}, {"inertia": 2e-4}, {"inertia": 3e-4}])
    assert [float(np.asarray(s.reference)[0]) for s in found] == [150.0, 151.0, 150.0]
    assert [s.changes["inertia"] for s in found] == [1e-4, 2e-4, 3e-4]


def test_a_sample_of_a_fit_has_its_covariance():
    names = ["mass", "offset.position", "effects.gravity.torque"]
    spread = {"mass": (10.0, 0.5, True), "effects.gravity.torque": (-1.0, 2.0, False)}
    fitted: Any = {
        name: SimpleNamespace(
            path=name, value=value, std=std, positive=positive, lower=-3.0 if value < 0 else 0.0, upper=np.inf
        )
        for name, (value, std, positive) in {**spread, "offset.position": (0.0, 1.0, False)}.items()
    }
    correlations = pd.DataFrame(np.eye(3), index=names, columns=names)
    correlations.iloc[0, 2] = correlations.iloc[2, 0] = 0.8
    fit: Any = SimpleNamespace(parameters=fitted, correlations=correlations)
    draws = pd.DataFrame(sample(fit, 20_000, seed=1))
    assert list(draws) == ["mass", "effects.gravity.torque"]
    mass, torque = draws.to_numpy().T
    assert mass.min() > 0 and np.log(mass).std() == pytest.approx(0.05, rel=0.03)
    assert torque.min() == -3.0
    inside = torque > -3.0
    # Of a normal pair that is cut off at one end the correlation falls a little.
    assert 0.6 < np.corrcoef(np.log(mass[inside]), torque[inside])[0, 1] < 0.85
    assert sample(fit, 3, seed=1) == sample(fit, 3, seed=1) != sample(fit, 3, seed=2)


@pytest.mark.slow
def test_a_shorter_scenario_costs_what_it_costs_alone():
    short, long = Scenario(UP[:20], TIMES[:20], start=START), Scenario(UP, TIMES, start=START)
    sizes = dict.fromkeys(jm.tuning.TERMS, 1.0)
    found = []
    for scenarios in ([short, short], [long, short]):
        evaluation = prepared(fan(), CONTROLLER, scenarios, sizes)
        found.append(evaluation.seen([0.05, 0.1], [0, 1]))
    alone, both = found
    for name, values in {"cost": alone.cost, **alone.terms}.items():
        beside = both.cost if name == "cost" else both.terms[name]
        assert beside[1] == pytest.approx(values[1], rel=1e-9, abs=1e-12)
    assert both.cost[0] != pytest.approx(both.cost[1])


class Echo(eqx.Module):
    """Gives back the speed that it sees."""

    of_all_readings: ClassVar = True

    def start(self):
        return None

    def update(self, state, wanted, readings, step):
        return None, readings["speed"]


def test_noise_and_resolution_are_seen_by_the_controller_alone():
    echo, told = Sensed(Echo(), {"speed": jnp.asarray(0.5)}), Told(jnp.zeros(()), {"speed": jnp.asarray(0.3)})

    def see(speed):
        return echo.update(None, told, {"speed": speed, "flow": jnp.zeros(())}, jnp.asarray(1.0))[1]

    assert float(see(jnp.asarray(1.0))) == 1.5 and float(see(jnp.asarray(0.9))) == 1.0
    assert float(jax.grad(see)(1.0)) == 1.0
    none = Sensed(Echo(), {"speed": jnp.asarray(0.0)})
    assert float(none.update(None, told, {"speed": jnp.asarray(0.91)}, jnp.asarray(1.0))[1]) == pytest.approx(
        1.21
    )


def test_noise_is_the_same_for_the_same_seed_and_scaled():
    scenarios = [
        Scenario(UP, TIMES, noise={"speed": 0.2}, seed=5),
        Scenario(UP, TIMES, noise={"speed": 0.4}, seed=5),
        Scenario(UP, TIMES, seed=5),
    ]
    noise = np.asarray(stacked(fan(), scenarios, "speed", ["a"] * 3).cases.told.noise["speed"])
    np.testing.assert_array_equal(noise[1], 2 * noise[0])
    assert not noise[2].any() and 0.1 < noise[0].std() < 0.3


JOINT, CLOCK = robot_joint(0.64), 2e-3 * np.arange(20)
TURN = built(PID, 1e5, 1e5)
SLIDING = built(SlidingMode, built(JointModel, 6.0, 60.0, 5e-4), 8.0)


def on_joint(reference: Any = np.zeros(20), times=CLOCK, **settings):  # noqa: B008
    return [Scenario(reference, times, **settings)]


@pytest.mark.parametrize(
    ("scenarios", "told"),
    [
        (on_joint(np.full(20, 3.5)), r"scenarios\[0\]: expected a reference within what the angle can reach, "
         r"-2.067 to 2.067 rad; got 3.5 in row 0"),
        (on_joint(built(Reference, *np.full((3, 20), -2.1))), "within what the angle can reach.*got -2.1"),
        (on_joint(np.zeros(19)), r"one row for each of its 20 instants; got shape \(19,\)"),
        (on_joint(np.where(CLOCK > 0.02, np.nan, 0.0)), "reference of finite numbers; got nan in row 11"),
        (on_joint("up"), "expected a reference of numbers"),
        (on_joint(times=CLOCK**2), r"scenarios\[0\]: times: expected at least two uniform"),
        (on_joint() + on_joint(times=2 * CLOCK), "one sampling step for all; got 0.002 to 0.004 s"),
        (on_joint() + on_joint(built(Reference, *np.zeros((3, 20)))), "references of one kind"),
        (on_joint(changes={"inertai": 1.0}), "unknown parameter 'inertai'; did you mean 'inertia'"),
        (on_joint(changes={"inertia": -1.0}), r"changes\['inertia'\]: expected a value above zero; got -1"),
        (on_joint(changes={"inertia": np.nan}), r"changes\['inertia'\]: expected a number"),
        (on_joint(noise={"angel": 1.0}), "noise: unknown reading 'angel'; did you mean 'angle'"),
        (on_joint(resolution={"angle": -1.0}), r"resolution\['angle'\]: expected a number of zero or above"),
        (on_joint(start={"angel": 1.0}) + on_joint(), "unknown state 'angel'; did you mean 'angle'"),
        ([], "at least one scenario"),
        ([np.zeros(20)], r"scenarios\[0\]: expected a jaxmuscle.tuning.Scenario; got ndarray"),
    ],
)  # fmt: skip
def test_wrong_scenarios_are_told(scenarios, told):
    with pytest.raises(InputError, match=told):
        jm.tune(JOINT, TURN, scenarios)


class Wide(eqx.Module):
    """Gives three numbers where one is asked for."""

    weight: jax.Array

    def start(self):
        return jnp.zeros(())

    def update(self, state, wanted, measured, step):
        return state, jnp.zeros(3) + self.weight * measured


class Growing(Wide):
    """Has another state after each sample."""

    def update(self, state, wanted, measured, step):
        return jnp.zeros(2), self.weight * measured


class WholeMachine(eqx.Module):
    """Of all readings, with three commands for two regulators."""

    of_all_readings: ClassVar = True
    weight: jax.Array

    def start(self):
        return jnp.zeros(())

    def update(self, state, wanted, readings, step):
        return state, jnp.zeros(3) + self.weight


@pytest.mark.parametrize(
    ("controller", "how", "told"),
    [
        (TURN, {"free": ["proportionl"]}, "free: unknown gain 'proportionl'; did you mean 'proportional'"),
        (TURN, {"free": "proportional"}, "free: expected a list of names"),
        (TURN, {"free": ["derivative"]}, "derivative begins at 0, and nothing says how large"),
        (TURN, {"bounds": {"proportional": (2e5, 3e5)}}, "bounds of proportional: its start, 100000, is not"),
        (TURN, {"bounds": {"proportional": (3e5, 2e5)}}, "a lower one below the upper one"),
        (TURN, {"bounds": {"smoothing": (0, 1)}}, "bounds: 'smoothing' is not free"),
        (TURN, {"bounds": {"smoth": (0, 1)}}, "bounds: unknown gain 'smoth'"),
        (TURN, {"bounds": {"proportional": 3.0}}, r"bounds\['proportional'\]: expected \(lower, upper\)"),
        (TURN, {"objective": {"traking": 1.0}}, "unknown term 'traking'; did you mean 'tracking'"),
        (TURN, {"objective": {"tracking": 0.0}}, r"objective\['tracking'\]: expected the size.*got 0.0"),
        (TURN, {"objective": {}}, "at least one term of tracking, peak"),
        (TURN, {"objective": 3.0}, "expected a mapping of terms to sizes, or a function; got 3.0"),
        (TURN, {"objective": lambda run, _: jnp.zeros((2, 2))}, r"a row of residuals; got shape \(2, 2\)"),
        (TURN, {"worst": 0.5}, "worst: expected a number from 1"),
        (TURN, {"starts": [{"integral": -1.0}]}, "integral = -1 is not within its bounds"),
        (TURN, {"budget": -1.0}, "budget: expected a number of seconds"),
        (SLIDING, {}, "SlidingMode: expected a control.Reference"),
        (Wide(jnp.ones(())), {}, r"Wide: expected an output of one number, shape \(\); got shape \(3,\)"),
        (Growing(jnp.ones(())), {}, "Growing: expected update to give a state of the form that start"),
        (WholeMachine(jnp.ones(())), {}, r"expected a command of shape \(2,\); the controller gave \(3,\)"),
        (object(), {}, "expected an object with the methods start and update; got object"),
    ],
)  # fmt: skip
def test_wrong_questions_are_told(controller, how, told):
    with pytest.raises(InputError, match=told):
        jm.tune(JOINT, controller, on_joint(), **how)


def test_a_controller_of_the_whole_machine_says_what_follows_the_reference():
    machine = bench.unsteered()
    with pytest.raises(InputError, match="reading: expected the name of the reading"):
        jm.tune(machine, Wide(jnp.ones(())), on_joint())
    with pytest.raises(InputError, match="unknown reading 'positon'; did you mean 'position'"):
        jm.tune(machine, Wide(jnp.ones(())), on_joint(), reading="positon")


@pytest.mark.slow
def test_an_attachment_of_ones_own_is_kept():
    loop = feedback_on(fan(), CONTROLLER)
    other = Attached(CONTROLLER, "speed", loop.rest, loop.direction, loop.lowest, jnp.asarray(6.0))
    found = jm.tune(fan(), other, [Scenario(UP, TIMES, start=START)], starts=1, steps=2)
    assert isinstance(found.controller, Attached) and float(found.controller.highest) == 6.0
    assert found.controller.controller.proportional != CONTROLLER.proportional
