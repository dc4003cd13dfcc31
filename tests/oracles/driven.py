"""Rig `driven` on one page: the force follows from the imposed pressure and contraction, sample by sample."""

from itertools import pairwise

import numpy as np
from oracles.muscle import THRESHOLDS, corrected_force, moved, thread_limit


def driven(card, effects, pressure, contraction, velocity):
    """Force at the samples; dry friction opposes the sign of the velocity and is zero at standstill.

    What would push, a slack muscle, gives no force.
    """
    strains = contraction / card["initial_length"]
    plays, force = [strains[0]] * len(THRESHOLDS), []
    for p, strain, v in zip(pressure - card["ambient_pressure"], strains, velocity, strict=True):
        plays = moved(plays, strain)
        friction = np.sign(v) * thread_limit(card, effects, strain, p, v)
        force.append(max(corrected_force(card, effects, strain, p, plays) - friction, 0.0))
    return np.array(force)


def lagged(force, step, time_constant, substeps):
    """τ dy/dt = F - y by fixed Heun steps, the force linear between its samples and y(0) = F(0)."""
    h, y, samples = step / substeps, force[0], [force[0]]
    for before, after in pairwise(force):
        for sub in range(substeps):
            here = before + (after - before) * sub / substeps
            there = before + (after - before) * (sub + 1) / substeps
            slope = (here - y) / time_constant
            y += h / 2 * (slope + (there - y - h * slope) / time_constant)
        samples.append(y)
    return np.array(samples)
