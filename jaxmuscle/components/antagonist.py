"""Two equal muscles that pull a sprocket against each other, in closed form: antagonist section of [T].

Pressures are gauge pressures; a positive angle shortens muscle 1. The forms hold while both muscles pull.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmuscle.components.mckibben import McKibben
from jaxmuscle.parameters import Scalar

Value = Float[Array, "..."]


class Coefficients(NamedTuple):
    """K1, K2, K3 of the torque, each per pascal: [N m/Pa], [N m/(Pa rad)], [N m/(Pa rad^2)]."""

    drive: Scalar
    restoring: Scalar
    curvature: Scalar


def coefficients(muscle: McKibben, sprocket_radius: Value, initial_contraction: Value) -> Coefficients:
    r"""Coefficients of the torque of two muscles that share one constant end factor k.

    .. math:: K_1 = π r_0^2 R\,[a (1 - kε_0)^2 - b], \quad
              K_2 = π r_0^2 R\,2 a k (1 - kε_0) \frac{R}{l_0}, \quad
              K_3 = π r_0^2 R\,a k^2 \frac{R^2}{l_0^2}

    [T] 17 and 18, antagonist section; :math:`a = 3/\tan^2α_0`, :math:`b = 1/\sin^2α_0`.

    Args:
        sprocket_radius: R [m].
        initial_contraction: ε0, contraction ratio of both muscles at angle 0 [-].
    """
    a = 3 / jnp.tan(muscle.braid_angle) ** 2
    b = 1 / jnp.sin(muscle.braid_angle) ** 2
    k, turn = muscle.end_factor, sprocket_radius / muscle.initial_length
    scale = jnp.pi * muscle.initial_radius**2 * sprocket_radius
    shortened = 1 - k * initial_contraction
    return Coefficients(
        scale * (a * shortened**2 - b), scale * 2 * a * k * shortened * turn, scale * a * (k * turn) ** 2
    )


def torque(k: Coefficients, pressure_1: Value, pressure_2: Value, angle: Value) -> Value:
    r"""Torque on the joint [N m]: :math:`T = K_1 (P_1 - P_2) - K_2 (P_1 + P_2) θ + K_3 (P_1 - P_2) θ^2`.

    [T] 17 and 18, antagonist section (18: without the last term). Pressures [Pa], angle θ [rad].
    """
    difference = pressure_1 - pressure_2
    return (
        k.drive * difference
        - k.restoring * (pressure_1 + pressure_2) * angle
        + (k.curvature * difference * angle**2)
    )


def biceps_triceps_torque(
    largest: Value, stiffness: Value, biceps: Value, triceps: Value, angle: Value
) -> Value:
    r"""Hogan's torque of a natural joint: :math:`T = T_{max} (u_b - u_t) - K (u_b + u_t) θ`, [T] 19.

    The same structure as :func:`torque` without its last term: with u = P/P_max, T_max = K1 P_max and
    K = K2 P_max.

    Args:
        largest: T_max [N m].
        stiffness: K [N m/rad].
        biceps, triceps: u_b and u_t, normalised commands, 0 to 1.
        angle: θ [rad].
    """
    return largest * (biceps - triceps) - stiffness * (biceps + triceps) * angle


def static_gain(k: Coefficients, mean_pressure: Value) -> Value:
    r"""Open-loop gain :math:`G = K_1/(K_2 P_0)` of :math:`θ = G ΔP` [rad/Pa].

    [T] 21 solved for rest: the commands are :math:`P_{1,2} = P_0 ± ΔP`, :math:`T = 2 K_1 ΔP - 2 K_2 P_0 θ`;
    K3 is left out.
    """
    return k.drive / (k.restoring * mean_pressure)


def stiffness(k: Coefficients, mean_pressure: Value) -> Value:
    r"""Natural stiffness of the joint at rest in the middle, :math:`2 K_2 P_0` [N m/rad], [T] 21."""
    return 2 * k.restoring * mean_pressure


def stiffness_at(k: Coefficients, mean_pressure: Value, half_difference: Value, angle: Value) -> Value:
    r"""Slope of the restoring torque anywhere, :math:`-∂T/∂θ = 2 K_2 P_0 - 4 K_3 ΔP θ` [N m/rad]."""
    return stiffness(k, mean_pressure) - 4 * k.curvature * half_difference * angle


def stiffness_in_closed_loop(k: Coefficients, mean_pressure: Value, feedback_gain: Value) -> Value:
    r"""Stiffness :math:`2 K_2 P_0 + 2 K_1 g` when a controller answers deflections, :math:`ΔP = -g\,δθ`.

    [T], antagonist section: feedback stiffens the natural compliance. feedback_gain g [Pa/rad].
    """
    return stiffness(k, mean_pressure) + 2 * k.drive * feedback_gain


def equilibrium_angle(k: Coefficients, mean_pressure: Value, half_difference: Value) -> Value:
    r"""Angle at which the torque vanishes [rad], K3 included.

    .. math:: θ = \frac{2 K_1 ΔP}{K_2 P_0 + \sqrt{K_2^2 P_0^2 - 4 K_1 K_3 ΔP^2}}

    The root that grows from 0 with ΔP; to first order it is :func:`static_gain` times ΔP. NaN where the
    torque has no zero, which is beyond the range of any pair of muscles (:func:`joint_range`).
    """
    linear = k.restoring * mean_pressure
    root = jnp.sqrt(linear**2 - 4 * k.drive * k.curvature * half_difference**2)
    return 2 * k.drive * half_difference / (linear + root)


def pressure_difference(k: Coefficients, mean_pressure: Value, angle: Value, torque: Value) -> Value:
    r"""ΔP that gives a torque at an angle [Pa]: :math:`ΔP = (T + 2 K_2 P_0 θ)/(2 (K_1 + K_3 θ^2))`."""
    return 0.5 * (torque + stiffness(k, mean_pressure) * angle) / (k.drive + k.curvature * angle**2)


def joint_range(muscle: McKibben, sprocket_radius: Value, initial_contraction: Value) -> Value:
    r"""Largest angle to either side, at which one muscle is at its full length: :math:`ε_0 l_0/R` [rad]."""
    return initial_contraction * muscle.initial_length / sprocket_radius
