"""Fuzzy PID controller that [T] sets beside its variable-structure controller."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.control.pid import check_signs, integrated, smoothed
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, ""]
Sets = Float[Array, " sets"]

LEVELS = np.arange(-3, 4)
"""Negative big, medium, small, zero, positive small, medium, big."""
MACVICAR_WHELAN = np.clip(LEVELS[:, None] + LEVELS, -3, 3) / 3
"""Rule table: the level of the answer for levels of the error (rows) and of its rate (columns), of ±1."""


class Fuzzy(eqx.Module):
    """State of the controller: integral part of the command, last error [rad], its filtered rate."""

    integral: Value
    error: Value
    rate: Value


class FuzzyPID(eqx.Module):
    r"""PID by fuzzy rules on MacVicar and Whelan's table, the baseline of [T]:
    :math:`u = K_p U + K_i \int U\,dt`.

    .. math:: U = \sum_{i,j} μ_i(e/\bar e)\,μ_j(\dot e/\bar r)\,T_{ij},\quad μ_i(x) = \max(0, 1 - |3x - i|)

    Seven triangular sets for the error and for its rate, equally spaced over ±1 and adding up to one, the
    ends held beyond; product for *and*, weighted mean for the answer. T: table of 7 by 7, rows for the error.
    Inside the table's saturation U is linear, a PD controller; the integral is taken of what the rules say.

    [T] names the table ("a fuzzy PID based on a classic McVicar-Wheelan table [51]") and gives nothing else:
    ranges, gains, limits and the shape of the sets are not in its text, nor the table itself, which is here
    the diagonal one that goes by that name. The limit is the mean pressure of [T], beyond which a muscle is
    empty. Unlike that of :class:`SlidingMode` the integral acts at any error, which [T] found to cost the
    natural compliance; it is limited like the command, and under narrower limits of :func:`closed_loop` it
    waits (:meth:`without_windup`).
    """

    reads: ClassVar = "rad"
    gives: ClassVar = "Pa"
    of_one_number: ClassVar = True
    gains: ClassVar = ("error_range", "rate_range", "proportional", "integral")
    error_range: Scalar = parameter("rad", "error ē that is as big as can be", positive=True)
    rate_range: Scalar = parameter("rad/s", "rate r̄ of the error that is as big as can be", positive=True)
    proportional: Scalar = parameter("Pa", "command K_p of the strongest rule", nonnegative=True)
    integral: Scalar = parameter("Pa/s", "its growth K_i", default=0.0, nonnegative=True)
    limit: Scalar = parameter(
        "Pa", "largest command, and largest integral part", default=2.5e5, positive=True
    )
    smoothing: Scalar = parameter("s", "time constant of the rate", default=0.01, nonnegative=True)
    table: Float[Array, "sets sets"] = parameter(
        "", "rule table T", default=tuple(map(tuple, MACVICAR_WHELAN))
    )

    def __check_init__(self) -> None:
        """Raise `InputError` for a number of the wrong sign, or a table that is not 7 by 7."""
        check_signs(self)
        if self.table.shape != MACVICAR_WHELAN.shape:
            raise InputError(
                f"FuzzyPID: expected a rule table of shape {MACVICAR_WHELAN.shape}, rows for the error and "
                f"columns for its rate; got {self.table.shape}"
            )

    def start(self, error: float | Array = 0.0) -> Fuzzy:
        """At rest, with an error that has not changed."""
        zero = jnp.zeros(())
        return Fuzzy(zero, jnp.asarray(error, dtype=float), zero)

    def answer(self, error: Value | float, rate: Value | float) -> Value:
        """What the rules say, U from -1 to 1, to an error [rad] and its rate [rad/s]."""
        return _memberships(error / self.error_range) @ self.table @ _memberships(rate / self.rate_range)

    def update(
        self, state: Fuzzy, wanted: Value, measured: Value, step: float | Value
    ) -> tuple[Fuzzy, Value]:
        """The state after a sample of `step` seconds, and ΔU [Pa] until the next; angles [rad]."""
        error = wanted - measured
        rate = smoothed(state.rate, (error - state.error) / step, self.smoothing, step)
        answer = self.answer(error, rate)
        integral = jnp.clip(state.integral + self.integral * step * answer, -self.limit, self.limit)
        command = jnp.clip(self.proportional * answer + integral, -self.limit, self.limit)
        return Fuzzy(integral, error, rate), command

    def without_windup(
        self, before: Fuzzy, after: Fuzzy, output: Value, lowest: Value, highest: Value
    ) -> Fuzzy:
        """The state after a sample whose command has narrower limits than the controller's own."""
        integral = integrated(before.integral, after.integral, output, lowest, highest)
        return eqx.tree_at(lambda state: state.integral, after, integral)


def _memberships(value: Value) -> Sets:
    """How much a value, of ±1, belongs to each set; they add up to one. NaN belongs to none and stays NaN."""
    place = 3 * jnp.clip(value, -1.0, 1.0)
    # By the cell that it lies in: on a set's peak rounding would take the slopes of both sides at once.
    cell = jnp.clip(jnp.floor(place), -3, 2)
    above = place - cell
    within = jnp.where(cell == LEVELS, 1 - above, jnp.where(cell + 1 == LEVELS, above, 0.0))
    return jnp.where(jnp.isnan(value), value, within)
