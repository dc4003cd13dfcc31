"""Pseudo-trapezoidal velocity profiles."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.parameters import Scalar, parameter

Times = Float[Array, "..."]


class Trapezoid(eqx.Module):
    """Way from 0 to 1: constant acceleration, cruise, constant deceleration.

    Defined by its cruising velocity and the slope of acceleration, as in [T]; a way too short for the
    cruising velocity is a triangle. Before time 0 it is at 0, after :attr:`duration` at 1.
    """

    cruise: Scalar = parameter("1/s", "largest velocity, in ways per second", positive=True)
    slope: Scalar = parameter("1/s^2", "acceleration, in ways per second squared", positive=True)

    @property
    def peak(self) -> Scalar:
        """Largest velocity that is reached [1/s]."""
        return jnp.minimum(self.cruise, jnp.sqrt(self.slope))

    @property
    def rise(self) -> Scalar:
        """Time of acceleration, and of deceleration [s]."""
        return self.peak / self.slope

    @property
    def duration(self) -> Scalar:
        """Time for the whole way [s]."""
        return 1 / self.peak + self.rise

    def position(self, time: Times) -> Times:
        """Share of the way at a time [s]."""
        begun, cruised, braked = self._since(time)
        return 0.5 * self.slope * (begun**2 - cruised**2 - braked**2)

    def velocity(self, time: Times) -> Times:
        """Rate of :meth:`position` [1/s]."""
        begun, cruised, braked = self._since(time)
        return self.slope * (begun - cruised - braked)

    def acceleration(self, time: Times) -> Times:
        """Rate of :meth:`velocity` [1/s^2]; at a switch that of the phase to come."""
        rising = (time >= 0) & (time < self.rise)
        falling = (time >= self.duration - self.rise) & (time < self.duration)
        return self.slope * (rising * 1.0 - falling * 1.0)

    def _since(self, time: Times) -> tuple[Times, Times, Times]:
        """Time since the acceleration began, since it ended, and since the deceleration began [s].

        Squares of these have a continuous slope, so that the gradient is right at every switch.
        """
        now = jnp.clip(time, 0.0, self.duration)
        return now, jnp.maximum(now - self.rise, 0.0), jnp.maximum(now - self.duration + self.rise, 0.0)
