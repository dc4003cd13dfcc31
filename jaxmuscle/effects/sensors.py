"""Effects in the sensors of the chain: lag of pressure and force, bent characteristic of a load cell,
backlash before an encoder.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import LOOP, AbstractMemoryEffect, AbstractStaticEffect
from jaxmuscle.effects.readings import AbstractCorrectedEffect, Samples, Series
from jaxmuscle.hysteresis.operators import play
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import FORCE_READING, POSITION_READING, PRESSURE_READING, Signals, Slot


class AbstractSensorLag(AbstractMemoryEffect):
    r"""First-order lag of a reading: :math:`τ \dot y = x - y`; the addition is y - x.

    Exact for an x that is linear over the step, so that a zero time constant leaves the reading as it is and
    the derivative there is -ẋ.
    """

    time_constant: Scalar = parameter("s", "time constant of the reading", default=0.0, nonnegative=True)

    @abc.abstractmethod
    def lagging(self, signals: Signals) -> Array:
        """What the sensor is loaded with, x."""

    def initial(self, signals: Signals) -> tuple[Array, Array]:
        value = self.lagging(signals)
        return jnp.zeros_like(value), value

    def update(self, memory: tuple[Array, Array], signals: Signals, step: Array) -> tuple[Array, Array]:
        error, before = memory
        value = self.lagging(signals)
        active = self.time_constant > 0
        tau = jnp.where(active, self.time_constant, 1.0)
        fading = jnp.where(active, jnp.exp(-step / tau), 0.0)
        # A step of no length, before a late command switches at once, leaves the memory as it is.
        at_once = self.time_constant / jnp.where(step > 0, step, 1.0)
        followed = jnp.where(active, _mean_fading(step / tau), at_once)
        return fading * error - followed * (value - before), value

    def value(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        return memory[0]


def _mean_fading(passed: Array) -> Array:
    r"""Mean of :math:`e^{-s}` from s = 0 to `passed`, :math:`(1 - e^{-z})/z`, which is 1 at z = 0."""
    small = passed < 1e-3
    z = jnp.where(small, 1.0, passed)
    series = 1 - passed / 2 * (1 - passed / 3 * (1 - passed / 4))
    return jnp.where(small, series, -jnp.expm1(-z) / z)


class ForceSensorLag(AbstractSensorLag):
    r"""First-order lag of the force reading: :math:`τ \dot y = F - y`; the addition is y - F.

    Exact for a force that is linear over the step, so that a zero time constant leaves the reading as it
    is and the derivative there is -Ḟ.
    """

    name: ClassVar = "force_sensor_lag"
    slot: ClassVar = FORCE_READING
    reads: ClassVar = frozenset({"force"})
    strength: ClassVar = "time_constant"
    largest: ClassVar = 1.0
    starts: ClassVar = ({},)
    source: ClassVar = "first-order lag, first-order hold"

    time_constant: Scalar = parameter(
        "s", "time constant of the force reading", default=0.0, nonnegative=True
    )

    def lagging(self, signals: Signals) -> Array:
        return signals.force


class PressureSensorLag(AbstractSensorLag, AbstractCorrectedEffect):
    r"""First-order lag of the pressure reading: :math:`τ \dot y = p - y`; the addition is y - p.

    A long tube or the sensor's own filter; one time constant for all pressures of a rig. Exact for a pressure
    that is linear over the step. Where a measured pressure is taken as an input of another link of the chain,
    it is y + τ ẏ, by central differences of the smoothed samples.
    """

    name: ClassVar = "pressure_sensor_lag"
    slot: ClassVar = PRESSURE_READING
    reads: ClassVar = frozenset({"pressure_reading"})
    strength: ClassVar = "time_constant"
    largest: ClassVar = 1.0
    starts: ClassVar = ({},)
    source: ClassVar = "first-order lag, first-order hold; Doebelin, Measurement Systems, chapter 6"

    time_constant: Scalar = parameter(
        "s", "time constant of the pressure reading", default=0.0, nonnegative=True, typical=5e-3
    )

    def lagging(self, signals: Signals) -> Array:
        return signals.pressure_reading

    def concerns(self, column: str, slot: Slot | None) -> bool:
        """Every column of the pressure's reading."""
        return slot == self.slot

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return shown + self.time_constant * samples.rate(shown)


