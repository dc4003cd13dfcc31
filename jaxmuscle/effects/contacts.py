"""Contacts of dry friction: the threads of muscles, and the guide or bearing of the load; bristles of each.

All that acts on the load is given as force or torque on it, the threads first, then guide or bearing, on an
axis of its own before those of the motion.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractSlipEffect, Effects, States
from jaxmuscle.effects.slip import Bristle
from jaxmuscle.signals import Signals

CONTACTS = 2
"""Threads; guide or bearing."""
NO_CONTACT = 0.0
"""Limit of a contact that a machine does not have."""


def with_contacts(
    effects: Effects,
    signals: Signals,
    limits: Callable[[Signals], tuple[Array | float, Array | float]],
) -> Signals:
    """`signals` with the limit of each contact and how large it is over that at rest, where an effect asks.

    Args:
        limits: signals → limits of the threads and of guide or bearing, on the load (:data:`NO_CONTACT` of
            one that a machine does not have); at rest where velocities of load and muscles are zero.
    """
    if not any(isinstance(effect, AbstractSlipEffect) for effect in effects.values()):
        return signals
    still = {
        name: 0.0 * value
        for name in ("velocity", "contraction_velocity")
        if (value := getattr(signals, name)) is not None
    }
    moving, at_rest = (
        jnp.stack(jnp.broadcast_arrays(*limits(at))) for at in (signals, signals.having(**still))
    )
    some = (moving > 0) & (at_rest > 0)
    ratio = jnp.where(some, moving, 1.0) / jnp.where(some, at_rest, 1.0)
    return signals.having(dry_limits=moving, limit_over_rest=ratio)


def bristle(effects: Effects, states: States, signals: Signals) -> Bristle | None:
    r"""How far the dry friction of all contacts has built up; `None` where it acts at once.

    Of contacts with limits :math:`L_i`, shares :math:`z_i` and ways :math:`δ_i` that bear the load side by
    side: :math:`L = \sum L_i`, :math:`L z = \sum L_i z_i`, and as stiffnesses add,
    :math:`L/δ = \sum L_i/δ_i`. Damping goes by the share that :math:`L_i/δ_i` weigh.

    Raises:
        ValueError: signals of a rig that did not say its limits.
    """
    for name, effect in effects.items():
        if isinstance(effect, AbstractSlipEffect):
            if signals.dry_limits is None:
                raise ValueError(
                    f"expected the limits of dry friction for {name}; got signals without any: a rig calls "
                    "with_contacts before it asks for its bristle"
                )
            shares = effect.value(states.get(name), signals)
            distance, softness = effect.deflection(), signals.limit_over_rest
            weights = _weights(signals.dry_limits)
            share, stiffness = (weights * shares).sum(0), weights / softness
            whole = stiffness.sum(0)
            bent = (stiffness * shares).sum(0) / whole
            return Bristle(share, distance / whole, effect.damping(), bent, shares - share)
    return None


def _weights(limits: Array) -> Array:
    """Part that each contact has in the limit of all; alike where there is no friction."""
    total = limits.sum(0)
    return jnp.where(total > 0, limits, 1.0) / jnp.where(total > 0, total, len(limits))


def slips(slip: Array, bristle: Bristle | None) -> tuple[Array, Array]:
    """Slip of the threads and of guide or bearing, of which `slip` is that of both together."""
    if bristle is None or bristle.beyond is None:
        return slip, slip
    threads, load = jnp.where(bristle.distance > 0, bristle.beyond, 0.0)
    return slip + threads, slip + load
