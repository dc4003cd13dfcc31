"""Linear second-order model of a joint, identified from its answer to a command."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from jaxmuscle._linalg import propagator
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

Series = Float[Array, " samples"]


class SecondOrder(eqx.Module):
    r""":math:`\ddot θ + a_1 \dot θ + a_2 θ = b\,ΔU`, [T] 28.

    :math:`a_1 = 2ζω`, :math:`a_2 = ω^2`, :math:`b = G ω^2`; ΔU in the unit of the command.
    """

    natural_frequency: Scalar = parameter("rad/s", "natural frequency ω", positive=True)
    damping_ratio: Scalar = parameter("", "damping ratio ζ", positive=True)
    gain: Scalar = parameter("rad/{command}", "static gain G")

    @property
    def coefficients(self) -> tuple[Scalar, Scalar, Scalar]:
        """a1 [1/s], a2 [1/s^2] and b [rad/s^2 per unit of the command]."""
        square = self.natural_frequency**2
        return 2 * self.damping_ratio * self.natural_frequency, square, self.gain * square

    def response(
        self, command: Series, step: ArrayLike, angle: ArrayLike = 0.0, velocity: ArrayLike = 0.0
    ) -> Series:
        """Angle at the samples [rad], exact for a command that is held from one to the next.

        Args:
            command: ΔU at the samples.
            step: sampling step [s].
            angle, velocity: at the first sample [rad, rad/s].
        """
        # States θ and θ'/ω: entries of one size, so that no digits are lost.
        omega = jnp.asarray(self.natural_frequency)
        turning = omega * jnp.array([[0.0, 1.0], [-1.0, 0.0]])
        damping = omega * self.damping_ratio * jnp.array([[0.0, 0.0], [0.0, -2.0]])
        held = propagator(turning + damping, jnp.asarray(step))

        def advance(state: Array, u: Array) -> tuple[Array, Array]:
            return held.whole @ state + held.first[:, 1] * (omega * self.gain * u), state[0]

        start = jnp.stack([jnp.asarray(angle, dtype=float), jnp.asarray(velocity) / omega])
        return jax.lax.scan(advance, start, command)[1]


@dataclasses.dataclass(frozen=True)
class Identified:
    """The identified system, its standard deviations (ω, ζ, G) and the root mean square misfit [rad]."""

    system: SecondOrder
    std: np.ndarray
    rmse: float


STARTS = ((0.3, 0.5), (1.0, 0.5), (3.0, 0.5), (1.0, 2.0), (3.0, 2.0))
"""Natural frequency, in units of 2π/(length of the recording)·5, and damping from which fits start."""


def identify(command: ArrayLike, angle: ArrayLike, step: float) -> Identified:
    """Least squares of the simulated angle over ω, ζ and the gain, started from rest at the first angle.

    Args:
        command: ΔU at the samples, held from one to the next, as deviation from the command under which
            the joint rested at first.
        angle: measured angle [rad], deviation from the first one is fitted.
        step: sampling step [s].

    Raises:
        InputError: fewer than ten samples, lengths that differ, a command or angle that never changes.
    """
    # Here, as the minimiser's folder loads machines, and these load this module.
    from jaxmuscle.optimization.least_squares import least_squares, with_jacobian

    u, measured = np.asarray(command, dtype=float), np.asarray(angle, dtype=float)
    _check(u, measured)
    moved = measured - measured[0]
    scale, size = np.abs(u).max(), np.abs(moved).max()
    data = jnp.asarray(u / scale), jnp.asarray(moved / size), jnp.asarray(step)
    base = 10 * np.pi / (len(u) * step)
    gain = moved[-1] / size / (u[-1] / scale) if u[-1] else 1.0
    starts = np.array([[np.log(base * w), np.log(zeta), gain] for w, zeta in STARTS])
    best = least_squares(with_jacobian(_residuals, data), starts)
    units = np.array([np.exp(best.x[0]), np.exp(best.x[1]), size / scale])
    omega, zeta, gain = units * [1.0, 1.0, best.x[2]]
    system = SecondOrder(*map(jnp.asarray, (omega, zeta, gain)))
    rmse = size * np.sqrt(2 * best.cost / len(u))
    return Identified(system, np.sqrt(np.diag(best.covariance)) * units, float(rmse))


def _residuals(z: Array, data: tuple[Series, Series, Scalar]) -> Series:
    command, moved, step = data
    return SecondOrder(jnp.exp(z[0]), jnp.exp(z[1]), z[2]).response(command, step) - moved


def _check(command: np.ndarray, angle: np.ndarray) -> None:
    if command.shape != angle.shape or command.ndim != 1 or len(command) < 10:
        raise InputError(
            "expected at least ten samples of one command and one angle, as many of each; "
            f"got shapes {command.shape} and {angle.shape}"
        )
    for name, values in (("command", command), ("angle", angle)):
        if not np.isfinite(values).all():
            raise InputError(f"the {name} has values that are not finite; leave those samples out")
    if not np.abs(command).max() or not np.ptp(angle):
        raise InputError("nothing to identify: the command is zero throughout, or the angle never changes")
