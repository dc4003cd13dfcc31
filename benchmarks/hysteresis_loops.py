"""Asymmetric loops, and what the best fits of the classical and the modified model of [W] leave of them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import jaxmuscle  # noqa: F401  (double precision)
from jaxmuscle.hysteresis import (
    AbstractHysteresis,
    Envelope,
    ExponentialPrandtlIshlinskii,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    elbow_modified,
    respond,
)
from jaxmuscle.hysteresis.loop_fit import fit_loop, largest_relative_error
from jaxmuscle.parameters import parameters, replace

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles.relays import lopsided, way  # pyright: ignore[reportMissingImports]

Series = NDArray[np.float64]

LEG = 60
"""Samples of a way between two corners; the first leg, from the unused device on, does not count."""
NOISE = 0.001
"""Noise on the output, relative to its range: 0.09 degrees of 90."""
STARTS = 4
RELAY_SPAN = 1.2
"""The relays are driven from -1.2 to 1.2 of their own input."""


class Loop(NamedTuple):
    """A measured loop: input, noisy output, and the model that made it if it was one of ours."""

    name: str
    inputs: Series
    outputs: Series
    maker: ModifiedPrandtlIshlinskii | None


def corners(top: float) -> tuple[float, ...]:
    """The unused device, two rounds of the major loop, a minor one."""
    return (0.0, top, 0.0, top, 0.0, 0.7 * top, 0.3 * top, 0.7 * top, 0.0)


def loops() -> list[Loop]:
    """Loops of Table 2 read in several units of pressure, and one of relays that no model here made."""
    rng = np.random.default_rng(0)
    units = {"Table 2, input 0-0.6 (MPa)": 0.6, "Table 2, input 0-3": 3.0, "Table 2, input 0-6 (bar)": 6.0}
    found = []
    for name, top in units.items():
        inputs = way(corners(top), LEG)
        found.append(
            noisy(name, inputs, np.asarray(respond(elbow_modified(), inputs)[1]), rng, elbow_modified())
        )
    inputs = way(corners(6.0), LEG)
    return [*found, noisy("relays, 0-6 bar", inputs, Plant().move(inputs), rng, None)]


def noisy(name: str, inputs: Series, outputs: Series, rng: Any, maker: Any) -> Loop:
    return Loop(name, inputs, outputs + NOISE * np.ptp(outputs[LEG:]) * rng.normal(size=len(outputs)), maker)


class Plant:
    """Relays as an elbow: 0 to 6 bar in, 0 to 90 degrees out, from rest at 0."""

    def __init__(self) -> None:
        self.relays = lopsided()
        self.low, self.high = self.relays.outputs(np.array([-RELAY_SPAN, RELAY_SPAN]))
        self.state = np.full(len(self.relays.share), -1.0)
        self.move(np.zeros(1))

    def move(self, bar: Series) -> Series:
        """Angles along straight ways between pressures; the relays stay as they then are."""
        outputs = self.relays.outputs(RELAY_SPAN * (np.asarray(bar) / 3 - 1), self.state)
        return 90 * (outputs - self.low) / (self.high - self.low)


def classical_fits(loop: Loop) -> dict[str, AbstractHysteresis]:
    """The best fits of the classical model: with the exponential density of [W], and with free weights."""
    top, span = loop.inputs.max(), np.ptp(loop.outputs[LEG:])
    slope, low = span / top, loop.outputs[LEG:].min()
    exponential: Any = ExponentialPrandtlIshlinskii
    free: Any = PrandtlIshlinskii
    grid = ((0.5, 0.3, 2.0, 0.05), (0.8, 0.1, 0.5, 0.02), (0.3, 0.2, 6.0, 0.1), (-0.2, 0.6, 1.0, 0.03))
    starts = [exponential(a * slope, b * slope, c / top, d * top, low) for a, b, c, d in grid]
    weighted = [free(0.5 * slope, np.full(10, 0.05 * slope), np.linspace(0.04, 0.5, 10) * top, low)]
    families = {"classical, exponential": starts, "classical, free weights": weighted}
    return {name: _fit(family, loop) for name, family in families.items()}


def modified_fit(loop: Loop) -> AbstractHysteresis:
    """The best fit of the modified model, from starts that know the range of the loop but not its maker."""
    top, span = loop.inputs.max(), np.ptp(loop.outputs[LEG:])
    low = loop.outputs[LEG:].min()
    envelope: Any = Envelope
    kind: Any = ModifiedPrandtlIshlinskii
    starts = []
    for steep, decay in ((1.5, 1.0), (1.5, 4.0), (3.0, 2.0), (0.5, 2.0)):
        spacing = 0.1
        density = 1 / np.exp(-decay * spacing * np.arange(1, 11)).sum()
        for gap in (0.1, 0.3):
            sides = [envelope(0.5, steep / top, -0.5 * steep + s * gap, 0.5 + low / span) for s in (-1, 1)]
            starts.append(kind(*sides, span * density, decay, spacing, 0.1 * span / top, 0.0))
    return _fit(starts, loop)


def refit(loop: Loop) -> AbstractHysteresis:
    """The modified model refitted to a loop of its own, every parameter first put wrong by about 20 %."""
    assert loop.maker is not None
    rng = np.random.default_rng(1)
    values = {path: float(p.value) for path, p in parameters(loop.maker).items()}
    wrong = [{k: v * (1 + 0.2 * rng.normal()) for k, v in values.items()} for _ in range(STARTS)]
    return _fit([replace(loop.maker, w) for w in wrong], loop)


def _fit(starts: list[Any], loop: Loop) -> AbstractHysteresis:
    return fit_loop(starts, loop.inputs, loop.outputs, judged=slice(LEG, None)).model


def error(model: AbstractHysteresis, loop: Loop) -> float:
    """Largest error relative to the range of the output, the measure of [W]."""
    outputs = np.asarray(respond(model, loop.inputs)[1])
    return largest_relative_error(outputs[LEG:], loop.outputs[LEG:])


def fits(loop: Loop) -> dict[str, AbstractHysteresis]:
    found = classical_fits(loop)
    found["modified"] = modified_fit(loop) if loop.maker is None else refit(loop)
    return found
