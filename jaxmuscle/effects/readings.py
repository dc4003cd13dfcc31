"""Errors of the sensor of one column, in both directions: what it shows of a true value, and what a shown
value was in truth.

A simulation shows readings with the error; an estimation frees the measured states of it before any link of
the chain is fed with them, and compares what the sensor would show with what it did show. So the weights of
the readings stay those of the sensor, and no measured column is interpolated or scaled before it is compared.
"""

from __future__ import annotations

import abc
import types
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, ClassVar, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmuscle.effects.base import TIME, AbstractEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import Slot

Series = Float[Array, " samples"]


class Samples(eqx.Module):
    """When the samples of one column were taken, at a constant step, and what its sensor calls zero.

    Attributes:
        time: since the first row of the recording [s]; the clock counts rows, a break takes no time.
        first, last: the first and the last sample of the stretch between breaks that each belongs to.
        zero: what the sensor shows unloaded: the ambient pressure of a pressure, 0 of anything else.
    """

    time: Series
    first: Int[Array, " *samples"]
    last: Int[Array, " *samples"]
    zero: Float[Array, ""] | float = 0.0

    @property
    def step(self) -> Float[Array, ""]:
        """Time from one sample to the next [s]."""
        return self.time[1] - self.time[0]

    def later(self, values: Series, delay: Float[Array, ""]) -> Series:
        """`values` a time `delay` [s] later; earlier where it is negative.

        Between samples by the cubic through two samples with the central differences as slopes (Catmull and
        Rom, 1974), which is continuous in the delay with its derivative and is each sample itself at a delay
        of zero. Beyond the ends of a stretch a straight line goes on. A single sample is constant.
        """
        if len(values) < 2:
            return values
        lag = delay / self.step
        whole = jnp.floor(lag)
        part = lag - whole
        index = jnp.arange(len(values)) + whole.astype(int)
        before, here, after, beyond = (self._at(values, index + i) for i in (-1, 0, 1, 2))
        bend = before - 2.5 * here + 2 * after - 0.5 * beyond
        twist = 1.5 * (here - after) + 0.5 * (beyond - before)
        return here + part * (0.5 * (after - before) + part * (bend + part * twist))

    def rate(self, values: Series) -> Series:
        """Central differences of `values` per second, one-sided at the ends of a stretch."""
        if len(values) < 2:
            return jnp.zeros_like(values)
        index = jnp.arange(len(values))
        return (self._at(values, index + 1) - self._at(values, index - 1)) / (2 * self.step)

    def _at(self, values: Series, index: Int[Array, " samples"]) -> Series:
        """Values at samples, those beyond a stretch on the straight line through its last or first two."""
        inside = jnp.clip(index, self.first, self.last)
        over = index - inside
        neighbour = jnp.clip(inside - jnp.sign(over), self.first, self.last)
        return values[inside] + jnp.abs(over) * (values[inside] - values[neighbour])


class AbstractCorrectedEffect(AbstractEffect):
    """An effect on readings of which measured columns are freed before they are fed to links of the chain."""

    @abc.abstractmethod
    def concerns(self, column: str, slot: Slot | None) -> bool:
        """Whether it acts on a column; `slot`: the slot of a reading that the column is of, if any."""

    @abc.abstractmethod
    def corrected(self, shown: Series, samples: Samples) -> Series:
        """The true values, as far as they follow from what was shown; exactly `shown` at zero strength."""

    def corrected_with_rate(self, shown: Series, rate: Series, samples: Samples) -> tuple[Series, Series]:
        """The true values and their rates per second, by the chain rule from the `rate` that was shown."""

        def true(values: Series, time: Series) -> Series:
            return self.corrected(values, eqx.tree_at(lambda s: s.time, samples, time))

        return jax.jvp(true, (shown, samples.time), (rate, jnp.ones_like(samples.time)))


class AbstractReadingEffect(AbstractCorrectedEffect):
    """An error of the sensor of one column, stateless; one class for each column (:func:`reading_effect`).

    Class variables:
        column: the column whose sensor it is.
        kind: name of the error without the column.
    """

    def concerns(self, column: str, slot: Slot | None) -> bool:
        """Its own column alone."""
        return column == self.column

    @abc.abstractmethod
    def shown(self, true: Series, samples: Samples) -> Series:
        """What the sensor shows; exactly `true` at zero strength."""


class SensorOffset(AbstractReadingEffect):
    r"""The sensor shows a constant too much: :math:`y = x + o`."""

    kind: ClassVar = "sensor_offset"
    strength: ClassVar = "offset"
    source: ClassVar = "zero error of a transducer, ISA-37.1"

    offset: eqx.AbstractVar[Scalar]

    def shown(self, true: Series, samples: Samples) -> Series:
        return true + self.offset

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return shown - self.offset


class SensorGain(AbstractReadingEffect):
    r"""The sensor shows all values too large by a factor: :math:`y = x + g (x - x_0)`.

    x0: what an unloaded sensor shows, the ambient pressure for a pressure, else 0.
    """

    kind: ClassVar = "sensor_gain"
    strength: ClassVar = "gain"
    largest: ClassVar = 0.5
    source: ClassVar = "sensitivity error of a transducer, ISA-37.1"

    gain: eqx.AbstractVar[Scalar]

    def shown(self, true: Series, samples: Samples) -> Series:
        return true + self.gain * (true - samples.zero)

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return shown - self.gain / (1 + self.gain) * (shown - samples.zero)


DRIFTED = 0.2
"""Share of the range of a reading by which its zero drifts within a recording at most; sensors that are sold
drift by hundredths. Of a measured muscle at three lengths, recorded one after the other, a pressure that
drifts by 0.7 of its range explained what differs from one length to the next."""


