"""Derivatives through whole closed loops (dry friction, saturation, sampled controller, noise) beside finite
differences, for scenarios side by side.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import fan
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import PID, feedback_on
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE, robot_joint
from jaxmuscle.tuning.cases import stacked
from jaxmuscle.tuning.cost_terms import Objective
from jaxmuscle.tuning.evaluation import MANY, Evaluation, Rig, _forward
from jaxmuscle.tuning.gains import gains_of
from jaxmuscle.tuning.tune import prepared

STEP, SAMPLES, SIZE = 2e-3, 150, 1e-5
TIMES = np.arange(SAMPLES) * STEP
JOINT, TURN = robot_joint(0.64), built(PID, 3e6, 1e7, 3e5)
REST = {"pressure": np.full(2, bench.AMBIENT + MEAN_PRESSURE)}
SIZES = {
    "tracking": 0.01,
    "peak": 0.03,
    "overshoot": 0.02,
    "settling": 0.1,
    "effort": 1e5,
    "variation": 3e6,
}
LOOP = feedback_on(JOINT, TURN)


@pytest.fixture(scope="module")
def evaluation():
    references = [0.3 * np.sin(9 * TIMES), np.where(TIMES < 0.1, 0.0, 0.3)]
    scenarios = jm.tuning.grid(references, TIMES, {"inertia": [0.5, 0.9]}, start=REST, noise={"angle": 2e-4})
    cases = stacked(JOINT, scenarios, "angle", ["a scenario"] * 4)
    sizes = {name: jnp.asarray(size) for name, size in SIZES.items()}
    gains = gains_of(TURN, None, None)
    objective = Objective(sizes, None, "angle", LOOP.rest)
    rig = Rig(JOINT, gains.movable, LOOP, objective, None, cases.step, cases.samples)
    return Evaluation(rig, gains.unknowns, cases, (0, 1, 2, 3), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1.0, 4.0], ids=["mean", "worst"])
def test_slopes_of_the_cost_equal_finite_differences(evaluation, order):
    both = dataclasses.replace(evaluation, order=order)
    at = both.unknowns.coordinates(both.unknowns.start)
    here, random = both(at[None])[0], np.random.default_rng(1)
    directions = random.standard_normal((10, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for direction in directions:
        up, down = both(np.stack([at + SIZE * direction, at - SIZE * direction]))
        difference = (up.cost - down.cost) / (2 * SIZE)
        assert here.gradient @ direction == pytest.approx(
            difference, abs=1e-7 * float(np.linalg.norm(here.gradient))
        )
    assert np.linalg.eigvalsh(here.matrix).min() > 0


@pytest.mark.slow
def test_derivatives_are_the_same_apart_from_the_values(evaluation):
    """From four scenarios a program on they are computed so: with dry friction, saturation and noise."""
    gains, cases = jnp.asarray(evaluation.unknowns.start), evaluation.stacked.cases
    assert len(cases.counts) == MANY
    apart = _forward(evaluation.rig, gains, cases)
    halves = [jax.tree.map(lambda leaf, own=own: leaf[own], cases) for own in (slice(0, 2), slice(2, 4))]
    beside = [_forward(evaluation.rig, gains, half) for half in halves]
    for one, parts in zip(apart, zip(*beside, strict=True), strict=True):
        other = np.concatenate(parts)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * float(np.abs(other).max()))


@pytest.mark.slow
def test_the_runs_are_saturated_and_stick(evaluation):
    seen = evaluation.seen(evaluation.unknowns.start, evaluation.rows)
    assert (seen.commands.min(), seen.commands.max()) == (bench.AMBIENT, bench.AMBIENT + 2 * MEAN_PRESSURE)
    still = np.diff(seen.readings["angle"], axis=1) == 0
    slow = np.abs(np.diff(seen.readings["angle"], axis=1)) < 1e-9
    assert still.any() or slow.any()


def test_reverse_mode_gives_the_same():
    times = 0.01 * np.arange(80)
    scenarios = jm.tuning.grid(
        150 + 20 * np.sin(5 * times), times, start={"speed": 150.0}, noise={"speed": 0.2}
    )
    gains, found = built(PID, 0.05, 0.1, 0.001), []
    for function in (residuals, sum_of_squares):
        evaluation = prepared(fan(), gains, scenarios, function)
        assert evaluation.forward == (function is residuals)
        found += evaluation(evaluation.unknowns.coordinates(evaluation.unknowns.start)[None])
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-12)
    np.testing.assert_allclose(found[0].gradient, found[1].gradient, rtol=1e-8)


def residuals(run, reference):
    return run.readings["speed"] - reference


def sum_of_squares(run, reference):
    return jnp.sum(residuals(run, reference) ** 2)


@pytest.mark.slow
def test_an_objective_may_look_at_the_machine_of_a_scenario():
    times, inertias = 0.01 * np.arange(40), [2e-4, 4e-4]
    scenarios = jm.tuning.grid(
        150 + 20 * np.sin(5 * times), times, {"inertia": inertias}, start={"speed": 150.0}
    )

    def energy(run, reference, machine):
        return machine.inertia / 1e-4 * (run.readings["speed"] - reference)

    both = [prepared(fan(), built(PID, 0.05), scenarios, function) for function in (energy, residuals)]
    own, plain = (each.seen(each.unknowns.start, each.rows).cost for each in both)
    np.testing.assert_allclose(own, np.square([2.0, 4.0]) * plain, rtol=1e-12)
    # A default of the user's own is no place for the machine.
    alike = prepared(
        fan(), built(PID, 0.05), scenarios, lambda run, wanted, by=1.0: by * residuals(run, wanted)
    )
    np.testing.assert_allclose(alike.seen(alike.unknowns.start, alike.rows).cost, plain, rtol=1e-12)


@pytest.mark.slow
def test_a_wider_friction_is_smoother_and_has_its_slopes():
    light = robot_joint(0.03)

    def moved(gain, widening):
        loop = feedback_on(light, built(PID, gain))
        run = jm.control.closed_loop(
            light, loop, 0.2 * np.sin(20 * TIMES), TIMES, start=REST, widening=widening
        )
        return run.readings["angle"]

    runs = {widening: np.asarray(moved(3e5, widening)) for widening in (None, 1.0, 100.0)}
    np.testing.assert_allclose(runs[1.0], runs[None], rtol=1e-12, atol=1e-15)
    apart = np.abs(runs[100.0] - runs[1.0]).max() / np.ptp(runs[1.0])
    assert 0.1 < apart < 1.0
    _, slopes = jax.jvp(lambda gain: moved(gain, 100.0), (3e5,), (1.0,))
    difference = (moved(300_003.0, 100.0) - moved(299_997.0, 100.0)) / 6.0
    np.testing.assert_allclose(slopes, difference, rtol=1e-4, atol=1e-7 * float(jnp.abs(slopes).max()))


@pytest.mark.slow
def test_a_wider_friction_is_the_same_in_open_loop():
    light, commands = robot_joint(0.03), 351e3 + 5e4 * np.sin(20 * TIMES)[:, None] * np.array([1.0, -1.0])
    angle = lambda **how: np.asarray(jm.simulate(light, commands, TIMES, start=REST, **how).readings["angle"])  # noqa: E731
    plain, same, wide = angle(), angle(widening=1.0), angle(widening=100.0)
    np.testing.assert_allclose(same, plain, rtol=1e-12, atol=1e-15)
    assert np.abs(wide - plain).max() > 0.02 * np.ptp(plain)
