"""What a tuning makes small: named terms of a run in closed loop, each beside the size that counts as one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.variables import rate_unit
from jaxmuscle.control.loop import ClosedLoop
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError, nearest

BAND, EDGE = 0.02, 0.2
"""Half-width of the band of a settled error, of the range of the motion; of its smooth edge, of the band."""
LAST = 0.1
"""Share of the samples, the last ones, at which a motion has to have arrived."""


class Seen(NamedTuple):
    """A run as the terms look at it: wanted and read values, commands and their rest, which samples count.

    The first axis is that of the samples; `step`: between them [s]; `disturbed`: largest sensitivity of the
    linearised loop, where it is asked for.
    """

    target: Array
    reading: Array
    commands: Array
    rest: Array
    counts: Bool[Array, " samples"]
    step: Array
    disturbed: Array | None = None

    @property
    def error(self) -> Array:
        """Wanted less read."""
        return self.target - self.reading


def _root_mean(values: Array, counts: Array) -> Array:
    """Numbers whose sum of squares is the mean square of those values that count."""
    counted = jnp.where(counts.reshape(-1, *[1] * (values.ndim - 1)), values, 0.0)
    return (counted / jnp.sqrt(jnp.maximum(counts.sum(), 1) * values[0].size)).ravel()


def _over(values: Array, counts: Array) -> Array:
    """The largest of those that count, at least zero."""
    shown = jnp.where(counts.reshape(-1, *[1] * (values.ndim - 1)), values, 0.0)
    return jnp.maximum(shown.max(), 0.0)


def _range(seen: Seen) -> tuple[Array, Array]:
    """Lowest and highest wanted value."""
    shown = seen.counts.reshape(-1, *[1] * (seen.target.ndim - 1))
    lowest = jnp.where(shown, seen.target, jnp.inf).min(axis=0)
    return lowest, jnp.where(shown, seen.target, -jnp.inf).max(axis=0)


def tracking(seen: Seen) -> Array:
    """Root mean square of the error."""
    return _root_mean(seen.error, seen.counts)


def peak(seen: Seen) -> Array:
    """Largest error."""
    return _over(jnp.abs(seen.error), seen.counts)


def overshoot(seen: Seen) -> Array:
    """How far the reading goes beyond all that is wanted of it."""
    lowest, highest = _range(seen)
    return _over(jnp.maximum(seen.reading - highest, lowest - seen.reading), seen.counts)


def settling(seen: Seen) -> Array:
    """Time for which the error is beyond 2 % of the range of the motion, with smooth edges."""
    lowest, highest = _range(seen)
    begin = seen.reading[0]
    band = BAND * (jnp.maximum(highest, begin) - jnp.minimum(lowest, begin))
    safe = jnp.where(band > 0, band, 1.0)
    share = jax.nn.sigmoid((jnp.abs(seen.error) - band) / (EDGE * safe))
    outside = share.reshape(len(share), -1).max(axis=1)
    return seen.step * jnp.where(seen.counts, outside, 0.0).sum()


def arrival(seen: Seen) -> Array:
    """Root mean square of the error over the last tenth of the samples: to be there, and at rest."""
    late = seen.counts & (jnp.cumsum(seen.counts) > (1 - LAST) * seen.counts.sum())
    return _root_mean(seen.error, late)


def effort(seen: Seen) -> Array:
    """Root mean square of the command's distance from rest."""
    return _root_mean(seen.commands - seen.rest, seen.counts)


def variation(seen: Seen) -> Array:
    """Root mean square of the command's rate from sample to sample: what wears valves, chattering."""
    return _root_mean(jnp.diff(seen.commands, axis=0) / seen.step, seen.counts[1:])


def sensitivity(seen: Seen) -> Array:
    r"""Largest sensitivity :math:`M_s = \max_ω 1/|1 + L|` of the linearised loop."""
    assert seen.disturbed is not None
    return seen.disturbed


TERMS: dict[str, Callable[[Seen], Array]] = {
    term.__name__: term
    for term in (tracking, peak, overshoot, settling, arrival, effort, variation, sensitivity)
}
"""Name → function whose sum of squares is the square of the term's value."""

Function = Callable[[ClosedLoop, Any], Array] | Callable[[ClosedLoop, Any, Any], Array]
"""A function of a run and its reference, or of these and the machine that ran."""
Given = Mapping[str, float] | Function
"""Term → the size of it that costs one; or a function."""


