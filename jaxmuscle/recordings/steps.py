"""The steps of a simulation as a user asks for them, checked at the door."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.stepping import CONTROLLED, METHODS

MOST = 100_000
"""Largest number of substeps."""
FINER = 0.1
"""Tolerance of the run that controlled steps are judged by, relative to their own."""


class Steps(eqx.Module):
    """A method (the machine's own when `None`), steps between two samples (the fewest, with a tolerance)."""

    method: str | None = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    tolerance: Float[Array, ""] | None

    def finer(self) -> Steps:
        """The steps by whose result these are judged: half as long, with a tenth of the tolerance."""
        tolerance = None if self.tolerance is None else FINER * self.tolerance
        return Steps(self.method, 2 * self.substeps, tolerance)


def enough_substeps(actuator: AbstractActuator, step: float) -> int:
    """Substeps that make the steps no longer than the rig's largest; `step`: between samples [s]."""
    return max(1, math.ceil(step / actuator.largest_step - 1e-9))


def steps_of(
    actuator: AbstractActuator,
    step: float,
    method: str | None = None,
    substeps: int | None = None,
    tolerance: float | None = None,
) -> Steps:
    """What a user asks for, `step` [s] between samples.

    Raises:
        InputError: an unknown method, one that does not estimate its error for a tolerance, substeps or a
            tolerance out of range.
    """
    if method is not None and method not in METHODS:
        raise InputError(f"method: unknown {method!r}{nearest(str(method), METHODS)}")
    fewest = enough_substeps(actuator, step) if tolerance is None else 1
    count = fewest if substeps is None else substeps
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise InputError(f"substeps: expected a whole number from 1 to {MOST}; got {substeps!r}")
    if tolerance is None:
        return Steps(method, count, None)
    if not 1e-13 <= tolerance <= 0.1:
        raise InputError(f"tolerance: expected a relative error from 1e-13 to 0.1; got {tolerance!r}")
    chosen = CONTROLLED[0] if method is None else method
    if chosen not in CONTROLLED:
        names = " or ".join(CONTROLLED)
        raise InputError(f"method: {chosen!r} does not estimate its error; for a tolerance take {names}")
    return Steps(chosen, count, jnp.asarray(tolerance, dtype=float))
