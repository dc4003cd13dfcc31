"""Rig `joint` on one page: RK4 at fixed small steps, sharp Coulomb friction, muscles that cannot push.

A muscle is not longer than its threads allow: the joint stops dead where one has its full length.
"""

from math import pi, sin

import numpy as np
from oracles.muscle import THRESHOLDS, corrected_force, moved, thread_limit


def joint(card, effects, command, step, pressure, angle, substeps):
    """Pressures 1 and 2, angle, angular velocity at the samples, from rest."""
    radius, length, ambient = card["sprocket_radius"], card["initial_length"], card["ambient_pressure"]
    omega, zeta, inertia = 2 * pi * card["regulator_frequency"], card["regulator_damping"], card["inertia"]
    bearing = effects.get("load_friction", {}).get("force", 0.0)
    damping = effects.get("load_damping", {}).get("coefficient", 0.0)
    weight = effects.get("gravity", {"torque": 0.0, "hanging_angle": 0.0})
    mismatch = effects.get("muscle_mismatch", {}).get("ratio", 0.0)
    delay = effects.get("command_delay", {}).get("delay", 0.0)
    muscles = [
        card,
        {**card, "initial_radius": card["initial_radius"] * (1 + mismatch)},
    ]

    def strains(theta):
        turn = radius * theta / length
        return card["initial_contraction"] + turn, card["initial_contraction"] - turn

    def torque(state, plays, sense):
        """Torque on the joint when the dry friction is at the limit against a motion of the given sense."""
        p1, p2, _, _, theta, w = state
        pull = []
        sides = zip(muscles, strains(theta), (p1, p2), plays, (sense, -sense), strict=True)
        for muscle, strain, p, memory, slip in sides:
            force = corrected_force(muscle, effects, strain, p - ambient, memory)
            friction = slip * thread_limit(muscle, effects, strain, p - ambient, radius * w)
            pull.append(max(force - friction, 0.0))
        swing = weight["torque"] * sin(theta - weight["hanging_angle"])
        return radius * (pull[0] - pull[1]) - swing - damping * w - sense * bearing

    def rates(state, u, plays, sense):
        p, rate, w = state[:2], state[2:4], state[5]
        bend = omega**2 * (u - p) - 2 * zeta * omega * rate
        moves = (w, torque(state, plays, sense) / inertia) if sense is not None else (0.0, 0.0)
        return np.concatenate([rate, bend, moves])

    h, end = step / substeps, card["initial_contraction"] * length / radius
    state = np.array([*pressure, 0.0, 0.0, angle, 0.0])
    plays = [[strain] * len(THRESHOLDS) for strain in strains(angle)]
    samples = []
    for row in range(len(command)):
        samples.append(state[[0, 1, 4, 5]])
        for sub in range(substeps):
            late = (row * substeps + sub + 0.5) / substeps - delay / step
            u = command[int(late)] if late >= 0 else np.asarray(pressure)
            up, down = torque(state, plays, 1.0), torque(state, plays, -1.0)
            sense = np.sign(state[5]) or (1.0 if up > 0 else -1.0)
            if state[5] == 0 and up <= 0 <= down:
                sense = None
            if (state[4] >= end and up > 0) or (state[4] <= -end and down < 0):
                sense = None
            k1 = rates(state, u, plays, sense)
            k2 = rates(state + h / 2 * k1, u, plays, sense)
            k3 = rates(state + h / 2 * k2, u, plays, sense)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(state + h * k3, u, plays, sense))
            if sense is not None and sense * state[5] < 0 and down > up:
                state[5] = 0.0
            if abs(state[4]) >= end:
                state[4], state[5] = np.sign(state[4]) * end, 0.0
            plays = [moved(z, strain) for z, strain in zip(plays, strains(state[4]), strict=True)]
    return np.array(samples).T
