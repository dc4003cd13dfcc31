"""Losses between the valve and the chamber, and delays of the command."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.effects.base import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, MASS_FLOW, Signals


class ChamberLeak(AbstractStaticEffect):
    """A leak from the chamber to the atmosphere: nozzle flow through `area` ([H] 2.18)."""

    name: ClassVar = "chamber_leak"
    slot: ClassVar = MASS_FLOW
    reads: ClassVar = frozenset({"mass_flow"})
    strength: ClassVar = "area"
    starts: ClassVar = ({},)
    source: ClassVar = "[H] equations 2.18-2.23"

    area: Scalar = parameter("m^2", "effective area of the leak", default=0.0, nonnegative=True)

    def value(self, signals: Signals) -> Array:
        return -nozzle_flow(self.area, signals.pressure, signals.ambient_pressure, signals.gas_temperature)


class CommandDelay(AbstractStaticEffect):
    """The command acts `delay` seconds late: u(t - delay) - u(t), zero-order hold, exact between samples."""

    name: ClassVar = "command_delay"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "past"})
    strength: ClassVar = "delay"
    starts: ClassVar = tuple({"delay": delay} for delay in (0.003, 0.006, 0.012, 0.025, 0.05, 0.1))
    source: ClassVar = "dead time"

    delay: Scalar = parameter("s", "dead time of the command", default=0.0, nonnegative=True)

    def value(self, signals: Signals) -> Array:
        assert signals.past is not None
        return signals.past(self.delay) - signals.past(0.0 * self.delay)
