"""Feed-forward by a model's inverse: tables by hand, slopes, what tracking gains by it, what is told."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from actuators.fan import STEP, TRUE, fan
from oracles import bench
from oracles.bench import built

import jaxmuscle as jm
from jaxmuscle.control import (
    PID,
    FeedForward,
    FuzzyPID,
    ModelInverse,
    Reference,
    SlidingMode,
    closed_loop,
    feedback_on,
    model_inverse,
)
from jaxmuscle.control.channel_model import channel_model
from jaxmuscle.control.sliding_mode import JointModel
from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import AnalyticInverse, IntegralInverse, PrandtlIshlinskii, inverse
from jaxmuscle.robot.tondu2000 import robot_joint

TIMES = STEP * np.arange(300)
WAVE = 160.0 + 25.0 * np.sin(3 * TIMES)
PI_GAINS = built(PID, 0.05, 0.1)


def error(machine, controller, wanted, times, **settings):
    """Root mean square error of a run."""
    reading = machine.declared_channel().reading
    run = closed_loop(machine, feedback_on(machine, controller), wanted, times, **settings)
    return float(jnp.sqrt(jnp.mean((run.readings[reading] - wanted) ** 2)))


@pytest.mark.slow
def test_the_table_is_that_of_the_fan_at_rest():
    # k (u0 + u) = d ω² with u0 of one volt; at no voltage the fan does not come to rest in finite time.
    table = model_inverse(fan())
    by_hand = np.sqrt(TRUE["torque_constant"] * (1.0 + np.asarray(table.outputs)) / TRUE["drag"])
    np.testing.assert_allclose(table.readings, by_hand, rtol=1e-6)
    assert len(table.outputs) >= 60 and float(table.outputs[-1]) == 11.0
    _, output = table.update(None, by_hand[17], STEP)
    assert float(output) == pytest.approx(float(table.outputs[17]))
    for beyond, end in ((0.0, 0), (1e3, -1)):
        assert float(table.update(None, beyond, STEP)[1]) == float(table.outputs[end])


@pytest.mark.slow
def test_where_the_machine_ends_the_table_does():
    # The muscles of a joint reach their ends long before the pressures do.
    joint = robot_joint(0.64)
    table, (_, end) = model_inverse(joint), joint.stops["angle"]
    assert float(table.readings[-1]) == pytest.approx(np.asarray(end).item(), rel=1e-6)
    assert float(table.outputs[-1]) < 2e5 and bool((jnp.diff(table.readings) > 0).all())


@pytest.mark.slow
def test_the_dead_zone_of_a_valve_is_left_out():
    force = model_inverse(bench.model("jet-pipe"), (-0.4, 0.4), points=17)
    assert float(force.readings[0]) == pytest.approx(3.0, abs=1e-3) and float(force.outputs[0]) > -0.1


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences():
    @jax.jit
    def output(both):
        table = model_inverse(fan(drag=1e-7 * both[0]), (0.5, 8.0), points=17)
        return table.update(None, 10 * both[1], STEP)[1]

    at, size = jnp.array([8.0, 21.3]), 1e-4
    slopes = jax.jit(jax.grad(output))(at)
    for i in range(2):
        difference = (output(at.at[i].add(size)) - output(at.at[i].add(-size))) / (2 * size)
        assert float(slopes[i]) == pytest.approx(float(difference), rel=1e-5)
    # u = d ω²/k - u0, up to the straight lines between points.
    assert float(slopes[0]) == pytest.approx(1e-7 * 213.0**2 / 0.01, rel=0.01)


@pytest.mark.slow
def test_the_model_is_followed_more_closely():
    start = {"speed": 160.0}
    alone = error(fan(), PI_GAINS, WAVE, TIMES, start=start)
    found = [
        error(fan(), built(FeedForward, how, PI_GAINS), WAVE, TIMES, start=start)
        for how in (
            model_inverse(fan()),
            model_inverse(fan(), step=STEP, quickness=3.0, about=1.0),
            model_inverse(fan(), step=STEP, quickness=30.0, about=1.0),
        )
    ]
    assert found[0] < 0.85 * alone and found[1] < 0.6 * alone and found[2] < 0.3 * alone


@pytest.mark.slow
def test_a_joint_is_followed_more_closely():
    joint, times = robot_joint(0.64, friction=False), 2e-3 * np.arange(700)
    wanted, start = 0.3 * np.sin(2 * times), {"pressure": np.full(2, 351e3)}
    pid = built(PID, 1e5, 1e5, 1e4)
    alone = error(joint, pid, wanted, times, start=start)
    ahead = built(FeedForward, model_inverse(joint, step=2e-3, quickness=30.0), pid)
    assert error(joint, ahead, wanted, times, start=start) < 0.6 * alone


def test_the_linear_model_follows_ever_closer():
    model = channel_model(fan(), STEP)
    wanted = model.rest + np.sin(4 * TIMES)

    def left(quickness):
        follower: Any = model_inverse(fan(), step=STEP, quickness=quickness).dynamics
        assert follower is not None
        state, x, errors = follower.start(), None, []
        for target in wanted:
            x = (target - model.rest) * np.asarray(follower.settled) if x is None else x
            errors.append(target - model.rest - model.c @ x)
            state, shown = follower.update(state, target)
            x = model.a @ x + model.b * float((shown - model.rest) / follower.gain)
        return np.sqrt(np.mean(np.square(errors)))

    slow, quick, quicker = (left(quickness) for quickness in (1.0, 10.0, 1e4))
    assert quick < 0.5 * slow and quicker < 0.5 * quick
    # A sample late is what is left in the limit.
    assert quicker == pytest.approx(np.sqrt(np.mean(np.diff(wanted) ** 2)), rel=0.05)


def elbow_inverse(elbow):
    """The integral inverse of an elbow's own hysteresis; 5e-6 rad/Pa is its steepest slope."""
    return built(IntegralInverse, elbow.hysteresis, 1.0 / (5e-6 * 1e-2))


