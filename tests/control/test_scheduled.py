"""The PID of [W] whose gains depend on the range."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.control import IntegralInversePID, ScheduledPID
from jaxmuscle.errors import InputError

STEP = 0.05
TWO = built(
    ScheduledPID, None, np.array([45.0]), np.array([0.02, 0.05]), np.array([0.5, 0.8]), np.array([0.0, 0.1])
)
TARGETS = 15 + 37.5 * (np.sin(np.pi * np.arange(1000) * STEP / 25 + np.pi / 2) + 1)
"""[W]: y_d = 15 + 37.5 (sin(πt/25 + π/2) + 1), from 15 to 90 degrees."""


def commands(controller):
    def sample(state, at):
        return controller.update(state, at[0], at[1], STEP)

    measured = jnp.asarray(0.9 * TARGETS)
    return np.asarray(jax.lax.scan(sample, controller.start(), (jnp.asarray(TARGETS), measured))[1])


def test_one_range_is_the_pid():
    one = built(ScheduledPID, None, np.zeros(0), np.array([0.02]), np.array([0.5]), np.array([0.1]))
    np.testing.assert_array_equal(commands(one), commands(built(IntegralInversePID, None, 0.02, 0.5, 0.1)))


def test_gains_are_those_of_the_range():
    integral = STEP * np.cumsum(0.1 * TARGETS)
    rate = np.diff(0.1 * TARGETS, prepend=0.0) / STEP
    low, high = (
        k * (0.1 * TARGETS + integral / ti + td * rate) for k, ti, td in ((0.02, 0.5, 0), (0.05, 0.8, 0.1))
    )
    np.testing.assert_allclose(commands(TWO), np.where(TARGETS < 45, low, high), rtol=1e-9)


@pytest.mark.parametrize(
    ("edges", "gains", "said"), [([45.0], 3, "n - 1 edges"), ([45.0, 30.0], 3, "edges that increase")]
)
def test_refused(edges, gains, said):
    with pytest.raises(InputError, match=said):
        built(ScheduledPID, None, np.array(edges), *(np.ones(gains) for _ in range(3)))
