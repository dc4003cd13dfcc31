"""Closed loop: an actuator under a controller, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.digital import check_clocks
from jaxmuscle.errors import InputError
from jaxmuscle.simulation import Feedback, Track, run, start_at_rest
from jaxmuscle.simulation.run import Derivatives
from jaxmuscle.simulation.simulate import Steps, steps_of
from jaxmuscle.simulation.track import commanded_track, sampling_step


class Controller(Protocol):
    """What :func:`closed_loop` asks of a controller: an `eqx.Module` or other pytree with these methods."""

    def start(self) -> Any:
        """The state at the first sample."""
        ...

    def update(
        self, state: Any, wanted: Any, readings: dict[str, Array], step: Float[Array, ""]
    ) -> tuple[Any, Any]:
        """The state after a sample of `step` seconds, and the command until the next."""
        ...


class ClosedLoop(eqx.Module):
    """A run in closed loop, SI; leading axis of samples everywhere.

    Attributes:
        time: sampling instants [s].
        readings: what the controller saw at each of them.
        commands: what it gave, held until the next.
    """

    time: Float[Array, " samples"]
    readings: dict[str, Float[Array, "samples ..."]]
    commands: Float[Array, "samples *commands"]


def closed_loop(
    actuator: AbstractActuator,
    controller: Controller,
    reference: Any,
    times: ArrayLike,
    *,
    begin: Any = None,
    start: Mapping[str, ArrayLike] | None = None,
    method: str | None = None,
    substeps: int | None = None,
    widening: ArrayLike | None = None,
    derivatives: Derivatives = "any",
) -> ClosedLoop:
    """Simulate `actuator` from rest under `controller`.

    At every sample the sensors are read, the controller gives the command, and the machine runs under it
    until the next, as :func:`jaxmuscle.simulate` would with that command. A delay sees the commands that
    were really given; before the first sample the machine is taken to rest under the command that holds it.
    A controller begins with an error of zero unless `begin` says otherwise: where the first reference is not
    the first reading, its rate at the first sample is that of a jump, which a derivative part answers with
    a kick. ``begin=controller.start(error)`` of :class:`SlidingMode` and :class:`FuzzyPID` avoids that.
    Differentiable in forward and in reverse mode with respect to machine, controller and reference; may be
    vmapped. Compiled once for every kind of machine and controller and every number of samples.

    Args:
        controller: from a reference and the readings to the command: :func:`feedback_on` puts a controller
            of one reading on a rig.
        reference: what `update` gets as `wanted`: an array, a list of numbers or a tree of arrays such as a
            :class:`Reference`; one row a sample.
        times: sampling instants [s], uniform.
        begin: the controller's state at the first sample; `controller.start()` when `None`.
        start, method, substeps: as for :func:`jaxmuscle.simulate`.
        widening: how many times as wide as it is dry friction is smoothed where a motion comes to rest, for
            the first stages of a descent; a mass that friction holds stays held. As it is when `None`.
        derivatives: as they will be taken: in either mode ("any"); or forward, with several tangents,
            computed apart from the values ("linearised"), which is quicker and has the same values.

    Raises:
        InputError: a rig without a command, a reference of another length or with values that are not
            finite, a `begin` that is no state of the controller, a state after a sample that is none, a
            command of the wrong shape, a :class:`DigitalController` whose instants are none of the loop.
    """
    if actuator.imposed or not actuator.commands:
        raise InputError(f"rig {actuator.rig!r} has no command for a controller to give")
    clock = np.asarray(times, dtype=float)
    step = sampling_step(clock)
    check_clocks(controller, step)
    wanted = _wanted(reference, len(clock))
    begin = controller.start() if begin is None else _begun(controller, begin)
    given = {name: jnp.asarray(value, dtype=float) for name, value in (start or {}).items()}
    steps = steps_of(actuator, step, method, substeps)
    wide = None if widening is None else jnp.asarray(widening, dtype=float)
    return _closed(
        actuator, controller, wanted, jnp.asarray(clock), jnp.asarray(step), begin, given, steps, wide,
        derivatives,
    )  # fmt: skip


def _wanted(reference: Any, samples: int) -> Any:
    """The reference as a tree of arrays, after a look at its lengths and its values."""
    # A list is an array that was not made yet; to JAX it would be a tree of numbers.
    numbers = type(reference) is tuple and all(jnp.ndim(entry) == 0 for entry in reference)
    as_array = lambda leaf: jnp.asarray(leaf, dtype=float)  # noqa: E731
    try:
        listed = type(reference) is list or numbers
        wanted = as_array(reference) if listed else jax.tree.map(as_array, reference)
    except (TypeError, ValueError) as error:
        raise InputError(f"expected a reference of numbers, one row for each instant: {error}") from error
    leaves = jax.tree.leaves(wanted)
    lengths = {jnp.shape(leaf)[:1] for leaf in leaves}
    if lengths != {(samples,)}:
        raise InputError(f"expected a reference with one row for each of {samples} instants; got {lengths}")
    for leaf in leaves:
        if not isinstance(leaf, jax.core.Tracer) and not bool(np.isfinite(leaf).all()):
            row = int(np.argwhere(~np.isfinite(leaf))[0][0])
            raise InputError(f"expected a reference of finite numbers; got {leaf[row]} in row {row}")
    return wanted


def _begun(controller: Controller, begin: Any) -> Any:
    """A state of the controller, after a look at its form."""
    if _form(begin) != _form(controller.start()):
        raise InputError(
            f"expected begin to be a state of {type(controller).__name__}, as its start() gives; "
            f"got {type(begin).__name__}"
        )
    return begin


def _form(state: Any) -> Any:
    """Structure and shapes of a state."""
    return jax.tree.structure(state), [jnp.shape(leaf) for leaf in jax.tree.leaves(state)]


def _called(controller: Any) -> str:
    """The class of a controller, or of the one within it."""
    while hasattr(controller, "controller"):
        controller = controller.controller
    return type(controller).__name__


@eqx.filter_jit
def _closed(
    actuator: AbstractActuator,
    controller: Controller,
    wanted: Any,
    clock: Array,
    step: Array,
    begin: Any,
    given: dict[str, Array],
    steps: Steps,
    widening: Array | None,
    derivatives: Derivatives,
) -> ClosedLoop:
    """:func:`closed_loop`, compiled."""
    width = (len(actuator.commands),) if len(actuator.commands) > 1 else ()
    bare = commanded_track(actuator, jnp.zeros((len(clock), *width)), step, given)
    rest = actuator.resting_command(bare.at(jnp.asarray(0)))
    track = Track(step, jnp.broadcast_to(rest, bare.command.shape), bare.measured, widening=widening)
    as_arrays = lambda tree: jax.tree.map(jnp.asarray, tree)  # noqa: E731

    def update(state: Any, readings: dict[str, Array], row: Array) -> tuple[Any, Array]:
        here = jax.tree.map(lambda leaf: leaf[row], wanted)
        after, command = controller.update(state, here, readings, step)
        if jnp.shape(command) != width:
            raise InputError(f"expected a command of shape {width}; the controller gave {jnp.shape(command)}")
        if _form(after) != _form(state):
            raise InputError(
                f"{_called(controller)}: expected update to give a state of the form that start() has, "
                f"{_form(state)}; got {_form(after)}"
            )
        return as_arrays(after), command

    found = run(
        actuator,
        track,
        start_at_rest(actuator, track),
        jnp.asarray(0),
        samples=len(clock),
        imposed=(),
        substeps=steps.substeps,
        method=steps.method,
        feedback=Feedback(as_arrays(begin), update),
        derivatives=derivatives,
    )
    return ClosedLoop(clock, found.readings, found.command)