@pytest.mark.slow
def test_hysteresis_is_taken_out_of_the_way():
    elbow, times = bench.model("elbow"), 1e-2 * np.arange(400)
    pid, wanted = built(PID, 1e5, 3e5), 0.5 + 0.3 * np.sin(2 * times)
    start = {"pressure": np.asarray(bench.AMBIENT)}

    def late(controller):
        run = closed_loop(elbow, feedback_on(elbow, controller), wanted, times, start=start)
        return float(np.sqrt(np.mean(np.square(np.asarray(run.readings["angle"]) - wanted)[200:])))

    alone, opened = late(pid), late(built(FeedForward, elbow_inverse(elbow)))
    both = late(built(FeedForward, elbow_inverse(elbow), pid))
    assert opened < 0.2 * alone and both < 0.15 * alone and both < opened


def test_the_analytic_inverse_of_hysteresis_runs_ahead():
    model = built(PrandtlIshlinskii, 0.8, [0.3, 0.2], [0.1, 0.4], 0.0, 0.0)
    ahead = built(FeedForward, AnalyticInverse(inverse(model)))
    state, memory = ahead.start(), model.rest()
    for wanted in np.concatenate([np.sin(np.linspace(0, 9, 60)), [0.2, -0.3]]):
        state, given = ahead.update(state, jnp.asarray(wanted), jnp.asarray(0.0), STEP)
        memory = model.update(memory, given)
        assert float(model.output(memory, given)) == pytest.approx(wanted, abs=1e-12)


def test_a_feedback_of_a_reference_with_rates_gets_it_whole():
    model = built(JointModel, 5.0, 30.0, 1e-3)
    sliding = built(SlidingMode, model, 8.0, per_error=1e4)
    table = built(ModelInverse, [-1.0, 1.0], [-2e5, 2e5])
    both, wanted = built(FeedForward, table, sliding), Reference(*(jnp.asarray(x) for x in (0.2, 0.1, 0.5)))
    assert both.reads == "rad" and not both.of_one_number
    _, alone = sliding.update(sliding.start(), wanted, jnp.asarray(0.1), STEP)
    _, output = both.update(both.start(), wanted, jnp.asarray(0.1), STEP)
    assert float(output) == pytest.approx(float(alone) + 0.2 * 2e5)


