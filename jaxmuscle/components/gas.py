"""Compressible flow through an orifice, and the pressure and temperature of the gas in a chamber."""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.polynomial import Chebyshev, Polynomial

from jaxmuscle.parameters import Scalar, parameter

GAMMA = 1.4
"""Ratio of specific heats of air [-]; the flow below makes use of its being 7/5."""
GAS_CONSTANT = 287.0
"""Specific gas constant of air [J/(kg K)]."""
CRITICAL_RATIO = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))
"""Pressure ratio at and below which the flow is choked, 0.5283 [-]."""
LAMINAR_RATIO = 0.999
"""Above this pressure ratio the flow is linear in the pressure difference (laminar range of ISO 6358)."""
_QUARTIC = Chebyshev.interpolate(lambda ratio: ratio ** (1 / 7), 4, domain=[CRITICAL_RATIO, 1.0])
SEVENTH = tuple(map(float, _QUARTIC.convert(kind=Polynomial).coef[::-1]))
"""Coefficients of a quartic near β^(1/7) from the critical ratio to 1, highest first."""

Value = Float[Array, "..."]


def nozzle_flow(area: Value, pressure_in: Value, pressure_out: Value, temperature: Value) -> Value:
    r"""Mass flow from `pressure_in` to `pressure_out`, negative when the pressures are reversed.

    .. math:: \dot m = A\,p_u \sqrt{\tfrac{2γ}{(γ-1)RT}\,(β^{2/γ} - β^{(γ+1)/γ})},
              \quad β = \max(p_d/p_u,\,0.528)

    [H] equations 2.18 to 2.22. Between a ratio of 0.999 and 1 the root, whose slope is infinite at
    equal pressures, is replaced by the chord to zero: the flow is continuous and its gradient is finite
    everywhere.

    Args:
        area: effective area A, discharge coefficient included [m^2].
        pressure_in, pressure_out: absolute pressures [Pa], above zero.
        temperature: T of the gas upstream [K].

    Returns:
        mass flow [kg/s], broadcast over the arguments.
    """
    forward = pressure_in >= pressure_out
    upstream = jnp.where(forward, pressure_in, pressure_out)
    downstream = jnp.where(forward, pressure_out, pressure_in)
    ratio = downstream / upstream
    factor = jnp.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS_CONSTANT * temperature))
    magnitude = area * upstream * factor * _shape(ratio)
    return jnp.where(forward, magnitude, -magnitude)


def _shape(ratio: Value) -> Value:
    """The root of equation 2.18 over the pressure ratio, with choking and the laminar chord."""
    laminar = ratio > LAMINAR_RATIO
    inside = jnp.clip(jnp.where(laminar, LAMINAR_RATIO, ratio), CRITICAL_RATIO, LAMINAR_RATIO)
    return _root(inside) * jnp.where(laminar, (1 - ratio) / (1 - LAMINAR_RATIO), 1.0)


@jax.custom_jvp
def _root(ratio: Value) -> Value:
    """The root of equation 2.18 between the critical and the laminar ratio: y^5 sqrt(1 - y^2)."""
    seventh = _seventh_root(ratio)
    # All under one root: XLA repeats cheap work in whatever reads it, but never a square root.
    return jnp.sqrt(seventh**10 * (1 - seventh**2))


@_root.defjvp
def _root_slope(primals, tangents):
    """dΨ/dβ = (5 y^3 - 6 y^5)/(7 Ψ), from the same y."""
    (ratio,), (change,) = primals, tangents
    seventh, root = _seventh_root(ratio), _root(ratio)
    return root, (5 * seventh**3 - 6 * seventh**5) / (7 * root) * change


def _seventh_root(ratio: Value) -> Value:
    """With γ = 7/5 the only power that is needed, β^(1/7), to rounding from the critical ratio to 1.

    The quartic is right to 6e-6; one step of Halley's rule, which cubes the error, does the rest. A power
    function, which XLA does not vectorise in double precision, was two thirds of a vector field.
    """
    guess = functools.reduce(lambda value, coefficient: value * ratio + coefficient, SEVENTH)
    power = guess**7
    return guess * (3 * power + 4 * ratio) / (4 * power + 3 * ratio)


class ChamberGas(eqx.Module):
    r"""Energy balance of an ideal gas whose ratio of specific heats is n, c_v = R/(n - 1).

    .. math:: \dot p = \frac{n}{V}(R H - p \dot V) + \frac{n - 1}{V} Q,\quad
              \dot T = T\left(\frac{\dot p}{p} + \frac{\dot V}{V} - \frac{R T \dot m}{p V}\right),\quad
              Q = G\,(T_w - T)

    H = Σ ṁ T of the streams, each with the temperature of where it comes from. `polytropic_exponent` n = 1.4
    without `wall_conductance` G is the adiabatic chamber of [H] 2.26 to 2.29 with the temperatures that [H]
    takes as constant; a large G, or n = 1, is the isothermal one.
    """

    polytropic_exponent: Scalar = parameter(
        "", "1 isothermal … 1.4 energy balance of air", default=GAMMA, positive=True
    )
    wall_conductance: Scalar = parameter(
        "W/K", "heat from the wall of a chamber per kelvin", default=0.0, nonnegative=True, typical=0.1
    )

    def rates(
        self,
        pressure: Value,
        temperature: Value,
        volume: Value,
        volume_rate: Value,
        mass_flow: Value,
        heat_flow: Value,
        wall_temperature: Value,
    ) -> tuple[Value, Value]:
        """Rates of pressure [Pa/s] and temperature [K/s], [H] 2.26-2.29 with the first law.

        Args: pressure [Pa, absolute], temperature [K], volume [m^3] and its rate [m^3/s], mass_flow into the
        chamber [kg/s], heat_flow: Σ ṁ T of its streams [kg K/s], wall_temperature [K].
        """
        n = self.polytropic_exponent
        warming = (n - 1) * self.wall_conductance * (wall_temperature - temperature)
        work = pressure * volume_rate
        pressure_rate = (n * (GAS_CONSTANT * heat_flow - work) + warming) / volume
        stored = volume * pressure_rate + work - GAS_CONSTANT * temperature * mass_flow
        return pressure_rate, temperature * stored / (pressure * volume)


def heat_of(flow: Value, inside: Value, outside: Value) -> Value:
    """Σ ṁ T of a stream into a chamber (negative: out of it) [kg K/s]; temperatures [K]."""
    return flow * jnp.where(flow >= 0, outside, inside)
