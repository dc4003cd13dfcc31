"""How far an effect moves the readings, beyond what the uncertain parameters of a card can take over."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Series = NDArray[np.float64]
FARTHEST = 3.0
"""Standard deviations that a parameter of the card may be off."""
STEP = 0.1
"""Difference by which slopes are taken, in standard deviations."""


def shift_left(
    readings: Callable[[Mapping[str, float]], Mapping[str, Series]],
    parameters: Sequence[str],
    measured: Mapping[str, Series],
    noise: Mapping[str, float],
) -> tuple[float, float]:
    """Root mean square of the change over the noise, largest of all readings, before and after imitation.

    min over x of |(d - J x) / s|² + |x|² with |x| ≤ 3: d is what the effect changes, s the noise, J the
    change of the readings by one standard deviation of each uncertain parameter, by differences. An effect
    whose d is J x cannot be told from a card that is a little off, however far it moves a reading.

    Args:
        readings: what the sensors say without the effect, of a machine whose parameters are off by so many
            standard deviations each.
        parameters: the uncertain ones.
        measured: what the sensors say with the effect.
        noise: of each reading that is judged, its standard deviation.
    """

    def stacked(given: Mapping[str, Series]) -> Series:
        return np.concatenate([given[name] / size for name, size in noise.items()])

    def largest(change: Series) -> float:
        return max(float(np.sqrt(np.mean(part**2))) for part in np.split(change, len(noise)))

    base = stacked(readings({}))
    change = stacked(measured) - base
    if not parameters:
        return largest(change), largest(change)
    slopes = np.stack([(stacked(readings({name: STEP})) - base) / STEP for name in parameters], axis=1)
    with_priors = np.vstack([slopes, np.eye(len(parameters))])
    target = np.concatenate([change, np.zeros(len(parameters))])
    imitated = lsq_linear(with_priors, target, bounds=(-FARTHEST, FARTHEST)).x
    return largest(change), largest(change - slopes @ imitated)
