"""Commands as functions of time."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.sweeps.commands import COMMANDS, Pulse, Ramp, Sine, Step, command_of

TIMES = np.array([-0.5, 0.0, 0.1, 0.25, 0.5, 2.0])


def over_time(command):
    return np.asarray(jax.vmap(command)(jnp.asarray(TIMES)))


def test_sine():
    found = over_time(Sine(amplitude=2.0, frequency=3.0, mean=0.5, phase=0.2))
    np.testing.assert_allclose(found, 0.5 + 2 * np.sin(6 * np.pi * TIMES + 0.2), rtol=1e-12)


def test_step():
    np.testing.assert_array_equal(over_time(Step(level=3.0, begin=0.25, before=1.0)), [1, 1, 1, 3, 3, 3])


def test_pulse():
    found = over_time(Pulse(level=3.0, begin=0.1, length=0.4, rest=-1.0))
    np.testing.assert_array_equal(found, [-1, -1, 3, 3, -1, -1])


def test_ramp():
    found = over_time(Ramp(level=3.0, begin=0.0, length=0.5, before=1.0))
    np.testing.assert_allclose(found, [1, 1, 1.4, 2, 3, 3])


def test_levels_of_several_muscles():
    found = over_time(Step(level=jnp.array([1.0, 2.0]), begin=0.0, before=0.5))
    np.testing.assert_array_equal(found[:2], [[0.5, 0.5], [1.0, 2.0]])


@pytest.mark.parametrize("kind", COMMANDS.values(), ids=COMMANDS)
def test_each_parameter_has_a_unit_and_a_finite_slope(kind):
    command = kind()
    assert set(jm.parameters.parameters(command)) == set(vars(command))
    slopes = jax.jacfwd(lambda c: jax.vmap(c)(jnp.asarray(TIMES)))(command)
    assert all(np.isfinite(slope).all() for slope in jax.tree.leaves(slopes))


def test_function_takes_defaults_and_what_is_swept():
    command = command_of(lambda time, level, slope=2.0, **more: level + slope * time, ["level", "other"])
    assert set(command.parameters) == {"level", "slope", "other"}
    np.testing.assert_allclose(over_time(command), 2 * TIMES)


def test_a_module_of_ones_own(machine):
    class Hold(eqx.Module):
        level: float

        def __call__(self, time):
            return self.level + 0 * time

    clock = np.arange(40) * 0.002
    found = jm.sweep(machine, {"command.level": [1.0, 2.0]}, command=Hold(5.0), times=clock)
    alone = jm.simulate(machine, np.full(40, 2.0), clock).readings
    np.testing.assert_allclose(found.pressure[1], alone["pressure"], rtol=1e-9)
    assert found["command.level"].attrs["units"] == ""
