"""What a sensor does to the quantity it measures."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractMemoryEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, Signals


class ForceSensorLag(AbstractMemoryEffect):
    r"""First-order lag of the force reading: :math:`τ \dot y = F - y`; the addition is y - F.

    Exact for a force that is linear over the step, so that a zero time constant leaves the reading as it
    is and the derivative there is -Ḟ.
    """

    name: ClassVar = "force_sensor_lag"
    slot: ClassVar = FORCE_READING
    reads: ClassVar = frozenset({"force"})
    strength: ClassVar = "time_constant"
    starts: ClassVar = ({},)
    source: ClassVar = "first-order lag, first-order hold"

    time_constant: Scalar = parameter(
        "s", "time constant of the force reading", default=0.0, nonnegative=True
    )

    def initial(self, signals: Signals) -> tuple[Array, Array]:
        return jnp.zeros_like(signals.force), signals.force

    def update(self, memory: tuple[Array, Array], signals: Signals, step: Array) -> tuple[Array, Array]:
        error, before = memory
        active = self.time_constant > 0
        tau = jnp.where(active, self.time_constant, 1.0)
        fading = jnp.where(active, jnp.exp(-step / tau), 0.0)
        ramp = self.time_constant * (signals.force - before) / step
        return fading * error - ramp * (1 - fading), signals.force

    def value(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        return memory[0]
