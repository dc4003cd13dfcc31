"""A closed-loop pressure regulator as seen from outside: a second-order lag."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class PressureRegulator(eqx.Module):
    """Regulator (I/P converter) with natural frequency and damping ratio."""

    frequency: Scalar = parameter("Hz", "natural frequency of the regulator", positive=True)
    damping: Scalar = parameter("", "damping ratio of the regulator", positive=True)

    def acceleration(self, command: Value, pressure: Value, pressure_rate: Value) -> Value:
        r""":math:`\ddot P = ω^2 (c - P) - 2ζω \dot P` [Pa/s^2], with :math:`ω = 2π f`.

        Args: command c, pressure P [Pa, both absolute or both gauge], pressure_rate [Pa/s].
        """
        omega = 2 * jnp.pi * self.frequency
        return omega**2 * (command - pressure) - 2 * self.damping * omega * pressure_rate
