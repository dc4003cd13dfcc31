"""Inverse of a machine's model: the output of a controller that leads to a wanted reading."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis import equilibrium
from jaxmuscle.control.channel_model import channel_model, without_dry_friction
from jaxmuscle.control.feedback import output_limits
from jaxmuscle.control.linear_quadratic import regulator
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Table = Float[Array, " points"]
POINTS, FEWEST = 65, 4
"""Points of a table of the machine at rest; those at least over which the reading has to rise."""
FLAT = 1e-6
"""Rise of the reading from point to point, of the largest, below which it stays the same."""


class Quickened(eqx.Module):
    """State of an inverse: that of its linear model, and whether it has begun."""

    model: Float[Array, " states"]
    begun: Bool[Array, ""]


class Quickening(eqx.Module):
    r"""A machine's linear model that is made to follow a reference: :math:`u = N (r - y_0) - K x`.

    .. math:: x_{next} = A x + B u

    K as for :func:`~jaxmuscle.control.linear_quadratic`; the less effort costs, the more the model's reading
    is the reference (cheap control: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, section 3.8).
    """

    a: Float[Array, "states states"]
    b: Float[Array, " states"]
    feedback: Float[Array, " states"]
    ahead: Float[Array, ""]
    gain: Float[Array, ""]
    settled: Float[Array, " states"]
    rest: Float[Array, ""]

    def start(self) -> Quickened:
        """Not begun: at the first reference it rests."""
        return Quickened(jnp.zeros_like(self.b), jnp.asarray(False))

    def update(self, state: Quickened, target: Scalar | float) -> tuple[Quickened, Scalar]:
        """The state after a sample, and the reading at rest under the output that it gives."""
        about = target - self.rest
        model = jnp.where(state.begun, state.model, about * self.settled)
        output = self.ahead * about - self.feedback @ model
        return Quickened(self.a @ model + self.b * output, jnp.asarray(True)), self.rest + self.gain * output


class ModelInverse(eqx.Module):
    r"""The output that makes a model's reading equal the reference: :math:`u = f^{-1}(r)` at rest.

    f, the reading at rest over the output, is a table that :func:`model_inverse` makes once, straight between
    its points; beyond its ends the output is that of the nearest end. With `dynamics` r is first changed to
    what the linearised machine needs in order not to lag behind.
    """

    readings: Table = parameter("{output}", "readings at rest, increasing")
    outputs: Table = parameter("{input}", "outputs of a controller that lead to them, increasing")
    dynamics: Quickening | None = None

    def __check_init__(self) -> None:
        """Raise `InputError` unless both increase over at least two points."""
        if any(isinstance(table, jax.core.Tracer) for table in (self.readings, self.outputs)):
            return
        shapes = self.readings.shape, self.outputs.shape
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or shapes[0][0] < 2:
            raise InputError(
                f"ModelInverse: expected as many readings as outputs, at least two; got shapes {shapes}"
            )
        for name, table in (("readings", self.readings), ("outputs", self.outputs)):
            if not bool((jnp.diff(table) > 0).all()):
                raise InputError(f"ModelInverse: expected {name} that increase; leave out where they do not")

    def start(self) -> Quickened | None:
        """The state at the first sample; without dynamics there is none."""
        return None if self.dynamics is None else self.dynamics.start()

    def update(self, state: Any, target: Scalar | float, step: float | Scalar) -> tuple[Any, Scalar]:
        """The state after a sample, and the output u that leads to the target."""
        if self.dynamics is not None:
            state, target = self.dynamics.update(state, target)
        return state, jnp.interp(target, self.readings, self.outputs)


def model_inverse(
    actuator: AbstractActuator,
    outputs: tuple[float, float] | None = None,
    *,
    points: int = POINTS,
    step: float | None = None,
    quickness: float | None = None,
    about: float = 0.0,
    **settings: ArrayLike,
) -> ModelInverse:
    r"""The inverse of a rig's channel at rest, and with `quickness` of its linearised dynamics.

    The machine is let come to rest under outputs over a range (:func:`~jaxmuscle.analysis.equilibrium`,
    differentiable by its parameters); of the table the longest part is kept over which the reading rises:
    ends of the travel and dead zones fall away. Dry friction is left out: it would hold the machine anywhere.
    Inside a transformation nothing can be left away: choose `outputs` over which the reading rises, and leave
    out the quickness, whose design is not made of JAX. A machine
    with hysteresis between command and reading has no such table; its inverse is an
    :class:`~jaxmuscle.hysteresis.IntegralInverse` or :class:`~jaxmuscle.hysteresis.AnalyticInverse`.

    Args:
        outputs: lowest and highest output of the table; what the rig's commands allow when `None`.
        points: of the table.
        step: sampling step of the loop [s], which the dynamics need.
        quickness: how many times the output of rest may be spent so that the reading is as quick as the
            reference. Only the rest is inverted when `None`.
        about: output at which the machine is linearised for that.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, a range that is none, one that nobody has told, a reading that
            does not rise with the output at rest, as that of a machine that integrates its command.
    """
    smooth = without_dry_friction(actuator)
    channel, acts = smooth.declared_channel(), smooth.actuation(**settings)
    lowest, highest = _range(smooth, acts, outputs)
    grid = jnp.linspace(lowest, highest, points)
    readings = _readings_at_rest(smooth, acts, grid)
    if not isinstance(readings, jax.core.Tracer):
        kept = _rising(readings)
        if kept.stop - kept.start < FEWEST:
            raise InputError(
                f"model_inverse: the {channel.reading} of rig {smooth.rig!r} does not rise with the output "
                f"from {lowest:g} to {highest:g}, once at rest: the machine integrates its command, or has "
                "hysteresis; then give FeedForward an inverse of your own, or "
                "jaxmuscle.hysteresis.IntegralInverse"
            )
        readings, grid = readings[kept], grid[kept]
    dynamics = None if quickness is None else _quickening(smooth, step, quickness, about, settings)
    return ModelInverse(readings, grid, dynamics)


@eqx.filter_jit
def _readings_at_rest(actuator: AbstractActuator, acts: Actuation, outputs: Array) -> Array:
    """The channel's reading at rest under each output; no number where there is no rest."""
    columns = [name for names in actuator.outputs.values() for name in names]
    place = columns.index(actuator.outputs[actuator.declared_channel().reading][0])

    def at_rest(output: Array) -> Array:
        command = jnp.clip(acts.rest + acts.direction * output, acts.lowest, acts.highest)
        point = equilibrium(actuator, command)
        return jnp.where(point.converged, point.readings[place], jnp.nan)

    return jax.vmap(at_rest)(outputs)


