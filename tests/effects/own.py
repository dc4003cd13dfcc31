"""An effect that is not in the package, as a user would write it."""

from typing import ClassVar

import jax.numpy as jnp

from jaxmuscle.effects import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE


class Sleeve(AbstractStaticEffect):
    """A sleeve around the muscle that pulls back the further it is bulged: -k x²."""

    name: ClassVar = "own_sleeve"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"contraction"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = ({},)
    source: ClassVar = "test"

    stiffness: Scalar = parameter("N/m^2", "force per contraction squared", default=0.0, typical=1e4)

    def value(self, signals):
        return -self.stiffness * jnp.square(signals.contraction)
