"""Rig `jet-pipe-piston` on one page: RK4 at small steps, sharp dry friction, gas by mass and internal energy.

Twelve states, of the gas the mass and the energy of each chamber instead of pressure and temperature; the
friction in one of three states for the length of a step: forward, backward, at rest.
"""

from math import exp, pi

import numpy as np
from oracles.isotonic import nozzle
from oracles.jetpipe import BORE, CHAMBERS, DAMPING, DRIVER, EMPTY, GAS, LAG, RESONANCE, TORQUE, leak, ports

SPRING, UNLOADED, MASS = 88.14, 69.1e-3, 0.02
STOP, STOP_DAMPING, STOP_WIDTH = 2e5, 2.0, 5e-6
STRIBECK, DEAD = 0.01, 1e-3


def rounded(x, w):
    return 0.0 if x < -w else x if x > w else (x + w) ** 2 / (4 * w)


def press(depth, speed):
    return STOP * rounded(depth, STOP_WIDTH) * rounded(1 + STOP_DAMPING * speed, 0.1)


def piston(card, command, step, substeps):
    """Current, force on the rod, position, pressure 1 and temperature 1 at the samples, from rest."""
    outer, ambient = card["gas_temperature"], card["ambient_pressure"]
    n, wall, cd = card["polytropic_exponent"], card["wall_conductance"], card["discharge_coefficient"]
    cv, area, gap = GAS / (n - 1), pi * BORE**2 / 4, card["stopper_position"] - EMPTY
    c, bend = card["pipe_compliance"], card["pipe_saturation_force"]

    def gas(mass, energy, x):
        temperature = energy / (mass * cv)
        volume = area * (np.array([x, CHAMBERS - x]) + DEAD)
        return temperature, mass * GAS * temperature / volume

    def rod(x, v):
        return SPRING * (UNLOADED - gap + x) + press(x - gap, v)

    def driving(p, x, v):
        """What moves the piston without dry friction, and the limit of the dry friction, [H] 2.33-2.35."""
        free = area * (p[0] - p[1]) - rod(x, v) + press(-x, -v) - card["viscous_friction"] * v
        fade = exp(-abs(v) / STRIBECK)
        return free, card["coulomb_friction"] * (1 - fade) + card["stiction"] * fade

    def rates(state, u, supply, sense):
        i, y, tip, w, x, v = state[:6]
        mass, energy = state[6:8], state[8:10]
        temperature, p = gas(mass, energy, x)
        force = TORQUE * i
        fed, open_ = ports(tip + card["receiver_offset"])
        flow, heat = np.zeros(2), np.zeros(2)
        for k in (0, 1):
            hot = outer if supply > p[k] else temperature[k]
            into = nozzle(cd * fed[k], supply, p[k], hot)
            out = nozzle(cd * open_[k], p[k], ambient, temperature[k])
            flow[k], heat[k] = into - out, into * hot - out * temperature[k]
        hot = temperature[0] if p[0] > p[1] else temperature[1]
        past = leak(p[0], p[1], hot)
        flow += np.array([-past, past])
        heat += np.array([-past, past]) * hot
        free, limit = driving(p, x, v)
        work = p * area * v * np.array([1, -1])
        return np.array(
            [
                DRIVER * (card["current_gain"] * u - i),
                LAG * (c * force / (1 + (force / bend) ** 4) ** 0.25 - y),
                w,
                RESONANCE**2 * (y - tip) - 2 * DAMPING * RESONANCE * w,
                v if sense else 0.0,
                (free - sense * limit) / MASS if sense else 0.0,
                *flow,
                *(n * cv * heat - work + wall * (outer - temperature)),
            ]
        )

    start = card["initial_pressure"] * area * np.array([DEAD, CHAMBERS + DEAD])
    state = np.concatenate([np.zeros(6), start / (GAS * outer), start / (n - 1)])
    h, samples = step / substeps, []
    for u, supply in command:
        for sub in range(substeps):
            x, v = state[4], state[5]
            temperature, p = gas(state[6:8], state[8:10], x)
            if sub == 0:
                samples.append([state[0], rod(x, v), x, p[0], temperature[0]])
            free, limit = driving(p, x, v)
            sense = np.sign(v) if v else (np.sign(free) if abs(free) > limit else 0.0)
            k1 = rates(state, u, supply, sense)
            k2 = rates(state + h / 2 * k1, u, supply, sense)
            k3 = rates(state + h / 2 * k2, u, supply, sense)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3, u, supply, sense))
            if limit and v and state[5] * v <= 0:
                state[5] = 0.0
    return np.array(samples).T
