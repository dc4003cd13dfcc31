"""Scenarios of a tuning: what is followed, by which machine, seen by which sensors; and many at once."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.sliding_mode import Reference
from jaxmuscle.effects import CommandDelay
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.fit_data import FitData
from jaxmuscle.parameter_names import of_machine, resolve
from jaxmuscle.parameters import get, known_names


@dataclasses.dataclass(frozen=True)
class Scenario:
    """One run in closed loop: a reference, the machine that is to follow it and what its sensors add.

    Attributes:
        reference: what the controller gets as `wanted`: an array or a :class:`~jaxmuscle.control.Reference`,
            one row a sample; or a function of time [s], such as ``jaxmuscle.commands.Sine(…)``.
        times: sampling instants [s], uniform; all scenarios of a tuning have the same step.
        changes: parameter of the machine → its value here (SI), by path or card name: "inertia",
            "load_friction.force", "command_delay.delay" of a machine that has the effect; the others stay
            as they are.
        start: measured states at the first sample, as for :func:`jaxmuscle.simulate`.
        noise: reading → standard deviation of white noise that the controller sees on it (SI).
        resolution: reading → step to which the controller sees it rounded (SI).
        delay: time that passes from a sample to the command that it leads to [s], beside that of the machine.
        seed: of the noise.
        name: what results call it; its number when empty.
    """

    reference: Any
    times: ArrayLike
    changes: Mapping[str, float] = dataclasses.field(default_factory=dict)
    start: Mapping[str, ArrayLike] = dataclasses.field(default_factory=dict)
    noise: Mapping[str, float] = dataclasses.field(default_factory=dict)
    resolution: Mapping[str, float] = dataclasses.field(default_factory=dict)
    delay: float = 0.0
    seed: int = 0
    name: str = ""

    @property
    def clock(self) -> NDArray[np.float64]:
        """The sampling instants as an array."""
        return np.asarray(self.times, dtype=float)


def grid(
    references: Any, times: ArrayLike, over: Mapping[str, Sequence[float]] | None = None, **settings: Any
) -> list[Scenario]:
    """A scenario for every reference and every combination of values of parameters.

    Args:
        references: one, or a list of them.
        times: sampling instants [s].
        over: parameter of the machine → its values (SI).
        settings: `start`, `noise`, `resolution`, `delay` and `seed` of all; the seed grows by one from one
            to the next.
    """
    values = dict(over or {})
    points = [dict(zip(values, point, strict=True)) for point in itertools.product(*values.values())]
    pairs = list(itertools.product(_listed(references), points))
    return _numbered(pairs, times, settings)


def drawn(
    references: Any, times: ArrayLike, draws: Sequence[Mapping[str, float]], **settings: Any
) -> list[Scenario]:
    """A scenario for every draw of parameters, the references taken in turn; arguments as :func:`grid`.

    `draws`: such as :func:`sample` gives.
    """
    return _numbered(list(zip(itertools.cycle(_listed(references)), draws, strict=False)), times, settings)


def sample(fit: FitData, count: int, seed: int = 0) -> list[dict[str, float]]:
    """Draws of the fitted parameters of a machine from their covariance, path → value (SI).

    Normal; of positive parameters the logarithm is, with the standard deviation std/value. What falls beyond
    a bound of the fit is set to it. Parameters without a finite standard deviation keep their values.
    """
    own = [name for name, fitted in fit.parameters.items() if of_machine(fitted.path)]
    fitted = [fit.parameters[name] for name in own]
    values = np.array([each.value for each in fitted])
    logarithmic = np.array([each.positive for each in fitted], dtype=bool)
    std = np.array([each.std if math.isfinite(each.std) else 0.0 for each in fitted])
    size = np.where(logarithmic, std / np.where(logarithmic, values, 1.0), std)
    inner = [name if name in fit.correlations.index else None for name in own]
    correlation = np.eye(len(own))
    for (i, a), (j, b) in itertools.product(enumerate(inner), repeat=2):
        if i != j and a is not None and b is not None:
            found = float(fit.correlations.loc[a, b])  # pyright: ignore[reportArgumentType]
            correlation[i, j] = found if math.isfinite(found) else 0.0
    # By its eigenvalues: what data hardly tell apart is correlated to the last digit.
    spread, axes = np.linalg.eigh(correlation)
    normal = np.random.default_rng(seed).standard_normal((count, len(own)))
    moves = size * (normal @ (axes * np.sqrt(np.maximum(spread, 0.0))).T)
    drawn = np.where(logarithmic, values * np.exp(np.where(logarithmic, moves, 0.0)), values + moves)
    within = np.clip(drawn, [each.lower for each in fitted], [each.upper for each in fitted])
    paths = [each.path for each in fitted]
    return [dict(zip(paths, row.tolist(), strict=True)) for row in within]


def with_delays(
    actuator: AbstractActuator, scenarios: Sequence[Scenario], where: Sequence[str]
) -> tuple[AbstractActuator, list[Scenario]]:
    """Scenarios whose delays are those of the machine's command, and a machine that has such a delay.

    Raises:
        InputError: a delay that is no time, or on a rig whose commands cannot be late.
    """
    for scenario, place in zip(scenarios, where, strict=True):
        if isinstance(scenario.delay, str) or not 0 <= float(scenario.delay) < math.inf:
            raise InputError(f"{place}: delay: expected a time of zero or above [s]; got {scenario.delay!r}")
    if not any(scenario.delay for scenario in scenarios):
        return actuator, list(scenarios)
    if not actuator.offers(CommandDelay):
        raise InputError(f"{where[0]}: delay: the commands of rig {actuator.rig!r} cannot be late")
    if CommandDelay.name not in actuator.effects:
        none: Any = 0.0
        actuator = actuator.with_effects(command_delay=CommandDelay(none))
    path, known = f"effects.{CommandDelay.name}.delay", known_names(actuator)
    own, made = float(get(actuator, path)), []
    for scenario, place in zip(scenarios, where, strict=True):
        changes = {resolve(known, name, f"{place}: changes").path: v for name, v in scenario.changes.items()}
        changes[path] = changes.get(path, own) + scenario.delay
        made.append(dataclasses.replace(scenario, changes=changes, delay=0.0))
    return actuator, made


def _listed(references: Any) -> Sequence[Any]:
    """Several references, or one, as a list; a list of numbers is one reference."""
    if not isinstance(references, list | tuple) or isinstance(references, Reference) or not references:
        return [references]
    return [references] if isinstance(references[0], Real) else references


def _numbered(pairs: Sequence[tuple[Any, Mapping[str, float]]], times: Any, settings: Any) -> list[Scenario]:
    seed = settings.pop("seed", 0)
    return [
        Scenario(reference, times, changes, seed=seed + number, **settings)
        for number, (reference, changes) in enumerate(pairs)
    ]
