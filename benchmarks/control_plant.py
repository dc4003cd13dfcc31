"""Gains tuned on a model, proved on a plant that the model is not: the oracle of a rig, with an effect that
the card does not name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from blind_cards import UNCERTAIN
from blind_recordings import Blind, drawn
from measured_rows import closed_on_plant, stable_on_plants
from numpy.typing import NDArray
from published_rows import Row

import jaxmuscle as jm
from jaxmuscle.control import PID, feedback_on

Series = NDArray[np.float64]
Gains = Mapping[str, float]
Constants = Mapping[str, float]
Effects = Mapping[str, Mapping[str, float]]
DRAWN = 100
"""Plants that are drawn around each."""
STRENGTHS = ("force", "torque", "static_coefficient", "kinetic_coefficient", "coefficient", "area")
"""Parameters of effects that tell how much of one there is."""


class Begun(NamedTuple):
    """A controller that is to be tuned, at which gains (or how many) descents begin, and which are free."""

    controller: Any
    starts: int | Sequence[Gains] = 8
    free: Sequence[str] | None = None


class Plant(NamedTuple):
    """A machine of the oracle's with its effects, and the settings with which a controller is put on it."""

    machine: Constants
    effects: Effects
    settings: Constants


@dataclasses.dataclass(frozen=True)
class Loop:
    """A rig in closed loop: what is followed, on which machines it is tuned and proved.

    Attributes:
        rig, reading, times [s]: the loop.
        settings: with which a controller is put on the rig; start: measured states at rest.
        noise: standard deviation of the sensor (SI).
        sizes: term of the objective → the size of it that costs one.
        relay: size (command) and width (reading) of the relay experiment, and the reading about which it is
            made.
        unit: of the reading as it is printed, and its size in SI; of the effort the same.
        practice, unseen: references (SI); the last of those unseen rises and stays.
        swing: how far a plant may be off where it should have come to rest.
        hidden: seed of a recording → the effect that its card does not name.
        factors: constant of the machine → by how much it is multiplied in practice; unseen: by how much in
            the runs that prove; drawn: between which two factors in drawn plants.
        run: oracle under a controller: (plant, loop, answer) → readings, answer being reading → commands.
        kind: what is tuned, in words; begun: (loop, model, PID by rule) → it before it is tuned, in several
            forms; the one that costs least on the model is taken.
    """

    rig: str
    reading: str
    times: Series
    settings: Constants
    start: Mapping[str, Any]
    noise: float
    sizes: Mapping[str, float]
    relay: tuple[float, float, float]
    unit: tuple[str, float, str, float]
    practice: Sequence[Series]
    unseen: Sequence[Series]
    swing: float
    hidden: Mapping[int, str]
    factors: Mapping[str, Sequence[float]]
    unseen_factors: Sequence[Constants]
    drawn_factors: Mapping[str, tuple[float, float]]
    run: Callable[[Plant, Loop, Callable[[float], Any]], Series]
    kind: str = "PID"
    begun: Callable[[Loop, Any, PID], Sequence[Begun]] = lambda loop, machine, rule: [Begun(rule)]

    @property
    def step(self) -> float:
        """Of the loop [s]."""
        return float(self.times[1])


class Proved(NamedTuple):
    """What a controller does on plants: root mean square error and effort, largest error, root mean square
    rate of the command (SI).
    """

    tracking: float
    effort: float
    peak: float
    variation: float


def errors_on_plant(
    loop: Loop, blind: Blind, controller: PID, wanted: Series, plant: Plant, seed: int
) -> tuple[Series, Series]:
    """One run of the oracle under a controller that sees its reading with noise: errors, commands."""
    bare = jm.actuator(blind.recording.card)
    attached, step = feedback_on(bare, controller, **plant.settings), jnp.asarray(loop.step)
    update = jax.jit(lambda state, row, seen: attached.update(state, row, {loop.reading: seen}, step))
    state, given = attached.start(), []
    noise = loop.noise * np.random.default_rng(seed).standard_normal(len(wanted))

    def answer(reading: float) -> Any:
        nonlocal state
        row = len(given)
        state, command = update(state, wanted[row], reading + noise[row])
        given.append(np.asarray(command).tolist())
        return given[-1]

    shown = loop.run(plant, loop, answer)
    return wanted - shown, np.array(given) - np.asarray(attached.rest)


