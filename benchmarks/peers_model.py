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

Fixed steps move the plays exactly, at the end of each step (:func:`landed`). Solvers that choose their steps
carry F_i as states: Ḟ_i = ε̇ where ε pushes against the edge of its play, over a width of 1e-4 without which
CVODES gives up and LSODA gets stuck, else 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

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
_QUARTIC = Chebyshev.interpolate(lambda ratio: ratio ** (1 / 7), 4, domain=[CRITICAL, 1.0])
SEVENTH = tuple(map(float, _QUARTIC.convert(kind=Polynomial).coef[::-1]))
"""A quartic near the seventh root from the critical ratio to 1, highest coefficient first."""
THRESHOLDS = np.linspace(0.01, 0.08, 8)
DENSITY = np.exp(-THRESHOLDS / 0.1)
SHARES = DENSITY / (DENSITY * THRESHOLDS).sum()
START = np.array([0.0, 101325.0, 0.0, 0.0, *np.zeros(8)])
START_SLOPES = np.zeros((12, len(FREE)))
"""Of the start by the free parameters: at rest the muscle has the pressure of its surroundings."""
START_SLOPES[1, FREE.index(NAMES.index("ambient"))] = 1.0


def masses(runs: int) -> np.ndarray:
    """The operating points of a batch [kg]."""
    return np.linspace(7.0, 9.0, runs) if runs > 1 else VALUES[MASS : MASS + 1]


def deviation(position: Any, reference: np.ndarray) -> float:
    """Largest deviation relative to the range of the reference."""
    return float(np.abs(np.asarray(position) - reference).max() / np.ptp(reference))


def seventh_root(ratio: Any) -> Any:
    """ratio^(1/7) from the critical ratio to 1, to rounding: a quartic and one step of Halley's rule.

    With γ = 7/5 no other power is needed, and every peer is spared the general one.
    """
    guess = SEVENTH[0]
    for coefficient in SEVENTH[1:]:
        guess = guess * ratio + coefficient
    cube = guess * guess * guess
    power = cube * cube * guess
    return guess * (3 * power + 4 * ratio) / (4 * power + 3 * ratio)


def nozzle(area: Any, one: Any, other: Any, warm: Any, ops: Any) -> Any:
    """Flow ṁ from `one` to `other`; the root of β^(2/γ) - β^((γ+1)/γ) is y^5 sqrt(1 - y^2), y = β^(1/7)."""
    up, down = ops.maximum(one, other), ops.minimum(one, other)
    ratio = down / up
    y = seventh_root(ops.minimum(ops.maximum(ratio, CRITICAL), LAMINAR))
    y2 = y * y
    y4 = y2 * y2
    chord = ops.minimum((1 - ratio) / (1 - LAMINAR), 1.0)
    size = area * up * ops.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS * warm) * y4 * y4 * y2 * (1 - y2)) * chord
    return ops.where(one >= other, size, -size)


def play(strain: Any, before: Any, threshold: float, ops: Any) -> Any:
    """A play operator after a monotone change of its input to `strain`."""
    return ops.maximum(strain - threshold, ops.minimum(strain + threshold, before))


def own_rates(state: Any, plays: Any, u: Any, q: Any, ops: Any, turn: Any = None) -> list[Any]:
    """Rates of o, p, x, v; `ops` brings where, exp, sqrt, maximum, minimum, sin, cos.

    Args:
        plays: F_i now.
        turn: sine and cosine of the braid angle, where they are computed beforehand.
    """
    o, p, x, v = state
    area, tau, full, supply, length, radius, angle, k, mass, ambient, warm, fs, fk, vs, coulomb, w = q
    # One of the two ports is shut, so that one nozzle is enough; a negative area turns its flow round.
    charging = o >= 0
    source, sink = ops.where(charging, supply, p), ops.where(charging, p, ambient)
    flow = nozzle(area * o, source, sink, warm, ops)
    gauge, strain = p - ambient, x / length
    sine, cosine = (ops.sin(angle), ops.cos(angle)) if turn is None else turn
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
    return [(u / full - o) / tau, (GAS * warm * flow - p * swept) / volume, v, held]


def rates(state: Any, u: Any, q: Any, ops: Any) -> tuple[list[Any], list[Any]]:
    """Rates of o, p, x, v and of the plays, which are states here."""
    own, plays = state[:4], state[4:]
    strain, v, length, turning = own[2] / q[4], own[3], q[4], []
    for r, f in zip(THRESHOLDS.tolist(), plays, strict=True):
        up, down = (
            ops.minimum(ops.maximum(1 + (way - r) / EDGE, 0.0), 1.0) for way in (strain - f, f - strain)
        )
        turning.append((up * ops.maximum(v, 0.0) + down * ops.minimum(v, 0.0)) / length)
    return own_rates(own, plays, u, q, ops), turning


def landed(own: Any, plays: Any, length: Any, ops: Any) -> tuple[list[Any], list[Any]]:
    """The end of a fixed step: not below the plate, and the plays moved along."""
    o, p, x, v = own
    x, v = ops.maximum(x, 0.0), ops.where(x <= 0, ops.maximum(v, 0.0), v)
    moved = [play(x / length, f, r, ops) for r, f in zip(THRESHOLDS.tolist(), plays, strict=True)]
    return [o, p, x, v], moved
