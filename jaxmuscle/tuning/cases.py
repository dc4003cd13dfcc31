"""Scenarios as arrays, side by side: checked beside the machine, of one length, with their noise."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.channel_model import ChannelModel
from jaxmuscle.control.feedback import Attached
from jaxmuscle.control.loop import Controller
from jaxmuscle.control.quantisation import quantised
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.control.stability_margins import machine_response
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameter_names import resolve
from jaxmuscle.parameters import get, known_names, replace, split_index
from jaxmuscle.simulation.track import sampling_step
from jaxmuscle.tuning.scenarios import Scenario


class Told(NamedTuple):
    """What a sensed controller is told at a sample: the reference, and the noise of each reading."""

    reference: Any
    noise: dict[str, Array]


class Sensed(eqx.Module):
    """A controller that sees readings with noise, rounded to what their sensors resolve.

    Rounding lets derivatives pass as if there were none: its own slope is zero almost everywhere.
    """

    controller: Controller
    resolution: dict[str, Float[Array, ""]]

    def start(self) -> Any:
        """The controller's own."""
        return self.controller.start()

    def update(
        self, state: Any, wanted: Told, readings: dict[str, Array], step: Float[Array, ""]
    ) -> tuple[Any, Any]:
        """The state after a sample of `step` seconds, and the command until the next."""
        shown = {name: value + wanted.noise.get(name, 0.0) for name, value in readings.items()}
        shown |= {name: quantised(shown[name], size) for name, size in self.resolution.items()}
        return self.controller.update(state, wanted.reference, shown, step)


class Linearised(NamedTuple):
    """A machine as its control channel sees it about rest: response at frequencies, reading at rest."""

    response: Array
    rest: Array


class Case(eqx.Module):
    """Scenarios as arrays, of one length; with a leading axis, many of them.

    Attributes:
        changes: path → value; start: state → value.
        told: reference and noise, one row a sample.
        resolution: reading → step of its sensor; 0 for none.
        counts: which samples count: a shorter scenario goes on at its last reference, and does not.
        linear: the machine linearised, where the objective asks for the margin of the loop.
    """

    changes: dict[str, Array]
    start: dict[str, Array]
    told: Told
    resolution: dict[str, Array]
    counts: Bool[Array, "... samples"]
    linear: Linearised | None = None


@dataclasses.dataclass(frozen=True)
class Stacked:
    """Scenarios of one tuning side by side: what they are called, their cases, step [s] and samples.

    `models`: each scenario's machine linearised, where the objective asks for the margin of the loop.
    """

    names: tuple[str, ...]
    cases: Case
    step: float
    samples: int
    models: tuple[ChannelModel, ...] = ()

    def blocks(self, rows: Sequence[int], size: int) -> Iterator[tuple[Case, int]]:
        """Cases of some scenarios in blocks of one size, and how many are in each; the last one repeats."""
        for first in range(0, len(rows), size):
            own = list(rows[first : first + size])
            yield self._taken(np.array(own + own[-1:] * (size - len(own)))), len(own)

    def linearised(self, actuator: AbstractActuator, attached: Attached) -> Stacked:
        """The same with each scenario's machine linearised at rest under an output of zero."""
        changes, many = self.cases.changes, len(self.names)
        machines = [replace(actuator, {p: v[i] for p, v in changes.items()}) for i in range(many)]
        found = [machine_response(m, self.step, attached.on(actuator, m)) for m in machines]
        rest = jnp.array([model.rest for model, _ in found])
        linear = Linearised(jnp.asarray(np.stack([response for _, response in found])), rest)
        cases = dataclasses.replace(self.cases, linear=linear)
        return dataclasses.replace(self, cases=cases, models=tuple(model for model, _ in found))

    def _taken(self, rows: NDArray[np.int64]) -> Case:
        return jax.tree.map(lambda leaf: leaf[rows], self.cases)


