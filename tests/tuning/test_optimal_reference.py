"""Optimal references: a case with a known optimum, slopes, limits with their multipliers, what is told."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, TRUE, fan
from oracles import bench
from oracles.bench import built
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

import jaxmuscle as jm
from jaxmuscle.control import PID, Reference, closed_loop, feedback_on
from jaxmuscle.errors import InputError
from jaxmuscle.optimization.least_squares import with_jacobian
from jaxmuscle.tuning import Scenario, optimal_reference
from jaxmuscle.tuning.free_reference import planning_of

SAMPLES = 41
TIMES = STEP * np.arange(SAMPLES)
LAST = TIMES[-1]
GAIN = 0.2
LOOP = built(PID, GAIN)
TARGET = np.full(SAMPLES, 170.0)
UP = Scenario(TARGET, TIMES, start={"speed": 150.0})
AT_THE_END = np.where(np.arange(SAMPLES) == SAMPLES - 1, 170.0, np.inf)
ARRIVES = {"speed": (np.where(np.isinf(AT_THE_END), -np.inf, 170.0), AT_THE_END)}


def without_air(**values):
    """A fan of which no air brakes the rotor: its speed is the integral of the voltage."""
    return fan(drag=1e-30, idle_voltage=0.0, **values)


def by_hand(knots):
    """Least sum of u² by linear algebra: u = K (w - ω), ω' = k u/J, so that ω goes on by k T u/J a sample.

    The reference w = B v is the natural spline through the values v; ω is 170 rad/s at the last sample.
    """
    spline = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(TIMES)
    per_sample = STEP * TRUE["torque_constant"] / TRUE["inertia"]
    speed, slopes, commands = 150.0, np.zeros(len(knots)), []
    last = speed, slopes
    for row in spline:
        commands.append((-GAIN * speed, GAIN * (row - slopes)))
        last = speed, slopes
        speed, slopes = speed + per_sample * commands[-1][0], slopes + per_sample * commands[-1][1]
    rest, by = np.array([u for u, _ in commands]), np.array([slope for _, slope in commands])
    kkt = np.block([[2 * by.T @ by / SAMPLES, last[1][:, None]], [last[1][None], np.zeros((1, 1))]])
    values = np.linalg.solve(kkt, np.append(-2 * by.T @ rest / SAMPLES, 170.0 - last[0]))
    return values[:-1], values[-1]


@pytest.mark.slow
def test_the_least_effort_of_an_integrator_is_that_of_linear_algebra():
    found = optimal_reference(
        without_air(), LOOP, UP, {"effort": 1.0}, limits=ARRIVES, knots=5, tolerance=1e-3
    )
    assert found.kept and found.converged
    values, slope = by_hand(found.knots)
    # About its minimum the cost is flat: it tells where it is to 1e-6 of the 170 rad/s that count as one.
    np.testing.assert_allclose(found.values, values, atol=5e-3)
    multiplier = found.multipliers["speed"][0, 1, -1] - found.multipliers["speed"][0, 0, -1]
    assert float(multiplier) == pytest.approx(slope, rel=1e-2)
    # No command needs less than the constant one (Cauchy, Schwarz): u = J 20/(k T).
    least = TRUE["inertia"] * 20.0 / (TRUE["torque_constant"] * LAST) * np.sqrt((SAMPLES - 1) / SAMPLES)
    assert least * (1 - 1e-4) <= float(found.after["effort"][0]) < 1.01 * least
    assert "limit of speed: kept, reached" in str(found)


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences():
    joint = bench.model("joint", thread_friction=bench.THREADS)
    times = 2e-3 * np.arange(60)
    rest = {"pressure": np.full(2, bench.AMBIENT + 2.5e5)}
    loop = feedback_on(joint, built(PID, 4e5, 1e6, 2e4))
    own = [Scenario(np.full(60, 0.2), times, changes={"inertia": j}, start=rest) for j in (0.03, 0.05)]
    limits: Any = {"pressure": (None, bench.AMBIENT + 2.6e5), "rate command": (None, 1e7), "angle": (0, 0.1)}
    sizes = {"arrival": 0.01, "effort": 1e5, "settling": 0.1}
    planning, _ = planning_of(joint, loop, own, ["a", "b"], sizes, limits, 5, None, False)
    both = with_jacobian(lambda x, plan: jnp.concatenate(plan.parts(x)), planning)
    at, size = np.array([0.1, 0.5, 1.2, 0.9, 1.1]), 1e-6
    _, slopes = both(at)
    assert np.isfinite(slopes).all() and (np.abs(slopes).max(axis=0) > 1e-3).all()
    for i, unit in enumerate(np.eye(5)):
        difference = (both(at + size * unit)[0] - both(at - size * unit)[0]) / (2 * size)
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-5 * np.abs(slopes[:, i]).max())


@pytest.mark.slow
def test_with_air_it_is_that_of_another_optimiser():
    found = optimal_reference(fan(), LOOP, UP, {"arrival": 0.2, "effort": 1.0}, knots=4)
    loop = feedback_on(fan(), LOOP)
    planning, _ = planning_of(fan(), loop, [UP], ["a"], {"arrival": 0.2, "effort": 1.0}, None, 4, None, False)

    def cost(values):
        told = planning.reference(jnp.asarray((values - 170.0) / 170.0))
        run = closed_loop(fan(), loop, told, TIMES, start=UP.start)
        error, effort = np.asarray(run.readings["speed"])[36:] - 170.0, np.asarray(run.commands) - 1.0
        return np.mean(error**2) / 0.2**2 + np.mean(effort**2)

    assert found.cost == pytest.approx(cost(found.values), rel=1e-9)
    other = minimize(cost, np.full(4, 170.0), method="Nelder-Mead", options={"maxfev": 1500, "fatol": 1e-7})
    assert found.cost <= other.fun * (1 + 1e-4)


@pytest.mark.slow
def test_limits_are_kept_and_cost_something():
    sizes = {"tracking": 1.0}
    free = optimal_reference(fan(), LOOP, UP, sizes, knots=8)
    fast = float(np.diff(np.asarray(free.runs[0].readings["speed"])).max() / STEP)
    most = float(np.asarray(free.runs[0].commands).max())
    limits = {"command": (None, 0.6 * most), "rate speed": (None, 0.5 * fast)}
    found = optimal_reference(fan(), LOOP, UP, sizes, limits=limits, knots=8)
    assert found.kept and found.cost > 1.05 * free.cost and not free.excess
    run = found.runs[0]
    assert np.asarray(run.commands).max() <= 0.6 * most * (1 + 1e-3)
    assert (np.diff(np.asarray(run.readings["speed"])) / STEP).max() <= 0.5 * fast * (1 + 1e-3)
    assert found.cost < found.cost_before or found.excess["command"] == 0.0
    # A multiplier says by how much the cost falls where a limit is a little wider.
    wider = {"command": (None, 0.6 * most * 1.01), "rate speed": (None, 0.5 * fast * 1.01)}
    less = optimal_reference(fan(), LOOP, UP, sizes, limits=wider, knots=8)
    gain = sum(
        0.01 * limits[name][1] * float(found.multipliers[name][0, 1].sum())
        for name in ("command", "rate speed")
    )
    assert found.cost - less.cost == pytest.approx(gain, rel=0.1)


@pytest.mark.slow
def test_one_reference_for_several_machines_ends_where_it_is_told():
    several = [Scenario(TARGET, TIMES, changes={"inertia": j}, start=UP.start) for j in (1.8e-4, 2.2e-4)]
    sizes = {"arrival": 0.5, "effort": 5.0}
    found = optimal_reference(fan(), LOOP, several, sizes, knots=6, seconds=0.3)
    assert len(found.runs) == 2 and found.after["arrival"].shape == (2,)
    assert found.cost < 0.5 * found.cost_before and found.knots[-1] == pytest.approx(0.3)
    late = found.times > 0.3 + 1e-9
    np.testing.assert_allclose(np.asarray(found.reference)[late], found.values[-1])


@pytest.mark.slow
def test_a_controller_of_rates_is_told_those_of_the_spline():
    class Leading(PID):
        of_one_number = False

        def update(self, state, reference, measured, step):
            told: Any = reference
            return super().update(state, told.angle + 0.02 * told.velocity, measured, step)

    sizes, leading = {"arrival": 0.5, "effort": 5.0}, built(Leading, GAIN)
    found = optimal_reference(fan(), leading, UP, sizes, knots=5, rates=True)
    assert isinstance(found.reference, Reference)
    values, rates, bends = (np.asarray(leaf) for leaf in found.reference)
    np.testing.assert_allclose(np.gradient(values, STEP)[1:-1], rates[1:-1], atol=0.02 * np.ptp(rates))
    np.testing.assert_allclose(np.gradient(rates, STEP)[2:-2], bends[2:-2], atol=0.1 * np.ptp(bends))


class Lost(PID):
    """Gives what is no number."""

    def update(self, state, reference, measured, step):
        return state, jnp.nan * reference


BAD: dict[str, Any] = {
    "reading": ({"limits": {"sped": (0, 1)}}, "limits: unknown reading 'sped'; did you mean 'speed'"),
    "pair": ({"limits": {"speed": 3.0}}, r"limits\['speed'\]: expected \(lowest, highest\) in SI"),
    "order": ({"limits": {"speed": (2.0, 1.0)}}, "a lower one below the upper one; got 2 and 1 in row 0"),
    "length": ({"limits": {"speed": (np.zeros(3), None)}}, r"expected numbers, one or 41; got shape \(3,\)"),
    "nan": ({"limits": {"speed": (np.nan, None)}}, "values that are no numbers"),
    "none": ({"limits": {"speed": (None, None)}}, "at least one limit"),
    "knots": ({"knots": 2}, "knots: expected a whole number from 3 on; got 2"),
    "seconds": ({"seconds": 9.0}, "up to the last sample, 0.4 s; got 9.0"),
    "first": ({"first": np.zeros(3)}, r"first: expected one finite number, or 12; got shape \(3,\)"),
    "term": ({"objective": {"effrt": 1.0}}, "unknown term 'effrt'; did you mean 'effort'"),
    "margin": ({"objective": {"sensitivity": 2.0}}, "does not depend on the reference"),
    "scenario": ({"scenarios": []}, "at least one jaxmuscle.tuning.Scenario"),
    "lengths": ({"scenarios": [UP, Scenario(TARGET[:9], TIMES[:9])]}, "scenarios of one length"),
    "gains": ({"controller": built(Lost, GAIN)}, "runs away at the values to begin with"),
    "channel": ({"actuator": bench.unsteered()}, "declares no control channel"),
}  # fmt: skip


@pytest.mark.parametrize("why", BAD)
def test_wrong_input_is_told(why):
    how, told = BAD[why]
    usual = {"actuator": fan(), "controller": LOOP, "scenarios": UP, "objective": {"effort": 1.0}}
    with pytest.raises(InputError, match=told):
        jm.tuning.optimal_reference(**{**usual, **how})
