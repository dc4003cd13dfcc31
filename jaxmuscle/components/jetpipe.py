"""The jet pipe: a tube on a flexure, bent by a torque motor, whose tip swings over the receiver."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class JetPipe(eqx.Module):
    r"""From the coil's current to the position of the tip.

    Lag and resonance are those of [H] equation 2.6,

    .. math:: \frac{X}{X^s} = \frac{ω_1}{s + ω_1}\,\frac{ω_2^2}{s^2 + 2 ζ_2 ω_2 s + ω_2^2}

    Their state is (lagged position y, tip position x, tip velocity over ω2), all in m: of one size, which
    keeps the exponential of their matrix exact to rounding.
    """

    compliance: Scalar = parameter("m/N", "tip travel per newton at small forces", positive=True)
    saturation_force: Scalar = parameter("N", "tip force around which the travel saturates", positive=True)
    receiver_offset: Scalar = parameter("m", "offset of the receiver from the tip at rest")
    force_constant: Scalar = parameter("N/A", "tip force per ampere of coil", default=1.946, positive=True)
    lag_bandwidth: Scalar = parameter("rad/s", "bandwidth ω1 of the pipe's lag", default=973.9, positive=True)
    resonance: Scalar = parameter("rad/s", "undamped resonance ω2 of the pipe", default=1856.7, positive=True)
    damping: Scalar = parameter("", "damping ratio ζ2 of the resonance", default=0.019, positive=True)

    def tip_force(self, current: Value) -> Value:
        """Force on the tip :math:`F = k_m i` [N], [H] equation 2.4; current i [A]."""
        return self.force_constant * current

    def static_position(self, tip_force: Value) -> Value:
        r"""Tip position under a steady force F, the mid-line of the hysteresis loop ([H] equation 2.5):
        :math:`x^s = c F / (1 + (F/F_{sat})^4)^{1/4}` [m].

        `compliance` c, `saturation_force` F_sat; tip_force [N].
        """
        return self.compliance * tip_force / (1 + (tip_force / self.saturation_force) ** 4) ** 0.25

    def rate(self, static_position: Value, state: Float[Array, "3"]) -> Float[Array, "3"]:
        """Time derivative of the state (y, x, v/ω2) under a static tip position [m]."""
        lagged, tip, swing = state
        following = self.lag_bandwidth * (static_position - lagged)
        swinging = self.resonance * (lagged - tip - 2 * self.damping * swing)
        return jnp.stack([following, self.resonance * swing, swinging])

    def over_receiver(self, tip: Value) -> Value:
        """Position of the tip from the middle of the receiver: :math:`x = x_{jp} + x_{off}` [m], [H] 2.7."""
        return tip + self.receiver_offset
