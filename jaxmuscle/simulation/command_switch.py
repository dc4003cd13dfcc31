r"""Steps that end where a delayed command switches, for machines with a part that is faster than the samples.

The command of a row is held from its sample to the next. With a dead time it switches inside the interval,
once, at the same place of every interval. Most machines filter it: the mean over the interval acts on them
as the command itself does. A part that settles within the interval, such as the current of a jet-pipe valve
(0.14 ms, sampled every 2 ms), follows the command, not its mean: readings of it would be wrong by up to the
whole step of the command, and a dead time fitted to them would be a whole number of samples. The steps of
such machines are therefore laid so that one ends at the switch.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmuscle._linalg import propagator
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects import CommandDelay
from jaxmuscle.simulation.solvers import ExponentialHeun


class Switch(eqx.Module):
    """Two rows of equal steps in an interval: up to the switch of the command, and from it to the end.

    Attributes:
        share: part of the interval that lies before the switch.
        steps: number of steps before it, of one more than an interval without a switch has.
        widths: of a step before and one behind it [s].
        before, after: the method for these widths.
    """

    share: Float[Array, ""]
    steps: Int[Array, ""]
    widths: tuple[Float[Array, ""], Float[Array, ""]]
    before: Any
    after: Any

    def step(self, number: Array) -> tuple[Array, Array, Any, Array]:
        """Begin and end of a step [s], its method, and whether the command has switched."""
        passed = number >= self.steps
        first, second = self.widths
        begin = jnp.where(passed, self.steps * first + (number - self.steps) * second, number * first)
        width = jnp.where(passed, second, first)
        method = jax.tree.map(lambda new, old: jnp.where(passed, new, old), self.after, self.before)
        return begin, begin + width, method, passed


def switch_of(
    actuator: AbstractActuator, interval: Array, substeps: int | Array, method: Any
) -> Switch | None:
    """Where the command of a machine with a dead time switches; `None` for one without, or without fast part.

    Args:
        interval: from a sample to the next [s].
        substeps: steps of it without a switch.
        method: exponential for a machine with a fast part.
    """
    delay = next((e for e in actuator.effects.values() if isinstance(e, CommandDelay)), None)
    if delay is None or not isinstance(method, ExponentialHeun):
        return None
    lag = delay.delay / interval
    share = lag - jnp.floor(lag)
    # At least one, if of no length, so that the derivative by the delay is there at a delay of zero.
    steps = jnp.clip(jnp.ceil(jax.lax.stop_gradient(share) * substeps), 1, substeps)
    widths = share * interval / steps, (1 - share) * interval / (substeps + 1 - steps)
    matrix = method.propagator.matrix
    before, after = (ExponentialHeun(propagator(matrix, width)) for width in widths)
    return Switch(share, steps.astype(int), widths, before, after)
