"""Predictions and residuals of each submodel, window and sample, and their Jacobian for many parameter
vectors at once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from jaxmuscle._traced_programs import KeptProgram
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.variables import Link
from jaxmuscle.effects.readings import reading_effect
from jaxmuscle.estimation.jacobian import Leaves, Traced, slopes_of
from jaxmuscle.estimation.padding import in_buckets, without_padding
from jaxmuscle.estimation.windows import Problem, Residuals
from jaxmuscle.optimization.descents import BROKEN
from jaxmuscle.parameter_names import OFFSET, START, of_machine
from jaxmuscle.parameters import replace, split_index
from jaxmuscle.simulation import Start, observe, predict, start_at_rest, with_states
from jaxmuscle.simulation.run import Derivatives
from jaxmuscle.simulation.sensor_errors import true_track


class Stepping(NamedTuple):
    """How simulations are stepped where it matters: for fewer errors of the solver, or for derivatives.

    Attributes:
        substeps: solver steps between two samples; the problem's when `None`.
        derivatives: what the simulations are laid out for.
    """

    substeps: int | Array | None = None
    derivatives: Derivatives = "any"

    def between_samples(self, problem: Problem) -> Any:
        """Solver steps between two samples of `problem`."""
        return problem.substeps if self.substeps is None else self.substeps


USUAL = Stepping()


def link_predictions(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Every output predicted by its own link, the inputs of the link as measured."""
    hidden = hidden_states(actuator, problem)
    return {link.output: link_prediction(actuator, problem, link, hidden) for link in actuator.links}


def link_prediction(
    actuator: AbstractActuator,
    problem: Problem,
    link: Link,
    hidden: Start,
    stepping: Stepping = USUAL,
) -> Array:
    """The output of one link, its inputs as measured and the states that are not from `hidden`."""
    return predict(
        actuator,
        _begun(actuator, problem).track,
        problem.rows,
        samples=problem.samples,
        imposed=(*link.imposed, *(n for n in actuator.imposed if n not in link.imposed)),
        substeps=stepping.between_samples(problem),
        hidden=hidden,
        period=problem.period,
        derivatives=stepping.derivatives,
    )[link.output]


def hidden_states(actuator: AbstractActuator, problem: Problem, stepping: Stepping = USUAL) -> Start:
    """The states that are not measured, carried along the recording from rest, or from what `begin` says."""
    track = _begun(actuator, problem).track
    own = {p: value for p, value in problem.begin.items() if split_index(p)[0] not in track.measured}
    start = with_states(start_at_rest(actuator, track), own)
    steps = stepping.between_samples(problem)
    return observe(actuator, track, problem.total, steps, start, stepping.derivatives)


