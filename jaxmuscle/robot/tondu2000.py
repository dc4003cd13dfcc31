"""Robot of Tondu and Lopez [T] as published, and the commands that make it follow a motion without
feedback.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.actuators.joint import Joint
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.components.antagonist import Coefficients, coefficients, pressure_difference
from jaxmuscle.effects import ThreadFriction
from jaxmuscle.effects.slip import friction_limit
from jaxmuscle.robot.arm import Arm, rod
from jaxmuscle.robot.scara import PULLS, Scara
from jaxmuscle.robot.trajectory import Motion
from jaxmuscle.signals import MUSCLE_FORCE, Signals

MEAN_PRESSURE = 2.5e5
"""Gauge pressure P0 about which the muscles of a joint are commanded [Pa]."""
LARGEST_PRESSURE = 5e5
"""Gauge pressure 2 P0, at which the other muscle is empty [Pa]."""
SPROCKET_RADIUS = 0.015
"""Radius R of the sprockets [m]."""
INITIAL_CONTRACTION = 0.1
"""Contraction ratio ε0 of both muscles at angle 0 [-]."""
FRICTION = {"static_coefficient": 0.015, "kinetic_coefficient": 0.105, "velocity_constant": 0.15}
"""f_s/n, f_k/n [-] and the velocity constant [m/s] of the threads."""


def robot_muscle(initial_length: float = 0.31) -> McKibben:
    """Muscle of the robot: r0 = 0.7 cm, 23°, k = 1.25, l0 = 31 cm (34 cm in one figure)."""
    return McKibben(*map(jnp.asarray, (initial_length, 0.007, math.radians(23), 1.25)))


def robot_arm(payload: float = 0.0) -> Arm:
    """Links of 40 cm with the inertia that the paper's loads imply; payload [kg].

    Three statements fix it: 1.5 kg are 30 % of the weight of both links (5 kg), of which the second has
    0.6 kg; and 0.5 kg at the tip add 50 % to the largest inertia of joint 1 (0.64 kg m²) and 150 % to
    that of joint 2 (0.0533 kg m²). Uniform rods with a point mass at their ends (joint 2 and the tool) meet
    all of them. The scanned "about 1 kg" of link 1 agrees with neither statement and is left aside.
    """
    load, span = 0.5, 0.4
    second_inertia, first_inertia = load * span**2 / 1.5, load * (2 * span) ** 2 / 0.5
    second_mass = 0.6
    first_mass = 1.5 / 0.3 - second_mass
    second = rod(span, *_shares(second_mass, second_inertia, span))
    straight = second_mass * span**2 + 2 * span * float(second.first_moment) + second_inertia
    first = rod(span, *_shares(first_mass, first_inertia - straight, span))
    return Arm(first, second, jnp.asarray(payload))


def _shares(mass: float, inertia: float, length: float) -> tuple[float, float]:
    """Mass of the rod and mass at its end that together have an inertia about the other end."""
    along = 1.5 * (mass - inertia / length**2)
    return along, mass - along


def robot_regulator() -> PressureRegulator:
    """Pressure converter; the paper calls it quick beside the muscle and gives no number: 12 Hz, 0.85."""
    return PressureRegulator(jnp.asarray(12.0), jnp.asarray(0.85))


def robot(payload: float = 0.0, *, friction: bool = True) -> Scara:
    """The two-joint robot: sprockets of 1.5 cm, ε0 = 0.1, with the paper's thread friction unless declined.

    Args:
        payload: mass at the tip [kg]; the paper's robustness test has 0, 0.5, 1 and 1.5.
    """
    bare = Scara(
        regulator=robot_regulator(),
        muscle=robot_muscle(),
        arm=robot_arm(payload),
        sprocket_radius=jnp.asarray(SPROCKET_RADIUS),
        initial_contraction=jnp.asarray(INITIAL_CONTRACTION),
    )
    return bare.with_effects(thread_friction=thread_friction()) if friction else bare


def robot_joint(inertia: float | Array, *, friction: bool = True) -> Joint:
    """One joint of the robot alone, with a moment of inertia [kg m^2]."""
    bare = Joint(
        regulator=robot_regulator(),
        muscle=robot_muscle(),
        inertia=jnp.asarray(inertia),
        sprocket_radius=jnp.asarray(SPROCKET_RADIUS),
        initial_contraction=jnp.asarray(INITIAL_CONTRACTION),
    )
    return bare.with_effects(thread_friction=thread_friction()) if friction else bare


def thread_friction() -> ThreadFriction:
    """The friction of the braid that the paper fitted."""
    return ThreadFriction(**{name: jnp.asarray(value) for name, value in FRICTION.items()})


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
