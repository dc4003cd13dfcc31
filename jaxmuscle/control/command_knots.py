"""A command that is given, not fed back: values at knots, for trajectory optimisation by `jaxmuscle.tune`."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import equinox as eqx
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.feedback import output_limits
from jaxmuscle.control.pid import check_signs
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter


class CommandKnots(eqx.Module):
    r"""A controller that looks at nothing: :math:`u(t) = s\,v(t)`, straight from knot to knot, then constant.

    Its gains are the knots, so that :func:`jaxmuscle.tune` optimises a trajectory through the simulation:
    least effort to a target with the terms "arrival" and "effort", least time with "settling", within the
    limits of the command. What it finds is one command for all the scenarios.

    Attributes:
        values: v, shares of the span; zero to begin with.
    """

    of_one_number: ClassVar = True
    gains: ClassVar = ("values",)
    values: Float[Array, " knots"] = eqx.field(converter=lambda given: jnp.asarray(given, dtype=float))
    times: Float[Array, " knots"] = parameter("s", "times of the knots, increasing")
    span: Scalar = parameter("{input}", "output s of a value of one", default=1.0, positive=True)

    def __check_init__(self) -> None:
        """Raise `InputError` unless there are as many values as times, at least two, which increase."""
        check_signs(self)
        if isinstance(self.times, jax.core.Tracer):
            return
        shapes = self.values.shape, self.times.shape
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or shapes[0][0] < 2:
            raise InputError(
                f"CommandKnots: expected as many values as times, at least two; got shapes {shapes}"
            )
        if not bool((jnp.diff(self.times) > 0).all()):
            raise InputError(f"CommandKnots: expected times that increase; got {self.times}")

    def start(self) -> Scalar:
        """The time at the first sample [s]."""
        return jnp.zeros(())

    def update(
        self, state: Scalar, wanted: Any, measured: Scalar, step: float | Scalar
    ) -> tuple[Scalar, Scalar]:
        """The time after a sample of `step` seconds, and the output u until then."""
        return state + step, self.span * jnp.interp(state, self.times, self.values)


def command_knots(
    actuator: AbstractActuator,
    seconds: float,
    knots: int = 20,
    span: float | None = None,
    first: ArrayLike = 0.0,
    **settings: ArrayLike,
) -> CommandKnots:
    """Knots for a rig's channel, equally far apart, that do nothing yet, or what they are told.

    Args:
        seconds: from the first to the last of them.
        knots: how many.
        span: output of a value of one; the farthest one that the rig's commands allow when `None`.
        first: values to begin with. A machine that dry friction holds has no slopes: begin with a command
            that moves it.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, or whose commands have no limits and no span was given; fewer
            than two knots, a time that is not above zero.
    """
    if knots < 2 or not 0 < seconds < math.inf:
        raise InputError(
            "command_knots: expected at least two knots over a time above zero [s]; got "
            f"{knots} over {seconds}"
        )
    actuator.declared_channel()
    farthest = float(jnp.abs(jnp.stack(output_limits(actuator.actuation(**settings)))).max())
    if span is None and not math.isfinite(farthest):
        raise InputError(
            f"command_knots: the commands of rig {actuator.rig!r} have no limits; say how large an output "
            "may be: span="
        )
    made: Any = CommandKnots
    values = jnp.broadcast_to(jnp.asarray(first, dtype=float), (knots,))
    return made(values, jnp.linspace(0.0, seconds, knots), farthest if span is None else span)