def test_what_the_feedback_integrates_waits_behind_the_limits_of_the_sum():
    table, feedback = built(ModelInverse, [0.0, 100.0], [0.0, 10.0]), built(PID, 0.1, 5.0)
    both = built(FeedForward, table, feedback)
    begin = both.start()
    after, output = both.update(begin, jnp.asarray(90.0), jnp.asarray(80.0), 0.01)
    assert float(output) == pytest.approx(9.0 + 1.0 + 0.5)
    held = both.without_windup(begin, after, output, jnp.asarray(-1.0), jnp.asarray(10.0))
    assert float(held.feedback.integral) == 0.0
    grown = both.without_windup(begin, after, output, jnp.asarray(-1.0), jnp.asarray(11.0))
    assert float(grown.feedback.integral) == pytest.approx(0.5)


def test_an_inverse_that_is_integrated_goes_no_further_than_the_limit():
    elbow = bench.model("elbow")
    both = built(FeedForward, elbow_inverse(elbow))
    begin = both.start()
    after, output = both.update(begin, jnp.asarray(1.0), jnp.asarray(0.0), 1e-2)
    held = both.without_windup(begin, after, output, jnp.asarray(0.0), jnp.asarray(1e5))
    assert float(output) > 1e5 and float(held.inverse.value) == 1e5


@pytest.mark.slow
def test_share_and_feedback_are_tuned():
    drawn = jm.tuning.grid(WAVE[:120], TIMES[:120], {"inertia": [2e-4, 3e-4]}, start={"speed": 160.0})
    both = built(FeedForward, model_inverse(fan()), PI_GAINS)
    found = jm.tune(fan(), both, drawn, {"tracking": 1.0, "variation": 20.0}, starts=1)
    assert list(found.gains) == ["share", "feedback.proportional", "feedback.integral"]
    assert found.after.cost < 0.7 * found.before.cost


BAD = {
    "integrates": (
        lambda: model_inverse(bench.model("isotonic")),
        "position of rig 'isotonic' does not rise",
    ),
    "hysteresis": (lambda: model_inverse(bench.model("elbow"), (0.0, 3e5)), "IntegralInverse"),
    "no limits": (lambda: model_inverse(bench.model("elbow")), r"outputs=\(lowest, highest\)"),
    "wrong range": (lambda: model_inverse(fan(), (3.0, 1.0)), "finite and increasing"),
    "no channel": (lambda: model_inverse(bench.unsteered()), "declares no control channel"),
    "no step": (lambda: model_inverse(fan(), quickness=3.0), "the sampling step of the loop"),
    "no quickness": (lambda: model_inverse(fan(), quickness=0.0, step=STEP), "quickness above zero"),
    "shapes": (lambda: built(ModelInverse, [0.0, 1.0], [0.0]), "as many readings as outputs"),
    "falls": (lambda: built(ModelInverse, [1.0, 0.0], [0.0, 1.0]), "expected readings that increase"),
    "no inverse": (lambda: built(FeedForward, 3.0), "expected inverse to have the methods"),
    "no feedback": (
        lambda: built(FeedForward, built(ModelInverse, [0, 1], [0, 1]), "pid"),
        "expected feedback to have the methods",
    ),
    "negative": (lambda: built(FeedForward, built(ModelInverse, [0, 1], [0, 1]), share=-1.0), "share"),
}


@pytest.mark.parametrize("why", BAD)
def test_wrong_input_is_told(why):
    make, told = BAD[why]
    with pytest.raises(InputError, match=told):
        make()


def test_a_feedback_in_other_units_is_told():
    fuzzy = built(FuzzyPID, 0.5, 5.0, 1e5)
    both = built(FeedForward, built(ModelInverse, [0.0, 1.0], [0.0, 1.0]), fuzzy)
    with pytest.raises(InputError, match="FeedForward turns an angle into"):
        feedback_on(bench.model("jet-pipe"), both)
