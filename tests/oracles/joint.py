"""Rig `joint` on two pages: RK4 at fixed small steps, muscles that cannot push, dry friction.

A muscle is not longer than its threads allow: the joint stops dead where one has its full length. Friction is
sharp; with `presliding` the threads of both muscles and the bearing are LuGre contacts.
"""

from functools import partial
from math import cos, pi, sin

import numpy as np
from oracles.commands import acting
from oracles.friction import Bristles, course, guide_limit
from oracles.muscle import (
    THRESHOLDS,
    aged,
    corrected_force,
    creeping,
    moved,
    thread_coefficient,
    thread_limit,
)
from oracles.outside import push
from oracles.stepping import runge_kutta


def joint(card, effects, command, step, pressure, angle, substeps, controller=None):
    """Pressures 1 and 2 of the muscles, angle, angular velocity at the samples, from rest.

    A `controller` (pressure 1, pressure 2, angle at a sample) → commands takes the place of `command`, of
    which only the number of samples is used then; what it gives acts at once.
    """

    def value(effect, parameter):
        return effects.get(effect, {}).get(parameter, 0.0)

    radius, length, ambient = card["sprocket_radius"], card["initial_length"], card["ambient_pressure"]
    omega, zeta, inertia = 2 * pi * card["regulator_frequency"], card["regulator_damping"], card["inertia"]
    damping, bearing = value("load_damping", "coefficient"), guide_limit(effects)
    link, hanging = value("gravity", "torque"), value("gravity", "hanging_angle")
    stop, hardness = effects.get("end_stop", {}).get("position", np.inf), value("end_stop", "stiffness")
    off, phase = value("eccentric_sprocket", "eccentricity"), value("eccentric_sprocket", "phase")
    other = phase + value("eccentric_sprocket", "wrap_angle")
    line = value("line_lag", "time_constant")
    thicker = card["initial_radius"] * (1 + value("muscle_mismatch", "ratio"))
    muscles = [card, {**card, "initial_radius": thicker}]
    bristles = []
    if bend := value("presliding", "distance"):
        threads = course(partial(thread_coefficient, effects))
        contacts = (radius * bend, threads), (radius * bend, threads), (bend, course(bearing))
        bristles = [Bristles(*contact) for contact in contacts]

    def strains(theta):
        """One muscle shortens by Rθ, the other lengthens; either by what the centre moves from its chain."""
        turn = [theta + off * (sin(theta - at) + sin(at)) for at in (phase, other)]
        first, second = (radius * each / length for each in turn)
        return card["initial_contraction"] + first, card["initial_contraction"] - second

    def speeds(theta, w):
        """Velocities of contraction: lever arms of the two, one of them negative, times the turning."""
        return radius * (1 + off * cos(theta - phase)) * w, -radius * (1 + off * cos(theta - other)) * w

    def torque(state, time, sense):
        """Torque on the joint; sharp friction at its limit against a motion of the given sense."""
        *_, p1, p2, theta, w = state[:8]
        total, (arm1, arm2) = 0.0, speeds(theta, 1.0)
        shares = [sense, -sense, sense]
        if bristles:
            shares = [b.share(v) for b, v in zip(bristles, (*speeds(theta, w), w), strict=True)]
        sides = zip(muscles, strains(theta), (p1, p2), plays, (arm1, arm2), shares, (0, 2), strict=False)
        for muscle, strain, p, memory, arm, slip, own in sides:
            force = corrected_force(muscle, effects, strain, p - ambient, memory)
            force = aged(effects, force, state[8 + own : 10 + own], time)
            friction = slip * thread_limit(muscle, effects, strain, p - ambient, arm * w)
            total += arm * max(force - friction, 0.0)
        total -= link * sin(theta - hanging) + hardness * max(theta - stop, 0.0)
        return total + push(effects, time, theta, w) - damping * w - shares[2] * bearing(w)

    def rates(state, told, time, sense):
        r1, r2, d1, d2, p1, p2, theta, w, *delayed = state
        bends = [
            omega**2 * (u - r) - 2 * zeta * omega * d
            for u, r, d in zip(told, (r1, r2), (d1, d2), strict=True)
        ]
        fills = [(r1 - p1) / line, (r2 - p2) / line] if line else [d1, d2]
        moves = [w, torque(state, time, sense) / inertia] if sense is not None else [0.0, 0.0]
        lates = [
            creeping(effects, s, delayed[i : i + 2]) for s, i in zip(strains(theta), (0, 2), strict=True)
        ]
        return [d1, d2, *bends, *fills, *moves, *lates[0], *lates[1]]

    h, end = step / substeps, card["initial_contraction"] * length / radius
    settled = [strain for strain in strains(angle) for _ in range(2)]
    state = [*pressure, 0.0, 0.0, *pressure, angle, 0.0, *settled]
    plays, samples, given = [[strain] * len(THRESHOLDS) for strain in strains(angle)], [], None
    for index, told in enumerate(acting(effects, command, np.asarray(pressure), step, substeps)):
        if index % substeps == 0:
            samples.append(state[4:8])
            given = controller(*state[4:7]) if controller else None
        told = told if given is None else given
        time, theta, w = index * h, state[6], state[7]
        up, down = torque(state, time, 1.0), torque(state, time, -1.0)
        sense = np.sign(w) or (1.0 if up > 0 else -1.0)
        if w == 0 and up <= 0 <= down:
            sense = None
        if (theta >= end and up > 0) or (theta <= -end and down < 0):
            sense = None
        for contact, v in zip(bristles, (*speeds(theta, w), w), strict=False):
            contact.slide(v, h / 2)
        state = runge_kutta(rates, state, h, told, time, sense)
        if sense is not None and sense * state[7] < 0 and down > up:
            state[7] = 0.0
        if abs(state[6]) >= end:
            state[6], state[7] = np.sign(state[6]) * end, 0.0
        for contact, v in zip(bristles, (*speeds(*state[6:8]), state[7]), strict=False):
            contact.slide(v, h / 2)
        plays = [moved(z, strain) for z, strain in zip(plays, strains(state[6]), strict=True)]
    return np.array(samples).T
