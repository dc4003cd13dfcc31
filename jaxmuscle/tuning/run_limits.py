"""Limits of readings, of commands and of their rates, sample by sample, and how far a run breaks them."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.loop import ClosedLoop
from jaxmuscle.errors import InputError, nearest

COMMAND, RATE = "command", "rate "
"""What limits call the command, and put before the name of that of which the rate is limited."""
SMALL = 0.01
"""Excess that costs one, of the range between the limits."""

Limit = tuple[ArrayLike | None, ArrayLike | None]
"""Lowest and highest value (SI)."""


class Fence(eqx.Module):
    """Lowest and highest value at every sample (infinite: none), and the excess that costs one."""

    lowest: Array
    highest: Array
    size: Array

    def excess(self, values: Array) -> Array:
        """How far values are below and above, in units of the size; less than zero within."""
        shape = (-1, *[1] * (values.ndim - 1))
        low, high = self.lowest.reshape(shape), self.highest.reshape(shape)
        return jnp.stack([_below(low, values), _below(values, high)]) / self.size


def _below(lower: Array, upper: Array) -> Array:
    """How far `lower` is above `upper`; far within where there is no limit, without a derivative."""
    some = jnp.isfinite(lower) & jnp.isfinite(upper)
    return jnp.where(some, jnp.where(some, lower, 0.0) - jnp.where(some, upper, 0.0), -1.0)


def limited(name: str, loop: ClosedLoop) -> Array:
    """Values of a reading or of the command, or of its rate, one row a sample."""
    bare = name.removeprefix(RATE)
    values = loop.commands if bare == COMMAND else loop.readings[bare]
    if bare == name:
        return values
    rate = jnp.diff(values, axis=0) / (loop.time[1] - loop.time[0])
    return jnp.concatenate([rate, rate[-1:]])


def fence(actuator: AbstractActuator, name: str, pair: Any, samples: int, span: float) -> Fence:
    """A limit at every sample."""
    known = [*actuator.outputs, COMMAND]
    if name.removeprefix(RATE) not in known:
        rest = [*known, *(RATE + each for each in known)]
        raise InputError(f"limits: unknown reading {name!r}{nearest(name, rest)}")
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(
            f"limits[{name!r}]: expected (lowest, highest) in SI, None for no limit; got {pair!r}"
        )
    ends = []
    for end, none in zip(pair, (-math.inf, math.inf), strict=True):
        values = np.asarray(none if end is None else end, dtype=float)
        if values.shape not in ((), (samples,)) or np.isnan(values).any():
            raise InputError(
                f"limits[{name!r}]: expected numbers, one or {samples}; got shape {values.shape}"
                + (" with values that are no numbers" if np.isnan(values).any() else "")
            )
        ends.append(np.broadcast_to(values, (samples,)))
    if (ends[0] > ends[1]).any():
        row = int(np.argmax(ends[0] > ends[1]))
        raise InputError(
            f"limits[{name!r}]: expected a lower one below the upper one; got {ends[0][row]:g} and "
            f"{ends[1][row]:g} in row {row}"
        )
    finite = np.concatenate(ends)[np.isfinite(np.concatenate(ends))]
    if not finite.size:
        raise InputError(f"limits[{name!r}]: expected at least one limit; got none")
    size = SMALL * (float(np.ptp(finite)) or float(np.abs(finite).max()) or span)
    return Fence(jnp.asarray(ends[0]), jnp.asarray(ends[1]), jnp.asarray(size))
