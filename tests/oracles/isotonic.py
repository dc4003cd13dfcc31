"""Rig `isotonic` on one page: RK4 at fixed small steps, sharp Coulomb friction, hard base plate.

The motion is in one of three states for the length of a step: up, down (friction at its limit) or at rest.
"""

from math import sqrt

import numpy as np
from oracles.muscle import THRESHOLDS, corrected_force, cylinder, moved, thread_limit

GAMMA, GAS, GRAVITY = 1.4, 287.0, 9.80665


def nozzle(area, upstream, downstream, temperature):
    """[H] 2.18: isentropic flow, choked below a pressure ratio of 0.528; no laminar range."""
    if upstream < downstream:
        return -nozzle(area, downstream, upstream, temperature)
    beta = max(downstream / upstream, (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1)))
    root = beta ** (2 / GAMMA) - beta ** ((GAMMA + 1) / GAMMA)
    return area * upstream * sqrt(2 * GAMMA / (GAS * temperature * (GAMMA - 1)) * max(root, 0.0))


def isotonic(card, effects, command, step, pressure, substeps):
    """Pressure, position, velocity at the samples, from rest on the plate with the valve shut."""
    temperature, ambient, mass = card["gas_temperature"], card["ambient_pressure"], card["mass"]
    guide = effects.get("load_friction", {}).get("force", 0.0)
    damping = effects.get("load_damping", {}).get("coefficient", 0.0)
    leak = effects.get("chamber_leak", {}).get("area", 0.0)
    delay = effects.get("command_delay", {}).get("delay", 0.0)

    def load(p, x, v, sense):
        """What accelerates the mass with dry friction at its limit against a motion of the given sense."""
        strain = x / card["initial_length"]
        threads = sense * thread_limit(card, effects, strain, p - ambient, v)
        pull = max(corrected_force(card, effects, strain, p - ambient, plays) - threads, 0.0)
        return pull - mass * GRAVITY - damping * v - sense * guide

    def rates(state, u, sense):
        o, p, x, v = state
        flow = nozzle(card["valve_area"] * max(o, 0.0), card["supply_pressure"], p, temperature)
        flow -= nozzle(card["valve_area"] * max(-o, 0.0) + leak, p, ambient, temperature)
        volume, slope = cylinder(card, x)
        inflow = GAS * temperature * flow
        return np.array(
            [
                (u / card["full_command"] - o) / card["valve_time_constant"],
                card["polytropic_exponent"] * (inflow - p * slope * v) / volume,
                v,
                load(p, x, v, sense) / mass if sense is not None else 0.0,
            ]
        )

    def after(state, h, u, sense):
        k1 = rates(state, u, sense)
        k2 = rates(state + h / 2 * k1, u, sense)
        k3 = rates(state + h / 2 * k2, u, sense)
        return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3, u, sense))

    h = step / substeps
    state, plays, samples = np.array([0.0, pressure, 0.0, 0.0]), [0.0] * len(THRESHOLDS), []
    for row in range(len(command)):
        samples.append(state[1:])
        for sub in range(substeps):
            # The middle of the substep lies on the right side of every switch of the command.
            late = (row * substeps + sub + 0.5) / substeps - delay / step
            u = command[int(late)] if late >= 0 else 0.0
            _, p, x, v = state
            up, down = load(p, x, v, 1.0), load(p, x, v, -1.0)
            sense = 1.0 if v > 0 or (v == 0 and up > 0) else -1.0
            if v == 0 and up <= 0 and (down >= 0 or x == 0):
                sense = None
            before, state = state, after(state, h, u, sense)
            if state[2] < 0:
                fall = h * x / (x - state[2])
                landed = after(before, fall, u, sense)
                state = after(np.array([*landed[:2], 0.0, 0.0]), h - fall, u, None)
            elif sense is not None and sense * state[3] < 0 and down > up:
                state[3] = 0.0
            plays = moved(plays, state[2] / card["initial_length"])
    return np.array(samples).T
