"""Simulation of an actuator on a recording or on a command of one's own, in steps that the user asks for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.notebook_html import View
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.simulation.observed import observed
from jaxmuscle.simulation.run import run
from jaxmuscle.simulation.sensor_errors import true_track
from jaxmuscle.simulation.simulation_state import (
    SimulationState,
    check_state,
    form_at_rest,
    named_states,
    resumed_track,
    state_at,
)
from jaxmuscle.simulation.simulation_views import simulation_figure, simulation_view
from jaxmuscle.simulation.solvers import CONTROLLED, METHODS
from jaxmuscle.simulation.track import (
    Track,
    commanded_track,
    hidden_start,
    is_measured,
    sampling_step,
    start_at_rest,
    with_states,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 100_000
"""Largest number of substeps."""
FINER = 0.1
"""Tolerance of the run that controlled steps are judged by, relative to their own."""


class Steps(eqx.Module):
    """A method (the machine's own when `None`), steps between two samples (the fewest, with a tolerance)."""

    method: str | None = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    tolerance: Float[Array, ""] | None

    def finer(self) -> Steps:
        """The steps by whose result these are judged: half as long, with a tenth of the tolerance."""
        tolerance = None if self.tolerance is None else FINER * self.tolerance
        return Steps(self.method, 2 * self.substeps, tolerance)


def enough_substeps(actuator: AbstractActuator, step: float) -> int:
    """Substeps that make the steps no longer than the rig's largest; `step`: between samples [s]."""
    return max(1, math.ceil(step / actuator.largest_step - 1e-9))


def steps_of(
    actuator: AbstractActuator,
    step: float,
    method: str | None = None,
    substeps: int | None = None,
    tolerance: float | None = None,
) -> Steps:
    """What a user asks for, `step` [s] between samples.

    Raises:
        InputError: an unknown method, one that does not estimate its error for a tolerance, substeps or a
            tolerance out of range.
    """
    if method is not None and method not in METHODS:
        raise InputError(f"method: unknown {method!r}{nearest(str(method), METHODS)}")
    fewest = enough_substeps(actuator, step) if tolerance is None else 1
    count = fewest if substeps is None else substeps
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise InputError(f"substeps: expected a whole number from 1 to {MOST}; got {substeps!r}")
    if tolerance is None:
        return Steps(method, count, None)
    if not 1e-13 <= tolerance <= 0.1:
        raise InputError(f"tolerance: expected a relative error from 1e-13 to 0.1; got {tolerance!r}")
    chosen = CONTROLLED[0] if method is None else method
    if chosen not in CONTROLLED:
        names = " or ".join(CONTROLLED)
        raise InputError(f"method: {chosen!r} does not estimate its error; for a tolerance take {names}")
    return Steps(chosen, count, jnp.asarray(tolerance, dtype=float))


class Simulation(eqx.Module):
    """Readings of a machine over time, SI: output → array with a leading axis of samples.

    Attributes:
        time: sampling instants [s].
        final: the state one step after the last sample, with which a run of the commands that follow goes on.
        states: name of a state → its values at the samples, if they were asked for; those of effects by the
            effect's name.
        error: if it was asked for, how far each reading may be from that of infinitely short steps, up to
            each sample.
        units: output → SI unit.
        command: what was held from each sample on.
    """

    time: Float[Array, " samples"]
    readings: dict[str, Float[Array, "samples *muscles"]]
    final: SimulationState
    states: dict[str, Any] | None = None
    error: dict[str, Float[Array, "samples *muscles"]] | None = None
    units: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())
    command: Float[Array, "samples *muscles"] | None = None

    def plot(self, recording: Recording | None = None) -> Figure:
        """A matplotlib figure: every reading over time, in units of the right size.

        Args:
            recording: what was measured, drawn beneath: columns of the same names, on its own clock.

        Raises:
            InputError: what is no recording; a recording without any of these columns; many
                simulations at once.
        """
        measured = None
        if recording is not None:
            if not isinstance(recording, Recording):
                raise InputError(f"plot: expected a recording; got {type(recording).__name__}")
            measured = recording.time, recording.columns
        return simulation_figure(self._table(), dict(self.units), measured)

    def _repr_html_(self) -> str:
        """What a notebook shows: every reading with its range and course."""
        if self.time.ndim != 1:
            return View("simulations", f"{' × '.join(map(str, self.time.shape[:-1]))} at once").html()
        return simulation_view(self._table(), dict(self.units)).html()

    def _table(self) -> pd.DataFrame:
        """:meth:`to_frame` of one simulation."""
        if self.time.ndim != 1:
            raise InputError(
                f"expected one simulation; got many at once, times of shape {self.time.shape}: take one with "
                f"jax.tree.map(lambda x: x[0], simulations)"
            )
        return self.to_frame()

    def to_frame(self) -> pd.DataFrame:
        """A table indexed by time [s], one column a sensor; several muscles are numbered from 1."""
        columns = {}
        for name, values in self.readings.items():
            table = np.asarray(values).reshape(len(values), -1)
            for i in range(table.shape[1]):
                columns[name if table.shape[1] == 1 else f"{name}_{i + 1}"] = table[:, i]
        return pd.DataFrame(columns, index=pd.Index(np.asarray(self.time), name="time"))


