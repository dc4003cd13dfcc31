"""What a fit may move: paths, starting values, scales, bounds by transform, priors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.parameters import Parameter, parameters, replace

LINEAR, LOGARITHMIC, SOFT = 0, 1, 2
"""Transforms: unbounded, above zero, not below zero."""
CORNER = 0.01
"""Rounding of the transform at zero, in units of the scale, squared."""


class Free(eqx.Module):
    r"""A vector of parameters of a model and its map from unbounded coordinates z.

    Linear: θ = θ0 + s z. Above zero: θ = θ0 exp(s z / θ0). Not below zero: θ = s (q + √(q² + 4c))/2 with
    q = z + q0. At z = 0 each gives its start θ0 (the third no less than a hundredth of s). The arrays
    are data, so that one compiled fit serves any choice of starts, scales and free entries.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    start: Float[Array, " parameters"]
    scale: Float[Array, " parameters"]
    kind: Array
    prior_mean: Float[Array, " parameters"]
    prior_std: Float[Array, " parameters"]  # infinite without a prior

    def values(self, z: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """Parameters θ in SI at coordinates z."""
        linear = self.start + self.scale * z
        safe = jnp.where(self.start > 0, self.start, 1.0)
        logarithmic = safe * jnp.exp(jnp.clip(self.scale / safe * z, -30.0, 30.0))
        ratio = jnp.maximum(self.start / self.scale, 0.1 * CORNER**0.5)
        q = z + ratio - CORNER / ratio
        soft = self.scale * 0.5 * (q + jnp.sqrt(q**2 + 4 * CORNER))
        return jnp.where(self.kind == LINEAR, linear, jnp.where(self.kind == LOGARITHMIC, logarithmic, soft))

    def apply(self, model: AbstractActuator, z: Float[Array, " parameters"]) -> AbstractActuator:
        """`model` with the parameters at coordinates z."""
        values = self.values(z)
        return replace(model, {path: values[i] for i, path in enumerate(self.paths)})

    def prior_residuals(self, z: Float[Array, " parameters"]) -> Float[Array, " parameters"]:
        """Distance from the prior means in standard deviations; logarithmic for positive parameters."""
        values = self.values(z)
        positive = self.kind == LOGARITHMIC
        mean = jnp.where(positive, self.prior_mean, 1.0)
        ratio = jnp.where(positive, values / mean, 1.0)
        distance = jnp.where(positive, mean * jnp.log(ratio), values - self.prior_mean)
        return distance / self.prior_std


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data: mean and standard deviation, SI."""

    mean: float
    std: float


def free(
    model: AbstractActuator,
    chosen: Sequence[str],
    priors: Mapping[str, Prior],
    scales: Mapping[str, float],
    order: Sequence[str],
) -> Free:
    """Describe `order` (every path a fit may ever move) with the paths `chosen` free.

    Args:
        priors: path → prior; its std is also the scale of the coordinate.
        scales: path → scale for those without a prior; otherwise a tenth of the value, or 1.
        order: fixed list of paths; entries not chosen keep their value exactly.
    """
    entries = parameters(model)
    values = np.array([float(entries[path].value) for path in order])

    def scale(path: str, value: float) -> float:
        if path in priors:
            return priors[path].std
        return scales.get(path) or 0.1 * abs(value) or entries[path].typical or 1.0

    return Free(
        paths=tuple(order),
        start=jnp.asarray(values),
        scale=jnp.array([scale(p, v) for p, v in zip(order, values, strict=True)]),
        kind=jnp.array([_kind(entries[p]) if p in chosen else LINEAR for p in order]),
        prior_mean=jnp.array(
            [priors[p].mean if p in priors else v for p, v in zip(order, values, strict=True)]
        ),
        prior_std=jnp.array([priors[p].std if p in priors and p in chosen else jnp.inf for p in order]),
    )


def _kind(entry: Parameter) -> int:
    return LOGARITHMIC if entry.positive else SOFT if entry.nonnegative else LINEAR
