"""Force controllers of [H]: proportional, and with the inverse of the static curve ahead."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.control.pid import check_signs
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Table = Float[Array, " points"]


class StaticCurve(eqx.Module):
    """Steady force over current, measured or computed; both increase."""

    current: Table = parameter("A", "currents")
    force: Table = parameter("N", "steady forces at the currents")

    def __check_init__(self) -> None:
        """Raise `InputError` unless both increase over at least two points."""
        if any(isinstance(table, jax.core.Tracer) for table in (self.current, self.force)):
            return
        shapes = self.current.shape, self.force.shape
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or shapes[0][0] < 2:
            raise InputError(f"expected as many currents as forces, at least two; got shapes {shapes}")
        for name, table in (("currents", self.current), ("forces", self.force)):
            if not bool((jnp.diff(table) > 0).all()):
                raise InputError(f"expected {name} that increase; leave out where the valve saturates")

    def inverse(self, force: Scalar | float) -> Scalar:
        """Current [A] that leads to a force; that of the nearest end outside the curve."""
        return jnp.interp(force, self.force, self.current)


class ProportionalForce(eqx.Module):
    r"""Force controller, [H] 4.2: :math:`i = k_p (F_d - F) + f^{-1}(F_d)`, without a `curve` its first part.

    [H] runs it at 500 Hz with k_p = 0.044 A/N. The first part alone leaves an error at rest; the inverse of
    the static curve removes it as far as the curve holds. Limited to the rated current.
    """

    reads: ClassVar = "N"
    gives: ClassVar = "A"
    of_one_number: ClassVar = True
    gains: ClassVar = ("gain",)
    gain: Scalar = parameter("A/N", "proportional gain k_p", default=0.044, positive=True)
    curve: StaticCurve | None = None
    limit: Scalar = parameter("A", "rated current", default=0.4, positive=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a gain or a limit that is not above zero."""
        check_signs(self)

    def start(self) -> None:
        """There is no state."""
        return None

    def update(
        self, state: None, wanted: Scalar | float, measured: Scalar | float, step: float | Scalar
    ) -> tuple[None, Scalar]:
        """No state, and the current [A] until the next sample, as :meth:`current`."""
        return None, self.current(wanted, measured)

    def current(self, wanted: Scalar | float, measured: Scalar | float) -> Scalar:
        """Current [A] for a wanted and a measured force [N]."""
        ahead = 0.0 if self.curve is None else self.curve.inverse(wanted)
        return jnp.clip(self.gain * (wanted - measured) + ahead, -self.limit, self.limit)

    def bandwidth(self, pole: Scalar | float, static_gain: Scalar | float) -> Scalar:
        r"""Closed-loop bandwidth :math:`a + k_p k a` of a valve with one dominant pole, [H] linear theory.

        Args:
            pole: a, open-loop bandwidth, in any unit of frequency; the result is in the same.
            static_gain: k [N/A].
        """
        return pole * (1 + self.gain * static_gain)
