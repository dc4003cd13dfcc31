"""Preisach's model as a sum of relays in plain NumPy: hysteresis made without a play operator.

A relay goes up when the input reaches `centre + half`, down when it reaches `centre - half`, and stays as it
is in between.
"""

import numpy as np


class Relays:
    """Relays on a grid of centres and half-widths, with a share each; output from -1 to 1."""

    def __init__(self, density, centres, halves):
        """`density(centre, half)` ≥ 0 on the grid of the two."""
        c, h = np.meshgrid(centres, halves, indexing="ij")
        share = density(c, h)
        kept = share > 1e-6 * share.max()
        self.up, self.down = (c + h)[kept], (c - h)[kept]
        self.share = share[kept] / share[kept].sum()

    def outputs(self, values, state=None):
        """Outputs along straight ways between `values`; a `state` is moved on, without one all start down."""
        state = np.full(len(self.share), -1.0) if state is None else state
        found = []
        for value in values:
            state[value >= self.up] = 1.0
            state[value <= self.down] = -1.0
            found.append(self.share @ state)
        return np.array(found)


def bell(x, middle, width):
    return np.exp(-0.5 * ((x - middle) / width) ** 2)


def jet_pipe():
    """Saturating S with a loop of nearly even width, wider where it is steep: a torque motor's iron."""
    grid = np.linspace(-1.6, 1.6, 161), np.linspace(0.004, 0.4, 100)
    return Relays(lambda c, h: bell(c, 0.0, 0.45) * bell(h, 0.10, 0.06), *grid)


def lopsided():
    """An unsymmetric loop, wide low down and narrow high up: half-widths fall with the centre."""
    grid = np.linspace(-1.6, 1.6, 161), np.linspace(0.004, 0.5, 125)
    return Relays(lambda c, h: bell(c, 0.15, 0.5) * bell(h, 0.14 - 0.06 * c, 0.05), *grid)


def broad():
    """Relays of all half-widths, most of them small: loops that are thin at the turn and fill up slowly."""
    grid = np.linspace(-1.6, 1.6, 161), np.linspace(0.004, 0.8, 200)
    return Relays(lambda c, h: bell(c, 0.0, 0.5) * np.exp(-h / 0.15), *grid)


MATERIALS = {"jet pipe": jet_pipe, "lopsided": lopsided, "broad": broad}


def way(corners, samples=60):
    """A series that goes straight from corner to corner, `samples` samples a leg; the first corner is in."""
    legs = [np.linspace(a, b, samples + 1)[1:] for a, b in zip(corners[:-1], corners[1:], strict=True)]
    return np.concatenate([[corners[0]], *legs])
