"""What every machine behind a jet-pipe valve has in common: the chain from the command to the tip."""

from typing import Any

import equinox as eqx
from jaxtyping import Array

from jaxmuscle.actuators.base import AbstractActuator, Held, State
from jaxmuscle.actuators.variables import Reading, StateVariable, Variable
from jaxmuscle.components import CurrentDriver, JetPipe
from jaxmuscle.effects.base import States
from jaxmuscle.parameters import Scalar
from jaxmuscle.signals import COMMAND, TIP_FORCE, TIP_POSITION, Signals

BEHIND_A_JET_PIPE: tuple[Variable, ...] = (
    StateVariable("current", "A"),
    StateVariable("pipe", "m"),
    StateVariable("pressure", "Pa"),
    Reading("current", "A", ("current",), signal="command"),
    Reading("force", "N", ("force",), signal="tip_position"),
)
"""States and readings of machines behind a jet-pipe valve."""


class AbstractJetPipe(AbstractActuator):
    """Command → current → tip force → tip position; current and force are measured, no state is."""

    driver: eqx.AbstractVar[CurrentDriver]
    pipe: eqx.AbstractVar[JetPipe]
    ambient_pressure: eqx.AbstractVar[Scalar]
    gas_temperature: eqx.AbstractVar[Scalar]

    def _up_to_the_tip(self, state: State, held: Held, states: States, **known: Any) -> Signals:
        """The chain up to the tip's static position; `known`: further signals that effects may read."""
        signals = Signals(
            past=held.past,
            ambient_pressure=self.ambient_pressure,
            gas_temperature=self.gas_temperature,
            pipe=self.pipe,
            current=state["current"],
            pressure=state["pressure"],
            **known,
        )
        signals = self._with(signals, COMMAND, held.command, states)
        signals = self._with(signals, TIP_FORCE, self.pipe.tip_force(signals.current), states)
        return self._with(signals, TIP_POSITION, self.pipe.static_position(signals.tip_force), states)

    def linear_part(self, state: State) -> State:
        # The tip follows small currents linearly; how far it saturates is left to the rest.
        unsaturated = self.pipe.compliance * self.pipe.tip_force(state["current"])
        return {
            "current": -self.driver.bandwidth * state["current"],
            "pipe": self.pipe.rate(unsaturated, state["pipe"]),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"current": signals.current, "force": signals.force_reading}

    def constrained(self, state: State) -> State:
        return state
