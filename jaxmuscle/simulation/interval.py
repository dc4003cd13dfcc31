"""One interval of the sample clock: what a machine is under, its rates, and how a step ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.sensing import sensed, sensing
from jaxmuscle.effects.base import States
from jaxmuscle.effects.chain import updated_memories
from jaxmuscle.signals import Past

# Functions of their arguments alone, which JAX traces once for all stages, links, runs and programs of a
# structure, and of which it keeps derivatives and batches too: a diagnosis of a lifted mass spends 5 s in
# tracing, not 10. XLA merges them into what calls them.


@eqx.filter_jit
def _rates_now(actuator: AbstractActuator, state: State, held: Held) -> State:
    """Rates of all states."""
    return actuator.vector_field(state, held)


@eqx.filter_jit
def _sensed_now(actuator: AbstractActuator, state: State, held: Held, states: States) -> dict[str, Array]:
    return sensed(actuator, actuator.signals(state, held), states)


def readings_of(actuator: AbstractActuator, state: State, held: Held, states: States) -> dict[str, Array]:
    """What the sensors show, in the order of the rig; `states`: integrated states and memories of effects."""
    found = _sensed_now(actuator, state, held, states)
    order = {name: i for i, name in enumerate(actuator.outputs)}
    return {name: found[name] for name in sorted(found, key=lambda name: order.get(name, len(order)))}


@eqx.filter_jit
def _finished(actuator: AbstractActuator, state: State, held: Held, size: Array) -> tuple[State, States]:
    """States and memories after a step of `size`: contacts and memories act."""
    state = actuator.constrained(state)
    signals = sensing(actuator, actuator.signals(state, held))
    return state, updated_memories(actuator.effects, held.memory, signals, size)


class Interval(eqx.Module):
    """What a machine is under during one interval of the sample clock.

    Attributes:
        step: its length [s].
        command, past: held command, and those before it.
        now, then: imposed states at its two ends; the others are integrated.
        widening: how many times as wide as it is dry friction is smoothed.
        time: of its begin since the first row of the track [s]; `None` where no effect reads it.
    """

    actuator: AbstractActuator
    step: Float[Array, ""]
    command: Any
    past: Past | None
    now: State
    then: State
    widening: Array | None = None
    time: Array | None = None

    def held(self, memory: States, switched: Array | None = None) -> Held:
        """What stays as it is during a step, before or after a late command switches if that is said."""
        past = self.past if self.past is None else dataclasses.replace(self.past, switched=switched)
        return Held(self.command, past, memory, self.widening, self.time)

    def whole(self, own: State, fraction: Array | float) -> State:
        """All states, the imposed ones at a fraction of the interval."""
        path = {name: now + fraction * (self.then[name] - now) for name, now in self.now.items()}
        return {**own, **path}

    def field_under(
        self, memory: States, switched: Array | None = None
    ) -> Callable[[Any, State, Any], State]:
        """The vector field of the integrated states."""
        held = self.held(memory, switched)

        def field(t, own, _):
            rates = _rates_now(self.actuator, self.whole(own, t / self.step), held)
            return {name: rates[name] for name in own}

        return field

    def finish(
        self, own: State, memory: States, end: Array, size: Array, switched: Array | None = None
    ) -> tuple[State, States]:
        """States and memories after a step of `size` that ended at `end`."""
        state, memory = _finished(
            self.actuator, self.whole(own, end / self.step), self.held(memory, switched), size
        )
        return {name: state[name] for name in own}, memory