class ForceSensorNonlinearity(AbstractStaticEffect):
    r"""The load cell's characteristic is bent: :math:`ΔF = c\,F^3`.

    The lowest odd term beside the gain, the same for pull and push. 0.25 % at 500 N are c = 1e-8 1/N².
    """

    name: ClassVar = "force_sensor_nonlinearity"
    slot: ClassVar = FORCE_READING
    reads: ClassVar = frozenset({"force"})
    strength: ClassVar = "cubic"
    starts: ClassVar = ({},)
    source: ClassVar = "nonlinearity of load cells, OIML R 60, as a cubic"

    cubic: Scalar = parameter("1/N^2", "cubic term of the force reading", default=0.0, typical=1e-8)

    def value(self, signals: Signals) -> Array:
        return self.cubic * signals.force**3


PLAY = 0.5
"""Play between load and sensor that a machine has at most, in ranges of the reading: with more, what the
load does hardly shows. A play as wide as the range explains that a reading stays where it is, as friction
does, and creep on short windows: of a coil muscle whose coil went on contracting it was 10.9 mm of 11."""
PUSHED = 0.2
"""Part of the gap's half width over which a reading has to move until the load is taken to be at the other
side. At true values of drawn machines predictions are as good with a tenth, where noise is nearer."""
LEAST = 1e-4
"""The same of a gap without width [m or rad], so that noise does not move the load across it."""


class Backlash(AbstractMemoryEffect, AbstractCorrectedEffect):
    r"""Backlash between load and sensor: :math:`y = \max(x - b, \min(x + b, y^-))`; the addition is y - x.

    The sensor stays until a side of a gap of width 2 b pushes it on: a play operator, at rest in the middle
    of the gap at first. A search begins with gaps that are wide, too: a fit on long windows does not get to
    them from a narrow one. Where a measured position is taken as an input of another link, or as that with
    which a window begins, it is y + s b, with s the side that last pushed: from -1 to 1, a stop operator on y
    that changes sides over a fifth of b. While the load crosses the gap the sensor rests, and nothing tells
    where it is; its velocity is taken to be the sensor's.
    """

    name: ClassVar = "backlash"
    slot: ClassVar = POSITION_READING
    reads: ClassVar = frozenset({"position_reading"})
    strength: ClassVar = "half_width"
    starts: ClassVar = ({}, {"half_width": 5e-4}, {"half_width": 5e-3})
    source: ClassVar = "play operator; Nordin and Gutman, Automatica 38, 2002"
    view: ClassVar = LOOP

    half_width: Scalar = parameter(
        "{motion}", "half the play between load and sensor", default=0.0, nonnegative=True, typical=2e-4
    )

    def concerns(self, column: str, slot: Slot | None) -> bool:
        """Every column of the motion's reading."""
        return slot == self.slot

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return shown + self.half_width * self._side(shown, samples)

    def corrected_with_rate(self, shown: Series, rate: Series, samples: Samples) -> tuple[Series, Series]:
        """The rate as it was shown: how fast the load crosses the gap is not known."""
        return self.corrected(shown, samples), rate

    def _side(self, shown: Series, samples: Samples) -> Series:
        """On which side of the gap the load is, -1 to 1; in its middle where a stretch begins."""
        begins, reach = jnp.arange(len(shown)) == samples.first, LEAST + PUSHED * self.half_width

        def onward(left: Array, sample: tuple[Array, Array]) -> tuple[Array, Array]:
            begin, here = sample
            left = jnp.where(begin, here, play(left, here, reach))
            return left, (here - left) / reach

        return jax.lax.scan(onward, shown[0], (begins, shown))[1]

    def largest_on(self, duration: float, ranges: Mapping[str, float]) -> float:
        """The play, twice the strength, is at most half of the range of its reading (:data:`PLAY`)."""
        return PLAY / 2 * ranges[self.slot.name]

    def initial(self, signals: Signals) -> Array:
        return signals.position_reading

    def update(self, memory: Array, signals: Signals, step: Array) -> Array:
        return self._behind(memory, signals.position_reading)

    def value(self, memory: Array, signals: Signals) -> Array:
        return self._behind(memory, signals.position_reading) - signals.position_reading

    def _behind(self, memory: Array, position: Array) -> Array:
        """The play operator, at b = 0 with its derivative towards b > 0, where max and min take the mean."""
        low, high = position - self.half_width, position + self.half_width
        return jnp.where(memory > high, high, jnp.where(memory < low, low, memory))
