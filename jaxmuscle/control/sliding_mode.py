"""Sliding-mode (variable-structure) controller of [T] for a joint that was identified as second order."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis import equilibrium, linearise
from jaxmuscle.control.channel_model import without_dry_friction
from jaxmuscle.control.pid import check_signs, smoothed
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Value = Float[Array, ""]

BAR = 1e5


class JointModel(eqx.Module):
    r"""Identified joint, [T] 28, open loop: :math:`\ddot θ + a_1 \dot θ + a_2 θ = b\,ΔU`."""

    damping: Scalar = parameter("1/s", "coefficient a1 of the velocity", nonnegative=True)
    stiffness: Scalar = parameter("1/s^2", "coefficient a2 of the angle", nonnegative=True)
    gain: Scalar = parameter("rad/(s^2 Pa)", "acceleration b per pressure difference", positive=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a coefficient whose sign is wrong."""
        check_signs(self)


def joint_model(actuator: AbstractActuator, **settings: ArrayLike) -> JointModel:
    r"""The :class:`JointModel` of a rig linearised at rest under an output of zero, without dry friction.

    What else moves than angle and velocity, the pressures, is taken to follow at once (singular
    perturbation): of :math:`\dot x = A x + B u` with the others f their equilibrium is put into the two.

    Args:
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel or without an angle and its velocity; one that does not come to
            rest, or would leave it by itself; one that the output does not turn the way in which the angle
            grows.
    """
    smooth = without_dry_friction(actuator)
    acts = smooth.actuation(**settings)
    linear = linearise(smooth, equilibrium(smooth, acts.rest))
    if not {"angle", "angular_velocity"} <= set(linear.states):
        raise InputError(
            f"joint_model: expected a rig with the states angle and angular_velocity; {actuator.rig!r} has "
            f"{', '.join(linear.states)}"
        )
    a, b = np.asarray(linear.a), np.asarray(linear.b) @ np.atleast_1d(np.asarray(acts.direction))
    slow = [linear.states.index(name) for name in ("angle", "angular_velocity")]
    fast = [place for place in range(len(a)) if place not in slow]
    follows = a[slow[1], fast] @ np.linalg.inv(a[np.ix_(fast, fast)])
    stiffness, damping = follows @ a[np.ix_(fast, slow)] - a[slow[1], slow]
    gain = b[slow[1]] - follows @ b[fast]
    size = np.abs(follows) @ np.abs(a[np.ix_(fast, slow)]) + np.abs(a[slow[1], slow])
    for name, value, much in zip(("stiffness", "damping"), (stiffness, damping), size, strict=True):
        # Rounding leaves a coefficient of nothing on either side of zero.
        if value < -1e-9 * much:
            raise InputError(
                f"joint_model: expected a joint that returns to rest by itself; its {name} is {value:.4g} "
                f"(negative: it falls over, or is driven by its own motion)"
            )
    numbers: Any = max(damping, 0.0), max(stiffness, 0.0), gain
    return JointModel(*numbers)


class Reference(NamedTuple):
    """Wanted angle [rad], velocity [rad/s] and acceleration [rad/s²]."""

    angle: Value
    velocity: Value
    acceleration: Value


def target_of(reference: Any) -> Any:
    """What the reading is to be, of a reference: the angle of a :class:`Reference`."""
    return reference.angle if isinstance(reference, Reference) else reference


class Sliding(eqx.Module):
    """State of the controller: integrator [Pa], last error [rad], its filtered rate and second rate."""

    integral: Value
    error: Value
    rate: Value
    second: Value


