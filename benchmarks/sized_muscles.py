"""A rig that is not in the package: muscles of one make and of several lengths on one test machine."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from jaxmuscle.actuators import Driven, Held, StateVariable, register
from jaxmuscle.actuators.actuator import State
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import Signals


@register
class SizedMuscles(Driven):
    """Rig `driven` whose muscle is as long at rest as a column says, which may differ from run to run.

    What the column says is nominal: all muscles may be longer at rest by the same length, where fittings hold
    less of them than was thought. Held at the nominal length, they are shortened by as much.
    """

    rig: ClassVar = "sized-muscles"
    quantities: ClassVar = {**Driven.quantities, "excess_length": "excess_length"}
    variables: ClassVar = (
        *Driven.variables,
        StateVariable("resting_length", "m", ("resting_length",), rest="muscle.initial_length", imposed=True),
    )

    excess_length: Scalar = parameter("m", "length at rest beyond the nominal one", default=0.0, typical=1e-3)

    def signals(self, state: State, held: Held) -> Signals:
        length = state["resting_length"] + self.excess_length
        sized = eqx.tree_at(lambda rig: rig.muscle.initial_length, self, length)
        shortened = {**state, "contraction": state["contraction"] + self.excess_length}
        return Driven.signals(sized, shortened, held)
