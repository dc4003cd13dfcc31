r"""The one-muscle model that all peers of `peers.py` integrate, and the run that they are asked for.

States: opening o, pressure p (absolute), position x, velocity v, eight plays F_i. Command u, held.

.. math::
    \dot o &= (u/u_{full} - o)/τ_v, \quad
    \dot p = (R T \dot m - p \dot V)/V, \quad \dot x = v \\
    \dot v &= (D - L s)/m, \quad D = F - ΔF - m g, \quad s = \mathrm{clip}((D + m v/τ)/L, -1, 1) \\
    F &= π r_0^2 P (a (1 - kε)^2 - b), \quad ΔF = w π r_0^2 P \sum_i c_i (ε - F_i), \quad ε = x/l_0 \\
    L &= L_c + (f_k + (f_s - f_k) e^{-|v|/v_s}) S P, \quad
    F_i = \max(ε - r_i, \min(ε + r_i, F_i^-))

Flow ṁ: isentropic from the supply while o > 0 and to the atmosphere while o < 0, choked below a ratio of
0.528, its last thousandth linear. V, S: [T] equations 3 and 14. v̇ = 0 on the plate (x ≤ 0) while v̇ < 0.
Friction passes from one side to the other over L_c τ/m = 1 mm/s on either side, 2 mm/s in all.

Peers without play operators carry F_i as states: Ḟ_i = ε̇ where ε pushes against the edge of its play, over a
width of 1e-4 without which CVODES gives up, else 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

SAMPLES, STEP, HOLD = 1000, 0.002, 50
LEVELS = (2.5, -2.0, 2.0, 0.0, -3.0, 2.0, -2.0, -1.5, 3.0, -1.0)
KNOTS = np.resize(LEVELS, SAMPLES // HOLD)
"""Command, held for 0.1 s each [V]: few jumps favour solvers with a memory, which begin anew at each."""
COMMAND = np.repeat(KNOTS, HOLD)
CLOCK = STEP * np.arange(SAMPLES)
ACCURACY = 1e-4
"""Of the position at all samples, relative to its range."""

NAMES = (
    "area", "time_constant", "full_command", "supply", "length", "radius", "angle", "end_factor", "mass",
    "ambient", "temperature", "static", "kinetic", "stribeck", "coulomb", "weight",
)  # fmt: skip
VALUES = np.array(
    [1.2e-6, 0.007, 5.0, 801325.0, 0.3, 0.007, np.radians(22), 1.3, 8.0,
     101325.0, 293.15, 0.008, 0.03, 0.1, 16.0, 0.05]
)  # fmt: skip
FREE = (0, 1, 3, 4, 5, 7, 8, 9, 11, 12, 14, 15)
"""The twelve parameters of the Jacobian, by their place in `NAMES`."""
PATHS = (
    "valve.area", "valve.time_constant", "valve.full_command", "valve.supply_pressure",
    "muscle.initial_length", "muscle.initial_radius", "muscle.braid_angle", "muscle.end_factor", "mass",
    "ambient_pressure", "gas_temperature", "effects.thread_friction.static_coefficient",
    "effects.thread_friction.kinetic_coefficient", "effects.thread_friction.velocity_constant",
    "effects.load_friction.force", "effects.length_hysteresis.weight",
)  # fmt: skip
"""The same in the package."""
MASS = NAMES.index("mass")

GAS, GRAVITY, GAMMA, STICK = 287.0, 9.80665, 1.4, 5e-4
CRITICAL, LAMINAR = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1)), 0.999
EDGE = 1e-4
THRESHOLDS = np.linspace(0.01, 0.08, 8)
DENSITY = np.exp(-THRESHOLDS / 0.1)
SHARES = DENSITY / (DENSITY * THRESHOLDS).sum()
START = np.array([0.0, 101325.0, 0.0, 0.0, *np.zeros(8)])


def masses(runs: int) -> np.ndarray:
    """The operating points of a batch [kg]."""
    return np.linspace(7.0, 9.0, runs) if runs > 1 else VALUES[MASS : MASS + 1]


def deviation(position: Any, reference: np.ndarray) -> float:
    """Largest deviation relative to the range of the reference."""
    return float(np.abs(np.asarray(position) - reference).max() / np.ptp(reference))


def rates(state: Any, u: Any, q: Any, ops: Any) -> tuple[list[Any], list[Any]]:
    """Rates of o, p, x, v and of the plays; `ops` brings where, exp, sqrt, maximum, minimum, sin, cos."""
    o, p, x, v, *plays = state
    area, tau, full, supply, length, radius, angle, k, mass, ambient, warm, fs, fk, vs, coulomb, w = q

    def nozzle(opened: Any, one: Any, other: Any) -> Any:
        up, down = ops.maximum(one, other), ops.minimum(one, other)
        ratio = down / up
        inside = ops.minimum(ops.maximum(ratio, CRITICAL), LAMINAR)
        s = inside ** (1 / GAMMA)
        chord = ops.minimum((1 - ratio) / (1 - LAMINAR), 1.0)
        size = opened * up * ops.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS * warm) * s * (s - inside)) * chord
        return ops.where(one >= other, size, -size)

    gauge, strain = p - ambient, x / length
    flow = nozzle(area * ops.maximum(o, 0.0), supply, p) - nozzle(area * ops.maximum(-o, 0.0), p, ambient)
    sine, cosine = ops.sin(angle), ops.cos(angle)
    ratio, scale = 1 - strain, np.pi * radius**2
    volume = scale * length * ratio * (1 - cosine**2 * ratio**2) / sine**2
    swept = -scale * (1 - 3 * cosine**2 * ratio**2) / sine**2 * ops.where(x <= 0, ops.maximum(v, 0.0), v)
    short = 1 - k * strain
    surface = 2 * np.pi * radius * length * sine / (short * ops.sqrt(1 - cosine**2 * short**2))
    loop = sum(c * (strain - f) for c, f in zip(SHARES.tolist(), plays, strict=True))
    force = scale * gauge * (3 * cosine**2 / sine**2 * short**2 - 1 / sine**2 - w * loop)
    limit = coulomb + (fk + (fs - fk) * ops.exp(-ops.maximum(v, -v) / vs)) * surface * ops.maximum(gauge, 0.0)
    driving = force - mass * GRAVITY
    slip = ops.maximum(ops.minimum((driving + mass * v / STICK) / limit, 1.0), -1.0)
    pushed = (driving - limit * slip) / mass
    held = ops.where(x <= 0, ops.maximum(pushed, 0.0), pushed)
    turning = []
    for r, f in zip(THRESHOLDS.tolist(), plays, strict=True):
        up, down = (
            ops.minimum(ops.maximum(1 + (way - r) / EDGE, 0.0), 1.0) for way in (strain - f, f - strain)
        )
        turning.append((up * ops.maximum(v, 0.0) + down * ops.minimum(v, 0.0)) / length)
    return [(u / full - o) / tau, (GAS * warm * flow - p * swept) / volume, v, held], turning
