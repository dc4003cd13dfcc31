"""Play operators and the models of [W] written out in plain floats, one sample after the other."""

from math import exp, tanh

import numpy as np

TABLE_2 = {
    "a": (7.313, 0.381, -0.085, -2.050), "b": (1.790, 0.816, -1.588, -0.696),
    "rho": 17.371, "tau": 2.092, "alpha": 0.250, "p": (0.777, -0.819),
}  # fmt: skip


def classical(values, p0, weights, thresholds):
    """[W] 1: p0 v + sum of p_i F_i, F from 0 on."""
    plays, found = [0.0] * len(weights), []
    for v in values:
        plays = [max(v - r, min(v + r, f)) for r, f in zip(thresholds, plays, strict=True)]
        found.append(p0 * v + sum(p * f for p, f in zip(weights, plays, strict=True)))
    return found


def modified_step(plays, v, table):
    """[W] 2 to 6 with the parameters of a table: plays and output after the input has gone straight to v."""
    (a0, a1, a2, a3), (b0, b1, b2, b3), (p1, p2) = table["a"], table["b"], table["p"]
    radii = [table["alpha"] * i for i in range(1, len(plays) + 1)]
    left, right = a0 * tanh(a1 * v + a2) + a3, b0 * tanh(b1 * v + b2) + b3
    plays = [max(left - r, min(right + r, f)) for r, f in zip(radii, plays, strict=True)]
    total = sum(table["rho"] * exp(-table["tau"] * r) * f for r, f in zip(radii, plays, strict=True))
    return plays, p1 * v + p2 * v**3 + total


def modified(values, table, operators):
    """The outputs along a series of inputs, the plays from 0 on."""
    plays, found = [0.0] * operators, []
    for v in values:
        plays, output = modified_step(plays, v, table)
        found.append(output)
    return found


def behind_play(values, half_width, at):
    """What a play of this half-width moves, `at` first: it stays until a side of the gap pushes it on."""
    found = np.empty_like(values)
    for row, value in enumerate(values):
        at = found[row] = np.maximum(value - half_width, np.minimum(value + half_width, at))
    return found
