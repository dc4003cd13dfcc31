"""Gains tuned on a model, proved on a plant that the model is not: the one-page oracle of the joint, with an
effect that the card does not name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from blind_cards import UNCERTAIN
from blind_recordings import SUBSTEPS, Blind, drawn
from measured_rows import closed_on_plant, stable_on_plants
from numpy.typing import NDArray
from oracles.joint import joint  # pyright: ignore[reportMissingImports]
from published_rows import Row

import jaxmuscle as jm
from jaxmuscle.control import PID, feedback_on

STEP, SECONDS = 2e-3, 3.0
TIMES = np.arange(0, SECONDS, STEP)
MEAN, AMBIENT = 2.2e5, 101325.0
REST = {"pressure": np.full(2, AMBIENT + MEAN)}
RELAY, WIDTH = 1e5, 0.03
"""Pressure difference [Pa] and width [rad] of the relay experiment."""
NOISE = 4e-4
"""Standard deviation of the angle's sensor [rad]."""
SIZES = {"tracking": np.deg2rad(0.25), "variation": 5e6}
HIDDEN = {1: "gravity", 41: "load_friction"}
"""Seed of a recording → the effect that its card does not name."""
PAYLOADS = (1.0, 1.5, 2.0)
"""Inertia of the plant over that of the recording."""
DRAWN, SWING = 100, 0.05
"""Plants that are drawn around each, and how far one may be off where it should have come to rest [rad]."""
STRENGTHS = ("force", "torque", "static_coefficient", "kinetic_coefficient", "coefficient")
"""Parameters of effects that tell how much of one there is."""


def raised(amplitude: float, hertz: float) -> NDArray[np.float64]:
    """A wanted angle [rad] that rises from rest and falls back, again and again, smoothly."""
    return 0.5 * amplitude * (1 - np.cos(2 * np.pi * hertz * TIMES))


def risen(amplitude: float, seconds: float) -> NDArray[np.float64]:
    """One that rises so within some seconds, and stays."""
    return 0.5 * amplitude * (1 - np.cos(np.pi * np.minimum(TIMES / seconds, 1.0)))


PRACTICE = (raised(0.3, 0.5), risen(-0.25, 0.6))
UNSEEN = (raised(-0.4, 0.4), risen(0.35, 0.5))


class Plant(NamedTuple):
    """A machine of the oracle's with its effects, and the mean pressure at which it is run [Pa, gauge]."""

    machine: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]]
    mean: float


class Proved(NamedTuple):
    """What a controller does on the plant: root mean square error [rad] and effort [Pa], largest error."""

    tracking: float
    effort: float
    peak: float


