"""Where a machine comes to rest: under a command, or at an output that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, ArrayLike, Bool

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.analysis.situation import Packed, Situation, situation
from jaxmuscle.errors import InputError

FIRST_STEP, GROWTH, STEPS = 1e-4, 1.6, 60
"""Time steps on the way to rest: the first [s], the factor between two, their number."""
TOLERANCE = 1e-9
"""Of Newton's last step, and of the rates that are left, relative to the size of each state."""


class OperatingPoint(eqx.Module):
    """A machine at rest.

    Attributes:
        situation: how the states are packed, and what is held.
        state: packed states.
        command: the constant command.
        readings: what the sensors show, in the order of the rig's outputs.
        converged: whether every rate vanishes; false where there is no such point.
    """

    situation: Situation
    state: Packed
    command: Array
    readings: Array
    converged: Bool[Array, ""]


def equilibrium(
    actuator: AbstractActuator,
    command: ArrayLike,
    *,
    start: Mapping[str, ArrayLike] | None = None,
    hold: tuple[str, ...] = (),
) -> OperatingPoint:
    """The state in which `actuator` rests under a constant command.

    Implicit Euler steps of growing length, one Newton iteration each, lead to where the machine settles by
    itself; Newton's method then solves for rates of zero. Differentiable with respect to parameters and
    command by the implicit function theorem; may be vmapped. Effects with a memory stay as they are at the
    start; a delayed command has arrived.

    Args:
        command: in the unit of the rig, one entry a muscle.
        start: measured states to begin from (SI); ambient pressure and zero for those not named.
        hold: states that keep the value they start with: a gas with its valve shut rests at any pressure.

    Raises:
        InputError: a rig without a command, unknown names.
    """
    command = jnp.asarray(command, dtype=float)
    here = situation(actuator, command, start or {}, hold)

    def rates(packed: Packed, model: tuple[AbstractActuator, Array]) -> Packed:
        return here.rates(model[0], packed, model[1])

    state, converged = _at_rest(rates, here.start, (actuator, command))
    return OperatingPoint(here, state, command, here.readings(actuator, state, command), converged)


def equilibrium_at(
    actuator: AbstractActuator,
    output: str,
    value: ArrayLike,
    *,
    command: ArrayLike = 0.0,
    start: Mapping[str, ArrayLike] | None = None,
    hold: tuple[str, ...] = (),
) -> OperatingPoint:
    """The operating point at which an output has a given value, with the command that it takes.

    A slow integral controller, itself a state, finds the command on the way (:func:`equilibrium`); the
    output has to grow with the command.

    Args:
        output: column of the output, such as "force"; value: in SI.
        command: where to begin; for rigs with one command.

    Raises:
        InputError: as :func:`equilibrium`; a rig with several commands, an unknown output.
    """
    if len(actuator.commands) != 1:
        raise InputError(f"rig {actuator.rig!r} has several commands; expected one that sets {output!r}")
    begin = jnp.asarray(command, dtype=float)
    here = situation(actuator, begin, start or {}, hold)
    place, value = here.output(actuator, output), jnp.asarray(value, dtype=float)
    scale = jnp.maximum(jnp.abs(value), 1e-3)

    def rates(packed: Packed, model: tuple[AbstractActuator, Array]) -> Packed:
        given = packed[-1]
        miss = (model[1] - here.readings(model[0], packed[:-1], given)[place]) / scale
        return jnp.concatenate([here.rates(model[0], packed[:-1], given), miss[None]])

    first = jnp.concatenate([here.start, begin[None]])
    state, converged = _at_rest(rates, first, (actuator, value))
    found = state[-1]
    readings = here.readings(actuator, state[:-1], found)
    return OperatingPoint(here, state[:-1], found, readings, converged)


def _at_rest(
    rates: Callable[[Packed, tuple[AbstractActuator, Array]], Packed],
    start: Packed,
    model: tuple[AbstractActuator, Array],
) -> tuple[Packed, Bool[Array, ""]]:
    """Packed state at which `rates` vanish, and whether they do."""

    def toward_rest(x: Packed, width: Array) -> tuple[Packed, None]:
        slopes = jax.jacfwd(rates)(x, model)
        return x + jnp.linalg.solve(jnp.eye(len(x)) / width - slopes, rates(x, model)), None

    widths = FIRST_STEP * GROWTH ** jnp.arange(STEPS)
    near = jax.lax.stop_gradient(jax.lax.scan(toward_rest, start, widths)[0])
    # Pressures and tip positions differ by nine orders of magnitude.
    sizes = jnp.where(near == 0, 1.0, jnp.maximum(jnp.abs(near), 1e-12))

    def scaled(z: Packed, model: tuple[AbstractActuator, Array]) -> Packed:
        return rates(sizes * z, model) / sizes

    solver = optx.Newton(rtol=TOLERANCE, atol=TOLERANCE)
    found = optx.root_find(scaled, solver, near / sizes, model, max_steps=30, throw=False).value
    # Something that rings fast comes to rest only within the rounding of its fastest rate.
    fastest = 1 + jnp.abs(jax.jacfwd(scaled)(found, model)).sum(axis=1)
    return sizes * found, jnp.all(jnp.abs(scaled(found, model)) < TOLERANCE * fastest)
