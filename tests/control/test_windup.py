"""Integrals under a limited command: no overshoot after saturation, nothing changed without a limit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from oracles.loops import MODIFIED

from jaxmuscle.control import Attached, FuzzyPID, IntegralInversePID, ScheduledPID, closed_loop, feedback_on
from jaxmuscle.hysteresis import IntegralInverse

STEP = 0.01
ONE_BAR = jnp.asarray(0.0), jnp.asarray(1e5)
PID = built(IntegralInversePID, None, 2e5, 0.3, 0.0)
SCHEDULED = built(ScheduledPID, None, np.array([5.0]), np.full(2, 2e5), np.full(2, 0.3), np.zeros(2))
FUZZY = built(FuzzyPID, 0.5, 50.0, 1.5e5, 6e5, 4.5e5)
TIMES = np.arange(1500) * STEP
WANTED = np.where(TIMES < 8, 1.5, 0.4)
"""First out of reach for 8 s, then within it."""


def loop(controller, highest):
    """The elbow under a controller whose command ends at `highest` above ambient [Pa]."""
    elbow = bench.model("elbow")
    ambient = float(elbow.ambient_pressure)
    attached = Attached(controller, "angle", *map(jnp.asarray, (ambient, 1.0, ambient, ambient + highest)))
    return closed_loop(elbow, attached, WANTED, TIMES, start={"pressure": ambient})


@pytest.mark.parametrize("controller", [PID, SCHEDULED], ids=["PID", "scheduled"])
def test_command_leaves_its_limit_when_the_error_turns(controller):
    found = loop(controller, 4.5e5)
    gauge = np.asarray(found.commands) - bench.AMBIENT
    assert (gauge[400:800] == 4.5e5).all() and found.readings["angle"][799] < 1.45
    # Wound up for 8 s, a PID would keep the limit for seconds after the target has come within reach.
    off = np.flatnonzero(gauge[800:] < 4.5e5)[0] * STEP
    assert off <= STEP
    late = np.abs(np.asarray(found.readings["angle"])[1100:] - 0.4)
    assert late.max() < 0.02


@pytest.mark.parametrize("controller", [PID, SCHEDULED], ids=["PID", "scheduled"])
def test_without_a_limit_nothing_is_held(controller):
    rest, step = controller.start(), jnp.asarray(STEP)
    after, output = controller.update(rest, jnp.asarray(1.0), jnp.asarray(0.2), step)
    held = controller.without_windup(rest, after, output, -jnp.inf, jnp.inf)
    assert jax.tree.all(jax.tree.map(lambda x, y: bool(x == y), after, held))


def test_integral_waits_beyond_a_limit_and_goes_back_at_once():
    rest = built(IntegralInversePID, None, 2e5, 0.3, 0.0).start()
    up, output = PID.update(rest, jnp.asarray(1.0), jnp.asarray(0.0), STEP)
    assert float(PID.without_windup(rest, up, output, *ONE_BAR).integral) == 0 < float(up.integral)
    down, _ = PID.update(up, jnp.asarray(0.0), jnp.asarray(0.1), STEP)
    assert float(PID.without_windup(up, down, output, *ONE_BAR).integral) == float(down.integral)


def test_fuzzy_integral_waits_at_limits_narrower_than_its_own():
    state = FUZZY.start(1.0)
    for _ in range(300):
        after, output = FUZZY.update(state, jnp.asarray(1.0), jnp.asarray(0.0), STEP)
        state = FUZZY.without_windup(state, after, output, jnp.asarray(0.0), jnp.asarray(3e5))
    # The rules give 1.5e5 of 3e5, the integral the rest and not more than one sample beyond.
    assert 1.4e5 < float(state.integral) < 1.5e5 + 6e5 * STEP


def test_input_of_the_inverse_waits_where_the_device_cannot_follow():
    pid = built(IntegralInversePID, built(IntegralInverse, MODIFIED, 50.0), 0.1, 1.0, 0.0)
    state = pid.start()
    for _ in range(300):
        after, output = pid.update(state, jnp.asarray(50.0), jnp.asarray(1.0), STEP)
        state = pid.without_windup(state, after, output, jnp.asarray(0.0), jnp.asarray(2.0))
    assert float(state.inverting.value) == 2.0
    np.testing.assert_allclose(state.inverting.memory, MODIFIED.update(MODIFIED.rest(), 2.0), rtol=1e-12)
    again, _ = pid.update(state, jnp.asarray(0.0), jnp.asarray(1.0), STEP)
    assert float(again.inverting.value) < 2.0


def test_limits_of_the_output_are_those_of_all_commands():
    joint = bench.model("joint")
    attached = feedback_on(joint, PID, mean_pressure=2.5e5)
    np.testing.assert_allclose(attached._limits, [-2.5e5, 2.5e5], rtol=1e-12)
    elbow = feedback_on(bench.model("elbow"), PID)
    np.testing.assert_array_equal(elbow._limits, [0.0, np.inf])


def test_slopes_through_a_limit_equal_finite_differences():
    elbow = bench.model("elbow")
    ambient = float(elbow.ambient_pressure)

    def last(gain):
        pid = IntegralInversePID(None, gain, jnp.asarray(0.3), jnp.asarray(0.0))
        limits = map(jnp.asarray, (ambient, 1.0, ambient, ambient + 4.5e5))
        found = closed_loop(
            elbow, Attached(pid, "angle", *limits), WANTED[700:900], TIMES[:200], start={"pressure": ambient}
        )
        return found.readings["angle"][-40:].sum()

    slope, h = jax.jit(jax.grad(last))(2e5), 1.0
    assert np.isfinite(slope)
    np.testing.assert_allclose(slope, (last(2e5 + h) - last(2e5 - h)) / (2 * h), rtol=1e-4, atol=1e-12)
