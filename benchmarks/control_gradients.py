"""Derivatives through whole closed loops beside finite differences, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from control_race import SIZES, TIMES, problem
from measured_rows import gradient_speed, slopes_agree
from published_rows import Row

import jaxmuscle as jm
from jaxmuscle.tuning.tune import prepared

DIRECTIONS, SIZE = 200, 1e-5
MANY = 1000


def gradient_rows() -> Iterator[Row]:
    """Stick-slip, saturation, sampled controller, noise: 200 directions in the six gains; then the time."""
    evaluation = prepared(*problem(6), SIZES)
    at = evaluation.unknowns.coordinates(evaluation.unknowns.start)
    slope, random = evaluation(at[None])[0].gradient, np.random.default_rng(0)
    errors = []
    for _ in range(DIRECTIONS):
        direction = random.standard_normal(len(at))
        direction /= np.linalg.norm(direction)
        up, down = evaluation(np.stack([at + SIZE * direction, at - SIZE * direction]))
        errors.append(abs((up.cost - down.cost) / (2 * SIZE) - slope @ direction) / np.linalg.norm(slope))
    yield from slopes_agree(errors)
    joint, controller, scenarios = problem(6)
    wanted = scenarios[0].reference
    inertias = np.linspace(0.5, 1.5, MANY) * float(joint.inertia)
    many = jm.tuning.grid(wanted, TIMES, {"inertia": inertias.tolist()}, start=scenarios[0].start)
    large = prepared(joint, controller, many, SIZES)
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        large(at[None])
        spent.append(time.perf_counter() - begin)
    yield from gradient_speed(MANY, spent[0], min(spent[1:]))