def errors_on_plant(
    blind: Blind, controller: PID, wanted: NDArray[np.float64], plant: Plant, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One run of the oracle under a controller that sees its angle with noise: errors, commands."""
    bare = jm.actuator(blind.recording.card)
    loop = feedback_on(bare, controller, mean_pressure=plant.mean)
    update = jax.jit(lambda state, row, seen: loop.update(state, row, {"angle": seen}, jnp.asarray(STEP)))
    state, given = loop.start(), []
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(wanted))

    def answer(first: float, second: float, angle: float) -> list[float]:
        nonlocal state
        row = len(given)
        state, command = update(state, wanted[row], angle + noise[row])
        given.append(np.asarray(command).tolist())
        return given[-1]

    rest = np.full((len(wanted), 2), AMBIENT + plant.mean)
    machine, effects, substeps = plant.machine, plant.effects, SUBSTEPS["joint"]
    *_, angle, _ = joint(machine, effects, rest, STEP, rest[0], 0.0, substeps, answer)
    return wanted - angle, np.array(given) - rest


def on_plant(blind: Blind, controller: PID, wanted: NDArray[np.float64], payload: float, seed: int) -> Proved:
    """One run of the oracle as it is, but for a payload."""
    machine = {**blind.machine, "inertia": payload * blind.machine["inertia"]}
    error, effort = errors_on_plant(blind, controller, wanted, Plant(machine, blind.effects, MEAN), seed)
    tracking, spent = (float(np.sqrt(np.mean(x**2))) for x in (error, effort))
    return Proved(tracking, spent, float(np.abs(error).max()))


def drawn_plants(blind: Blind, seed: int, count: int) -> Iterator[Plant]:
    """Plants like that of a recording, from a seed of their own.

    What the card is unsure of is drawn anew by its standard deviations; the payload is up to as heavy
    again, the mean pressure, as from another supply, and every effect up to a fifth more or less.
    """
    random = np.random.default_rng(seed)
    stds = {name: std for name, std in UNCERTAIN["joint"].items() if name in blind.machine}
    for _ in range(count):
        machine = {n: x + stds.get(n, 0.0) * random.standard_normal() for n, x in blind.machine.items()}
        machine["inertia"] *= random.uniform(1.0, 2.0)
        grown = {name: random.uniform(0.8, 1.2) for name in blind.effects}
        effects = {
            name: {n: x * grown[name] if n in STRENGTHS else x for n, x in values.items()}
            for name, values in blind.effects.items()
        }
        yield Plant(machine, effects, MEAN * random.uniform(0.8, 1.2))


def unstable(blind: Blind, controller: PID, seed: int, count: int = DRAWN) -> int:
    """Plants of so many drawn ones that do not come to rest where the reference stays.

    The last second of a rise that takes half a second: an angle that is no number or off by more than
    :data:`SWING`.
    """
    late, found = TIMES > SECONDS - 1.0, 0
    for number, plant in enumerate(drawn_plants(blind, seed, count)):
        error, _ = errors_on_plant(blind, controller, UNSEEN[1], plant, number)
        found += not bool(np.abs(error[late]).max() <= SWING)  # what is no number is not below it
    return found


class Relay(eqx.Module):
    """One pressure difference or the other: it switches when the error has gone `width` beyond zero."""

    size: Any
    width: Any

    def start(self) -> Any:
        return jnp.ones(())

    def update(self, state: Any, wanted: Any, measured: Any, step: Any) -> tuple[Any, Any]:
        error = wanted - measured
        side = jnp.where(error > self.width, 1.0, jnp.where(error < -self.width, -1.0, state))
        return side, side * self.size


def by_rule(machine: Any) -> PID:
    """Gains by Ziegler and Nichols' rule (1942) after Åström and Hägglund's relay experiment (1984).

    A relay of size d and width w makes the joint swing with amplitude a and period T: ultimate gain
    4 d/(π √(a² - w²)). The gain is 0.6 of it, half of the period the time of the integral, an eighth that of
    the rate.
    """
    loop = feedback_on(machine, Relay(RELAY, WIDTH), mean_pressure=MEAN)
    run = jm.control.closed_loop(machine, loop, np.zeros(len(TIMES)), TIMES, start=REST)
    late = np.asarray(run.readings["angle"])[len(TIMES) // 3 :]
    swing = late - late.mean()
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    if len(up) < 3:
        raise RuntimeError(f"the joint does not swing under a relay of {RELAY:g} Pa and {WIDTH:g} rad")
    period, size = STEP * float(np.diff(up).mean()), np.ptp(late) / 2
    gain: Any = 0.6 * 4 * RELAY / (np.pi * np.sqrt(size**2 - WIDTH**2))
    kind: Any = PID
    return kind(gain, 2 * gain / period, gain * period / 8)


def tuned_on(machine: Any, begin: PID) -> jm.tuning.Tuning:
    """Gains tuned on a model with payloads."""
    inertia = float(machine.inertia)
    settings = {"start": REST, "noise": {"angle": NOISE}}
    practice = jm.tuning.grid(list(PRACTICE), TIMES, {"inertia": [inertia, 2 * inertia]}, **settings)
    loop = feedback_on(machine, begin, mean_pressure=MEAN)
    return jm.tune(machine, loop, practice, SIZES, worst=4)


def together(runs: Sequence[Proved]) -> Proved:
    """Root mean squares of several runs, and the largest error."""
    tracking, effort, peak = np.array(runs).T
    return Proved(float(np.sqrt(np.mean(tracking**2))), float(np.sqrt(np.mean(effort**2))), float(peak.max()))


def proved(blind: Blind, controllers: Mapping[str, PID]) -> dict[str, Proved]:
    """Every controller on unseen references and payloads."""
    runs = [(wanted, payload) for wanted in UNSEEN for payload in PAYLOADS]
    return {
        name: together([on_plant(blind, c, *run, seed) for seed, run in enumerate(runs)])
        for name, c in controllers.items()
    }


def plant_rows() -> Iterator[Row]:
    """Tracking errors on the plant: by the rule, tuned without the effect, and with what is found."""
    for seed, effect in HIDDEN.items():
        blind = drawn(seed, "joint", 1, False, [effect])
        diagnosis = jm.diagnose(blind.recording)
        without = jm.fit(jm.actuator(blind.recording.card), blind.recording).actuator
        rule = by_rule(without)
        tuned = {"left out": tuned_on(without, rule), "diagnosed": tuned_on(diagnosis.model, rule)}
        controllers = {"rule": rule, **{name: each.controller.controller for name, each in tuned.items()}}
        found = proved(blind, controllers)
        for name, each in found.items():
            gains = [float(getattr(controllers[name], gain)) for gain in PID.gains]
            print(
                f"    hidden {effect}, found {[e.name for e in diagnosis.effects]}; {name}: "
                f"{np.rad2deg(each.tracking):.3f} deg, largest {np.rad2deg(each.peak):.2f} deg, "
                f"{each.effort / 1e3:.1f} kPa; gains {gains[0]:.3g}, {gains[1]:.3g}, {gains[2]:.3g}"
            )
        yield from closed_on_plant(effect, {name: each._asdict() for name, each in found.items()})
        yield from stable_on_plants(effect, unstable(blind, controllers["diagnosed"], seed), DRAWN)
