"""From one sample to the next: the command is held, imposed states go straight from value to value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.effects.base import States, updated_memories
from jaxmuscle.signals import Past


class Interval(eqx.Module):
    """What a machine is under during one interval of the sample clock.

    Attributes:
        step: its length [s].
        command, past: held command, and those before it.
        now, then: imposed states at its two ends; the others are integrated.
        widening: how many times as wide as it is dry friction is smoothed.
    """

    actuator: AbstractActuator
    step: Float[Array, ""]
    command: Any
    past: Past | None
    now: State
    then: State
    widening: Array | None = None

    def held(self, memory: States) -> Held:
        """What stays as it is during a step."""
        return Held(self.command, self.past, memory, self.widening)

    def whole(self, own: State, fraction: Array | float) -> State:
        """All states, the imposed ones at a fraction of the interval."""
        path = {name: now + fraction * (self.then[name] - now) for name, now in self.now.items()}
        return {**own, **path}

    def field_under(self, memory: States) -> Callable[[Any, State, Any], State]:
        """The vector field of the integrated states."""
        held = self.held(memory)

        @jax.jit  # traced once for all stages of the solver
        def field(t, own, _):
            rates = self.actuator.vector_field(self.whole(own, t / self.step), held)
            return {name: rates[name] for name in own}

        return field

    def finish(self, own: State, memory: States, end: Array, size: Array) -> tuple[State, States]:
        """States and memories after a step of `size` that ended at `end`: contacts and memories act."""
        state = self.actuator.constrained(self.whole(own, end / self.step))
        signals = self.actuator.signals(state, self.held(memory))
        after = {name: state[name] for name in own}
        return after, updated_memories(self.actuator.effects, memory, signals, size)
