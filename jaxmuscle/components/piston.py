"""A piston that slides on a rod between the end of its cylinder and a stopper."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.contact import pressing
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, "..."]


class Piston(eqx.Module):
    r"""Mass, spring, stops and friction of a piston at x_p from the end of its cylinder.

    .. math:: m \ddot x_p = A_p (p_1 - p_2) - F_{rod} + F_{end} - b \dot x_p - F_f,\quad
              F_{rod} = k_s (L_0 - g) + F_{stop},\quad g = x_s - L_p - L_s - L_{sup} - x_p

    [H] 2.32 to 2.38: the spring lies in the gap g between piston and stopper and keeps the rod taut; once
    the gap is closed the stopper carries the rest. Stops are stiff one-sided springs (:func:`pressing`),
    the stiffness that of rod and force sensor. The spring's solid length is neglected.
    """

    mass: Scalar = parameter(
        "kg", "mass of the piston and of what moves with it", default=0.02, positive=True
    )
    spring_rate: Scalar = parameter("N/m", "rate of the spring", default=88.14, nonnegative=True)
    spring_length: Scalar = parameter("m", "unloaded length of the spring", default=69.1e-3, positive=True)
    viscous: Scalar = parameter("N s/m", "viscous friction b", default=0.0, nonnegative=True, typical=1.0)
    coulomb_force: Scalar = parameter("N", "Coulomb friction F_c", default=0.0, nonnegative=True, typical=1.0)
    stiction_force: Scalar = parameter("N", "stiction F_s", default=0.0, nonnegative=True, typical=1.0)
    stiction_velocity: Scalar = parameter(
        "m/s", "velocity over which stiction turns into Coulomb friction", default=0.01, positive=True
    )
    # The thesis has rigid stops; how soft they are is a choice of this package.
    stop_stiffness: Scalar = parameter("N/m", "stiffness of the stops", default=2e5, positive=True)
    stop_damping: Scalar = parameter("s/m", "damping of the stops", default=2.0, nonnegative=True)
    stop_width: Scalar = parameter("m", "depth over which a stop sets in", default=5e-6, positive=True)

    def rod_force(self, gap: Value, velocity: Value) -> Value:
        """Pull on the rod F_rod [N], [H] 2.37-2.38; gap g to the stopper [m], piston's velocity [m/s]."""
        stop = pressing(-gap, velocity, self.stop_stiffness, self.stop_damping, self.stop_width)
        return self.spring_rate * (self.spring_length - gap) + stop

    def end_force(self, position: Value, velocity: Value) -> Value:
        """Push of the cylinder's end F_end [N]; position x_p [m], velocity [m/s]."""
        return pressing(-position, -velocity, self.stop_stiffness, self.stop_damping, self.stop_width)

    def viscous_force(self, velocity: Value) -> Value:
        """Viscous friction b ẋ_p [N], [H] 2.33."""
        return self.viscous * velocity

    def dry_limit(self, velocity: Value) -> Value:
        r"""Largest dry friction :math:`F_c + (F_s - F_c)\,e^{-|\dot x_p|/v_s}` [N]: [H] 2.35, smooth.

        [H] jumps from F_s to F_c as the piston starts; here it falls over v_s, `stiction_velocity`.
        """
        fading = jnp.exp(-jnp.abs(velocity) / self.stiction_velocity)
        return self.coulomb_force + (self.stiction_force - self.coulomb_force) * fading
