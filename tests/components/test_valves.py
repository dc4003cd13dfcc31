"""The flow valve and the pressure regulator.

The current driver of [H].
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.components import CurrentDriver, FlowValve, PressureRegulator, nozzle_flow

VALVE = built(FlowValve, 2e-6, 7e-3, 5.0, 7e5)
AMBIENT, WARM = jnp.asarray(1e5), jnp.asarray(293.15)


def flow(opening, pressure):
    return VALVE.mass_flow(jnp.asarray(opening), jnp.asarray(pressure), AMBIENT, WARM)


@pytest.mark.parametrize("pressure", [1e5, 3e5, 6e5])
def test_charges_from_the_supply_and_exhausts_to_ambient(pressure):
    charge = nozzle_flow(jnp.asarray(1e-6), VALVE.supply_pressure, jnp.asarray(pressure), WARM)
    exhaust = nozzle_flow(jnp.asarray(1e-6), jnp.asarray(pressure), AMBIENT, WARM)
    assert float(flow(0.5, pressure)) == float(charge) > 0
    assert float(flow(-0.5, pressure)) == -float(exhaust) <= 0
    assert float(flow(0.0, pressure)) == 0


def test_slope_over_the_opening_is_finite_when_closed():
    slope = jax.vmap(jax.grad(flow), in_axes=(0, None))(jnp.array([-0.1, 0.0, 0.1]), 3e5)
    # Both sides have a slope of their own; at zero it is that of opening to the supply.
    assert np.isfinite(slope).all() and slope[0] > 0 and slope[1] == slope[2] > 0


def test_spool_settles_at_the_commanded_opening():
    assert float(VALVE.opening_rate(jnp.asarray(2.5), jnp.asarray(0.5))) == 0
    assert float(VALVE.opening_rate(jnp.asarray(5.0), jnp.asarray(0.0))) == pytest.approx(1 / 7e-3)


def test_regulator_has_its_natural_frequency_and_damping():
    regulator = built(PressureRegulator, 12.0, 0.85)

    def rates(state):
        return jnp.stack([state[1], regulator.acceleration(jnp.asarray(3e5), state[0], state[1])])

    poles = np.linalg.eigvals(jax.jacobian(rates)(jnp.array([2e5, 1e4])))
    np.testing.assert_allclose(np.abs(poles), 2 * np.pi * 12, rtol=1e-12)
    np.testing.assert_allclose(-np.real(poles) / np.abs(poles), 0.85, rtol=1e-12)


def test_regulator_rests_at_its_command():
    regulator = built(PressureRegulator, 12.0, 0.85)
    still = jnp.zeros(2)
    command = jnp.array([2e5, 3e5])
    np.testing.assert_array_equal(regulator.acceleration(command, command, still), 0.0)


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
