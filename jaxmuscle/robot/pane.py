"""A fixed pane that the tip of the arm leans on."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Point = Float[Array, "... 2"]


class Pane(eqx.Module):
    r"""Unilateral spring and damper without friction: the foam roller against the window of [T].

    .. math:: F = K\,(δ)_+\,(1 + c\,\dot δ)_+

    along the pane's normal (Hunt and Crossley, J. Appl. Mech. 42, 1975), δ the penetration. Both positive
    parts are rounded over a small width by a parabola, so that F is continuous with its slope, exactly zero
    beyond that width, and never pulls. At stiffness 0 there is no pane.
    """

    stiffness: Scalar = parameter("N/m", "stiffness of roller and pane", default=0.0, nonnegative=True)
    damping: Scalar = parameter("s/m", "damping c of roller and pane", default=0.0, nonnegative=True)
    normal: Scalar = parameter("rad", "direction of the normal, pointing into the pane", default=0.0)
    distance: Scalar = parameter("m", "distance of the pane from the base along its normal", default=1.0)
    width: Scalar = parameter("m", "penetration over which contact sets in", default=1e-4, positive=True)

    def penetration(self, point: Point) -> Float[Array, "..."]:
        """Depth of a point behind the pane [m], negative in front of it."""
        return point @ self._direction - self.distance

    def force(self, point: Point, velocity: Point) -> Point:
        """Force of the pane on the tip [N], along the normal and away from the pane; SI."""
        return -self.pressing(point, velocity)[..., None] * self._direction

    def pressing(self, point: Point, velocity: Point) -> Float[Array, "..."]:
        """Size F of the contact force [N], never negative."""
        depth = positive_part(self.penetration(point), self.width)
        return self.stiffness * depth * positive_part(1 + self.damping * (velocity @ self._direction), 0.1)

    @property
    def _direction(self) -> Float[Array, "2"]:
        return jnp.stack([jnp.cos(self.normal), jnp.sin(self.normal)])


def positive_part(value: Array, width: Array | float) -> Array:
    r"""max(value, 0) with its corner rounded to :math:`(x + w)^2/(4w)` in :math:`|x| < w`; never negative."""
    inside = jnp.clip(value, -width, width)
    return (inside + width) ** 2 / (4 * width) + jnp.maximum(value - width, 0.0)
