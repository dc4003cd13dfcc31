"""Rig `jet-pipe` on one page: RK4 at fixed small steps, every area by the formula of two circles.

Written from the thesis: six states (current, lagged and true tip position, tip velocity, two pressures).
"""

from math import acos, pi, sqrt

import numpy as np
from oracles.commands import acting
from oracles.isotonic import nozzle
from oracles.stepping import runge_kutta

GAS = 287.0
DRIVER, TORQUE, LAG, RESONANCE, DAMPING = 7050.0, 1.946, 973.9, 1856.7, 0.019
PORT, BORE, CHAMBERS, EMPTY = 0.9652e-3, 15.875e-3, 70e-3, 26e-3
LEAK, LEAK_SLOPE = 0.0971e-6, 0.0475e-6
PLAYS = 8


def lens(distance, r, big):
    """Area common to circles of radius r and `big` ≥ r, their centres `distance` apart."""
    d = abs(distance)
    if d >= r + big:
        return 0.0
    if d <= big - r:
        return pi * r**2
    kite = 0.5 * sqrt((-d + r + big) * (d + r - big) * (d - r + big) * (d + r + big))
    return (
        r**2 * acos((d**2 + r**2 - big**2) / (2 * d * r))
        + big**2 * acos((d**2 + big**2 - r**2) / (2 * d * big))
        - kite
    )


def ports(x):
    """Supply areas and return areas of ports 1 and 2 with the tip at x [m^2], [H] 2.8-2.17."""
    r = PORT / 2
    supply = lens(x - PORT, r, r), lens(x + PORT, r, r)
    outlet = pi * r**2 - lens(x - PORT, r, 3 * r), pi * r**2 - lens(x + PORT, r, 3 * r)
    return supply, outlet


def leak(p1, p2, temperature):
    """Flow past the piston from chamber 1 to 2 [kg/s], [H] 2.23."""
    area = max(LEAK - LEAK_SLOPE * min(p1, p2) / max(p1, p2), 0.0)
    return nozzle(area, p1, p2, temperature)


def jet_pipe(card, effects, command, step, substeps):
    """Current and force at the samples, from zero current and equal pressures."""
    temperature, ambient, supply = card["gas_temperature"], card["ambient_pressure"], card["supply_pressure"]
    piston = pi * BORE**2 / 4
    travel = card["stopper_position"] - EMPTY
    stiff = [
        card["polytropic_exponent"] * GAS * temperature / (piston * v) for v in (travel, CHAMBERS - travel)
    ]
    limit = effects.get("current_saturation", {}).get("limit", np.inf)
    weight = effects.get("valve_hysteresis", {}).get("weight", 0.0)
    radii = effects.get("valve_hysteresis", {}).get("width", 0.0) * np.arange(1, PLAYS + 1) / PLAYS
    outside = effects.get("chamber_leak", {}).get("area", 0.0)
    c, bend, cd = card["pipe_compliance"], card["pipe_saturation_force"], card["discharge_coefficient"]

    def moved(plays, i):
        force = TORQUE * i
        return np.maximum(force - radii, np.minimum(force + radii, plays))

    def rates(state, u, plays):
        i, y, x, v, p1, p2 = state
        force = TORQUE * min(max(i, -limit), limit)
        static = c * force / (1 + (force / bend) ** 4) ** 0.25
        if weight:
            static -= weight * c * float(np.mean(TORQUE * i - moved(plays, i)))
        fed, open_ = ports(x + card["receiver_offset"])
        past = leak(p1, p2, temperature)
        flow = [
            nozzle(cd * a, supply, p, temperature) - nozzle(cd * b + outside, p, ambient, temperature)
            for a, b, p in zip(fed, open_, (p1, p2), strict=True)
        ]
        return [
            DRIVER * (card["current_gain"] * u - i),
            LAG * (static - y),
            v,
            RESONANCE**2 * (y - x) - 2 * DAMPING * RESONANCE * v,
            stiff[0] * (flow[0] - past),
            stiff[1] * (flow[1] + past),
        ]

    h, plays, samples = step / substeps, np.zeros(PLAYS), []
    state = [0.0, 0.0, 0.0, 0.0, card["initial_pressure"], card["initial_pressure"]]
    for index, u in enumerate(acting(effects, command, 0.0, step, substeps)):
        if index % substeps == 0:
            samples.append([state[0], max(piston * (state[4] - state[5]), card["residual_force"])])
        state = runge_kutta(rates, state, h, u, plays)
        plays = moved(plays, state[0]) if weight else plays
    return np.array(samples).T
