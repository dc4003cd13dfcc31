"""Gas between supply and chamber: droop, lag of the line, dead volume, heating of the gas."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from scipy.optimize import brentq

from jaxmuscle.components import ChamberGas
from jaxmuscle.components.gas import GAMMA, GAS_CONSTANT, heat_of
from jaxmuscle.effects import DeadVolume, GasHeating, LineLag, SupplyDroop
from jaxmuscle.effects.gas_path import SHORTEST_LAG
from jaxmuscle.signals import Signals

VALVE = bench.model("isotonic").valve
SUPPLY = float(VALVE.supply_pressure)
WALL = 293.15


def before_the_valve(pressure, opening=1.0):
    return Signals(
        valve=VALVE,
        opening=jnp.asarray(opening),
        supply_pressure=jnp.asarray(SUPPLY),
        pressure=jnp.asarray(pressure),
        ambient_pressure=jnp.asarray(bench.AMBIENT),
        gas_temperature=jnp.asarray(WALL),
    )


def droop(resistance, pressure, opening: Any = 1.0):
    return built(SupplyDroop, resistance=resistance).value(before_the_valve(pressure, opening))


def balanced(resistance, pressure) -> Any:
    """The droop at which the flow through line and valve is the same."""

    def excess(fall):
        flow = VALVE.mass_flow(1.0, pressure, bench.AMBIENT, WALL, jnp.asarray(SUPPLY - fall))  # pyright: ignore
        return fall - resistance * float(flow)

    return brentq(excess, 0.0, SUPPLY - pressure)


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_droop_of_choked_flow_is_exact(share):
    assert -droop(3e7, share * SUPPLY) == pytest.approx(balanced(3e7, share * SUPPLY), rel=1e-9)


@pytest.mark.parametrize("pressure", [4.5e5, 5.5e5, 6.5e5])
def test_droop_below_is_a_few_per_cent_too_large(pressure):
    exact = balanced(2e7, pressure)
    assert exact > 0.02 * SUPPLY
    assert exact <= -float(droop(2e7, pressure)) < 1.06 * exact


@pytest.mark.slow
def test_no_droop_while_nothing_is_drawn():
    for pressure, opening in ((3e5, 0.0), (3e5, -1.0), (SUPPLY + 1e5, 1.0), (SUPPLY, 1.0)):
        assert float(droop(2e7, pressure, opening)) == 0
        slopes = jax.vmap(jax.grad(droop, argnums=(0, 1, 2)))(
            *(jnp.array([x]) for x in (2e7, pressure, opening))
        )
        assert np.isfinite(slopes).all()


@pytest.mark.parametrize("resistance", [0.0, 2e7])
@pytest.mark.parametrize("pressure", [2e5, 5.5e5])
def test_slopes_of_the_droop(resistance, pressure):
    at = (jnp.asarray(resistance), jnp.asarray(pressure), jnp.asarray(0.6))
    slopes = jax.grad(droop, argnums=(0, 1, 2))(*at)
    for i, h in enumerate((1e2, 1.0, 1e-6)):
        up, down = ([v + s * h * (i == j) for j, v in enumerate(at)] for s in (1, -1))
        difference = (droop(*up) - droop(*down)) / (2 * h)
        assert float(slopes[i]) == pytest.approx(float(difference), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("time_constant", [0.0, 0.4e-3, 1e-3, 5e-3, 0.04])
def test_line_lags_by_its_time_constant(time_constant):
    lag = built(LineLag, time_constant=time_constant)
    rate, step, flow = 0.3, 4e-4, lambda t: 1e-3 + 0.3 * t
    state, reached = lag.initial(Signals(valve_flow=jnp.asarray(flow(0.0)))), []
    onward = jax.jit(lambda s, q: s + step * lag.rate(s, Signals(valve_flow=q)))
    times = np.arange(2500) * step
    for t in times:
        here = Signals(valve_flow=jnp.asarray(flow(t)))
        reached.append(float(flow(t) + lag.value(state, here)))
        state = onward(state, here.valve_flow)
    # A flow that rises steadily arrives τ late, whatever the lag.
    assert (flow(times[-1]) - reached[-1]) / rate == pytest.approx(time_constant, abs=1e-9)
    assert reached[0] == flow(0.0)


@pytest.mark.parametrize("time_constant", [0.0, 0.4e-3, 0.04])
def test_slopes_of_the_line(time_constant):
    def both(values, effect_time):
        lag = built(LineLag, time_constant=effect_time)
        here = Signals(valve_flow=values[0])
        return jnp.stack([lag.value(values[1], here), SHORTEST_LAG * lag.rate(values[1], here)])

    values, h = jnp.array([3e-3, 2e-3]), 1e-8
    slope = jax.jit(jax.jacfwd(both, argnums=1))(values, jnp.asarray(time_constant))
    difference = (both(values, time_constant + h) - both(values, time_constant)) / h
    np.testing.assert_allclose(slope, difference, rtol=1e-4, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["isotonic", "jet-pipe"])
def test_dead_volume_slows_the_pressure_in_proportion(rig):
    from effects.test_zero_strength import drawn, held

    state, table, _ = drawn(rig, 1)
    state = {**state, "effects": {}}
    bare, larger = bench.model(rig), bench.model(rig, dead_volume={"volume": 2e-5})
    volume = bare.signals(state, held(rig, table, {})).volume
    rates = [m.vector_field(state, held(rig, table, {}))["pressure"] for m in (bare, larger)]
    np.testing.assert_allclose(rates[1] / rates[0], volume / (volume + 2e-5), rtol=1e-12)
    assert float(built(DeadVolume, volume=2e-5).value(Signals(volume=volume)).sum()) > 0


def compressed(share, thermal_time, exponent, period, amplitude=0.002):
    """Amplitude of the pressure of a closed chamber whose volume swings, relative to the volume's."""
    effect = built(GasHeating, share=share, thermal_time=thermal_time)
    step, omega = period / 400, 2 * np.pi / period

    def rates(t, y):
        pressure, z = y
        volume = 1e-4 * (1 - amplitude * jnp.sin(omega * t))
        signals = Signals(
            pressure=pressure,
            volume=volume,
            volume_rate=-1e-4 * amplitude * omega * jnp.cos(omega * t),
            mass_flow=jnp.zeros(()),
            gas_temperature=jnp.asarray(WALL),
            polytropic_exponent=jnp.asarray(exponent),
        )
        bare = -exponent * pressure * signals.volume_rate / volume
        return jnp.stack([bare + effect.value(z, signals), effect.rate(z, signals)])

    def onward(y, t):
        first = rates(t, y)
        middle = rates(t + step / 2, y + step / 2 * first)
        again = rates(t + step / 2, y + step / 2 * middle)
        last = rates(t + step, y + step * again)
        return y + step / 6 * (first + 2 * middle + 2 * again + last), y[0]

    begin = jnp.stack([jnp.asarray(3e5), jnp.zeros(())])
    pressure = jax.lax.scan(onward, begin, jnp.arange(4000) * step)[1][-400:]
    return float(jnp.ptp(pressure) / 2 / 3e5 / amplitude)


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_gas_is_adiabatic_when_fast_and_isothermal_when_slow(exponent):
    assert compressed(1.0, 0.3, exponent, 0.003) == pytest.approx(GAMMA, rel=2e-3)
    assert compressed(1.0, 0.003, exponent, 3.0) == pytest.approx(1.0, rel=2e-3)
    assert compressed(0.0, 0.3, exponent, 0.003) == pytest.approx(exponent, rel=2e-3)
    middle = exponent + 0.5 * (GAMMA - exponent)
    assert compressed(0.5, 0.3, exponent, 0.003) == pytest.approx(middle, rel=2e-3)


