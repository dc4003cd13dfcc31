"""Dry friction of a machine: the sum of its limits, and how much of it acts, sticking or sliding."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractFrictionEffect, Effects
from jaxmuscle.signals import Signals, Slot

STICKING_TIME = 5e-4
"""Time constant with which a sticking mass comes to rest [s]: short against anything that is sampled."""
DAMPING_TIME = 8 * STICKING_TIME
"""Damping of bristles over their stiffness where nothing else is said [s]."""
STIFF = 2.0
"""q over (ω τ)², ω the frequency at which a mass rings on its bristles (:func:`softening`). With this a joint
stays on bristles of 1e-7 to 1e-2 rad at steps of 2 ms, and ringing at 20 to 50 Hz keeps its own damping."""


LEAST_BENDING = 1e-3
"""Rate of bending over that of straight bristles from which on there is no damping to speak of."""


class Bristle(NamedTuple):
    """Share of the limit to which dry friction has built up, and the way that it takes.

    Attributes:
        share: z, of all contacts together.
        distance: δ, zero where friction acts at once.
        damping_time: T, damping over stiffness [s].
        bent: how far the bristles are bent, as damping goes by it: of several contacts the stiff ones count
            for more; the share when `None`.
        beyond: of each contact, by how much its share differs from that of all; `None` if all are one.
    """

    share: Array
    distance: Array
    damping_time: Array | float = DAMPING_TIME
    bent: Array | None = None
    beyond: Array | None = None


def friction_limit(effects: Effects, slot: Slot, signals: Signals) -> Array | float:
    """Sum of the limits of all dry friction on a slot."""
    limits = [
        e.limit(signals) for e in effects.values() if isinstance(e, AbstractFrictionEffect) and e.slot == slot
    ]
    return sum(limits, start=0.0)


def slip_of_mass(
    driving: Array,
    momentum: Array,
    limit: Array | float,
    widening: Array | float | None = None,
    bristle: Bristle | None = None,
    mass: Array | float = 1.0,
) -> Array:
    r"""Slip of a mass under dry friction: :math:`\mathrm{clip}((F + m v/τ)/L, -1, 1)`.

    The Coulomb law with a true sticking phase (Kikuuwe et al., IEEE Trans. Robotics 22, 2006): friction
    balances the driving force F and brings the mass to rest within τ as long as its limit L suffices, and
    slides at the limit otherwise. Not stiffer than 1/τ however large the friction. At L = 0 it is the sign
    of the driving force, which makes the gradient with respect to the limit that of the sliding phase.

    With a bristle of distance δ that has built up the share z of the limit the slip is
    :math:`\mathrm{clip}((S z + F + m v/τ)/(S + L), -1, 1)`, :math:`S = m δ/(τ T (1 - z s))`: one implicit
    step of length τ for a mass on a spring L/δ with damping T L/δ, at the rate 1 - z s at which bristles
    bend when it moves in the sense s (LuGre: Canudas de Wit et al., IEEE Trans. Automatic Control 40, 1995).
    It is z where z is slow or bent to its end, is as little stiff as the law above, and at δ = 0 is that
    law. Bent further by fast sliding, bristles hold more than L (:func:`reach`).

    Args:
        driving: force F.
        momentum: m v.
        limit: L, not negative.
        widening: factor of τ, for the first stages of a fit: `held.widening` of a rig (`None`: 1).
        bristle: how far friction has built up; `None` where it acts at once.
        mass: m, only needed with a bristle.
    """
    wanted = force_to_rest(driving, momentum, widening)
    most: Array | float = 1.0
    if bristle is not None:
        sense = jnp.sign(wanted - limit * bristle.share)
        over_mass = jnp.asarray(limit) / mass
        softness = mass * softening(bristle, over_mass, sense, widening)
        wanted, limit = wanted + softness * bristle.share, limit + softness
        most = reach(bristle, over_mass, widening)
    some = jnp.asarray(limit) > 0
    ratio = wanted / jnp.where(some, limit, 1.0)
    return jnp.where(some, jnp.clip(ratio, -most, most), jnp.sign(wanted))


def force_to_rest(driving: Array, momentum: Array, widening: Array | float | None = None) -> Array:
    """Friction that would bring a mass to rest within τ, F + m v/τ; arguments as :func:`slip_of_mass`."""
    return driving + momentum / _widened(STICKING_TIME, widening)


def reach(bristle: Bristle, limit: Array, widening: Array | float | None = None) -> Array:
    """Largest share of the limit that dry friction has: 1, or more with bristles bent by fast sliding.

    Not more where they are so stiff that they would spring back within a step. `limit`: L/m.
    """
    beyond = jnp.maximum(jnp.abs(bristle.share), 1.0) - 1.0
    return 1.0 + (1.0 - stiffness(bristle, limit, widening)) * beyond


def stiffness(bristle: Bristle, limit: Array, widening: Array | float | None = None) -> Array:
    """q/(1 + q) of :func:`softening`: from 0, a step follows bristles as they ring, to 1, it does not."""
    ringing = STIFF * jnp.square(_widened(STICKING_TIME, widening)) * limit
    whole = ringing + bristle.distance
    return jnp.where(whole > 0, ringing, 1.0) / jnp.where(whole > 0, whole, 1.0)


def softening(bristle: Bristle, limit: Array, sense: Array, widening: Array | float | None = None) -> Array:
    r"""S/m of :func:`slip_of_mass`: acceleration that a bristle makes up for, :math:`δ/(τ T (1 - z s))`.

    Bristles that would ring faster than a step follows are damped as if their time were
    :math:`T + 8τ\,q/(1 + q)`, :math:`q = 2 τ^2 L/(m δ)`.

    Args:
        limit: L/m.
        sense: s, the sign of the motion: bent as far as they go in that sense bristles bend no more, and
            have no damping.
    """
    sticking = _widened(STICKING_TIME, widening)
    stiff = stiffness(bristle, limit, widening)
    bending = jnp.maximum(_bending(bristle, sense), LEAST_BENDING)
    time = _widened(bristle.damping_time, widening) + _widened(DAMPING_TIME, widening) * stiff
    return bristle.distance / (sticking * time * bending)


def _bending(bristle: Bristle, sense: Array) -> Array:
    """Rate at which bristles bend on the way, over that of straight ones, 1 - z s."""
    return 1.0 - sense * (bristle.share if bristle.bent is None else bristle.bent)


def slip_of_velocity(
    velocity: Array,
    width: float = 1e-4,
    widening: Array | float | None = None,
    bristle: Bristle | None = None,
) -> Array:
    """Slip where the motion is imposed: tanh(v/width) with a width far below any bench's velocities [m/s].

    With a bristle :math:`z + T v (1 - z s)/δ`, not beyond what it reaches.

    Args:
        widening: factor of the width, as in :func:`slip_of_mass`.
    """
    slip = jnp.tanh(velocity / _widened(width, widening))
    if bristle is None:
        return slip
    some, most = bristle.distance > 0, jnp.maximum(jnp.abs(bristle.share), 1.0)
    rate = velocity * _bending(bristle, jnp.sign(velocity)) / jnp.where(some, bristle.distance, 1.0)
    return jnp.where(some, jnp.clip(bristle.share + bristle.damping_time * rate, -most, most), slip)


def _widened(width: Array | float, widening: Array | float | None) -> Array | float:
    return width if widening is None else width * widening
