"""Minor loops of relays: Frame's rule, the mid-line and play operators beside what the relays do."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jaxmuscle  # noqa: F401  (double precision)
from jaxmuscle.hysteresis import (
    AbstractHysteresis,
    Envelope,
    FrameRule,
    GeneralizedPrandtlIshlinskii,
    ModifiedPrandtlIshlinskii,
    PrandtlIshlinskii,
    midline,
    respond,
)
from jaxmuscle.hysteresis.loop_fit import fit_loop

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles.relays import Relays, way  # pyright: ignore[reportMissingImports]

Series = NDArray[np.float64]

END = 1.6
"""The major loop goes from -1.6 to 1.6."""
MAJOR = (-END, END, -END)
TRAINING = (0.5, -0.4, 0.5, -END)
"""The one minor loop that the fits see, from the rising half."""
JUDGED = {
    "first order": (END, -0.5, 0.5, -0.5),
    "spiral": (1.0, -0.9, 0.7, -0.6, 0.4, -0.3, 0.2, -0.1, 0.05),
    "biased": (0.9, 0.6, 0.85, 0.55, 1.0),
    "random": tuple(np.random.default_rng(7).uniform(-1.1, 1.1, 10)),
}
LEG = 60
OPERATORS = 12


def frame_of(relays: Relays) -> FrameRule:
    """Frame's rule with the relays' own major loop."""
    samples = 240
    outputs = relays.outputs(way((-END, END, -END, END, -END), samples))
    rising, falling = outputs[2 * samples : 3 * samples + 1], outputs[3 * samples :][::-1]
    kind: Any = FrameRule
    return kind(np.linspace(-END, END, samples + 1), rising, falling)


def starts() -> dict[str, list[AbstractHysteresis]]:
    envelope: Any = Envelope
    classical: Any = PrandtlIshlinskii
    modified: Any = ModifiedPrandtlIshlinskii
    generalized: Any = GeneralizedPrandtlIshlinskii
    apart = [envelope(1.0, 1.0, s * 0.1) for s in (-1, 1)]
    alike = [envelope(1.0, 1.5)] * 2
    radii, even = np.linspace(0.03, 0.9, OPERATORS), np.full(OPERATORS, 1 / OPERATORS)
    falling = np.exp(-radii / 0.1) / np.exp(-radii / 0.1).sum()
    return {
        "classical": [classical(0.3, 0.5 * even, radii)],
        "modified [W]": [
            modified(*apart, 1 / 3, 3.0, 0.08, 0.1, 0.0, OPERATORS),
            modified(*alike, 2 / 3, 9.0, 0.03, 0.1, 0.0, OPERATORS),
        ],
        "generalized": [generalized(*apart, even, radii), generalized(*alike, falling, radii / 3)],
    }


def fitted(relays: Relays) -> dict[str, AbstractHysteresis]:
    """Prandtl-Ishlinskii models fitted to the major loop and one minor loop."""
    inputs = way((0.0, *MAJOR, END, -END, *TRAINING), LEG)
    outputs = relays.outputs(inputs)
    late = slice(1 + LEG, None)
    return {name: fit_loop(family, inputs, outputs, judged=late).model for name, family in starts().items()}


def errors(relays: Relays) -> dict[str, dict[str, float]]:
    """Root mean square errors over the judged loops, relative to the range of the major loop."""
    frame, models = frame_of(relays), fitted(relays)
    extent = float(frame.rising[-1] - frame.rising[0])
    left: dict[str, dict[str, Series]] = {}
    for loop, corners in JUDGED.items():
        inputs = way((0.0, *MAJOR, *corners), LEG)
        late = slice(1 + 3 * LEG, None)
        truth = relays.outputs(inputs)[late]
        ways = {name: np.asarray(respond(model, inputs)[1])[late] for name, model in models.items()}
        saturated = way((*MAJOR, *corners), LEG)
        ways["Frame"] = np.asarray(respond(frame, saturated)[1])[1 + 2 * LEG :]
        ways["mid-line"] = np.asarray(midline(frame, inputs))[late]
        for name, outputs in ways.items():
            left.setdefault(name, {})[loop] = (outputs - truth) / extent
    return {
        name: {
            **{loop: rms(part) for loop, part in parts.items()},
            "all": rms(np.concatenate([*parts.values()])),
        }
        for name, parts in left.items()
    }


def rms(values: Series) -> float:
    return float(np.sqrt(np.mean(values**2)))