class SensorDrift(AbstractReadingEffect):
    r"""The sensor's zero drifts steadily: :math:`y = x + d\,t`; t since the first row of a recording."""

    kind: ClassVar = "sensor_drift"
    strength: ClassVar = "rate"
    source: ClassVar = "zero drift of a transducer, ISA-37.1"
    view: ClassVar = TIME

    rate: eqx.AbstractVar[Scalar]

    def shown(self, true: Series, samples: Samples) -> Series:
        return true + self.rate * samples.time

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return shown - self.rate * samples.time

    def largest_on(self, duration: float, ranges: Mapping[str, float]) -> float:
        """A fifth of its range is what a zero drifts by within a recording at most (:data:`DRIFTED`)."""
        return DRIFTED * ranges[self.slot.name] / duration


class ClockOffset(AbstractReadingEffect):
    r"""The column is read late against the commands and the other columns: :math:`y(t) = x(t - δ)`.

    δ may be negative. Between samples by a cubic (:meth:`Samples.later`). It is an error of the instants that
    are written down: a controller in the loop sees its readings without it.
    """

    kind: ClassVar = "clock_offset"
    strength: ClassVar = "delay"
    largest: ClassVar = 1.0
    source: ClassVar = "clocks of two recorders, or channels sampled in turn"

    delay: eqx.AbstractVar[Scalar]

    def shown(self, true: Series, samples: Samples) -> Series:
        return samples.later(true, -self.delay)

    def corrected(self, shown: Series, samples: Samples) -> Series:
        return samples.later(shown, self.delay)


KINDS: Mapping[str, type[AbstractReadingEffect]] = {
    each.kind: each for each in (SensorGain, SensorOffset, SensorDrift, ClockOffset)
}
"""Name of an error of a sensor → what it is, of whichever column; in the order in which they act."""
USUAL_OFFSETS = {"pressure": 2e3, "position": 2e-4, "angle": 2e-3, "force": 2.0, "current": 1e-3}
"""Column, without the number that tells muscles apart → usual size of the zero error of its sensor [SI]."""
USUAL_TIME = 20.0
"""Time in which a usual drift makes a usual offset [s]."""


def _usual_offset(column: str) -> float | None:
    return USUAL_OFFSETS.get(column.rstrip("0123456789").removesuffix("_"))


def _usual_drift(column: str) -> float | None:
    offset = _usual_offset(column)
    return None if offset is None else offset / USUAL_TIME


STRENGTHS: Mapping[str, Callable[[str], Any]] = {
    "sensor_offset": lambda column: parameter(
        f"{{column {column}}}",
        f"what the sensor of {column} shows too much",
        default=0.0,
        typical=_usual_offset(column),
    ),
    "sensor_gain": lambda column: parameter(
        "", f"relative error of the gain of the sensor of {column}", default=0.0, typical=0.01
    ),
    "sensor_drift": lambda column: parameter(
        f"{{rate {column}}}",
        f"rate at which the zero of the sensor of {column} drifts",
        default=0.0,
        typical=_usual_drift(column),
    ),
    "clock_offset": lambda column: parameter(
        "s", f"time by which {column} is read late", default=0.0, typical=5e-3
    ),
}
"""Name of an error of a sensor → how its parameter is declared for a column."""


@cache
def reading_effect(kind: str, column: str) -> type[AbstractReadingEffect]:
    """The class of an error of the sensor of a column, its name being kind and column.

    Args:
        kind: a key of :data:`KINDS`.
    """
    base = KINDS[kind]
    name = f"{kind}_{column}"
    body = {
        "__module__": __name__,
        "__qualname__": name,
        "__doc__": base.__doc__,
        "__annotations__": {base.strength: Scalar},
        base.strength: STRENGTHS[kind](column),
        "name": name,
        "kind": kind,
        "column": column,
        # Its unit is the column's, not the template of a slot of the chain: the chain never adds it.
        "slot": Slot(f"{column}_reading", f"{{column {column}}}"),
        "reads": frozenset({column_signal(column)}),
        "starts": ({},),
    }
    return types.new_class(name, (base,), {}, lambda namespace: namespace.update(body))


def column_signal(column: str) -> str:
    """What an effect reads that acts on a column, and what every rig with that column has."""
    return f"column {column}"


def reading_effect_named(name: str) -> type[AbstractReadingEffect] | None:
    """The class of the error that a name such as ``"sensor_offset_pressure"`` stands for, if it does."""
    for kind in KINDS:
        if name.startswith(f"{kind}_") and len(name) > len(kind) + 1:
            return reading_effect(kind, name.removeprefix(f"{kind}_"))
    return None


def __getattr__(name: str) -> type[AbstractReadingEffect]:
    """The class of an error by its name, as a pickle asks for it."""
    if (found := reading_effect_named(name)) is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return found


class Rig(Protocol):
    """What is needed of a rig, a class or an object."""

    commands: ClassVar[tuple[str, ...]]
    measured: ClassVar[Mapping[str, tuple[str, ...]]]
    outputs: ClassVar[Mapping[str, tuple[str, ...]]]


def measured_columns(rig: Rig | type[Rig]) -> tuple[str, ...]:
    """Every column that a sensor measures, commands apart."""
    groups = (*rig.measured.values(), *rig.outputs.values())
    names = dict.fromkeys(name for group in groups for name in group)
    return tuple(name for name in names if name not in rig.commands)


def reading_effects(actuator: Rig | type[Rig]) -> tuple[type[AbstractReadingEffect], ...]:
    """Every error of a sensor that a rig may have: each kind, for each measured column.

    For ``jaxmuscle.diagnose(recording, catalogue=(*CATALOGUE, *reading_effects(actuator)))``.
    """
    return tuple(reading_effect(kind, column) for column in measured_columns(actuator) for kind in KINDS)
