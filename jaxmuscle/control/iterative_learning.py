"""Iterative learning control: the same reference again and again, the command better from repetition to
repetition (Bristow, Tharayil and Alleyne, IEEE Control Systems Magazine 26(3), 2006).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.control.channel_model import ChannelModel
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.simulation.simulate import simulate

Series = Float[Array, " samples"]


class LearningLaw(Protocol):
    """What a repetition teaches: an object with this method."""

    def change(self, error: Series) -> Series:
        """The change of the output, from the errors of the repetition before at all samples."""
        ...


class ProportionalLearning(eqx.Module):
    r"""P-type law, Bristow et al. (2006): :math:`Δu_k = γ\,e_{k+m}`.

    It converges where :math:`|1 - γ h_m| < 1`, h_m the first sample of the impulse response that is not zero,
    and then may still pass through large errors: :func:`contraction` below one excludes that.

    Attributes:
        lead: m, samples after which an output shows.
    """

    gain: Scalar = parameter("{input}/{output}", "learning gain γ", nonnegative=True)
    lead: int = eqx.field(static=True, default=1)

    def change(self, error: Series) -> Series:
        """The change of the output; none at the last samples, of which no error is known."""
        later = jnp.concatenate([error[self.lead :], jnp.zeros(self.lead)])
        return self.gain * later


class InverseLearning(eqx.Module):
    r"""Law by a model's regularised inverse, :math:`Δu = (G^T G/ε^2 + I/f^2)^{-1} G^T e/ε^2`.

    Quadratically optimal: it makes :math:`\sum (e/ε)^2 + (Δu/f)^2` of the next repetition least, G the lifted
    model (Bristow et al. 2006, "Quadratically Optimal Design"); the plain inverse of the model in the limit
    of large f. On the model every repetition lowers the error. :func:`inverse_learning` makes it.
    """

    matrix: Float[Array, "samples samples"]

    def change(self, error: Series) -> Series:
        """The change of the output."""
        return self.matrix @ error


def lifted(model: ChannelModel, samples: int) -> Float[np.ndarray, "samples samples"]:
    """G, from the outputs of a repetition to the readings about rest at all samples; none at the first."""
    response = model.impulse(samples)
    late = np.subtract.outer(np.arange(samples), np.arange(samples))
    return np.where(late > 0, response[np.maximum(late - 1, 0)], 0.0)


def inverse_learning(model: ChannelModel, samples: int, *, error: float, effort: float) -> InverseLearning:
    """The law of a machine's linear model, as :func:`~jaxmuscle.control.channel_model` gives it.

    Args:
        samples: of a repetition.
        error, effort: sizes of an error and of a change of the output that cost alike (SI). The smaller the
            effort, the slower it learns, and the less a model that is not the machine matters.

    Raises:
        InputError: a size that is not above zero, fewer than two samples.
    """
    for name, size in (("error", error), ("effort", effort)):
        if not 0 < size < np.inf:
            raise InputError(f"inverse_learning: {name}: expected a number above zero (SI); got {size!r}")
    if samples < 2:
        raise InputError(f"inverse_learning: samples: expected at least two; got {samples}")
    g = lifted(model, samples) / error
    return InverseLearning(jnp.asarray(np.linalg.solve(g.T @ g + np.eye(samples) / effort**2, g.T) / error))


def contraction(law: LearningLaw, model: ChannelModel, samples: int) -> float:
    r"""Factor by which an error on the model shrinks at least from repetition to repetition.

    The largest singular value of :math:`I - G L`, after the first sample, which nothing can change: below
    one the root mean square error falls in every repetition (Bristow et al. 2006, monotonic convergence), on
    the model and without the smoothing and the limits of :func:`learn`.
    """
    taught = np.asarray(jax.vmap(law.change, out_axes=1)(jnp.eye(samples)))
    left = np.eye(samples) - lifted(model, samples) @ taught
    return float(np.linalg.norm(left[1:, 1:], 2))


class Learned(eqx.Module):
    """Repetitions of a plant; leading axis of repetitions.

    Attributes:
        outputs: of the controller, what the plant was given.
        readings: what it showed.
        errors: root mean squares of reference less reading.
    """

    outputs: Float[Array, "repetitions samples"]
    readings: Float[Array, "repetitions samples"]
    errors: Float[Array, " repetitions"]

    @property
    def output(self) -> Series:
        """The output of the repetition with the smallest error."""
        return self.outputs[jnp.argmin(self.errors)]


def learn(
    plant: Callable[[Series], Any],
    reference: ArrayLike,
    law: LearningLaw,
    *,
    repetitions: int = 10,
    first: ArrayLike = 0.0,
    smoothing: float = 0.0,
    limits: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
) -> Learned:
    r"""Repeat a reference: :math:`u_{j+1} = \mathrm{clip}(Q[u_j + Δu(e_j)])`, e reference less reading.

    Q passes slow parts only, with no shift in time: a first-order low pass over the samples and back. It
    keeps what the law cannot learn, noise and frequencies where the model is wrong, from growing.
    Differentiable where the plant is.

    Args:
        plant: outputs at the samples → readings there, always from the same state: a rig of your own, an
            oracle, or :func:`repeated` of a model.
        reference: wanted readings (SI), one a sample.
        law: what an error teaches.
        repetitions: how often the plant runs.
        first: outputs of the first repetition: one number, or one a sample.
        smoothing: time constant of Q in samples; none when 0.
        limits: lowest and highest output.

    Raises:
        InputError: a plant whose readings are not one a sample, or no numbers, with the repetition; a law
            whose change has another length; a number of repetitions below one, a negative smoothing.
    """
    wanted = jnp.asarray(reference, dtype=float)
    if wanted.ndim != 1 or len(wanted) < 2:
        raise InputError(f"learn: expected a reference of at least two samples; got shape {wanted.shape}")
    if repetitions < 1 or not 0 <= smoothing < np.inf:
        raise InputError(
            "learn: expected at least one repetition and a smoothing of 0 samples or more; got "
            f"{repetitions} and {smoothing}"
        )
    if jnp.shape(first) not in ((), wanted.shape):
        raise InputError(f"learn: first: expected one number, or {len(wanted)}; got shape {jnp.shape(first)}")
    output = jnp.clip(jnp.broadcast_to(jnp.asarray(first, dtype=float), wanted.shape), *limits)
    outputs, readings = [], []
    for number in range(repetitions):
        shown = _checked(plant(output), wanted.shape, f"repetition {number + 1}: readings of the plant")
        outputs.append(output)
        readings.append(shown)
        change = _checked(law.change(wanted - shown), wanted.shape, "change of the law")
        output = jnp.clip(_slow(output + change, smoothing), *limits)
    shown = jnp.stack(readings)
    return Learned(jnp.stack(outputs), shown, jnp.sqrt(jnp.mean((wanted - shown) ** 2, axis=1)))


def repeated(
    actuator: AbstractActuator,
    times: ArrayLike,
    start: Mapping[str, ArrayLike] | None = None,
    **settings: ArrayLike,
) -> Callable[[Series], Series]:
    """A model as the plant of :func:`learn`: outputs on the rig's control channel → its reading.

    Args:
        times: sampling instants [s].
        start: measured states at the first sample, as for :func:`jaxmuscle.simulate`.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.
    """
    channel, acts = actuator.declared_channel(), actuator.actuation(**settings)

    def plant(output: Series) -> Series:
        pushed = jnp.multiply.outer(output, acts.direction)
        command = jnp.clip(acts.rest + pushed, acts.lowest, acts.highest)
        return simulate(actuator, command, times, start=start).readings[channel.reading]

    return plant


def _checked(given: Any, shape: tuple[int, ...], what: str) -> Series:
    values = jnp.asarray(given, dtype=float)
    if values.shape != shape:
        raise InputError(f"learn: {what}: expected shape {shape}, one a sample; got {values.shape}")
    if not isinstance(values, jax.core.Tracer) and not bool(jnp.isfinite(values).all()):
        row = int(np.argmax(~np.isfinite(values)))
        raise InputError(f"learn: {what}: expected finite numbers; got {values[row]} in row {row}")
    return values


def _slow(values: Series, samples: float) -> Series:
    """A low pass over the samples and back, that begins at the first value each way."""
    if samples == 0:
        return values
    keep = samples / (samples + 1)

    def onward(before: Array, now: Array) -> tuple[Array, Array]:
        after = keep * before + (1 - keep) * now
        return after, after

    forth = jax.lax.scan(onward, values[0], values)[1]
    return jax.lax.scan(onward, forth[-1], forth, reverse=True)[1]
