"""The PID of [W], and what a model inside it adds."""

import jax
import jax.numpy as jnp
import pytest
from oracles.bench import built
from oracles.loops import MODIFIED

from jaxmuscle.control import IntegralInversePID
from jaxmuscle.hysteresis import IntegralInverse


def controlled(controller, plant, reference, step):
    """Outputs of a plant of hysteresis alone; a command acts from one sample to the next."""

    def onward(carry, target):
        memory, command, state = carry
        memory = plant.update(memory, command)
        measured = plant.output(memory, command)
        state, command = controller.update(state, target, measured, step)
        return (memory, command, state), measured

    start = (plant.rest(), jnp.zeros(()), controller.start())
    return jax.lax.scan(onward, start, reference)[1]


def test_compensator_makes_a_pid_better():
    step = 0.01
    reference = 0.8 * jnp.sin(2 * jnp.pi * 0.5 * jnp.arange(600) * step)

    def error(model):
        ahead = None if model is None else built(IntegralInverse, model, 60.0)
        pid = built(IntegralInversePID, ahead, 0.1, 0.05, 0.0)
        return float(jnp.sqrt(jnp.mean((controlled(pid, MODIFIED, reference, step) - reference)[200:] ** 2)))

    assert error(MODIFIED) < 0.5 * error(None)


def test_pid_is_its_equation():
    pid = built(IntegralInversePID, None, 2.0, 0.5, 0.3)
    state, first = pid.update(pid.start(1.0), jnp.asarray(1.0), jnp.asarray(0.6), 0.1)
    assert float(first) == pytest.approx(1.0 + 2 * (0.4 + 0.1 * 0.4 / 0.5 + 0.3 * 0.4 / 0.1))
    _, second = pid.update(state, jnp.asarray(1.0), jnp.asarray(0.9), 0.1)
    assert float(second) == pytest.approx(1.0 + 2 * (0.1 + 0.1 * 0.5 / 0.5 + 0.3 * (0.1 - 0.4) / 0.1))
