"""The "piecewise" PID of [W]: gains by the range that the wanted angle lies in."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.control.checks import check_signs
from jaxmuscle.control.pid import Controlling, IntegralInversePID
from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import IntegralInverse
from jaxmuscle.parameters import Scalar, parameter

Gains = Float[Array, " ranges"]


class ScheduledPID(eqx.Module):
    r"""PID of [W] (7) whose gains hold in ranges of the reference, with or without an inverse ahead of it.

    :math:`u = u_1 + K_{p,j}\,(e + \frac1{T_{i,j}} \int e\,dt + T_{d,j}\,\dot e)`, j the range of y_d. The
    numbers of [W] Table 3 are not legible; its angles go from 15° to 90°. One range is the PID of [W] (7).
    """

    of_one_number: ClassVar = True
    inverse: IntegralInverse | None
    edges: Float[Array, " edges"] = parameter("{output}", "ends of the ranges but the last, increasing")
    proportional: Gains = parameter("{input}/{output}", "gain K_p of each range", nonnegative=True)
    integral_time: Gains = parameter("s", "integral time T_i of each range", positive=True)
    derivative_time: Gains = parameter("s", "derivative time T_d of each range", nonnegative=True)

    def __check_init__(self) -> None:
        """Raise `InputError` unless gains have their sign, ranges are one more than edges, which increase."""
        check_signs(self)
        tables = (self.edges, self.proportional, self.integral_time, self.derivative_time)
        if any(isinstance(table, jax.core.Tracer) for table in tables):
            return
        sizes = [table.shape for table in tables]
        if len(set(sizes[1:])) > 1 or len(sizes[1]) != 1 or sizes[0] != (sizes[1][0] - 1,):
            raise InputError(f"expected n gains of each kind and n - 1 edges; got edges and gains of {sizes}")
        if not bool((jnp.diff(self.edges) > 0).all()):
            raise InputError(f"expected edges that increase; got {self.edges}")

    def start(self, value: float | Array = 0.0) -> Controlling:
        """At rest, at the input `value`."""
        return self._at(jnp.asarray(0)).start(value)

    def update(
        self, state: Controlling, reference: Scalar, measured: Scalar, step: float | Scalar
    ) -> tuple[Controlling, Scalar]:
        """The state after a sample of `step` seconds, and the command u until the next."""
        return self._at(jnp.searchsorted(self.edges, reference, side="right")).update(
            state, reference, measured, step
        )

    def without_windup(
        self, before: Controlling, after: Controlling, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> Controlling:
        """As :meth:`IntegralInversePID.without_windup`: the integrals are the same in all ranges."""
        return self._at(jnp.asarray(0)).without_windup(before, after, output, lowest, highest)

    def _at(self, place: Array) -> IntegralInversePID:
        """The controller of one range; the integral of the error is shared by all."""
        gains = (self.proportional, self.integral_time, self.derivative_time)
        return IntegralInversePID(self.inverse, *(gain[place] for gain in gains))
