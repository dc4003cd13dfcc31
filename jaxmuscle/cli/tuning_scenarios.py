"""Scenarios that a card makes: references, payloads, machines that it leaves open, noise of its sensors."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control import Reference
from jaxmuscle.errors import InputError
from jaxmuscle.formatting import quantity
from jaxmuscle.parameter_names import resolve
from jaxmuscle.parameters import Parameter, known_names
from jaxmuscle.recordings.card import Card
from jaxmuscle.tuning import Scenario
from jaxmuscle.units import Series

Machine = dict[str, float]
"""Path of a parameter → its value (SI), where a machine differs from that of the card."""


def machines(
    card: Card, actuator: AbstractActuator, count: int, seed: int
) -> tuple[list[Machine], list[Machine]]:
    """Two times `count` machines as the card's priors have them; none where it is sure of everything.

    Of positive quantities the logarithm is normal, with the standard deviation std/value.

    Raises:
        InputError: a negative count or seed.
    """
    for option, number in (("--draws", count), ("--seed", seed)):
        if number < 0:
            raise InputError(f"{option}: expected a number from 0 on; got {number}")
    known, random = known_names(actuator), np.random.default_rng(seed)
    unsure = {name: entry for name, entry in card.entries.items() if entry.std is not None}
    found: list[Machine] = []
    for _ in range(2 * count if unsure else 0):
        machine = {}
        for name, entry in unsure.items():
            place, normal = resolve(known, name, "card"), float(random.standard_normal())
            std = 0.0 if entry.std is None else entry.std
            logarithmic = (place.positive or place.nonnegative) and entry.value > 0
            grown = entry.value * math.exp(normal * std / entry.value) if logarithmic else entry.value
            machine[place.path] = grown if logarithmic else entry.value + normal * std
        found.append(machine)
    return found[:count], found[count:]


@dataclasses.dataclass(frozen=True)
class ScenarioMaker:
    """What scenarios of one card have in common.

    Attributes:
        step: sample time [s].
        begin: measured states at the first sample.
        payloads: name as it was written → parameter, its values (SI).
        rates: whether the controller follows rates of the reference too; differences from sample to sample.
    """

    actuator: AbstractActuator
    card: Card
    step: float
    begin: Mapping[str, Any]
    payloads: Mapping[str, tuple[Parameter, Series]]
    rates: bool = False

    def scenarios(
        self,
        references: Mapping[str, tuple[Series, Series]],
        machines: Sequence[Machine],
        seed: int,
        first: int = 0,
    ) -> list[Scenario]:
        """A scenario for every reference, every combination of payloads and every machine.

        Args:
            references: name → its clock and values, with a column for each joint of a robot.
            seed: of the noise of the first; it grows by one from one to the next.
            first: number by which the first of the machines is called.
        """
        values = ([(place, float(value)) for value in each] for place, each in self.payloads.values())
        loads = list(itertools.product(*values))
        every = itertools.product(references.items(), loads, enumerate(machines, first))
        return [
            self._scenario(name, *signal, load, draw, seed + number)
            for number, ((name, signal), load, draw) in enumerate(every)
        ]

    def _scenario(
        self,
        name: str,
        time: Series,
        wanted: Series,
        load: Sequence[tuple[Parameter, float]],
        draw: tuple[int, Machine],
        seed: int,
    ) -> Scenario:
        clock = np.arange(int((time[-1] - time[0]) / self.step + 1e-9) + 1) * self.step
        number, machine = draw
        sampled = np.apply_along_axis(lambda own: np.interp(clock, time - time[0], own), 0, wanted)
        told = [name, *(f"{place.name} {quantity(value, place.unit)}" for place, value in load)]
        told += [f"machine {number}"] if machine else []
        return Scenario(
            self._reference(sampled),
            clock,
            {**machine, **{place.path: value for place, value in load}},
            self.begin,
            self._noise(),
            seed=seed,
            name=", ".join(told),
        )

    def _reference(self, wanted: Series) -> Any:
        """What the controller is told of a reference."""
        if not self.rates:
            return wanted
        velocity = np.gradient(wanted, self.step, axis=0)
        told: Any = wanted, velocity, np.gradient(velocity, self.step, axis=0)
        return Reference(*told)

    def _noise(self) -> dict[str, float]:
        """Reading → standard deviation of its sensor, as the card has it; of several columns the largest."""
        own = {
            name: [self.card.noise[column] for column in columns if column in self.card.noise]
            for name, columns in self.actuator.outputs.items()
        }
        return {name: max(levels) for name, levels in own.items() if levels}
