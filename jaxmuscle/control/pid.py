"""The PID of [W], with a model run inside it that takes the hysteresis out of its way."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.control.checks import check_signs, integrated
from jaxmuscle.hysteresis import IntegralInverse
from jaxmuscle.hysteresis.compensator import Inverting
from jaxmuscle.parameters import Scalar, parameter


class Controlling(eqx.Module):
    """State of an integral-inverse controller: that of the inverse, integral and last value of the error."""

    inverting: Inverting
    integral: Scalar
    error: Scalar


class IntegralInversePID(eqx.Module):
    r"""Compensator and PID, [W] (7): :math:`u = u_1 + K_p(e + \frac1{T_i} \int e\,dt + T_d \dot e)`.

    e = y_d - y is the error of the real output. Rectangles for the integral, a backward difference for the
    rate. Without an `inverse` it is the plain PID. The error before the first sample is taken to be zero:
    one that is not gives a kick of :math:`K_p T_d e / Δt` at that sample.

    In :func:`closed_loop`, whose command is limited, neither integral winds up: :meth:`without_windup`.
    """

    of_one_number: ClassVar = True
    inverse: IntegralInverse | None
    proportional: Scalar = parameter("{input}/{output}", "gain K_p, input per output", nonnegative=True)
    integral_time: Scalar = parameter("s", "integral time T_i", positive=True)
    derivative_time: Scalar = parameter("s", "derivative time T_d", nonnegative=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a negative gain or time."""
        check_signs(self)

    def start(self, value: float | Array = 0.0) -> Controlling:
        """At rest, at the input `value`, without an error so far."""
        inverting = Inverting(jnp.asarray(value, dtype=float), None)
        if self.inverse is not None:
            inverting = self.inverse.start(value)
        return Controlling(inverting, jnp.zeros(()), jnp.zeros(()))

    def update(
        self, state: Controlling, reference: Scalar, measured: Scalar, step: float | Scalar
    ) -> tuple[Controlling, Scalar]:
        """The state after a sample of `step` seconds, and the command u until the next."""
        error = reference - measured
        integral = state.integral + step * error
        rate = (error - state.error) / step
        inverting, ahead = state.inverting, state.inverting.value
        if self.inverse is not None:
            inverting, ahead = self.inverse.update(inverting, reference, step)
        pid = self.proportional * (error + integral / self.integral_time + self.derivative_time * rate)
        return Controlling(inverting, integral, error), ahead + pid

    def without_windup(
        self, before: Controlling, after: Controlling, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> Controlling:
        """The state after a sample whose `output` u is limited to `lowest` … `highest`.

        While u is beyond a limit the integral of the error does not grow further that way: conditional
        integration (Åström and Hägglund, PID Controllers, 2nd ed. 1995, section 3.5). The input u_1 of the
        inverse, which is that of the device, goes to the limit and no further.
        """
        integral = integrated(before.integral, after.integral, output, lowest, highest)
        if self.inverse is None:
            return eqx.tree_at(lambda state: state.integral, after, integral)
        value = jnp.clip(after.inverting.value, lowest, highest)
        inverting = Inverting(value, self.inverse.model.update(before.inverting.memory, value))
        return Controlling(inverting, integral, after.error)
