"""The amplifier that drives the coil of a valve with a current."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class CurrentDriver(eqx.Module):
    """Voltage-to-current amplifier with a first-order lag."""

    gain: Scalar = parameter("A/V", "current of the driver per volt of command", positive=True)
    offset: Scalar = parameter("A", "current of the driver at no command", default=0.0, typical=1e-3)
    bandwidth: Scalar = parameter("rad/s", "bandwidth of the driver", default=7050.0, positive=True)

    def current_rate(self, command: Value, current: Value) -> Value:
        r""":math:`\dot i = ω_{cd}\,(g u + i_{off} - i)` [A/s], [H] equations 2.1 to 2.3.

        Args: command u [V], current i [A]. Rated for ±0.4 A.
        """
        return self.bandwidth * (self.gain * command + self.offset - current)

    def steady_current(self, command: Value) -> Value:
        """Current [A] that a constant command u [V] leads to, [H] 2.3: :math:`i = g u + i_{off}`."""
        return self.gain * jnp.asarray(command) + self.offset
