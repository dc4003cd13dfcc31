"""Kinematics of the arm: where its tip is, and which joint angles bring it somewhere."""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from jaxmuscle.errors import InputError
from jaxmuscle.robot.arm import Arm, Joints

Points = Float[Array, "... 2"]
Elbow = Literal[1, -1]


def elbow_point(arm: Arm, angle: Joints) -> Points:
    """Position of the second joint [m]; angle [rad]."""
    return arm.first.length * _direction(angle[..., 0])


def tip(arm: Arm, angle: Joints) -> Points:
    r"""Position of the tip [m]: :math:`l_1 (\cos q_1, \sin q_1) + l_2 (\cos(q_1+q_2), \sin(q_1+q_2))`.

    The origin is the base, the x-axis the line of both links at angles zero ([T], Cartesian experiment).
    """
    return elbow_point(arm, angle) + arm.second.length * _direction(angle.sum(-1))


def jacobian(arm: Arm, angle: Joints) -> Float[Array, "... 2 2"]:
    """∂tip/∂q [m]: columns are the turned lines from each joint to the tip."""
    end = tip(arm, angle)
    return jnp.stack([_turned(end), _turned(end - elbow_point(arm, angle))], axis=-1)


def angles_at(arm: Arm, point: Points, elbow: Elbow) -> Joints:
    r"""Joint angles that bring the tip to a point of the workspace [rad]; differentiable, unchecked.

    .. math:: \cos q_2 = \frac{x^2 + y^2 - l_1^2 - l_2^2}{2 l_1 l_2},\quad
              q_1 = \operatorname{atan2}(y, x) - \operatorname{atan2}(l_2 \sin q_2, l_1 + l_2 \cos q_2)

    NaN outside the workspace; the slope is infinite at its edge, where the arm is straight or folded.
    """
    x, y = point[..., 0], point[..., 1]
    l1, l2 = arm.first.length, arm.second.length
    second = elbow * jnp.arccos((x**2 + y**2 - l1**2 - l2**2) / (2 * l1 * l2))
    first = jnp.arctan2(y, x) - jnp.arctan2(l2 * jnp.sin(second), l1 + l2 * jnp.cos(second))
    # One turn less or more, so that the angle lies between -π and π.
    first = first - 2 * jnp.pi * jnp.round(first / (2 * jnp.pi))
    return jnp.stack([first, second], axis=-1)


def inverse(arm: Arm, point: ArrayLike, elbow: int) -> Joints:
    """Joint angles that bring the tip to one point or to many [rad].

    Args:
        point: positions of the tip [m], (..., 2).
        elbow: 1 for a second joint bent to positive angles, -1 for negative ones: the two solutions.

    Raises:
        InputError: another elbow, another shape, or a point out of reach; the first such point is named.
    """
    if elbow not in (1, -1):
        raise InputError(f"expected an elbow of 1 (q2 > 0) or -1 (q2 < 0); got {elbow!r}")
    where = np.asarray(point, dtype=float)
    if where.shape[-1:] != (2,):
        raise InputError(f"expected points with two coordinates, shape (..., 2); got shape {where.shape}")
    l1, l2 = float(arm.first.length), float(arm.second.length)
    distance = np.linalg.norm(where, axis=-1)
    # The base itself, within reach of equal links, leaves the first angle open.
    bad = ~((distance <= l1 + l2) & (distance >= abs(l1 - l2)) & (distance > 0))
    if bad.any():
        x, y = where[bad][0]
        raise InputError(
            f"the point ({x:g}, {y:g}) m is out of reach: it is {np.hypot(x, y):g} m from the base, and the "
            f"tip reaches from {abs(l1 - l2):g} to {l1 + l2:g} m (not the base itself); "
            "choose points in between"
        )
    return angles_at(arm, jnp.asarray(where), 1 if elbow == 1 else -1)


def rates_along(arm: Arm, angle: Joints, velocity: Points, acceleration: Points) -> tuple[Joints, Joints]:
    r"""Joint velocities and accelerations of one posture for those of the tip.

    .. math:: \dot q = J^{-1} \dot x,\quad \ddot q = J^{-1} (\ddot x - \dot J \dot q)

    Singular where the arm is straight or folded.
    """
    matrix = jacobian(arm, angle)
    rate = jnp.linalg.solve(matrix, velocity)
    turning = jax.jvp(lambda q: jacobian(arm, q), (angle,), (rate,))[1]
    return rate, jnp.linalg.solve(matrix, acceleration - turning @ rate)


def _direction(angle: Array) -> Points:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)


def _turned(vector: Points) -> Points:
    """By a right angle, counter-clockwise."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)