def simulate(
    actuator: AbstractActuator,
    given: Recording | ArrayLike | Callable[[Array], Array],
    times: ArrayLike | None = None,
    *,
    start: Mapping[str, ArrayLike] | SimulationState | None = None,
    method: str | None = None,
    substeps: int | None = None,
    tolerance: float | None = None,
    error: bool = False,
    states: bool = False,
    widening: ArrayLike | None = None,
) -> Simulation:
    """Simulate `actuator` from rest, or on from where another simulation ended.

    Between two samples, where the command is held, fixed steps are taken or, with a `tolerance`, steps whose
    estimated error stays below it. Play operators are exact either way. Of a muscle with dry friction and
    hysteresis that lifts a mass at 500 Hz (`benchmarks/accuracy.py`), the position is wrong by this much of
    its range: with 1, 2, 4 substeps 1.4e-4, 2.3e-5, 7.6e-6 by "chebyshev" and 4.4e-3, 1.7e-5, 3.9e-6 by
    "heun", which sticking friction makes unstable in steps longer than 1 ms; with a tolerance of 1e-4 2.4e-6.

    Args:
        given: a recording, whose command is replayed from its first measured state (states that the bench
            imposes follow the recording); or a command, one row a sample, held until the next one; or the
            command as a function of time [s] in JAX, such as :class:`jaxmuscle.commands.Step`.
        times: sampling instants of a command [s], uniform.
        start: states at the first sample, SI, absolute pressures; without it the muscle is at ambient
            pressure and everything at rest. By name: measured states and rates, which a recording has
            itself; hidden states of the machine (``opening``); those of effects by the effect's name
            (``creep``); of an array all entries or one (``creep[0]``), as a fit calls them after ``start.``.
            Or the `final` state of another simulation, or a state of a :func:`jaxmuscle.stepper`: in fixed
            steps a command in two halves then gives the readings of the whole. (An error of a sensor that
            takes a series does not see the readings before.)
        method: "chebyshev" (second order, stabilised), "heun" (second), "bogacki-shampine" (third) or
            "dormand-prince" (fifth); without one the machine's own, which is "chebyshev" or, where part of
            the machine is linear and fast, an exponential method.
        substeps: steps between two samples; with a tolerance the fewest, one if not given; else as many as
            the rig's `largest_step` asks for.
        tolerance: largest error of a step relative to the largest value that each state has had.
        error: simulate a second time, with steps half as long and a tenth of the tolerance, and give twice
            the largest difference so far as the error of the readings. It bounds the error where halving
            the steps halves it at least.
        states: keep the states at every sample too.
        widening: how many times as wide as it is dry friction is smoothed where a motion comes to rest, as in
            :func:`jaxmuscle.control.closed_loop`; as it is when `None`.

    Returns:
        the readings at every sample and the state at the end; differentiable with respect to the parameters
        in forward mode, and with fixed steps in reverse mode.

    Raises:
        ValueError: a command without times, times of another length or not uniform, an unknown start.
        TypeError: a command for a rig whose states are imposed by a bench.
        InputError: an unknown method, substeps or a tolerance out of range; measured states as start of a
            recording, a state of another rig, of a machine with other effects, or at another sampling step
            where a delay asks for the commands before it.
    """
    named = {} if isinstance(start, SimulationState) else dict(start or {})
    if isinstance(given, Recording):
        track, clock, hidden = _recorded(actuator, given, start, named)
    else:
        track, clock, hidden = _commanded(actuator, given, times, named)
    if widening is not None:
        track = dataclasses.replace(track, widening=jnp.asarray(widening, dtype=float))
    step = float(clock[1] - clock[0])
    steps = steps_of(actuator, step, method, substeps, tolerance)
    begin = start if isinstance(start, SimulationState) else None
    if begin is not None:
        check_state(actuator, begin, step, form_at_rest(actuator))
    readings, kept, final = _run(actuator, track, len(clock), steps, hidden, begin, states)
    bound = None
    if error:
        finer, *_ = _run(actuator, track, len(clock), steps.finer(), hidden, begin, False)
        bound = jax.tree.map(_bound, readings, finer)
    return Simulation(jnp.asarray(clock), readings, final, kept, bound, _units(actuator), track.command)


