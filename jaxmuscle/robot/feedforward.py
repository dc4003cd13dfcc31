"""Commands that make the robot follow a motion without feedback, as far as the model is right."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.components.antagonist import Coefficients, coefficients, pressure_difference
from jaxmuscle.effects.base import friction_limit
from jaxmuscle.robot.reference import MEAN_PRESSURE
from jaxmuscle.robot.scara import PULLS, Scara
from jaxmuscle.robot.trajectory import Motion
from jaxmuscle.signals import MUSCLE_FORCE, Signals

ROUNDS = 5
"""Rounds in which pressures and the friction under them are brought together."""


def pressure_commands(
    robot: Scara, joints: Motion, mean_pressure: float = MEAN_PRESSURE
) -> Float[Array, "samples 4"]:
    r"""Commanded pressures [Pa, absolute] for a motion of the joints.

    Inverse dynamics gives the torques, the antagonist's closed form the pressures :math:`P_0 ± ΔP`. The
    friction of the threads, which grows with the pressures, is overcome where the joint moves: a few
    rounds of pressures and friction, each of which leaves a tenth of the error or less. ΔP is limited to ±P0.

    Args:
        joints: angles, velocities and accelerations at the samples, as :func:`joints_along` gives them.
        mean_pressure: P0 above ambient [Pa].
    """
    k, p0 = robot_coefficients(robot), jnp.asarray(mean_pressure)

    def command(angle: Array, velocity: Array, acceleration: Array) -> Array:
        torque = robot.arm.torque(angle, velocity, acceleration)
        pressure = robot.ambient_pressure + p0 * jnp.ones(4)
        for _ in range(ROUNDS):
            friction = _thread_torque(robot, angle, velocity, pressure) * jnp.sign(velocity)
            difference = pressure_difference(k, p0, angle, torque + friction)
            pressure = robot.ambient_pressure + p0 + jnp.clip(difference, -p0, p0) @ PULLS
        return pressure

    return jax.vmap(command)(*joints)


def robot_coefficients(robot: Scara) -> Coefficients:
    """K1, K2, K3 of either joint of the robot."""
    return coefficients(robot.muscle, robot.sprocket_radius, robot.initial_contraction)


def _thread_torque(robot: Scara, angle: Array, velocity: Array, pressure: Array) -> Array:
    """Limit of the thread friction of each joint [N m]."""
    middle = robot.initial_contraction * robot.muscle.initial_length
    signals = Signals(
        ambient_pressure=robot.ambient_pressure,
        pressure=pressure,
        muscle=robot.muscle,
        contraction=middle + robot.sprocket_radius * angle @ PULLS,
        contraction_velocity=robot.sprocket_radius * velocity @ PULLS,
        position=angle,
        velocity=velocity,
    )
    limit = friction_limit(robot.effects, MUSCLE_FORCE, signals) * jnp.ones(4)
    return robot.sprocket_radius * np.abs(PULLS) @ limit