def stacked(
    actuator: AbstractActuator, scenarios: Sequence[Scenario], reading: str | None, where: Sequence[str]
) -> Stacked:
    """All scenarios as arrays of one length.

    Args:
        reading: what follows the reference; `None` where that is not known.
        where: what messages call each scenario.

    Raises:
        InputError: scenarios with different steps, an unknown parameter, reading or start, a reference of
            the wrong length, with values that are not finite, or beyond where the machine ends.
    """
    steps = [_step(scenario, place) for scenario, place in zip(scenarios, where, strict=True)]
    if max(steps) - min(steps) > 1e-6 * steps[0]:
        raise InputError(
            f"scenarios: expected one sampling step for all; got {min(steps):g} to {max(steps):g} s"
        )
    samples = max(len(scenario.clock) for scenario in scenarios)
    changed = [_changes(actuator, scenario, place) for scenario, place in zip(scenarios, where, strict=True)]
    paths = list(dict.fromkeys(path for changes in changed for path in changes))
    changes = {path: _column([c.get(path, get(actuator, path)) for c in changed]) for path in paths}
    machines = [replace(actuator, own) for own in changed]
    references = [_reference(s, place) for s, place in zip(scenarios, where, strict=True)]
    forms = [jax.tree.structure(reference) for reference in references]
    if len(set(forms)) > 1:
        raise InputError("scenarios: expected references of one kind, all arrays or all control.Reference")
    for machine, reference, place in zip(machines, references, where, strict=True):
        _check_reach(machine, reference, reading, place)
    held = [jax.tree.map(lambda leaf: _lengthened(leaf, samples), reference) for reference in references]
    counts = [np.arange(samples) < len(scenario.clock) for scenario in scenarios]
    told = Told(_stack(held), _noise(actuator, scenarios, samples, where))
    cases = Case(
        changes,
        _starts(machines, scenarios),
        told,
        _resolutions(actuator, scenarios, where),
        jnp.asarray(np.stack(counts)),
    )
    names = tuple(s.name or str(number) for number, s in enumerate(scenarios))
    return Stacked(names, cases, steps[0], samples)


def _step(scenario: Scenario, where: str) -> float:
    try:
        return sampling_step(scenario.clock)
    except ValueError as error:
        raise InputError(f"{where}: times: {error}") from error


def _changes(actuator: AbstractActuator, scenario: Scenario, where: str) -> dict[str, float]:
    """Path → value of the parameters that a scenario changes."""
    known, found = known_names(actuator), {}
    for name, value in scenario.changes.items():
        place = resolve(known, name, f"{where}: changes")
        if isinstance(value, str) or not (np.ndim(value) == 0 and math.isfinite(float(value))):
            unit = place.unit or "1"
            raise InputError(f"{where}: changes[{name!r}]: expected a number in SI [{unit}]; got {value!r}")
        signed = place.positive or place.nonnegative
        if (signed and float(value) < 0) or (place.positive and float(value) == 0):
            least = "above zero" if place.positive else "zero or above"
            raise InputError(f"{where}: changes[{name!r}]: expected a value {least}; got {value:g}")
        found[place.path] = float(value)
    return found


def _reference(scenario: Scenario, where: str) -> Any:
    """The reference as a tree of arrays of the scenario's length."""
    given, clock = scenario.reference, scenario.clock
    if callable(given):
        given = jax.vmap(given)(jnp.asarray(clock))
    try:
        as_listed = type(given) in (list, tuple)
        reference = np.asarray(given, dtype=float) if as_listed else jax.tree.map(_floats, given)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: expected a reference of numbers, one row for each instant: {error}"
        ) from error
    for leaf in jax.tree.leaves(reference):
        if leaf.shape[:1] != clock.shape:
            raise InputError(
                f"{where}: expected a reference with one row for each of its {len(clock)} instants; got "
                f"shape {leaf.shape}"
            )
        if not np.isfinite(leaf).all():
            row = int(np.argwhere(~np.isfinite(leaf))[0][0])
            raise InputError(f"{where}: expected a reference of finite numbers; got {leaf[row]} in row {row}")
    return reference