def takes_the_machine(function: Function) -> bool:
    """Whether a function has a third argument, for the machine, that has no value without it."""
    try:
        given = inspect.signature(function).parameters.values()
    except ValueError:  # not every callable tells
        return False
    plain = [p for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    return len([p for p in plain if p.default is p.empty]) == 3


class Objective(eqx.Module):
    r"""Cost of a run: :math:`c = \sum_i (v_i/s_i)^2` over named terms, or what a function of the user's says.

    Attributes:
        sizes: term → the value of it that costs one (SI).
        function: (run, reference), or (run, reference, machine) → residuals, whose squares add up to the
            cost, or one number, the cost itself, not below zero; `None` for named terms.
        reading: that follows the reference; rest: command that costs no effort.
        squares: whether the cost is a sum of squares.
    """

    sizes: dict[str, Float[Array, ""]]
    function: Function | None = eqx.field(static=True)
    reading: str | None = eqx.field(static=True)
    rest: Array
    squares: bool = eqx.field(static=True, default=True)

    @property
    def margin(self) -> bool:
        """Whether the linearised loop is looked at."""
        return sensitivity.__name__ in self.sizes

    def seen(self, loop: ClosedLoop, target: Array, counts: Array, disturbed: Array | None = None) -> Seen:
        """A run as the terms look at it."""
        assert self.reading is not None
        step = loop.time[1] - loop.time[0]
        return Seen(target, loop.readings[self.reading], loop.commands, self.rest, counts, step, disturbed)

    def values(
        self, loop: ClosedLoop, target: Any, counts: Array, disturbed: Array | None
    ) -> dict[str, Array]:
        """Value of every term, asked for or not, in SI; the sensitivity only where it is."""
        if self.reading is None:
            return {}
        seen = self.seen(loop, target, counts, disturbed)
        known = {name: term for name, term in TERMS.items() if self.margin or term is not sensitivity}
        return {name: jnp.sqrt(jnp.sum(term(seen) ** 2)) for name, term in known.items()}

    def residuals(
        self,
        machine: AbstractActuator,
        loop: ClosedLoop,
        reference: Any,
        counts: Array,
        disturbed: Array | None = None,
    ) -> Array:
        """What the cost of a machine's run is made of: numbers whose squares add up to it, or the cost."""
        if self.function is not None:
            given: Any = (loop, reference, machine) if takes_the_machine(self.function) else (loop, reference)
            return jnp.asarray(self.function(*given))
        target = target_of(reference)
        seen = self.seen(loop, target, counts, disturbed)
        parts = [jnp.atleast_1d(TERMS[name](seen)) / size for name, size in self.sizes.items()]
        return jnp.concatenate(parts)

    def cost(self, residuals: Array) -> Array:
        """The cost that residuals stand for."""
        return jnp.sum(residuals**2) if self.squares else residuals


def units(actuator: AbstractActuator, reading: str | None, margin: bool = True) -> dict[str, str]:
    """Term → its SI unit; `margin`: whether the sensitivity is among them."""
    if reading is None:
        return {}
    own, command = (
        actuator.column(actuator.outputs[reading][0]).unit,
        actuator.column(actuator.commands[0]).unit,
    )
    return {
        **dict.fromkeys(("tracking", "peak", "overshoot", "arrival"), own),
        "settling": "s",
        "effort": command,
        "variation": rate_unit(command),
        **({"sensitivity": ""} if margin else {}),
    }


def sizes_of(given: Mapping[str, float]) -> dict[str, float]:
    """Sizes of named terms as they were written.

    Raises:
        InputError: none, an unknown term, a size that is not above zero.
    """
    if not given:
        raise InputError(f"objective: expected at least one term of {', '.join(TERMS)}, and its size")
    for name, size in given.items():
        if name not in TERMS:
            raise InputError(f"objective: unknown term {name!r}{nearest(str(name), TERMS)}")
        if isinstance(size, bool) or not isinstance(size, int | float) or not 0 < float(size) < float("inf"):
            raise InputError(
                f"objective[{name!r}]: expected the size of the term that costs one, above zero (SI); "
                f"got {size!r}"
            )
    return {name: float(size) for name, size in given.items()}