def _units(actuator: AbstractActuator) -> tuple[tuple[str, str], ...]:
    """Output and its unit, of those that are declared as columns."""
    return tuple(
        (name, actuator.columns[group[0]].unit)
        for name, group in actuator.outputs.items()
        if group[0] in actuator.columns
    )


def _bound(coarse: Array, fine: Array) -> Array:
    """Twice the largest difference up to each sample; once would do for an error without any limit."""
    return 2 * jax.lax.cummax(jnp.abs(coarse - fine), axis=0)


@eqx.filter_jit
def _run(
    actuator: AbstractActuator,
    track: Track,
    samples: int,
    steps: Steps,
    hidden: dict[str, Array],
    state: SimulationState | None,
    states: bool,
) -> tuple[dict[str, Array], dict[str, Any] | None, SimulationState]:
    """Readings, states by name where they are wanted, and the state at the end."""
    row = 0
    if state is None:
        begin = with_states(start_at_rest(actuator, track), hidden)
    else:
        begin = state.begin
        track, row = resumed_track(actuator, track, state)
    done = run(
        actuator,
        track,
        begin,
        jnp.asarray(row),
        samples=samples,
        imposed=actuator.imposed,
        substeps=steps.substeps,
        method=steps.method,
        tolerance=steps.tolerance,
        keep=tuple(begin.state) if states else (),
    )
    final = state_at(actuator, track, done.final, row + samples)
    return done.readings, named_states(done.states) if states else None, final


def _recorded(
    actuator: AbstractActuator,
    recording: Recording,
    start: Mapping[str, ArrayLike] | SimulationState | None,
    named: Mapping[str, ArrayLike],
) -> tuple[Track, NDArray[np.float64], dict[str, Array]]:
    """Track, sampling instants, and the hidden states among those `named` as the start."""
    track = observed(actuator, recording, recording.card.noise).track
    if isinstance(start, SimulationState):
        # A sensor that drifts has drifted since the simulation began.
        track = dataclasses.replace(track, begin_time=start.time)
    track = true_track(actuator, track)
    if own := [name for name in named if is_measured(actuator, name)]:
        raise InputError(f"start: a recording begins as it was measured; leave out {', '.join(own)}")
    return track, np.asarray(recording.time), hidden_start(actuator, track, named)


def _commanded(
    actuator: AbstractActuator,
    given: ArrayLike | Callable[[Array], Array],
    times: ArrayLike | None,
    start: Mapping[str, ArrayLike],
) -> tuple[Track, NDArray[np.float64], dict[str, Array]]:
    """Track, sampling instants, and the hidden states of `start`."""
    if actuator.imposed:
        raise TypeError(f"rig {actuator.rig!r} has no command: its states are imposed; give a recording")
    if times is None:
        raise ValueError("a command needs the instants of its samples: simulate(actuator, command, times)")
    clock = np.asarray(times, dtype=float)
    if callable(given):
        given = jax.vmap(given)(jnp.asarray(clock))
    command = jnp.asarray(given, dtype=float)
    muscles = (len(actuator.commands),) if len(actuator.commands) > 1 else ()
    if command.shape != (*clock.shape, *muscles):
        raise ValueError(f"expected a command of shape {(*clock.shape, *muscles)}; got {command.shape}")
    measured = {name: value for name, value in start.items() if is_measured(actuator, name)}
    track = commanded_track(actuator, command, jnp.asarray(sampling_step(clock)), measured)
    others = {name: value for name, value in start.items() if name not in measured}
    return track, clock, hidden_start(actuator, track, others)