def _floats(leaf: Any) -> NDArray[np.float64]:
    return np.asarray(leaf, dtype=float)


def _check_reach(machine: AbstractActuator, reference: Any, reading: str | None, where: str) -> None:
    """Raise `InputError` for a reference beyond where the machine ends."""
    target = target_of(reference)
    if reading is None or not isinstance(target, np.ndarray):
        return
    for state, (lowest, highest) in machine.stops.items():
        if machine.measured.get(state) != machine.outputs[reading]:
            continue
        low, high = np.broadcast_arrays(np.asarray(lowest), np.asarray(highest))
        beyond = (target < low) | (target > high)
        if beyond.any():
            row = int(np.argwhere(beyond)[0][0])
            unit = machine.column(machine.outputs[reading][0]).unit
            raise InputError(
                f"{where}: expected a reference within what the {reading} can reach, "
                f"{np.min(low):.4g} to {np.max(high):.4g} {unit}; got {np.ravel(target[row])[0]:.4g} in row "
                f"{row}"
            )


def _lengthened(values: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Values that go on at the last one."""
    return values[np.minimum(np.arange(samples), len(values) - 1)]


def _starts(machines: Sequence[AbstractActuator], scenarios: Sequence[Scenario]) -> dict[str, Array]:
    """State → values at the first sample; where a scenario gives none, those at rest."""
    names = dict.fromkeys(name for scenario in scenarios for name in scenario.start)

    def first(machine: AbstractActuator, scenario: Scenario, path: str) -> Any:
        if path in scenario.start:
            return scenario.start[path]
        name, index = split_index(path)
        if name not in machine.states:
            raise InputError(f"start: unknown state {name!r}{nearest(name, machine.states)}")
        return machine.at_rest(name)[index or ()]

    pairs = list(zip(machines, scenarios, strict=True))
    return {name: _column([first(machine, s, name) for machine, s in pairs]) for name in names}


def _noise(
    actuator: AbstractActuator, scenarios: Sequence[Scenario], samples: int, where: Sequence[str]
) -> dict[str, Array]:
    """Reading → noise of each scenario; the same numbers for the same seed, whatever else there is."""
    sizes = _of_readings(actuator, [s.noise for s in scenarios], [f"{place}: noise" for place in where])
    found = {}
    for name, std in sizes.items():
        width = actuator.outputs[name]
        shape = (samples, *((len(width),) if len(width) > 1 else ()))
        place = list(actuator.outputs).index(name)
        rows = [np.random.default_rng([s.seed, place]).standard_normal(shape) for s in scenarios]
        found[name] = jnp.asarray(np.stack([size * row for size, row in zip(std, rows, strict=True)]))
    return found


def _resolutions(
    actuator: AbstractActuator, scenarios: Sequence[Scenario], where: Sequence[str]
) -> dict[str, Array]:
    given = [s.resolution for s in scenarios]
    sizes = _of_readings(actuator, given, [f"{place}: resolution" for place in where])
    return {name: _column(values) for name, values in sizes.items()}


def _of_readings(
    actuator: AbstractActuator, given: Sequence[Mapping[str, float]], where: Sequence[str]
) -> dict[str, list[float]]:
    """Reading → its number in each scenario, 0 where there is none."""
    for numbers, place in zip(given, where, strict=True):
        for name, value in numbers.items():
            if name not in actuator.outputs:
                raise InputError(f"{place}: unknown reading {name!r}{nearest(name, actuator.outputs)}")
            if not (np.ndim(value) == 0 and 0 <= float(value) < math.inf):
                raise InputError(f"{place}[{name!r}]: expected a number of zero or above (SI); got {value!r}")
    names = dict.fromkeys(name for numbers in given for name in numbers)
    return {name: [float(numbers.get(name, 0.0)) for numbers in given] for name in names}


def _column(values: Sequence[Any]) -> Array:
    """A value for each scenario, one below the other."""
    arrays = [np.asarray(value, dtype=float) for value in values]
    return jnp.asarray(np.stack(np.broadcast_arrays(*arrays)))


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *trees)