def chain_predictions(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Every output predicted from the command alone, window by window."""
    hidden, problem = hidden_states(actuator, problem), _begun(actuator, problem)
    return predict(
        actuator,
        problem.track,
        problem.rows,
        samples=problem.samples,
        imposed=actuator.imposed,
        substeps=problem.substeps,
        hidden=hidden,
    )


def _begun(actuator: AbstractActuator, problem: Problem) -> Problem:
    """With the measured states freed of sensors' errors, those of the first sample as `begin` says."""
    track = true_track(actuator, problem.track)
    measured = dict(track.measured)
    for path, value in problem.begin.items():
        name, index = split_index(path)
        if name in measured:
            measured[name] = measured[name].at[(0, *(index or ()))].set(value)
    return dataclasses.replace(problem, track=dataclasses.replace(track, measured=measured))


def residuals(actuator: AbstractActuator, problem: Problem) -> Residuals:
    """Weighted residuals (predicted - measured) of all links."""
    predicted = link_predictions(actuator, problem)
    return {out: weighted(predicted[out], problem, out) for out in predicted}


def weighted(predicted: Array, problem: Problem, output: str) -> Array:
    """Weighted residual of one output; what is not a number counts as `BROKEN`."""
    residual = (predicted - problem.targets[output]) * problem.weights[output]
    return jnp.where(jnp.isfinite(residual), jnp.clip(residual, -BROKEN, BROKEN), BROKEN)


_residuals = KeptProgram(residuals)
_chain_predictions = KeptProgram(chain_predictions)
Evaluated = dict[str, NDArray[np.float64]]
"""Output → (windows, samples, …), without padding."""


def evaluate(actuator: AbstractActuator, problem: Problem) -> Evaluated:
    """Weighted residuals, compiled once for each structure of a model and size of a recording."""
    return without_padding(_residuals(actuator, in_buckets(problem)), problem)


def evaluate_chain(actuator: AbstractActuator, problem: Problem) -> Evaluated:
    """Predictions from the command alone, compiled once for a recording and its parts."""
    return without_padding(_chain_predictions(actuator, in_buckets(problem, whole=True)), problem)


def moved(
    actuator: AbstractActuator, problem: Problem, paths: Sequence[str], values: Sequence[Array]
) -> tuple[AbstractActuator, Problem]:
    """The machine and the problem with the given values (SI) at the paths.

    What the machine's sensors measured is freed of their errors where it is a state from which windows begin
    or which is imposed: here already, so that those who move a state at a window's beginning move the one
    that it begins with.
    """
    machine, problem = moved_as_measured(actuator, problem, paths, values)
    return machine, freed(problem, machine)


def moved_as_measured(
    actuator: AbstractActuator, problem: Problem, paths: Sequence[str], values: Sequence[Array]
) -> tuple[AbstractActuator, Problem]:
    """The machine and the problem of :func:`moved` with the states as measured.

    For functions that free them of sensors' errors themselves, in compiled code, as :func:`evaluate` does.
    The offset of a sensor is an effect of the machine (:class:`SensorOffset`) like those of a card or of a
    diagnosis, and predictions of its readings have it. A state at the first sample takes the place of what
    was measured there, or of rest.
    """
    given = dict(zip(paths, values, strict=True))
    machine = replace(actuator, {path: v for path, v in given.items() if of_machine(path)})
    offsets = {
        path: reading_effect("sensor_offset", path.removeprefix(OFFSET))(**{"offset": value})
        for path, value in given.items()
        if path.startswith(OFFSET)
    }
    begin = {path.removeprefix(START): v for path, v in given.items() if path.startswith(START)}
    if begin:
        problem = dataclasses.replace(problem, begin={**problem.begin, **begin})
    return machine.with_effects(**offsets) if offsets else machine, problem


def freed(problem: Problem, actuator: AbstractActuator) -> Problem:
    """With measured states freed of what the machine's sensors do to their readings; itself if nothing."""
    track = true_track(actuator, problem.track)
    return problem if track is problem.track else dataclasses.replace(problem, track=track)


def residual_vector(
    theta: Float[Array, " values"],
    actuator: AbstractActuator,
    problem: Problem,
    paths: Sequence[str],
    stepping: Stepping = USUAL,
) -> Float[Array, " residuals"]:
    """Weighted residuals of all links, one after the other; what is not a number is left as it is."""
    machine, shifted = moved(actuator, problem, paths, list(theta))
    hidden = hidden_states(machine, shifted, stepping)
    return jnp.concatenate([_weighted(machine, shifted, link, hidden, stepping) for link in actuator.links])


def _weighted(
    machine: AbstractActuator,
    problem: Problem,
    link: Link,
    hidden: Start,
    stepping: Stepping = USUAL,
) -> Float[Array, " residuals"]:
    weight = problem.weights[link.output]
    predicted = link_prediction(machine, problem, link, hidden, stepping)
    return jnp.where(weight > 0, (predicted - problem.targets[link.output]) * weight, 0.0).ravel()


@KeptProgram
def values_and_slopes(
    thetas: Float[Array, "lanes values"], actuator: AbstractActuator, problem: Problem, paths: tuple[str, ...]
) -> tuple[Float[Array, "lanes residuals"], Float[Array, "lanes values residuals"]]:
    """Residuals at each set of values (SI) and their derivatives by every value.

    The hidden states and each link are simulated once, with a tangent for every value that can act there;
    all sets go through the same simulations, compiled once for a structure of the machine and a shape of the
    problem.
    """

    def at(values: Leaves) -> tuple[AbstractActuator, Problem]:
        return moved(actuator, problem, paths, values)

    trees: list[Any] = []

    def observed(values: Leaves, _: Leaves) -> Leaves:
        leaves, tree = jax.tree.flatten(hidden_states(*at(values)))
        trees.append(tree)
        return leaves

    def predicted(link: Link, values: Leaves, leaves: Leaves) -> Leaves:
        return [_weighted(*at(values), link, jax.tree.unflatten(trees[0], leaves))]

    observer = Traced(observed, thetas[0], [])
    links = [Traced(partial(predicted, link), thetas[0], observer.shapes) for link in actuator.links]

    def lane(theta: Array) -> tuple[Array, Array]:
        hidden = slopes_of(observer, theta, [], [], [])
        parts = [slopes_of(link, theta, *hidden) for link in links]
        blocks = [_block(slopes[0], reached[0], values[0]) for values, slopes, reached in parts]
        return jnp.concatenate([values[0] for values, *_ in parts]), jnp.concatenate(blocks, axis=1)

    if len(thetas) == 1:  # one level of batching less is traced and compiled in two thirds of the time
        return tuple(part[None] for part in lane(thetas[0]))  # pyright: ignore[reportReturnType]
    return jax.vmap(lane)(thetas)


SIDE_BY_SIDE = 80
"""Numbers predicted side by side, windows (padding included) times readings, from which derivatives are
computed apart from values in a program that serves many fits.

That takes twice as long to compile. Twelve tangents of 84 numbers (a joint in 28 windows) take 38 ms where
they took 98 ms. With 56 (a lifted mass in 28 windows) a diagnosis compiles 18 s instead of 9 s, two cores
counted both, and saves 1 s of runs.
"""


@KeptProgram
def values_and_chosen_slopes(
    theta: Float[Array, " values"],
    chosen: Int[Array, " width"],
    actuator: AbstractActuator,
    problem: Problem,
    paths: tuple[str, ...],
) -> tuple[Float[Array, " residuals"], Float[Array, "width residuals"]]:
    """Residuals at one set of values (SI) and their derivatives by some of the values.

    Which values is data, not structure: one compilation serves every choice among the paths of a machine.
    :func:`values_and_slopes`, compiled for one choice, leaves out tangents that cannot act and is the faster
    one to run.

    Args:
        chosen: positions of the values along which derivatives are taken; one behind the last value asks
            for none and gives zeros.
    """
    many = sum(w[:, 0].size for w in problem.weights.values()) >= SIDE_BY_SIDE
    stepping = Stepping(derivatives="linearised" if many else "forward")

    def residuals(values: Array) -> Array:
        return residual_vector(values, actuator, problem, paths, stepping)

    def pushed(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(residuals, (theta,), (direction,))

    directions = jax.nn.one_hot(chosen, len(paths), dtype=theta.dtype)
    return jax.vmap(pushed, out_axes=(None, 0))(directions)


def _block(slopes: Array | None, reached: NDArray[np.bool_], values: Array) -> Array:
    """Derivatives of one link by every value, zero by those that do not act on it."""
    block = jnp.zeros((len(reached), *values.shape))
    return block if slopes is None else block.at[np.flatnonzero(reached)].set(slopes)