def _range(
    actuator: AbstractActuator, acts: Actuation, given: tuple[float, float] | None
) -> tuple[Array, Array]:
    """Lowest and highest output of the table."""
    lowest, highest = map(jnp.asarray, output_limits(acts) if given is None else given)
    if isinstance(lowest, jax.core.Tracer) or isinstance(highest, jax.core.Tracer):
        return lowest, highest
    finite = bool(jnp.isfinite(lowest) & jnp.isfinite(highest))
    if given is None and not finite:
        raise InputError(
            f"model_inverse: the commands of rig {actuator.rig!r} have no limits; say over which range of "
            "the output: outputs=(lowest, highest)"
        )
    if not finite or not bool(lowest < highest):
        raise InputError(
            f"model_inverse: expected outputs=(lowest, highest), finite and increasing; got {given}"
        )
    return lowest, highest


def _rising(readings: Array) -> slice:
    """The longest run of points over which readings rise."""
    rises = jnp.diff(readings) > FLAT * jnp.nanmax(jnp.abs(readings))
    best, begin = slice(0, 0), 0
    for i, rise in enumerate([*rises.tolist(), False]):
        if not rise:
            if i + 1 - begin > best.stop - best.start:
                best = slice(begin, i + 1)
            begin = i + 1
    return best


def _quickening(
    actuator: AbstractActuator, step: float | None, quickness: float, about: float, settings: dict[str, Any]
) -> Quickening:
    """The linear model of a machine, which follows a reference by state feedback."""
    if step is None or not 0 < quickness < np.inf:
        raise InputError(
            "model_inverse: expected quickness above zero, and with it the sampling step of the loop, "
            f"step= [s]; got quickness {quickness!r} and step {step!r}"
        )
    acts = actuator.actuation(**settings)
    point = equilibrium(actuator, acts.rest + acts.direction * about)
    a, b, c, rest, _ = channel_model(actuator, step, point, delayed=False, **settings)
    still = np.eye(len(a)) - a
    settled = np.linalg.solve(still, b)
    gain = float(c @ settled)
    feedback, _ = regulator(a, b, c, step, 1.0, quickness / abs(gain), None)
    ahead = 1 / (c @ np.linalg.solve(still + np.outer(b, feedback), b))
    numbers = a, b, feedback, ahead, gain, settled / gain, rest
    return Quickening(*(jnp.asarray(number, dtype=float) for number in numbers))
