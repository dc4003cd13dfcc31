"""Operating points: closed forms, conditions that hold there, derivatives, what has no such point."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

from jaxmuscle.actuators.isotonic import STANDARD_GRAVITY
from jaxmuscle.analysis import equilibrium, equilibrium_at
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import replace

JET = bench.model("jet-pipe")
SAMPLES = 1650
"""Of long runs: the same in all tests, so that they share what is compiled."""


def test_mass_hangs_where_the_force_of_the_muscle_is_its_weight():
    actuator, gauge = bench.model("isotonic"), 2.5e5
    start = {"pressure": bench.AMBIENT + gauge, "position": 0.01}
    point = equilibrium(actuator, 0.0, start=start, hold=("pressure",))
    muscle = actuator.muscle
    a, b = 3 / np.tan(muscle.braid_angle) ** 2, 1 / np.sin(muscle.braid_angle) ** 2
    weight = actuator.mass * STANDARD_GRAVITY / (np.pi * muscle.initial_radius**2 * gauge)
    strain = (1 - np.sqrt((weight + b) / a)) / muscle.end_factor
    assert point.converged
    np.testing.assert_allclose(point.readings, [start["pressure"], strain * 0.3], rtol=1e-8)


@pytest.mark.slow
def test_jet_pipe_settles_where_a_long_run_ends():
    command = 1.2
    force = bench.simulated(JET, bench.track("jet-pipe", np.full(SAMPLES, command)), 2).readings["force"][-1]
    point = equilibrium(JET, command)
    assert point.converged
    np.testing.assert_allclose(point.readings, [0.12, float(force)], rtol=1e-3)


@pytest.mark.parametrize("force", [10.0, 45.0, 85.0])
def test_a_force_that_is_asked_for_is_reached(force):
    point = equilibrium_at(JET, "force", force, command=1.0)
    assert point.converged
    np.testing.assert_allclose(point.readings[1], force, rtol=1e-9)
    again = equilibrium(JET, point.command)
    np.testing.assert_allclose(again.readings, point.readings, rtol=1e-7)


@pytest.mark.slow
def test_derivatives_follow_the_implicit_function_theorem():
    def force(values):
        return equilibrium(replace(JET, {"pipe.compliance": values[0]}), values[1]).readings[1]

    at = np.array([0.8e-3, 1.1])

    @jax.jit
    def both_ways(values):
        _, push = jax.linearize(force, values)
        pull = jax.linear_transpose(push, values)
        return jax.vmap(push)(jnp.eye(2)), pull(jnp.ones(()))[0]

    (forward, reverse), h = both_ways(at), 1e-5
    difference = [(force(at * (1 + h * e)) - force(at * (1 - h * e))) / (2 * h) for e in np.eye(2)] / at
    np.testing.assert_allclose(forward, difference, rtol=1e-6)
    np.testing.assert_allclose(reverse, difference, rtol=1e-6)


def test_no_point_is_reported_as_such():
    assert not equilibrium_at(JET, "force", 400.0, command=1.0).converged
    # With its valve shut a gas rests at any pressure: the equations are singular.
    assert not equilibrium(bench.model("isotonic"), 0.0).converged


def test_errors_say_what_was_expected():
    with pytest.raises(InputError, match="'driven' has no command"):
        equilibrium(bench.model("driven"), 0.0)
    with pytest.raises(InputError, match="hold: expected states of .*current.*got \\['speed'\\]"):
        equilibrium(JET, 0.0, hold=("speed",))
    with pytest.raises(InputError, match=r"start: expected some of \[\]; got \['pressure'\]"):
        equilibrium(JET, 0.0, start={"pressure": 1e5})
    with pytest.raises(InputError, match=r"one of \['current', 'force'\]; got 'torque'"):
        equilibrium_at(JET, "torque", 1.0)
    with pytest.raises(InputError, match=r"several commands; .*\['command_1', 'command_2'\]; got None"):
        equilibrium_at(bench.model("joint"), "angle", 0.1)
