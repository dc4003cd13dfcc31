"""LuGre friction (Canudas de Wit, Olsson, Åström, Lischinsky 1995) on half a page.

    dz/dt = v - σ0 |v| z / g(v),   F = σ0 z + σ1 dz/dt

The limit g(v) of a contact may change with pressure and contraction; its course over the speed, `course`, is
what it is over its value at rest. Bristles that are fully bent at rest are bent by `distance`, δ. Written for
s = z / δ, so that σ0 = g(0) / δ, and friction over its limit is (s + τ ds/dt) / course(v).
"""

from math import copysign, exp

BRISTLE_TIME = 5e-4
"""σ1 / σ0 [s]: bristles that ring for a few cycles when a mass of 10 kg comes to rest on them."""


class Bristles:
    """One contact: how far its bristles are bent, in units of `distance` (m, or rad on a shaft)."""

    def __init__(self, distance, course):
        self.distance, self.course, self.bend = distance, course, 0.0

    def share(self, v):
        """Friction over its limit at this speed: -1 to 1 in steady sliding."""
        course = self.course(v)
        rate = (v - abs(v) * self.bend / course) / self.distance
        return (self.bend + BRISTLE_TIME * rate) / course

    def slide(self, v, h):
        """Bend for h seconds at a constant speed: the exact solution, however stiff the bristles are."""
        full = copysign(self.course(v), v)
        self.bend = full + (self.bend - full) * exp(-abs(v) * h / (abs(full) * self.distance))


def guide_limit(effects):
    """Friction limit of a guide or bearing over the speed: Coulomb, and more near rest ([Stribeck 1902])."""
    coulomb = effects.get("load_friction", {}).get("force", 0.0)
    more = effects.get("stribeck")
    if more is None:
        return lambda v: coulomb
    return lambda v: coulomb + more["excess"] * exp(-((v / more["velocity_constant"]) ** 2))


def course(limit):
    """A limit over its value at rest, 1 where there is none."""
    at_rest = limit(0.0)
    return (lambda v: limit(v) / at_rest) if at_rest else (lambda v: 1.0)
