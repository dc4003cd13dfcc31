"""The gas of a chamber in the limits whose laws are known."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle import components
from jaxmuscle.components.chamber import heat_of

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
