"""The linear model of [H] chapter 4 on one page: every derivative in closed form, by hand, in NumPy.

As there: a positive current (supply of port 1 and return of port 2 open, the other two shut), no choking at
orifice 1 and past the piston, choking at orifice 2, constant temperature, a piston that does not move.
"""

from math import pi, sqrt

import numpy as np
from oracles.jetpipe import (
    BORE,
    CHAMBERS,
    DAMPING,
    DRIVER,
    EMPTY,
    GAS,
    LAG,
    LEAK,
    LEAK_SLOPE,
    PORT,
    RESONANCE,
    TORQUE,
    lens,
)

GAMMA = 1.4
CRITICAL = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))


def shape(beta):
    """The root in 2.18, and its slope over the pressure ratio."""
    inside = beta ** (2 / GAMMA) - beta ** ((GAMMA + 1) / GAMMA)
    slope = 2 / GAMMA * beta ** (2 / GAMMA - 1) - (GAMMA + 1) / GAMMA * beta ** (1 / GAMMA)
    return sqrt(inside), slope / (2 * sqrt(inside))


def chord(distance, r, big):
    """Length of the chord that two circles share: what their common area loses per distance."""
    d = abs(distance)
    across = sqrt((-d + r + big) * (d + r - big) * (d - r + big) * (d + r + big)) / d
    return -np.sign(distance) * across


def linear_model(card, current, tip, pressures):
    """A, B, C of 4.32 and 4.33 about a current [A], a tip position [m] and two pressures [Pa].

    State (i, tip acceleration, tip velocity, tip position, P1, P2), input the command, output the force.
    """
    p1, p2 = pressures
    ambient, supply, temperature = card["ambient_pressure"], card["supply_pressure"], card["gas_temperature"]
    discharge, r, x = card["discharge_coefficient"], PORT / 2, tip + card["receiver_offset"]
    assert 0 < x < 2 * PORT and CRITICAL < p1 / supply < 1 and CRITICAL < p2 / p1 < 1
    assert ambient / p2 < CRITICAL
    root = sqrt(2 * GAMMA / (GAS * temperature * (GAMMA - 1)))
    # Driver 4.3 and 4.4, jet pipe 4.5 to 4.8: the transfer function of 2.6 multiplied out.
    c0, c1 = DRIVER, DRIVER * card["current_gain"]
    c2, c3 = LAG + 2 * DAMPING * RESONANCE, RESONANCE**2 + 2 * DAMPING * RESONANCE * LAG
    c4 = LAG * RESONANCE**2
    bent = (TORQUE * current / card["pipe_saturation_force"]) ** 4
    c5 = c4 * card["pipe_compliance"] * (1 + bent) ** -1.25 * TORQUE
    # Flows 4.9 to 4.19: into chamber 1, out of chamber 2, past the piston.
    at, slope = shape(p1 / supply)
    k0 = discharge * root * supply * at * chord(x - PORT, r, r)
    k1 = -discharge * root * lens(x - PORT, r, r) * slope
    outlet = pi * r**2 - lens(x + PORT, r, 3 * r)
    at, _ = shape(CRITICAL)
    k2 = discharge * root * p2 * at * -chord(x + PORT, r, 3 * r)
    k3 = discharge * root * outlet * at
    ratio, leak = p2 / p1, LEAK - LEAK_SLOPE * p2 / p1
    at, slope = shape(ratio)
    # The leak's opening depends on the pressure ratio too (2.23).
    by_ratio = leak * slope - LEAK_SLOPE * at
    k4 = root * (leak * at - ratio * by_ratio)
    k5 = -root * by_ratio
    # Chambers 4.20 to 4.31: pressure per mass that flows in.
    area = pi * BORE**2 / 4
    volumes = area * np.array([card["stopper_position"] - EMPTY, CHAMBERS - card["stopper_position"] + EMPTY])
    k6, k7 = card["polytropic_exponent"] * GAS * temperature / volumes
    a = np.array(
        [
            [-c0, 0, 0, 0, 0, 0],
            [c5, -c2, -c3, -c4, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0],
            [0, 0, 0, k6 * k0, -k6 * (k1 + k4), k6 * k5],
            [0, 0, 0, -k7 * k2, k7 * k4, -k7 * (k3 + k5)],
        ]
    )
    return a, np.array([c1, 0, 0, 0, 0, 0]), np.array([0, 0, 0, 0, area, -area])
