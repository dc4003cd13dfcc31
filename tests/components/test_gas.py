"""Nozzle flow: values, symmetry, and slopes at the points where it changes its form.

The gas of a chamber in the limits whose laws are known.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle import components
from jaxmuscle.components.gas import CRITICAL_RATIO, GAMMA, GAS_CONSTANT, LAMINAR_RATIO, heat_of, nozzle_flow

AREA, WARM = jnp.asarray(2e-6), jnp.asarray(293.15)
UP = 7e5


def flow(pressure_in, pressure_out, area=AREA):
    return nozzle_flow(area, jnp.asarray(pressure_in), jnp.asarray(pressure_out), WARM)


def gradient(*arguments):
    return np.array(jax.grad(nozzle_flow, argnums=(0, 1, 2, 3))(*map(jnp.asarray, arguments)))


def difference(*arguments):
    steps = np.diag(1e-6 * np.abs(arguments) + 1e-12 * (np.asarray(arguments) == 0))
    values = np.asarray(arguments)
    return np.array(
        [
            float(nozzle_flow(*map(jnp.asarray, values + s)) - nozzle_flow(*map(jnp.asarray, values - s)))
            / (2 * s.sum())
            for s in steps
        ]
    )


def test_choked_flow_of_air():
    # 0.0404 A p / sqrt(T), the textbook number for air.
    assert float(flow(UP, 1e5)) == pytest.approx(0.0404 * 2e-6 * UP / np.sqrt(293.15), rel=1e-3)


def test_choked_flow_in_closed_form():
    peak = np.sqrt(GAMMA / GAS_CONSTANT) * (2 / (GAMMA + 1)) ** ((GAMMA + 1) / (2 * (GAMMA - 1)))
    assert float(flow(UP, 1e5)) == pytest.approx(peak * 2e-6 * UP / np.sqrt(293.15), rel=1e-12)
    assert float(flow(UP, 1e5)) == float(flow(UP, 3e5))


def test_critical_ratio():
    assert pytest.approx(0.528, abs=5e-4) == CRITICAL_RATIO


@pytest.mark.parametrize("ratio", [0.6, 0.8, 0.95])
def test_subsonic_flow_follows_the_energy_balance(ratio):
    # ṁ = ρ v A with v² / 2 = c_p (T0 - T), T = T0 β^((γ-1)/γ), ρ = p / (R T).
    cooled = 293.15 * ratio ** ((GAMMA - 1) / GAMMA)
    speed = np.sqrt(2 * GAMMA * GAS_CONSTANT / (GAMMA - 1) * (293.15 - cooled))
    expected = ratio * UP / (GAS_CONSTANT * cooled) * speed * 2e-6
    assert float(flow(UP, ratio * UP)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("ratio", [0.3, CRITICAL_RATIO, 0.7, 0.9995, 1.0])
def test_reversed_pressures_reverse_the_flow(ratio):
    assert float(flow(ratio * UP, UP)) == -float(flow(UP, ratio * UP))


def test_no_flow_at_equal_pressures_or_through_a_closed_hole():
    assert float(flow(UP, UP)) == 0.0
    assert float(flow(UP, 1e5, area=jnp.asarray(0.0))) == 0.0


@pytest.mark.parametrize("ratio", [CRITICAL_RATIO, LAMINAR_RATIO])
def test_is_continuous_where_its_form_changes(ratio):
    below, above = flow(UP, UP * ratio * (1 - 1e-12)), flow(UP, UP * ratio * (1 + 1e-12))
    np.testing.assert_allclose(below, above, rtol=1e-8)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(
    "ratio", [0.3, CRITICAL_RATIO - 1e-3, CRITICAL_RATIO + 1e-3, 0.7, 0.998, 0.9995, 1.0]
)
def test_slopes_equal_finite_differences(ratio, reverse):
    pressures = (ratio * UP, UP) if reverse else (UP, ratio * UP)
    point = (2e-6, *pressures, 293.15)
    # Differences over 1e-6 of the argument err most where the root bends most: 4e-6 at a ratio of 0.998.
    scale = float(abs(flow(UP, 1e5))) / np.asarray(point)
    np.testing.assert_allclose(gradient(*point) / scale, difference(*point) / scale, atol=1e-5)


@pytest.mark.parametrize("side", [-1e-9, 0.0, 1e-9])
def test_slope_over_the_outlet_vanishes_at_the_choking_point(side):
    slope = gradient(2e-6, UP, UP * (CRITICAL_RATIO + side), 293.15)
    assert np.isfinite(slope).all()
    assert abs(slope[2]) * UP < 1e-6 * float(flow(UP, 1e5))


def test_slopes_through_a_closed_hole():
    slope = gradient(0.0, UP, 3e5, 293.15)
    assert slope[0] == pytest.approx(float(flow(UP, 3e5)) / 2e-6, rel=1e-12)
    assert not slope[1:].any()
    np.testing.assert_array_equal(gradient(0.0, UP, UP, 293.15), 0.0)


@pytest.mark.slow
def test_slopes_have_no_nan_in_a_batch_of_all_forms():
    ratios = jnp.array(
        [0.0001, CRITICAL_RATIO, 0.7, LAMINAR_RATIO, 1.0, 1 / LAMINAR_RATIO, 2.0, 1 / CRITICAL_RATIO]
    )
    for argument in range(4):
        slope = jax.grad(nozzle_flow, argnums=argument)
        batch = jax.vmap(slope, in_axes=(None, None, 0, None))(AREA, jnp.asarray(UP), ratios * UP, WARM)
        assert np.isfinite(batch).all()


def test_the_flow_is_that_of_the_power_function_to_rounding():
    ratio = np.linspace(CRITICAL_RATIO, LAMINAR_RATIO, 1001)
    expected = np.sqrt(ratio ** (2 / GAMMA) - ratio ** ((GAMMA + 1) / GAMMA))
    largest = np.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS_CONSTANT * 293.15)) * 2e-6 * UP
    found = np.array(flow(UP, ratio * UP)) / largest
    # Near 1 the difference of the powers has lost digits, in both.
    assert np.abs(found / expected - 1).max() < 1e-13 / (1 - LAMINAR_RATIO) ** 0.5


ChamberGas: Any = components.ChamberGas
Piston: Any = components.Piston
GAS, P, T, V = 287.0, 4e5, 310.0, 3e-6


def test_closed_chamber_is_adiabatic():
    rate, warming = ChamberGas().rates(P, T, V, -2e-5, 0.0, 0.0, 293.0)
    assert float(rate) == pytest.approx(1.4 * P * 2e-5 / V, rel=1e-12)
    assert float(warming) == pytest.approx(0.4 * T * 2e-5 / V, rel=1e-12)


def test_isothermal_gas_keeps_its_temperature():
    flow = 1e-5
    rate, warming = ChamberGas(1.0).rates(P, T, V, 1e-5, flow, flow * T, T)
    assert float(rate) == pytest.approx((GAS * T * flow - P * 1e-5) / V, rel=1e-12)
    assert abs(float(warming)) < 1e-9


def test_filling_from_a_supply_warms_towards_gamma_times_its_temperature():
    # An evacuated chamber filled adiabatically ends at n T_supply: there a flow no longer warms it.
    flow, supply = 1e-5, 293.0
    assert abs(float(ChamberGas().rates(P, 1.4 * supply, V, 0.0, flow, flow * supply, 0.0)[1])) < 1e-9


def test_wall_takes_the_heat():
    # 50 K too warm: G·50 W out of a mass pV/(RT) with c_v = R/0.4.
    rate, warming = ChamberGas(1.4, 0.2).rates(P, 343.0, V, 0.0, 0.0, 0.0, 293.0)
    mass = P * V / (GAS * 343.0)
    assert float(warming) == pytest.approx(-0.2 * 50 / (mass * GAS / 0.4), rel=1e-12)
    assert float(rate) == pytest.approx(P * float(warming) / 343.0, rel=1e-12)


def test_a_stream_has_the_temperature_of_where_it_comes_from():
    np.testing.assert_allclose(
        heat_of(jnp.array([2.0, -2.0]), jnp.asarray(310.0), jnp.asarray(290.0)), [580.0, -620.0]
    )


def test_piston_without_gap_hangs_on_spring_and_stopper():
    piston = Piston()
    assert float(piston.rod_force(0.0691 - 0.05, 0.0)) == pytest.approx(88.14 * 0.05)
    pressed = 88.14 * (0.0691 + 1e-4) + 2e5 * 1e-4
    assert float(piston.rod_force(-1e-4, 0.0)) == pytest.approx(pressed)
    assert float(piston.end_force(0.01, 0.0)) == 0.0 < float(piston.end_force(-1e-5, 0.0))
    slopes = jax.vmap(jax.grad(piston.rod_force), (0, None))(np.array([-1e-5, -5e-6, 0.0, 5e-6, 1e-5]), 0.0)
    assert np.isfinite(slopes).all() and (np.diff(slopes) >= 0).all()


def test_friction_falls_from_stiction_to_coulomb():
    piston = Piston(coulomb_force=1.0, stiction_force=2.5, viscous=4.0)
    limits = [float(piston.dry_limit(v)) for v in (0.0, 0.01, -0.01, 1.0)]
    np.testing.assert_allclose(limits, [2.5, 1 + 1.5 / np.e, 1 + 1.5 / np.e, 1.0], rtol=1e-6)
    assert float(piston.viscous_force(0.5)) == 2.0