def on_plant(
    loop: Loop, blind: Blind, controller: PID, wanted: Series, factors: Constants, seed: int
) -> Proved:
    """One run of the oracle as it is, but for some constants."""
    machine = {name: value * factors.get(name, 1.0) for name, value in blind.machine.items()}
    plant = Plant(machine, blind.effects, loop.settings)
    error, effort = errors_on_plant(loop, blind, controller, wanted, plant, seed)
    tracking, spent = (float(np.sqrt(np.mean(x**2))) for x in (error, effort))
    rate = float(np.sqrt(np.mean((np.diff(effort, axis=0) / loop.step) ** 2)))
    return Proved(tracking, spent, float(np.abs(error).max()), rate)


def drawn_plants(loop: Loop, blind: Blind, seed: int, count: int) -> Iterator[Plant]:
    """Plants like that of a recording, from a seed of their own.

    What the card is unsure of is drawn anew by its standard deviations; payload and supply, or mean
    pressure, within their factors, and every effect up to a fifth more or less.
    """
    random = np.random.default_rng(seed)
    stds = {name: std for name, std in UNCERTAIN[loop.rig].items() if name in blind.machine}
    for _ in range(count):
        machine = {n: x + stds.get(n, 0.0) * random.standard_normal() for n, x in blind.machine.items()}
        by = {name: random.uniform(*ends) for name, ends in loop.drawn_factors.items()}
        machine = {name: value * by.get(name, 1.0) for name, value in machine.items()}
        grown = {name: random.uniform(0.8, 1.2) for name in blind.effects}
        effects = {
            name: {n: x * grown[name] if n in STRENGTHS else x for n, x in values.items()}
            for name, values in blind.effects.items()
        }
        settings = {name: value * by.get(name, 1.0) for name, value in loop.settings.items()}
        yield Plant(machine, effects, settings)


def unstable(loop: Loop, blind: Blind, controller: PID, seed: int, count: int = DRAWN) -> int:
    """Plants of so many drawn ones that do not come to rest where the reference stays.

    The last second of a rise that is over before: a reading that is no number or off by more than the
    loop's `swing`.
    """
    late, found = loop.times > loop.times[-1] - 1.0, 0
    for number, plant in enumerate(drawn_plants(loop, blind, seed, count)):
        error, _ = errors_on_plant(loop, blind, controller, loop.unseen[-1], plant, number)
        found += not bool(np.abs(error[late]).max() <= loop.swing)  # what is no number is not below it
    return found


class Relay(eqx.Module):
    """One output or the other: it switches when the error has gone `width` beyond zero."""

    size: Any
    width: Any

    def start(self) -> Any:
        return jnp.ones(())

    def update(self, state: Any, wanted: Any, measured: Any, step: Any) -> tuple[Any, Any]:
        error = wanted - measured
        side = jnp.where(error > self.width, 1.0, jnp.where(error < -self.width, -1.0, state))
        return side, side * self.size


