"""Point-to-point motions of the joints or of the tip, with pseudo-trapezoidal velocity profiles."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.robot.arm import Arm
from jaxmuscle.robot.kinematics import inverse, rates_along

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


Vectors = Float[Array, "samples 2"]


class Motion(NamedTuple):
    """Position, velocity and acceleration at the samples: rad or m, per s, per s^2."""

    position: Vectors
    velocity: Vectors
    acceleration: Vectors


class Straight(eqx.Module):
    """Straight way from `start` to `end`, of the joints or of the tip, under a pseudo-trapezoid."""

    start: Float[Array, "2"]
    end: Float[Array, "2"]
    profile: Trapezoid

    @property
    def duration(self) -> Array:
        """Time for the whole way [s]."""
        return self.profile.duration

    def at(self, time: ArrayLike) -> Motion:
        """The motion at times [s]; at rest before 0 and after :attr:`duration`."""
        way, t = self.end - self.start, jnp.asarray(time, dtype=float)[..., None]
        return Motion(
            self.start + self.profile.position(t) * way,
            self.profile.velocity(t) * way,
            self.profile.acceleration(t) * way,
        )

    def to_and_fro(self, time: ArrayLike, times: int) -> Motion:
        """The way there and back, so many `times`, at times [s]."""
        t = jnp.asarray(time, dtype=float)
        period = 2 * self.duration
        # Past the last return it rests at the start, as before time 0.
        t = jnp.where(t < times * period, jnp.mod(t, period), -1.0)
        back = t >= self.duration
        there, return_ = self.at(t), Straight(self.end, self.start, self.profile).at(t - self.duration)
        return Motion(*(jnp.where(back[..., None], b, a) for a, b in zip(there, return_, strict=True)))


def joint_motion(start: ArrayLike, end: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> Straight:
    """Motion of both joints that starts and ends together and keeps to the limits of each.

    Args:
        start, end: joint angles [rad].
        velocity, acceleration: limits, of both joints or of each [rad/s, rad/s^2], above zero.

    Raises:
        InputError: start and end are the same, or a limit is not above zero.
    """
    begin, finish = _pair("start", start), _pair("end", end)
    way = np.abs(finish - begin)
    limits = [np.broadcast_to(np.asarray(x, dtype=float), 2) for x in (velocity, acceleration)]
    _check(way, *limits)
    moving = way > 0
    cruise, slope = (float((limit[moving] / way[moving]).min()) for limit in limits)
    return Straight(
        jnp.asarray(begin), jnp.asarray(finish), Trapezoid(jnp.asarray(cruise), jnp.asarray(slope))
    )


def line(start: ArrayLike, end: ArrayLike, velocity: float, acceleration: float) -> Straight:
    """Straight line of the tip.

    Args:
        start, end: points [m].
        velocity, acceleration: limits along the line [m/s, m/s^2], above zero.

    Raises:
        InputError: start and end are the same, or a limit is not above zero.
    """
    begin, finish = _pair("start", start), _pair("end", end)
    way = np.linalg.norm(finish - begin)
    _check(way, np.asarray(velocity), np.asarray(acceleration))
    profile = Trapezoid(jnp.asarray(velocity / way), jnp.asarray(acceleration / way))
    return Straight(jnp.asarray(begin), jnp.asarray(finish), profile)


def joints_along(arm: Arm, motion: Motion, elbow: int) -> Motion:
    """What the joints do while the tip follows a motion.

    Args:
        motion: of the tip, at samples.
        elbow: 1 or -1, as in :func:`inverse`.

    Raises:
        InputError: a point of the way is out of reach.
    """
    angle = inverse(arm, motion.position, elbow)
    rates = jax.vmap(lambda q, v, a: rates_along(arm, q, v, a))(angle, motion.velocity, motion.acceleration)
    return Motion(angle, *rates)


def _pair(name: str, value: ArrayLike) -> np.ndarray:
    array = np.asarray(value, dtype=float)
    if array.shape != (2,) or not np.isfinite(array).all():
        raise InputError(f"expected two finite numbers for {name}; got {value!r}")
    return array


def _check(way: np.ndarray | np.floating, velocity: np.ndarray, acceleration: np.ndarray) -> None:
    if not np.any(way > 0):
        raise InputError("start and end of a motion are the same; give two different points")
    for name, limit in (("velocity", velocity), ("acceleration", acceleration)):
        if not (np.isfinite(limit).all() and (limit > 0).all()):
            raise InputError(f"expected a {name} limit above zero; got {limit.tolist()}")
