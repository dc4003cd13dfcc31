"""The current driver of [H]."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.components import CurrentDriver

DRIVER = built(CurrentDriver, 0.1, 0.02)


@pytest.mark.parametrize("command", [-3.0, 0.0, 2.5])
def test_settles_at_its_static_characteristic(command):
    steady = DRIVER.steady_current(jnp.asarray(command))
    assert float(steady) == pytest.approx(0.1 * command + 0.02)
    assert float(DRIVER.current_rate(jnp.asarray(command), steady)) == pytest.approx(0.0, abs=1e-9)


def test_approaches_it_at_its_bandwidth():
    # 1122 Hz, [H] 3.1.2
    left = DRIVER.steady_current(jnp.asarray(1.0)) - 0.05
    rate = DRIVER.current_rate(jnp.asarray(1.0), jnp.asarray(0.05))
    assert float(rate / left) == pytest.approx(2 * np.pi * 1122, rel=1e-3)
