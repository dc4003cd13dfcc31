"""Linear-quadratic controller with an observer and an integral (LQG, LQI), designed from a linearised rig."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_discrete_are

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis import OperatingPoint
from jaxmuscle.control.channel_model import channel_model
from jaxmuscle.control.pid import integrated
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Vector = Float[Array, " states"]
Matrix = NDArray[np.float64]


class Estimated(eqx.Module):
    """State of the controller: integral of the error, estimated state of the machine about rest, the last
    reference, and whether there has been one.
    """

    integral: Scalar
    estimate: Vector
    target: Scalar
    begun: Bool[Array, ""]


class LinearQuadratic(eqx.Module):
    r"""State feedback with an observer.

    .. math::
        u &= N (r - y_0) + N_v \dot r - K \hat x + K_i \int (r - y)\,dt \\
        \hat x &= x^- + L (y - y_0 - C x^-), \quad x^-_{next} = A \hat x + B u

    of one reading y and one output u, about the operating point of the design. A and B are those of the
    sampling step of the design, which the loop has to have too. :func:`linear_quadratic` makes it. While the
    command is beyond its limits the integral waits, and the observer is told the output that was given. The
    rate of the reference is its backward difference, zero at the first sample.
    """

    of_one_number: ClassVar = True
    gains: ClassVar = ("feedback", "integral", "ahead", "ahead_rate")
    feedback: Vector = parameter("", "gains K of the states")
    integral: Scalar = parameter("{input}/({output} s)", "gain K_i of the integrated error", nonnegative=True)
    ahead: Scalar = parameter("{input}/{output}", "gain N of the reference")
    observer: Vector = parameter("", "gains L of the observer")
    a: Float[Array, "states states"] = parameter("", "A, from sample to sample")
    b: Vector = parameter("", "B, from sample to sample")
    c: Vector = parameter("", "C")
    rest: Scalar = parameter("{output}", "reading y0 at the operating point")
    ahead_rate: Scalar = parameter("{input} s/{output}", "gain N_v of the reference's rate", default=0.0)

    def start(self) -> Estimated:
        """At rest at the operating point."""
        return Estimated(jnp.zeros(()), jnp.zeros_like(self.b), jnp.zeros(()), jnp.asarray(False))

    def update(
        self, state: Estimated, reference: Scalar, measured: Scalar, step: float | Scalar
    ) -> tuple[Estimated, Scalar]:
        """The state after a sample of `step` seconds, and the output u until the next."""
        about = measured - self.rest
        here = state.estimate + self.observer * (about - self.c @ state.estimate)
        integral = state.integral + step * self.integral * (reference - measured)
        target = jnp.asarray(reference, dtype=float)
        rate = jnp.where(state.begun, (target - state.target) / step, 0.0)
        output = self.ahead * (target - self.rest) + self.ahead_rate * rate - self.feedback @ here + integral
        return Estimated(integral, self.a @ here + self.b * output, target, jnp.asarray(True)), output

    def without_windup(
        self, before: Estimated, after: Estimated, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> Estimated:
        """The state after a sample whose output is limited."""
        integral = integrated(before.integral, after.integral, output, lowest, highest)
        given = jnp.clip(output, lowest, highest)
        estimate = after.estimate + self.b * (given - output)
        return Estimated(integral, estimate, after.target, after.begun)


def linear_quadratic(
    actuator: AbstractActuator,
    step: float,
    *,
    error: float,
    effort: float,
    noise: float,
    integral_time: float | None = None,
    disturbance: float | None = None,
    ramps: bool = False,
    point: OperatingPoint | None = None,
    **settings: ArrayLike,
) -> LinearQuadratic:
    r"""A controller of a rig's channel that is optimal for the rig linearised about a point of rest.

    .. math:: \sum (y/e)^2 + (u/f)^2 + (z/(e\,T_i))^2

    is made least by K and K_i, with e the `error`, f the `effort` and z the integral of y (Åström and
    Wittenmark, Computer-Controlled Systems, 3rd ed. 1997, sections 11.2 and 11.4); L is that of the Kalman
    filter, and N leaves no error at rest. Dry friction holds a linearised machine: give one without it,
    ``actuator.without_effects("load_friction")``, where the joint is to move.

    Args:
        step: sampling step of the loop [s].
        error, effort: sizes of reading and output that count alike (SI).
        noise: standard deviation of the reading's sensor (SI).
        integral_time: T_i [s]; no integral when `None`, which leaves what a disturbance does.
        disturbance: standard deviation of what adds to u from sample to sample, `effort` when `None`.
        ramps: whether N_v is what leaves no error behind a reference that moves steadily, in place of zero;
            a step of the reference is then answered with a kick.
        point: where the rig is linearised, at rest under an output of zero when `None`.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, a size that is not above zero, no point of rest, a reading that
            jumps with the command, or a rig that no feedback of this reading stabilises.
    """
    sizes = {"step": step, "error": error, "effort": effort, "noise": noise}
    others = {"integral_time": integral_time, "disturbance": disturbance}
    sizes |= {name: size for name, size in others.items() if size is not None}
    for name, size in sizes.items():
        if not 0 < size < np.inf:
            raise InputError(f"{name}: expected a number above zero (SI); got {size!r}")
    a, b, c, rest, _ = channel_model(actuator, step, point, delayed=False, **settings)
    pushed = np.outer(b, b) * (effort if disturbance is None else disturbance) ** 2
    try:
        feedback, slow = regulator(a, b, c, step, error, effort, integral_time)
        spread = solve_discrete_are(a.T, c[:, None], pushed, np.array([[noise**2]]))
    except LinAlgError as failed:
        raise InputError(
            f"no feedback of the {actuator.declared_channel().reading} stabilises rig {actuator.rig!r} about "
            f"this point: {failed}"
        ) from failed
    observer = spread @ c / (c @ spread @ c + noise**2)
    still = np.eye(len(a)) - a + np.outer(b, feedback)
    settled = np.linalg.solve(still, b)
    ahead = 1 / (c @ settled)
    # Of (N + N_v (1 - 1/z)/h) G(z), with G(1) = 1/N, the slope at z = 1 is the lag behind a ramp.
    rate = step * ahead**2 * (c @ np.linalg.solve(still, settled)) if ramps else 0.0
    numbers = feedback, slow, ahead, observer, a, b, c, rest, rate
    return LinearQuadratic(*map(jnp.asarray, numbers))


def regulator(
    a: Matrix, b: Matrix, c: Matrix, step: float, error: float, effort: float, integral_time: float | None
) -> tuple[Matrix, float]:
    """K and K_i of :func:`linear_quadratic`."""
    cost = np.outer(c, c) / error**2
    if integral_time is None:
        solved = solve_discrete_are(a, b[:, None], cost, np.array([[effort**-2]]))
        return b @ solved @ a / (b @ solved @ b + effort**-2), 0.0
    size = len(a)
    whole, push = np.zeros((size + 1, size + 1)), np.append(b, 0.0)
    whole[:size, :size], whole[size, :size], whole[size, size] = a, step * c, 1.0
    both = np.zeros_like(whole)
    both[:size, :size], both[size, size] = cost, (error * integral_time) ** -2
    solved = solve_discrete_are(whole, push[:, None], both, np.array([[effort**-2]]))
    gains = push @ solved @ whole / (push @ solved @ push + effort**-2)
    return gains[:size], float(gains[size])
