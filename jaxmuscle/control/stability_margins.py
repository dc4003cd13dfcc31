"""How far a loop is from instability: the machine linearised and sampled, the controller as it is."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Complex, Float
from numpy.typing import NDArray

from jaxmuscle._linalg import solve
from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis import equilibrium
from jaxmuscle.control.channel_model import ChannelModel, sampled_model, without_dry_friction
from jaxmuscle.control.digital import digital_controllers
from jaxmuscle.control.feedback import Attached, feedback_on
from jaxmuscle.control.sliding_mode import Reference
from jaxmuscle.errors import InputError

POINTS, LOWEST = 300, 1e-4
"""Frequencies at which a loop is looked at, from this share of the highest that samples show."""


class Margins(eqx.Module):
    r"""Margins of a loop L (Åström and Murray, Feedback Systems, 2008, section 9.3).

    Attributes:
        stable: whether the closed loop is stable; if not, the others mean nothing.
        modulus: :math:`s_m = \min_ω |1 + L|`, the distance from the critical point.
        sensitivity: :math:`M_s = 1/s_m`, the largest factor by which a disturbance is made worse.
        gain: factor by which L may grow at most; infinite where it may grow without end.
        phase: by which L may lag more [rad]; infinite where its size is nowhere one at :func:`frequencies`.
    """

    stable: bool
    modulus: float
    sensitivity: float
    gain: float
    phase: float


def frequencies(step: float) -> Float[np.ndarray, " points"]:
    """Where a loop of a sampling step is looked at [rad/s]."""
    return np.geomspace(LOWEST, 1.0, POINTS) * np.pi / step


def machine_response(
    actuator: AbstractActuator, step: float, attached: Attached, about: float = 0.0
) -> tuple[ChannelModel, Complex[np.ndarray, " points"]]:
    """A machine at rest under an output of a controller, linearised; its response at :func:`frequencies`.

    Dry friction, which holds a linearised machine, is left out; a delay of the command is not.

    Raises:
        InputError: a controller with a clock of its own, whose loop is not the same from sample to sample.
    """
    if digital_controllers(attached.controller):
        raise InputError(
            "margins: a DigitalController does not act at every sample; linearise the controller within it "
            "at its own sample time, margins(actuator, digital.controller, step=period), on an actuator with "
            "its delay, with_effects(command_delay=jaxmuscle.effects.CommandDelay(delay))"
        )
    smooth = without_dry_friction(actuator)
    acts = Actuation(attached.rest, attached.direction, attached.lowest, attached.highest)
    point = equilibrium(smooth, acts.rest + acts.direction * about)
    model = sampled_model(smooth, step, attached.reading, acts, point)
    z = np.exp(1j * frequencies(step) * step)
    inner = z[:, None, None] * np.eye(len(model.a)) - model.a
    response = np.linalg.solve(inner, np.broadcast_to(model.b[:, None], (len(z), len(model.b), 1)))[..., 0]
    return model, response @ model.c


@eqx.filter_jit
def _linearised(controller: Any, rest: ArrayLike, step: float, rates: bool) -> tuple[Array, ...]:
    """A, B, C, D of a controller, from a reading about its rest to the output."""
    moving, still = eqx.partition(jax.tree.map(jnp.asarray, controller.start()), eqx.is_inexact_array)
    start, unravel = ravel_pytree(moving)
    here = jnp.asarray(rest, dtype=float)
    told: Any = here, jnp.zeros(()), jnp.zeros(())
    wanted = Reference(*told) if rates else here

    def sample(both: Array) -> Array:
        state = eqx.combine(unravel(both[:-1]), still)
        after, output = controller.update(state, wanted, here + both[-1], jnp.asarray(step))
        return jnp.append(ravel_pytree(eqx.filter(after, eqx.is_inexact_array))[0], output)

    slopes = jax.jacfwd(sample)(jnp.append(start, 0.0))
    return slopes[:-1, :-1], slopes[:-1, -1], slopes[-1, :-1], slopes[-1, -1]


def loop_response(
    controller: Any, response: Complex[Array, " points"], rest: ArrayLike, step: float, rates: bool = False
) -> Complex[Array, " points"]:
    """L, of a controller of one reading and a machine's response; differentiable by the controller's gains.

    Args:
        rest: reading about which both are linearised.
        rates: whether the controller follows a :class:`~jaxmuscle.control.Reference`.
    """
    a, b, c, d = _linearised(controller, rest, step, rates)
    if not len(b):
        return -response * d

    def of(z: Array) -> Array:
        return c @ solve(z * jnp.eye(len(b)) - a, b.astype(z.dtype)) + d

    return -response * jax.vmap(of)(jnp.exp(1j * frequencies(step) * step))


def sensitivity(loop: Complex[Array, " points"]) -> Float[Array, ""]:
    """M_s of a loop."""
    return jnp.max(1 / jnp.abs(1 + loop))


def margins(
    actuator: AbstractActuator,
    controller: Any,
    step: float,
    *,
    about: float = 0.0,
    rates: bool = False,
    **settings: ArrayLike,
) -> Margins:
    """Stability margins of a controller on a rig's channel: both linearised, without dry friction.

    Args:
        controller: of one reading, as :func:`feedback_on` takes it, or attached.
        step: sampling step of the loop [s].
        about: output at which the machine rests.
        rates: whether the controller follows a :class:`Reference`.
        settings: of the rig's `actuation`, as for :func:`feedback_on`, where it is not attached.

    Raises:
        InputError: as :func:`feedback_on` and :func:`channel_model`.
    """
    own = isinstance(controller, Attached)
    attached = controller if own else feedback_on(actuator, controller, **settings)
    inner = attached.controller
    model, response = machine_response(actuator, step, attached, about)
    loop = np.asarray(loop_response(inner, jnp.asarray(response), model.rest, step, rates))
    size, angle = np.abs(loop), np.unwrap(np.angle(loop))
    through = size[:-1] >= 1
    crossing = np.flatnonzero(through != (size[1:] >= 1))
    phases = [_angle_between(angle[crossing + side]) for side in (0, 1)]
    real, imaginary = np.real(loop), np.imag(loop)
    negative = np.flatnonzero(np.diff(np.signbit(imaginary)) & (real[:-1] < 0))
    # At the highest frequency, where outputs alternate, a loop is real.
    sizes = np.abs(np.concatenate([real[negative], real[negative + 1], real[-1:][real[-1:] < 0]]))
    largest = sizes[sizes < 1].max(initial=0.0)
    most = float(sensitivity(jnp.asarray(loop)))
    return Margins(
        stable=is_stable(model, inner, step, rates),
        modulus=1 / most,
        sensitivity=most,
        gain=float(1 / largest) if largest > 0 else np.inf,
        phase=float(np.concatenate(phases).min(initial=np.inf)),
    )


def _angle_between(angles: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """Distance of angles from the negative real axis."""
    return np.abs(np.mod(angles, 2 * np.pi) - np.pi)


def is_stable(model: ChannelModel, controller: Any, step: float, rates: bool = False) -> bool:
    """Whether all poles of the closed loop from sample to sample are within the unit circle.

    Args: as of :func:`loop_response`.
    """
    return spectral_radius(model, controller, step, rates) < 1


def spectral_radius(model: ChannelModel, controller: Any, step: float, rates: bool = False) -> float:
    """Size of the largest pole of the closed loop, from sample to sample: by how much a deviation that lasts
    grows; infinite where one is no number.

    Args: as of :func:`loop_response`.
    """
    a, b, c, d = (np.asarray(part) for part in _linearised(controller, model.rest, step, rates))
    kept = _acting(a, b, c)
    a, b, c = a[kept][:, kept], b[kept], c[kept]
    closed = np.block(
        [
            [model.a + d * np.outer(model.b, model.c), np.outer(model.b, c)],
            [np.outer(b, model.c), a],
        ]
    )
    if not np.isfinite(closed).all():
        return np.inf
    return float(np.abs(np.linalg.eigvals(closed)).max())


def _acting(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Which states of a controller the reading moves and the output depends on: no integral without gain."""
    linked = (a != 0).astype(float)
    reached, seen = b != 0, c != 0
    for _ in range(len(b)):
        reached = reached | (linked @ reached > 0)
        seen = seen | (linked.T @ seen > 0)
    return reached & seen
