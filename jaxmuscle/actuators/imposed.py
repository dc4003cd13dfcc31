"""Rigs on which a test machine imposes every state and only readings are predicted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.effects.chain import state_rates


class AbstractImposed(AbstractActuator):
    """A rig without equations of motion of its own: each of its states follows what was measured.

    Between samples the states stand still, so that only states of effects (creep, a lag) are integrated. A
    rig of this kind declares `variables` (every state with `imposed=True`), `signals` and `readings`; see
    :class:`AbstractActuator`.
    """

    largest_step: ClassVar = math.inf

    def rest(self, measured: Mapping[str, Array]) -> State:
        """The state as it was measured."""
        return dict(measured)

    def vector_field(self, state: State, held: Held) -> State:
        """Zero for what is imposed, and the rates of the effects."""
        signals = self.signals(state, held)
        still = {name: jnp.zeros_like(state[name]) for name in self.imposed}
        return {**still, "effects": state_rates(self.effects, state.get("effects", {}), signals)}

    def constrained(self, state: State) -> State:
        """The state itself: what is imposed is within its limits."""
        return state
