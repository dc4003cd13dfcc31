"""What lies between muscle and load: a sprocket of varying lever arm, a tendon that stretches."""

from __future__ import annotations

import math
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractStaticEffect, AbstractTransmissionEffect, Effects
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals


class EccentricSprocket(AbstractTransmissionEffect):
    r"""The sprockets' lever arm changes with the angle, alike for both muscles of a joint.

    .. math:: R(θ) = R\,[1 + e \cos(θ - φ)],\quad
              x = ε_0 l_0 ± R\,[θ + e (\sin(θ - φ) + \sin φ)]

    The contraction is the integral of the lever arm, so that no work is lost. e, φ are those of every
    joint. A sprocket out of round is of this form; a round one whose axis is beside its centre has a lever
    arm that grows on one side as it falls on the other, which this law does not describe. Valid for |e| < 1,
    ends of the joint to 1e-9 rad for |e| ≤ 0.2.
    """

    name: ClassVar = "eccentric_sprocket"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"sprocket"})
    strength: ClassVar = "eccentricity"
    starts: ClassVar = ({"phase": 0.0}, {"phase": 0.5 * math.pi})
    source: ClassVar = "lever arm with one harmonic, contraction its integral"

    eccentricity: Scalar = parameter("", "amplitude of the lever arm over its mean", default=0.0)
    phase: Scalar = parameter("rad", "angle of the largest lever arm", default=0.0, typical=0.5)

    def winding(self, angle: Array) -> Array:
        return self.eccentricity * (jnp.sin(angle - self.phase) + jnp.sin(self.phase))

    def lever(self, angle: Array) -> Array:
        return self.eccentricity * jnp.cos(angle - self.phase)


class ElasticTendon(AbstractStaticEffect):
    r"""An elastic tendon between muscle and load: the muscle is shorter than the load's place says.

    .. math:: ΔF = F_t - F(x),\quad F_t = F(x + c F_t)

    x: contraction by the position of the load [m], F: the muscle's own force [N]. Quasi-static: tendon and
    muscle end have no mass, and only the force law sees the stretch, not volume, velocity and other
    effects. Closed form for force laws up to the second power of x, as [T] equations 4 and 7 are; the root
    of the equation that is F(x) at c = 0. A muscle that does not pull has no stretch.
    """

    name: ClassVar = "elastic_tendon"
    slot: ClassVar = MUSCLE_FORCE
    reads: ClassVar = frozenset({"muscle", "pressure", "contraction"})
    strength: ClassVar = "compliance"
    starts: ClassVar = ({},)
    source: ClassVar = "linear spring in series"

    compliance: Scalar = parameter(
        "m/N", "stretch of the tendon per force", default=0.0, nonnegative=True, typical=1e-5
    )

    def value(self, signals: Signals) -> Array:
        muscle, c = signals.muscle, self.compliance

        def force(contraction: Array) -> Array:
            return muscle.force(contraction, signals.gauge_pressure, muscle.end_factor)

        def slope(contraction: Array) -> Array:
            return jax.jvp(force, (contraction,), (jnp.ones_like(contraction),))[1]

        x = signals.contraction
        own, first = force(x), slope(x)
        second = 0.5 * jax.jvp(slope, (x,), (jnp.ones_like(x),))[1]
        linear = 1 - c * first
        # Of a pulling muscle the root is at least 1; the limit keeps others from a root of less than zero.
        root = jnp.sqrt(jnp.maximum(linear**2 - 4 * c**2 * second * own, 0.25))
        return jnp.where(own > 0, 2 * own / (linear + root), own) - own


def winding(effects: Effects, angle: Array) -> Array:
    """Angle by which chain is wound up on the sprocket's mean radius [rad], after all effects on it."""
    own = [e.winding(angle) for e in effects.values() if isinstance(e, AbstractTransmissionEffect)]
    return sum(own, start=angle)


def lever(effects: Effects, angle: Array) -> Array | float:
    """Ratio of the sprocket's lever arm to its mean radius, after all effects on it."""
    own = [e.lever(angle) for e in effects.values() if isinstance(e, AbstractTransmissionEffect)]
    return sum(own, start=1.0)


UNWINDINGS = 4
"""Newton's steps to the angle of a winding: they leave less than 1e-9 rad where levers vary by a fifth."""


def unwound(effects: Effects, wound: Array) -> Array:
    """The angle by which a given length of chain is wound up, the inverse of :func:`winding` [rad]."""
    angle = wound
    if any(isinstance(e, AbstractTransmissionEffect) for e in effects.values()):
        for _ in range(UNWINDINGS):
            angle = angle - (winding(effects, angle) - wound) / lever(effects, angle)
    return angle
