"""PID controllers: the plain one, and those of [W], with a model run inside that takes the hysteresis out of
the way, and "piecewise", with gains by the range that the wanted angle lies in. What sampled controllers have
in common stands first.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import IntegralInverse
from jaxmuscle.hysteresis.compensation import Inverting
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, ""]


def check_signs(controller: eqx.Module) -> None:
    """Raise `InputError` for a gain, a time or a limit whose sign its declaration does not allow.

    Traced values pass: inside a transformation nothing is known of them.
    """
    for field in dataclasses.fields(controller):
        value = getattr(controller, field.name)
        positive, nonnegative = (field.metadata.get(key) for key in ("positive", "nonnegative"))
        if isinstance(value, jax.core.Tracer) or not (positive or nonnegative):
            continue
        if not bool((value > 0).all() if positive else (value >= 0).all()):
            least, meaning = "above zero" if positive else "zero or above", field.metadata["meaning"]
            raise InputError(
                f"{type(controller).__name__}: expected {field.name} ({meaning}) {least}; got {value}"
            )


def smoothed(before: Value, now: Value, time_constant: Value, step: float | Value) -> Value:
    """First-order low pass of samples, implicit: `before` [same unit as `now`] one `step` [s] later."""
    keep = time_constant / (time_constant + step)
    return keep * before + (1 - keep) * now


def integrated(before: Value, after: Value, output: Value, lowest: Value, highest: Value) -> Value:
    """An integral that waits where it would go the way on which the output is already beyond its limit."""
    waits = ((output > highest) & (after > before)) | ((output < lowest) & (after < before))
    return jnp.where(waits, before, after)


class Sampled(eqx.Module):
    """State of a PID controller: integral part of the output, last error, its smoothed rate."""

    integral: Scalar
    error: Scalar
    rate: Scalar


class PID(eqx.Module):
    r"""PID controller: :math:`u = K_p e + K_i \int e\,dt + K_d \dot e`, e the wanted less the measured value.

    Rectangles for the integral; the rate is a backward difference behind a first-order low pass, without
    which the noise of a sensor would be most of it. Its gains are in the units of the rig; at zero a part is
    off. Where the output is beyond its limits the integral waits, as in :class:`IntegralInversePID`, which
    has the times of [W] in the place of K_i and K_d and no low pass.
    """

    of_one_number: ClassVar = True
    gains: ClassVar = ("proportional", "integral", "derivative")
    proportional: Scalar = parameter("{input}/{output}", "gain K_p, input per output", nonnegative=True)
    integral: Scalar = parameter("{input}/({output} s)", "gain K_i", default=0.0, nonnegative=True)
    derivative: Scalar = parameter("{input} s/{output}", "gain K_d", default=0.0, nonnegative=True)
    smoothing: Scalar = parameter("s", "time constant of the rate", default=0.01, nonnegative=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a negative gain or time."""
        check_signs(self)

    def start(self, error: float | Array = 0.0) -> Sampled:
        """At rest, with an error that has not changed."""
        return Sampled(jnp.zeros(()), jnp.asarray(error, dtype=float), jnp.zeros(()))

    def update(
        self, state: Sampled, reference: Scalar, measured: Scalar, step: float | Scalar
    ) -> tuple[Sampled, Scalar]:
        """The state after a sample of `step` seconds, and the output u until the next."""
        error = reference - measured
        rate = smoothed(state.rate, (error - state.error) / step, self.smoothing, step)
        integral = state.integral + self.integral * step * error
        output = self.proportional * error + integral + self.derivative * rate
        return Sampled(integral, error, rate), output

    def without_windup(
        self, before: Sampled, after: Sampled, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> Sampled:
        """The state after a sample whose output is limited: the integral does not grow further that way."""
        integral = integrated(before.integral, after.integral, output, lowest, highest)
        return eqx.tree_at(lambda state: state.integral, after, integral)


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
    gains: ClassVar = ("proportional", "integral_time", "derivative_time")
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
        inverting = self.inverse.limited(before.inverting, after.inverting, lowest, highest)
        return Controlling(inverting, integral, after.error)


Gains = Float[Array, " ranges"]


class ScheduledPID(eqx.Module):
    r"""PID of [W] (7) whose gains hold in ranges of the reference, with or without an inverse ahead of it.

    :math:`u = u_1 + K_{p,j}\,(e + \frac1{T_{i,j}} \int e\,dt + T_{d,j}\,\dot e)`, j the range of y_d. The
    numbers of [W] Table 3 are not legible; its angles go from 15° to 90°. One range is the PID of [W] (7).
    """

    of_one_number: ClassVar = True
    gains: ClassVar = ("proportional", "integral_time", "derivative_time")
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
