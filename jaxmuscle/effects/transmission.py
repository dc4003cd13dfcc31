"""What lies between muscle and load: a sprocket of varying lever arm, a tendon that stretches."""

from __future__ import annotations

import math
from typing import ClassVar, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike
from numpy.typing import NDArray

from jaxmuscle.effects.base import AbstractStaticEffect, AbstractTransmissionEffect, Effects
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals

Pulls: TypeAlias = NDArray[np.float64]


class EccentricSprocket(AbstractTransmissionEffect):
    r"""The sprocket turns about an axis beside its centre: its muscles' lever arms change with the angle.

    .. math:: R_i(θ) = R\,[1 + e \cos(θ - φ_i)],\quad
              x_i = ε_0 l_0 ± R\,[θ + e (\sin(θ - φ_i) + \sin φ_i)],\quad φ_1 = φ,\ φ_2 = φ + ψ

    e R: distance of axis and centre; ψ: the angle over which the chain is wrapped around the sprocket. Of
    muscles that pull in line, chains straight across the sprocket (ψ = 0), both arms change alike; of muscles
    side by side (ψ = π) one grows by what the other falls. The contraction is the integral of the lever arm,
    so that no work is lost. e, φ, ψ are those of every joint. Valid for |e| < 1, ends of the joint to 1e-9
    rad for |e| ≤ 0.2.
    """

    name: ClassVar = "eccentric_sprocket"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"sprocket"})
    strength: ClassVar = "eccentricity"
    starts: ClassVar = tuple(
        {"phase": phase, "wrap_angle": wrap} for wrap in (0.0, math.pi) for phase in (0.0, 0.5 * math.pi)
    )
    source: ClassVar = "arm of a circle that turns about a point beside its centre; contraction its integral"

    eccentricity: Scalar = parameter("", "distance of axis and centre over the radius", default=0.0)
    phase: Scalar = parameter("rad", "angle of the largest arm of muscle 1", default=0.0, typical=0.5)
    wrap_angle: Scalar = parameter(
        "rad", "angle over which the chain is wrapped around the sprocket", default=0.0, typical=math.pi
    )

    def winding(self, angle: Array, muscle: ArrayLike) -> Array:
        phase = self.phase + muscle * self.wrap_angle
        return self.eccentricity * (jnp.sin(angle - phase) + jnp.sin(phase))

    def lever(self, angle: Array, muscle: ArrayLike) -> Array:
        return self.eccentricity * jnp.cos(angle - self.phase - muscle * self.wrap_angle)


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


def shortening(effects: Effects, angle: Array, pulls: Pulls) -> Array:
    """Contraction of every muscle beyond that at angle 0, over the sprockets' mean radius [rad].

    Args:
        pulls: the sense in which each muscle turns each joint; for a single joint, its two muscles.
    """
    turned = jnp.asarray(angle)[..., None]
    wound = sum((e.winding(turned, pulls < 0) for e in _of_transmission(effects)), start=turned)
    return over_joints(jnp.asarray(pulls) * wound)


def over_joints(each: Array) -> Array:
    """The sum over the joints of what each of them adds to every muscle; of a single joint, what it adds."""
    return each.sum(axis=tuple(range(each.ndim - 1)))


def arms(effects: Effects, angle: Array, pulls: Pulls) -> Array:
    """Lever arms of the muscles over the sprockets' mean radius, with the sense of `pulls`, in its shape."""
    turned = jnp.asarray(angle)[..., None]
    levers = (each.lever(turned, pulls < 0) for each in _of_transmission(effects))
    return jnp.asarray(pulls) * sum(levers, start=jnp.ones(()))


UNWINDINGS = 4
"""Newton's steps to the angle of a winding: they leave less than 1e-9 rad where levers vary by a fifth."""


def unwound(effects: Effects, wound: Array, muscle: int) -> Array:
    """The angle at which so much of a muscle's chain is wound up [rad]."""
    acting, angle = _of_transmission(effects), wound
    for _ in range(UNWINDINGS if acting else 0):
        excess = angle - wound + sum(e.winding(angle, muscle) for e in acting)
        angle = angle - excess / (1 + sum(e.lever(angle, muscle) for e in acting))
    return angle


def _of_transmission(effects: Effects) -> list[AbstractTransmissionEffect]:
    return [each for each in effects.values() if isinstance(each, AbstractTransmissionEffect)]