class SlidingMode(eqx.Module):
    r"""Variable-structure controller, [T] 26, 28 and 29: :math:`ΔU = ΔU_{eq} + ΔU_d + ΔU_i`, e = θ_d - θ.

    .. math::
        s &= \dot e + C e + C' \ddot e \quad \text{(26), improved by the last term} \\
        ΔU_{eq} &= \tfrac1b [\ddot θ_d + a_1 \dot θ_d + a_2 θ_d - a_2 e + (C - a_1) \dot e] \quad (29) \\
        ΔU_d &= (α |e| + β |\dot e| + γ)\,\mathrm{sat}(s / w)

    ΔU_d (Harashima) is limited to ±`limit`; its sign is linear within w of the sliding line. The integrator
    acts while \|e\| < `integral_band` and is limited to ±`integral_limit`. With ΔU_eq alone and the
    identified joint the error obeys ë + C ė = 0. Rates are differences of the error, smoothed.

    The six numbers that [T] tunes are C, C', α, β, γ and the integrator's gain; it gives C = 5 to 10 and
    C' = 0.01 to 0.05, a sampling period of 2 ms, and the limits that are the defaults here.
    """

    reads: ClassVar = "rad"
    gives: ClassVar = "Pa"
    gains: ClassVar = ("slope", "curvature", "per_error", "per_rate", "least", "integral_gain")
    joint: JointModel
    slope: Scalar = parameter("1/s", "slope C of the sliding line", positive=True)
    curvature: Scalar = parameter("s", "weight C' of the second rate", default=0.0, nonnegative=True)
    per_error: Scalar = parameter("Pa/rad", "α", default=0.0, nonnegative=True)
    per_rate: Scalar = parameter("Pa s/rad", "β", default=0.0, nonnegative=True)
    least: Scalar = parameter("Pa", "γ", default=0.0, nonnegative=True)
    integral_gain: Scalar = parameter("Pa/(rad s)", "gain of the integrator", default=0.0, nonnegative=True)
    boundary: Scalar = parameter("rad/s", "half-width w of the linear sign", default=0.1, positive=True)
    limit: Scalar = parameter("Pa", "largest ΔU_d", default=BAR, positive=True)
    integral_limit: Scalar = parameter("Pa", "largest ΔU_i", default=0.8 * BAR, positive=True)
    integral_band: Scalar = parameter(
        "rad", "error below which it integrates", default=jnp.pi / 18, positive=True
    )
    smoothing: Scalar = parameter("s", "time constant of the rates", default=0.01, nonnegative=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a gain, a limit or a time constant whose sign is wrong."""
        check_signs(self)

    def start(self, error: float | Array = 0.0) -> Sliding:
        """At rest, with an error that has not changed."""
        zero = jnp.zeros(())
        return Sliding(zero, jnp.asarray(error, dtype=float), zero, zero)

    def equivalent(self, wanted: Reference, error: Value, rate: Value) -> Value:
        """ΔU_eq [Pa], [T] 29: what keeps the identified joint on the sliding line (26)."""
        joint = self.joint
        held = wanted.acceleration + joint.damping * wanted.velocity + joint.stiffness * wanted.angle
        back = -joint.stiffness * error + (self.slope - joint.damping) * rate
        return (held + back) / joint.gain

    def switching(self, error: Value, rate: Value, second: Value) -> Value:
        """ΔU_d [Pa]: towards the sliding line."""
        line = rate + self.slope * error + self.curvature * second
        size = self.per_error * jnp.abs(error) + self.per_rate * jnp.abs(rate) + self.least
        return jnp.clip(size * jnp.clip(line / self.boundary, -1.0, 1.0), -self.limit, self.limit)

    def update(
        self, state: Sliding, wanted: Reference, angle: Value, step: float | Value
    ) -> tuple[Sliding, Value]:
        """The state after a sample of `step` seconds, and ΔU [Pa] until the next: P0 ± ΔU for the muscles.

        Raises:
            InputError: `wanted` is no :class:`Reference`.
        """
        if not isinstance(wanted, Reference):
            got = "an array" if isinstance(wanted, Array) else type(wanted).__name__
            raise InputError(
                "SlidingMode: expected a control.Reference (angle, velocity and acceleration) as the "
                f"reference; got {got}; zeros do for the rates of a target at rest"
            )
        error = wanted.angle - angle
        rate = smoothed(state.rate, (error - state.error) / step, self.smoothing, step)
        second = smoothed(state.second, (rate - state.rate) / step, self.smoothing, step)
        near = jnp.abs(error) < self.integral_band
        grown = state.integral + jnp.where(near, self.integral_gain * step * error, 0.0)
        integral = jnp.clip(grown, -self.integral_limit, self.integral_limit)
        command = self.equivalent(wanted, error, rate) + self.switching(error, rate, second) + integral
        return Sliding(integral, error, rate, second), command