@pytest.mark.parametrize("excess", [0.0, 0.15, -0.1])
def test_heating_is_that_of_the_energy_balance(excess):
    # Rates of :class:`ChamberGas`; its conductance gives the thermal time.
    pressure, volume, swelling, flow = 3e5, 1e-4, 2e-4, 4e-4
    gas = built(ChamberGas, wall_conductance=0.05)
    mass = pressure * volume / (GAS_CONSTANT * WALL * (1 + excess))
    heat = heat_of(jnp.asarray(flow), jnp.asarray(WALL), jnp.asarray(WALL))
    numbers = (pressure, WALL * (1 + excess), volume, swelling, flow, heat, WALL)
    warm = built(gas.rates, *map(jnp.asarray, numbers))
    thermal_time = mass * GAS_CONSTANT / (GAMMA - 1) / 0.05
    effect = built(GasHeating, share=1.0, thermal_time=thermal_time)
    signals = Signals(
        pressure=jnp.asarray(pressure),
        volume=jnp.asarray(volume),
        volume_rate=jnp.asarray(swelling),
        mass_flow=jnp.asarray(flow),
        gas_temperature=jnp.asarray(WALL),
        polytropic_exponent=jnp.asarray(1.0),
    )
    isothermal = (GAS_CONSTANT * WALL * flow - pressure * swelling) / volume
    assert float(warm[0]) == pytest.approx(
        isothermal + float(effect.value(jnp.asarray(excess), signals)), rel=1e-9
    )
    assert float(warm[1]) / WALL == pytest.approx(float(effect.rate(jnp.asarray(excess), signals)), rel=1e-9)
