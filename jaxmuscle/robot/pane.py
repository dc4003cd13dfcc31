"""A fixed pane that the tip of the arm leans on."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.contact import pressing
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
        speed = velocity @ self._direction
        return pressing(self.penetration(point), speed, self.stiffness, self.damping, self.width)

    @property
    def _direction(self) -> Float[Array, "2"]:
        return jnp.stack([jnp.cos(self.normal), jnp.sin(self.normal)])