def by_rule(loop: Loop, machine: Any) -> PID:
    """Gains by Ziegler and Nichols' rule (1942) after Åström and Hägglund's relay experiment (1984).

    A relay of size d and width w makes the machine swing with amplitude a and period T: ultimate gain
    4 d/(π √(a² - w²)). The gain is 0.6 of it, half of the period the time of the integral, an eighth that of
    the rate.
    """
    large, width, about = loop.relay
    relay = feedback_on(machine, Relay(large, width), **loop.settings)
    wanted = np.full(len(loop.times), about)
    run = jm.control.closed_loop(machine, relay, wanted, loop.times, start=loop.start)
    late = np.asarray(run.readings[loop.reading])[len(loop.times) // 3 :] - about
    swing = late - late.mean()
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    if len(up) < 3:
        raise RuntimeError(f"the {loop.rig} does not swing under a relay of {large:g} and {width:g}")
    period, size = loop.step * float(np.diff(up).mean()), np.ptp(late) / 2
    gain: Any = 0.6 * 4 * large / (np.pi * np.sqrt(size**2 - width**2))
    kind: Any = PID
    return kind(gain, 2 * gain / period, gain * period / 8)


def tuned_on(loop: Loop, machine: Any, rule: PID) -> jm.tuning.Tuning:
    """Gains tuned on a model with payloads, and supply pressures where it has a supply; in the form that
    costs least on it.
    """
    over = {
        name: [float(jm.parameters.get(machine, name)) * by for by in factors]
        for name, factors in loop.factors.items()
    }
    settings = {"start": loop.start, "noise": {loop.reading: loop.noise}}
    practice = jm.tuning.grid(list(loop.practice), loop.times, over, **settings)
    found = []
    for controller, starts, free in loop.begun(loop, machine, rule):
        attached = feedback_on(machine, controller, **loop.settings)
        found.append(jm.tune(machine, attached, practice, loop.sizes, worst=4, starts=starts, free=free))
    return min(found, key=lambda tuning: tuning.after.cost)


def together(runs: Sequence[Proved]) -> Proved:
    """Root mean squares of several runs, and the largest error."""
    tracking, effort, peak, rate = np.array(runs).T
    middle = [float(np.sqrt(np.mean(each**2))) for each in (tracking, effort, rate)]
    return Proved(middle[0], middle[1], float(peak.max()), middle[2])


def proved(loop: Loop, blind: Blind, controllers: Mapping[str, PID]) -> dict[str, Proved]:
    """Every controller on unseen references, payloads and supplies."""
    runs = [(wanted, factors) for wanted in loop.unseen for factors in loop.unseen_factors]
    return {
        name: together([on_plant(loop, blind, c, *run, seed) for seed, run in enumerate(runs)])
        for name, c in controllers.items()
    }


def plant_rows(loop: Loop) -> Iterator[Row]:
    """Tracking errors on the plant: by the rule, tuned without the effect, and with what is found."""
    unit, size, spent, large = loop.unit
    for seed, effect in loop.hidden.items():
        blind = drawn(seed, loop.rig, 1, False, [effect])
        diagnosis = jm.diagnose(blind.recording)
        without = jm.fit(jm.actuator(blind.recording.card), blind.recording).actuator
        rule = by_rule(loop, without)
        tuned = {
            "left out": tuned_on(loop, without, rule),
            "diagnosed": tuned_on(loop, diagnosis.model, rule),
        }
        controllers = {"rule": rule, **{name: each.controller.controller for name, each in tuned.items()}}
        found = proved(loop, blind, controllers)
        gains = {name: ", ".join(f"{each.values[n]:.3g}" for n in each.gains) for name, each in tuned.items()}
        gains["rule"] = ", ".join(f"{float(getattr(rule, gain)):.3g}" for gain in PID.gains)
        for name, each in found.items():
            print(
                f"    {loop.rig}, hidden {effect}, found {[e.name for e in diagnosis.effects]}; {name} "
                f"({'PID' if name == 'rule' else loop.kind}): {each.tracking / size:.3f} {unit}, largest "
                f"{each.peak / size:.2f} {unit}, {each.effort / large:.3g} {spent}, "
                f"{each.variation / large:.3g} {spent}/s; gains {gains[name]}",
                flush=True,
            )
        yield from closed_on_plant(loop.rig, effect, {name: each._asdict() for name, each in found.items()})
        swinging = unstable(loop, blind, controllers["diagnosed"], seed)
        yield from stable_on_plants(loop.rig, effect, swinging, DRAWN)
