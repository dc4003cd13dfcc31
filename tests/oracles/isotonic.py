"""Rig `isotonic` on two pages: RK4 at fixed small steps, hard base plate, dry friction sharp or of bristles.

Under sharp (Coulomb) friction the motion is in one of three states for the length of a step: up, down
(friction at its limit) or at rest. With `presliding` the threads and the guide are LuGre contacts.
"""

from functools import partial
from math import sqrt

import numpy as np
from oracles.commands import acting
from oracles.friction import Bristles, course, guide_limit
from oracles.muscle import (
    THRESHOLDS,
    aged,
    corrected_force,
    creeping,
    cylinder,
    moved,
    thread_coefficient,
    thread_limit,
)
from oracles.outside import push, swinging
from oracles.stepping import runge_kutta

GAMMA, GAS, GRAVITY = 1.4, 287.0, 9.80665


def nozzle(area, upstream, downstream, temperature):
    """[H] 2.18: isentropic flow, choked below a pressure ratio of 0.528; no laminar range."""
    if upstream < downstream:
        return -nozzle(area, downstream, upstream, temperature)
    beta = max(downstream / upstream, (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1)))
    root = beta ** (2 / GAMMA) - beta ** ((GAMMA + 1) / GAMMA)
    return area * upstream * sqrt(2 * GAMMA / (GAS * temperature * (GAMMA - 1)) * max(root, 0.0))


def drooped(area, supply, pressure, temperature, resistance):
    """Flow from a supply that falls by resistance times flow: the zero of a function, by false position."""
    full = nozzle(area, supply, pressure, temperature)
    if resistance == 0.0 or full <= 0.0:
        return full
    low, high, over, under = (
        0.0,
        full,
        full,
        nozzle(area, supply - resistance * full, pressure, temperature) - full,
    )
    flow = high
    for _ in range(60):
        flow = (low * under - high * over) / (under - over)
        error = nozzle(area, supply - resistance * flow, pressure, temperature) - flow
        if abs(error) < 1e-12 * full:
            break
        if error > 0:
            low, over, under = flow, error, under / 2
        else:
            high, under, over = flow, error, over / 2
    return flow


def isotonic(card, effects, command, step, pressure, substeps, controller=None):
    """Pressure, position, velocity at the samples, from rest on the plate with the valve shut.

    A `controller` (pressure, position at a sample) → command takes the place of `command`, of which only the
    number of samples is used then; what it gives acts at once.
    """

    def value(effect, parameter):
        return effects.get(effect, {}).get(parameter, 0.0)

    temperature, ambient, mass = card["gas_temperature"], card["ambient_pressure"], card["mass"]
    area, supply, exponent = card["valve_area"], card["supply_pressure"], card["polytropic_exponent"]
    length, opening_time, full = card["initial_length"], card["valve_time_constant"], card["full_command"]
    leak, droop = value("chamber_leak", "area"), value("supply_droop", "resistance")
    line, wall = value("line_lag", "time_constant"), value("wall_thickness", "thickness")
    dead, warm, cooling = (
        value("dead_volume", "volume"),
        value("gas_heating", "share"),
        value("gas_heating", "thermal_time"),
    )
    damping, guide = value("load_damping", "coefficient"), guide_limit(effects)
    stop, hardness = effects.get("end_stop", {}).get("position", np.inf), value("end_stop", "stiffness")
    bristles = []
    if bend := value("presliding", "distance"):
        bristles = [Bristles(bend, course(limit)) for limit in (partial(thread_coefficient, effects), guide)]

    def load(state, time, sense):
        """What accelerates the mass; sharp friction at its limit against a motion of the given sense."""
        _, p, x, v, _, _, *delayed = state
        strain = x / length
        threads, sides = (b.share(v) for b in bristles) if bristles else (sense, sense)
        force = aged(effects, corrected_force(card, effects, strain, p - ambient, plays), delayed, time)
        pull = max(force - threads * thread_limit(card, effects, strain, p - ambient, v), 0.0)
        pull += push(effects, time, x, v)
        return pull - mass * GRAVITY - damping * v - sides * guide(v) - hardness * max(x - stop, 0.0)

    def rates(state, u, time, sense):
        o, p, x, v, arriving, gas, *delayed = state
        fed = swinging(effects, supply, time)
        flow = drooped(area * max(o, 0.0), fed, p, temperature, droop)
        flow -= nozzle(area * max(-o, 0.0) + leak, p, ambient, gas)
        lagging = (flow - arriving) / line if line else 0.0
        flow = arriving if line else flow
        volume, slope = cylinder(card, x, wall)
        volume += dead
        heating = 0.0
        if warm:
            # Energy of the gas without heat to the wall, and what relaxes to the wall's temperature.
            entering = GAMMA * (temperature if flow > 0 else gas) - gas
            heating = entering * flow * GAS * gas / (p * volume) - (GAMMA - 1) * gas * slope * v / volume
            heating = warm * heating - (gas - temperature) / cooling
        return [
            (u / full - o) / opening_time,
            exponent * (GAS * gas * flow - p * slope * v) / volume + p * heating / gas,
            v,
            load(state, time, sense) / mass if sense is not None else 0.0,
            lagging,
            heating,
            *creeping(effects, x / length, delayed),
        ]

    h = step / substeps
    state, plays, samples = [0.0, pressure, 0.0, 0.0, 0.0, temperature, 0.0, 0.0], [0.0] * len(THRESHOLDS), []
    given = None
    for index, u in enumerate(acting(effects, command, 0.0, step, substeps)):
        if index % substeps == 0:
            samples.append(state[1:4])
            given = controller(*state[1:3]) if controller else None
        u = u if given is None else given
        time, (_, _, x, v, *_) = index * h, state
        up, down = load(state, time, 1.0), load(state, time, -1.0)
        sense = 1.0 if v > 0 or (v == 0 and up > 0) else -1.0
        if v == 0 and up <= 0 and (down >= 0 or x == 0):
            sense = None
        for contact in bristles:
            contact.slide(v, h / 2)
        before, state = state, runge_kutta(rates, state, h, u, time, sense)
        if state[2] < 0:
            fall = h * x / (x - state[2])
            landed = runge_kutta(rates, before, fall, u, time, sense)
            state = runge_kutta(rates, [*landed[:2], 0.0, 0.0, *landed[4:]], h - fall, u, time, None)
        elif sense is not None and sense * state[3] < 0 and down > up:
            state[3] = 0.0
        for contact in bristles:
            contact.slide(state[3], h / 2)
        plays = moved(plays, state[2] / length)
    return np.array(samples).T
