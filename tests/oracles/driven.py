"""Rig `driven` on one page: the force follows from the imposed pressure and contraction, sample by sample."""

from functools import partial
from itertools import pairwise

import numpy as np
from oracles.friction import Bristles, course
from oracles.muscle import (
    THRESHOLDS,
    aged,
    corrected_force,
    moved,
    thread_coefficient,
    thread_limit,
)
from oracles.outside import push

FINE = 50
"""Substeps to a sample of what creeps."""
PARTS = 16
"""Straight moves to a sample of what rubs."""


def driven(card, effects, pressure, contraction, velocity, step=0.01):
    """Force at the samples; dry friction opposes the sign of the velocity and is zero at standstill.

    What would push, a slack muscle, gives no force. With `presliding` the threads are a LuGre contact.
    """
    strains = contraction / card["initial_length"]
    delayed = [np.zeros_like(strains)] * 2
    if creep := effects.get("creep"):
        delayed = [lagged(strains, step, creep[name], FINE) for name in ("fast_time", "slow_time")]
    shares = np.sign(velocity)
    if bend := effects.get("presliding", {}).get("distance", 0.0):
        shares = _bent(effects, bend, contraction, velocity, step)
    plays, force = [strains[0]] * len(THRESHOLDS), []
    moments = zip(pressure - card["ambient_pressure"], strains, velocity, shares, *delayed, strict=True)
    for row, (p, strain, v, share, *late) in enumerate(moments):
        plays = moved(plays, strain)
        friction = share * thread_limit(card, effects, strain, p, v)
        tension = aged(effects, corrected_force(card, effects, strain, p, plays), late, row * step)
        tension += push(effects, row * step, strain * card["initial_length"], v)
        force.append(max(tension - friction, 0.0))
    return np.array(force)


def _bent(effects, distance, contraction, velocity, step):
    """Friction over its limit at the samples, the threads' bristles unbent at first.

    Between samples the motion is the cubic with their places and velocities, in short straight moves: over a
    whole sample friction changes with the velocity, and a reversal in between bends bristles back.
    """
    threads = Bristles(distance, course(partial(thread_coefficient, effects)))
    shares, h = [threads.share(velocity[0])], step / PARTS
    for places, speeds in zip(pairwise(contraction), pairwise(velocity), strict=True):
        path = hermite(places, speeds, step)
        for way in np.diff(path):
            threads.slide(way / h, h)
        shares.append(threads.share(speeds[1]))
    return np.array(shares)


def hermite(places, speeds, step):
    """Places on the cubic with these places and speeds at its ends, at the ends of `PARTS` equal times."""
    s = np.linspace(0, 1, PARTS + 1)
    bend = (2 * s**3 - 3 * s**2) * (places[0] - places[1])
    return places[0] + bend + step * (speeds[0] * (s**3 - 2 * s**2 + s) + speeds[1] * (s**3 - s**2))


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
