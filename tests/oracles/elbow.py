"""Rig `elbow` on one page: RK4 for the regulator at fixed small steps, play operators sample by sample."""

from math import pi

import numpy as np
from oracles.plays import modified_step

OPERATORS = 10


def table_of(card):
    """The parameters of the card as the tables of [W] name them, for pressures in Pa and angles in rad."""

    def envelope(side):
        return tuple(card[f"{side}_{name}"] for name in ("height", "slope", "shift", "level"))

    return {
        "a": envelope("rising"),
        "b": envelope("falling"),
        "rho": card["density"],
        "tau": card["decay"],
        "alpha": card["spacing"],
        "p": (card["linear"], card["cubic"]),
    }


def elbow(card, effects, command, step, pressure, substeps):
    """Pressure and angle at the samples, the pressure at rest before the first command."""
    omega, zeta = 2 * pi * card["regulator_frequency"], card["regulator_damping"]
    delay, ambient = effects.get("command_delay", {}).get("delay", 0.0), card["ambient_pressure"]
    table, h = table_of(card), step / substeps

    def rates(state, u):
        return np.array([state[1], omega**2 * (u - state[0]) - 2 * zeta * omega * state[1]])

    state, plays, found = np.array([pressure, 0.0]), [0.0] * OPERATORS, []
    plays, angle = modified_step(plays, pressure - ambient, table)
    for row in range(len(command)):
        found.append((state[0], angle))
        for sub in range(substeps):
            late = (row * substeps + sub + 0.5) / substeps - delay / step
            u = command[int(late)] if late >= 0 else pressure
            k1 = rates(state, u)
            k2 = rates(state + h / 2 * k1, u)
            k3 = rates(state + h / 2 * k2, u)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3, u))
            plays, angle = modified_step(plays, state[0] - ambient, table)
    return np.array(found).T
