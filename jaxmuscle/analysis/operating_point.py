"""Operating points by pseudo-transient continuation: under a command, or at an output that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from jaxmuscle._linalg import solve
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis.packed_state import Packed, Situation, situation
from jaxmuscle.errors import InputError

Vector = Float[Array, " n"]
FIRST_STEP, GROWTH, EULER_STEPS = 1e-4, 1.6, 60
"""Time steps on the way to rest: the first [s], the factor between two, their number; Newton's follow."""


class Settled(eqx.Module):
    """How far it is: steps made, and the last one relative to what is allowed of it."""

    count: Int[Array, ""]
    size: Float[Array, ""]


class Settling(optx.AbstractRootFinder):
    r"""Implicit Euler steps of :math:`\dot x = f(x)`, one Newton iteration each, ever longer, and at last
    Newton's own, the Euler step of infinite length (pseudo-transient continuation: Kelley and Keyes, SIAM J.
    Numer. Anal. 35, 1998).

    .. math:: x_{k+1} = x_k + (I/h_k - f'(x_k))^{-1} f(x_k)

    Ends where a step of Newton's is below `atol` + `rtol`\|x\| in every component. All in one loop, so that
    the function is compiled once.
    """

    rtol: float = 1e-9
    atol: float = 1e-12
    norm: Callable[[Any], Any] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> Settled:
        """Nothing has been done."""
        return Settled(jnp.asarray(0), jnp.asarray(jnp.inf))

    def step(self, fn, y, args, options, state: Settled, tags) -> tuple[Vector, Settled, Any]:
        """The next point on the way."""

        def twice(x: Vector) -> tuple[Vector, tuple[Vector, Any]]:
            value, aux = fn(x, args)
            return value, (value, aux)

        slopes, (value, aux) = jax.jacfwd(twice, has_aux=True)(y)
        euler = state.count < EULER_STEPS
        inverse = jnp.where(euler, GROWTH ** (-1.0 * state.count) / FIRST_STEP, 0.0)
        move = solve(inverse * jnp.eye(y.size) - slopes, value)
        size = self.norm(move / (self.atol + self.rtol * jnp.abs(y + move)))
        return y + move, Settled(state.count + 1, jnp.where(euler, jnp.inf, size)), aux

    def terminate(self, fn, y, args, options, state: Settled, tags) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether to stop, and with what result."""
        lost = ~jnp.isfinite(y).all()
        result = optx.RESULTS.where(lost, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return lost | (state.size < 1), result

    def postprocess(
        self, fn, y, aux, args, options, state, tags, result
    ) -> tuple[Vector, Any, dict[str, Any]]:
        """The point as it is."""
        return y, aux, {}


MOST_STEPS = EULER_STEPS + 30
"""After which there is taken to be no point of rest."""


class OperatingPoint(eqx.Module):
    """A machine at rest.

    Attributes:
        situation: how the states are packed, and what is held.
        state: packed states.
        command: the constant command.
        readings: what the sensors show, in the order of the rig's outputs.
        converged: whether Newton's last step was nothing; false where there is no such point.
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
    return _equilibrium(actuator, _floats(command), _starts(start), hold)


@eqx.filter_jit
def _equilibrium(
    actuator: AbstractActuator, command: Array, start: dict[str, Array], hold: tuple[str, ...]
) -> OperatingPoint:
    """:func:`equilibrium`, compiled once for every kind of machine."""
    here = situation(actuator, command, start, hold)

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
    adjusted: str | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    hold: tuple[str, ...] = (),
) -> OperatingPoint:
    """The operating point at which an output has a given value, with the command that it takes.

    A slow integral controller, itself a state, finds the command on the way (:func:`equilibrium`); the
    output has to grow with the command.

    Args:
        output: column of the output, such as "force"; value: in SI.
        command: where to begin, one entry a command.
        adjusted: the command that is sought, of a rig with several; the others stay as they are.

    Raises:
        InputError: as :func:`equilibrium`; an unknown output, no or an unknown command to adjust.
    """
    commands = actuator.commands
    if len(commands) > 1 and adjusted not in commands:
        raise InputError(
            f"rig {actuator.rig!r} has several commands; expected adjusted to be the one that sets "
            f"{output!r}, of {list(commands)}; got {adjusted!r}"
        )
    place = commands.index(adjusted) if len(commands) > 1 and adjusted else None
    return _equilibrium_at(actuator, output, _floats(value), _floats(command), place, _starts(start), hold)


@eqx.filter_jit
def _equilibrium_at(
    actuator: AbstractActuator,
    output: str,
    value: Array,
    begin: Array,
    adjusted: int | None,
    start: dict[str, Array],
    hold: tuple[str, ...],
) -> OperatingPoint:
    """:func:`equilibrium_at`, compiled once for every kind of machine."""
    here = situation(actuator, begin, start, hold)
    place = here.output(actuator, output)
    which = () if adjusted is None else adjusted

    def rates(packed: Packed, model: tuple[AbstractActuator, Array, Array]) -> Packed:
        machine, wanted, others = model
        given = others.at[which].set(packed[-1])
        miss = wanted - here.readings(machine, packed[:-1], given)[place]
        slow = miss / jnp.maximum(jnp.abs(wanted), 1e-3)
        return jnp.concatenate([here.rates(machine, packed[:-1], given), slow[None]])

    first = jnp.concatenate([here.start, begin[which][None]])
    state, converged = _at_rest(rates, first, (actuator, value, begin))
    found = begin.at[which].set(state[-1])
    return OperatingPoint(here, state[:-1], found, here.readings(actuator, state[:-1], found), converged)


def _floats(value: ArrayLike) -> Array:
    return jnp.asarray(value, dtype=float)


def _starts(start: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    return {name: _floats(value) for name, value in (start or {}).items()}


def _at_rest(
    rates: Callable[[Packed, Any], Packed],
    start: Packed,
    model: tuple[AbstractActuator, *tuple[Array, ...]],
) -> tuple[Packed, Bool[Array, ""]]:
    """Packed state at which `rates` vanish, and whether they do."""
    found = optx.root_find(rates, Settling(), start, model, max_steps=MOST_STEPS, throw=False)
    return found.value, found.result == optx.RESULTS.successful
