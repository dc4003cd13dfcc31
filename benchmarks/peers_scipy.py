"""SciPy: LSODA with a right-hand side in numba, on all cores by processes; and the reference.

The reference is RK4 in very short steps, its plays exact.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from math import cos, exp, pi, sin, sqrt

import numpy as np
from numba import njit  # pyright: ignore[reportMissingImports]
from peers_model import (
    CRITICAL,
    EDGE,
    GAMMA,
    GAS,
    GRAVITY,
    HOLD,
    KNOTS,
    LAMINAR,
    MASS,
    SHARES,
    START,
    STEP,
    STICK,
    THRESHOLDS,
    VALUES,
    masses,
    seventh_root,
)  # fmt: skip
from scipy.integrate import odeint

TOLERANCES = (3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8)
"""Relative; tried from the loosest on."""
SCALES = np.array([1.0, 1e5, 0.1, 0.1, *[0.1] * 8])
"""Sizes of the states, for the absolute tolerance."""
CHUNKS = 8
"""Parts of a batch for each process, so that the last one is not waited for."""

root = njit(cache=True)(seventh_root)


@njit(cache=True)
def nozzle(area, one, other, warm):
    up, down = max(one, other), min(one, other)
    ratio = down / up
    y = root(min(max(ratio, CRITICAL), LAMINAR))
    size = area * up * sqrt(2 * GAMMA / ((GAMMA - 1) * GAS * warm) * (1 - y**2)) * y**5
    size *= min((1 - ratio) / (1 - LAMINAR), 1.0)
    return size if one >= other else -size


@njit(cache=True)
def rates(y, t, u, q, out, exact):
    """Rates of the twelve states; with `exact`, the last eight are plays before this step and get none.

    Else they turn over the width that they have for all solvers: where they jump, LSODA gets stuck.
    """
    area, tau, full, supply, length, radius, angle, k, mass, ambient, warm, fs, fk, vs, coulomb, w = q
    o, p, x, v = y[0], y[1], y[2], y[3]
    gauge, strain = p - ambient, x / length
    flow = nozzle(area * o, supply, p, warm) if o >= 0 else nozzle(area * o, p, ambient, warm)
    sine, cosine = sin(angle), cos(angle)
    ratio, scale = 1 - strain, pi * radius**2
    volume = scale * length * ratio * (1 - cosine**2 * ratio**2) / sine**2
    swept = -scale * (1 - 3 * cosine**2 * ratio**2) / sine**2 * (v if x > 0 else max(v, 0.0))
    short = 1 - k * strain
    surface = 2 * pi * radius * length * sine / (short * sqrt(1 - cosine**2 * short**2))
    loop = 0.0
    for i in range(8):
        r, f = THRESHOLDS[i], y[4 + i]
        gap = strain - f
        loop += SHARES[i] * (min(max(gap, -r), r) if exact else gap)
        out[4 + i] = 0.0
        if not exact:
            past = gap - r if v > 0 else -gap - r
            out[4 + i] = min(max(1 + past / EDGE, 0.0), 1.0) * v / length
    force = scale * gauge * (3 * cosine**2 / sine**2 * short**2 - 1 / sine**2 - w * loop)
    limit = coulomb + (fk + (fs - fk) * exp(-abs(v) / vs)) * surface * max(gauge, 0.0)
    driving = force - mass * GRAVITY
    slip = max(min((driving + mass * v / STICK) / limit, 1.0), -1.0)
    pushed = (driving - limit * slip) / mass
    out[0], out[1] = (u / full - o) / tau, (GAS * warm * flow - p * swept) / volume
    out[2], out[3] = v, max(pushed, 0.0) if x <= 0 else pushed
    return out


@njit(cache=True)
def reference(command, q, substeps):
    """Position at the samples: RK4, contact and plays exact at the end of each step."""
    y, found, h = START.copy(), np.empty(len(command)), STEP / substeps
    k1, k2, k3, k4 = np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(12)
    for row in range(len(command)):
        found[row] = y[2]
        for _ in range(substeps):
            u = command[row]
            rates(y, 0.0, u, q, k1, True)
            rates(y + h / 2 * k1, 0.0, u, q, k2, True)
            rates(y + h / 2 * k2, 0.0, u, q, k3, True)
            rates(y + h * k3, 0.0, u, q, k4, True)
            y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            if y[2] <= 0:
                y[2], y[3] = 0.0, max(y[3], 0.0)
            for i in range(8):
                strain = y[2] / q[4]
                y[4 + i] = max(strain - THRESHOLDS[i], min(strain + THRESHOLDS[i], y[4 + i]))
    return found


def run(knots: np.ndarray, tolerance: float, q: np.ndarray = VALUES) -> np.ndarray:
    """Position at the samples by LSODA, which begins anew where the command jumps."""
    y, parts, out = START, [], np.zeros(12)
    times = STEP * np.arange(HOLD + 1)
    for u in knots:
        found = odeint(
            rates, y, times, (u, q, out, False), rtol=tolerance, atol=tolerance * SCALES, mxstep=10000
        )
        parts.append(found[:-1, 2])
        y = found[-1]
    return np.concatenate(parts)


def tops(some: np.ndarray, tolerance: float) -> np.ndarray:
    """Largest positions with these masses."""
    q = np.repeat(VALUES[None, :], len(some), axis=0)
    q[:, MASS] = some
    return np.array([run(KNOTS, tolerance, one).max() for one in q])


def batch(pool: Executor, cores: int, runs: int, tolerance: float) -> Callable[[], np.ndarray]:
    """A function that makes `runs` runs of different masses in the processes of a pool: largest positions."""
    parts = np.array_split(masses(runs), CHUNKS * cores)
    return lambda: np.concatenate(list(pool.map(tops, parts, [tolerance] * len(parts))))
