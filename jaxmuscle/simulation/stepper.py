"""Stepper of a machine for loops of other people's: a state and a command in, the next state out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.sensing import sensed
from jaxmuscle.errors import InputError
from jaxmuscle.simulation.run import run
from jaxmuscle.simulation.sensor_errors import Readings, readings_now, without_sensor_errors
from jaxmuscle.simulation.simulate import MOST, Steps, enough_substeps, steps_of
from jaxmuscle.simulation.simulation_state import (
    Form,
    SimulationState,
    check_state,
    first_state,
    form_at_rest,
    named_states,
    resumed_track,
    state_at,
)
from jaxmuscle.simulation.track import Track, held_at, reads

HISTORY = 0.5
"""Time over which a state remembers commands, of a machine with an effect that asks for them [s]."""


class Stepper(eqx.Module):
    """A machine that goes on by one sample at a time, as :func:`stepper` makes it.

    It is a tree of arrays: a function of it may be compiled, mapped over machines and differentiated by their
    parameters.

    Attributes:
        actuator: the machine.
        time_step: from one command to the next [s].
        steps: method, and steps of the solver within one time step.
        given: how many commands a state remembers.
    """

    actuator: AbstractActuator
    time_step: Float[Array, ""]
    steps: Steps
    given: int = eqx.field(static=True)
    form: Form = eqx.field(static=True)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the entries of a command."""
        return self.actuator.commands

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each reading and of each entry of a command; pressures are absolute."""
        rig = self.actuator
        units = {name: rig.column(columns[0]).unit for name, columns in rig.outputs.items()}
        return {**units, **{name: rig.column(name).unit for name in rig.commands}}

    def initial(self, start: Mapping[str, ArrayLike] | None = None) -> SimulationState:
        """The machine at rest, or with some of its states as in `start`, as for :func:`jaxmuscle.simulate`.

        Raises:
            InputError: a state that the machine has not, a value of another shape or not finite.
        """
        values = {name: jnp.asarray(value, dtype=float) for name, value in (start or {}).items()}
        for name, value in values.items():
            if not isinstance(value, jax.core.Tracer) and not np.isfinite(value).all():
                raise InputError(f"start: expected finite numbers for {name}; got {value}")
        return _first(self.actuator, self.time_step, values, self.given)

    def readings(self, state: SimulationState) -> Readings:
        """What the sensors show in a state, under the command that is held: reading → value (SI).

        Raises:
            InputError: a state of another rig, or of a machine with other effects.
        """
        self._check(state)
        return _shown(self.actuator, state)

    def step(
        self, state: SimulationState, command: ArrayLike | Sequence[float]
    ) -> tuple[SimulationState, Readings]:
        """Hold a command for one time step.

        Compiled once, whatever the numbers: in a Python loop a call costs some calls of NumPy. Inside a
        compiled loop nothing can be refused, and a state that runs away is not a number from there on.

        Args:
            state: from :meth:`initial`, a step before, or :func:`jaxmuscle.simulate`.
            command: one number, or one for each of `commands` (SI).

        Returns:
            the state one `time_step` later, and what the sensors show then, before another command is given.
            An error of a sensor that takes a series (one that is late) is not shown.

        Raises:
            InputError: a command of another shape or with values that are not finite, a state of another rig,
                or of a machine with other effects, a machine that runs away.
        """
        self._check(state)
        width = (len(self.commands),) if len(self.commands) > 1 else ()
        given = jnp.asarray(command, dtype=float)
        if given.shape != width:
            raise InputError(
                f"command: expected {' and '.join(self.commands)}, shape {width}; got shape {given.shape}"
            )
        after, readings, finite = _stepped(self.actuator, self.time_step, self.steps, state, given)
        if not isinstance(finite, jax.core.Tracer) and not bool(finite):
            raise InputError(self._fault(after, given))
        return after, readings

    def _check(self, state: SimulationState) -> None:
        late = reads(self.actuator, "past") and not isinstance(self.time_step, jax.core.Tracer)
        check_state(self.actuator, state, float(self.time_step) if late else math.nan, self.form)

    def _fault(self, after: SimulationState, command: Array) -> str:
        """Why a state is no number."""
        if not bool(jnp.isfinite(command).all()):
            return f"command: expected finite numbers; got {np.asarray(command)}"
        values = named_states(after.begin).items()
        lost = [n for n, v in values if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(v))]
        late = ""
        if reads(self.actuator, "past"):
            late = f"; or a delay is longer than the {self.given * float(self.time_step):g} s of commands "
            late += "that a state remembers (history=)"
        return (
            f"the machine ran away: {', '.join(lost)} no number at {float(after.time):.6g} s; give smaller "
            f"commands or more substeps than {self.steps.substeps}{late}"
        )


def stepper(
    actuator: AbstractActuator,
    time_step: float,
    *,
    method: str | None = None,
    substeps: int | None = None,
    history: float = HISTORY,
) -> Stepper:
    """A machine that goes on by one sample at a time, for a loop of your own.

    ::

        machine = jm.stepper(actuator, time_step=2e-3)
        state = machine.initial()
        for command in commands:
            state, readings = machine.step(state, command)

    The same commands give the same states as in :func:`jaxmuscle.simulate`. Machines of one kind share one
    compilation, whatever their parameters. Differentiable in forward and reverse mode.

    Args:
        time_step: from one command to the next [s].
        method, substeps: as for :func:`jaxmuscle.simulate`.
        history: time over which a state remembers commands [s], if the machine has an effect that asks for
            them: its longest delay.

    Raises:
        InputError: a rig without a command, a time step that is none or too long for the largest step that
            the rig's dynamics bear, substeps that make steps longer than that, an unknown method.
    """
    if actuator.imposed or not actuator.commands:
        raise InputError(f"rig {actuator.rig!r} has no command that a step could hold")
    numbers = {"time_step": time_step, "history": history}
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
            raise InputError(f"{name}: expected a time above zero [s]; got {value!r}")
    fewest = enough_substeps(actuator, time_step)
    longest = f"rig {actuator.rig!r} bears steps of {actuator.largest_step:g} s at most"
    if fewest > MOST:
        raise InputError(f"time_step: {longest}, {MOST} of them in a time step; got {time_step:g} s")
    steps = steps_of(actuator, time_step, method, substeps)
    if steps.substeps < fewest:
        raise InputError(
            f"substeps: {longest}: expected at least {fewest} in a time step of {time_step:g} s; "
            f"got {substeps}"
        )
    given = math.ceil(history / time_step) + 1 if reads(actuator, "past") else 1
    return Stepper(actuator, jnp.asarray(time_step, dtype=float), steps, given, form_at_rest(actuator))


@eqx.filter_jit
def _first(actuator: AbstractActuator, step: Array, start: dict[str, Array], given: int) -> SimulationState:
    return first_state(actuator, step, start, given)


@eqx.filter_jit
def _shown(actuator: AbstractActuator, state: SimulationState) -> Readings:
    return _readings(actuator, state)


@eqx.filter_jit
def _stepped(
    actuator: AbstractActuator, step: Array, steps: Steps, state: SimulationState, command: Array
) -> tuple[SimulationState, Readings, Array]:
    """One step; and whether all of it is finite."""
    track, row = resumed_track(actuator, Track(step, command[None], {}), state)
    done = run(
        actuator,
        track,
        state.begin,
        jnp.asarray(row),
        samples=1,
        imposed=(),
        substeps=steps.substeps,
        method=steps.method,
    )
    after = state_at(actuator, track, done.final, row + 1, len(state.commands))
    finite = jnp.stack([jnp.isfinite(leaf).all() for leaf in jax.tree.leaves((after.begin, command))]).all()
    return after, _readings(actuator, after), finite


def _readings(actuator: AbstractActuator, state: SimulationState) -> Readings:
    """What the sensors show while the last command is still held."""
    track, row = resumed_track(actuator, Track(state.step, state.commands[-1:], {}), state)
    here, begin = jnp.asarray(row), state.begin
    bare = without_sensor_errors(actuator)
    signals = bare.signals(begin.state, held_at(bare, track, here, begin.memory))
    states = {**begin.state.get("effects", {}), **begin.memory}
    return readings_now(actuator, sensed(bare, signals, states), track, here)
