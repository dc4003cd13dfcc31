"""Candidate effects that a rig may have and its model lacks, their parameters, and strengths to try."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.base import AbstractEffect, AbstractMemoryEffect, AbstractRateEffect
from jaxmuscle.parameter_names import effect_path, split_effect
from jaxmuscle.parameters import parameters

LEVELS = 6
"""Strengths that are tried, of either sign, from one that is just seen to one that explains everything."""
SEEN = 0.5
"""Root mean square change of the predictions, in units of the noise, that is just seen."""


def missing(
    actuator: AbstractActuator, catalogue: Sequence[type[AbstractEffect]]
) -> list[type[AbstractEffect]]:
    """The effects of `catalogue` that the rig can have and the model does not."""
    offered = (effect for effect in dict.fromkeys(catalogue) if actuator.offers(effect))
    return [effect for effect in offered if effect.name not in actuator.effects]


def carries_state(effect: type[AbstractEffect]) -> bool:
    """Whether an effect has a state or a memory of its own."""
    return issubclass(effect, AbstractRateEffect | AbstractMemoryEffect)


def loaded(actuator: AbstractActuator, effects: Sequence[type[AbstractEffect]]) -> AbstractActuator:
    """`actuator` carrying all `effects` at zero strength."""
    return actuator.with_effects(**{effect.name: effect() for effect in effects})


def paths_of(model: AbstractActuator, name: str) -> list[str]:
    """Paths of the parameters of the effect `name`."""
    return [path for path in parameters(model) if split_effect(path)[0] == name]


def strength_path(effect: type[AbstractEffect]) -> str:
    """Path of the strength of an effect."""
    return effect_path(effect.name, effect.strength)


def linear_strength(
    residual: Float[np.ndarray, " n"], free: Float[np.ndarray, "k n"], direction: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Least-squares strength of an effect whose residuals change by `direction` per unit, and its gain.

    The sensitivities of the parameters that are free anyway are projected off both, so that the gain is
    what no refit of the present model could achieve. Returns (strength, relative fall of the cost).
    """
    basis, _ = np.linalg.qr(free.T)
    rest = residual - basis @ (basis.T @ residual)
    own = direction - basis @ (basis.T @ direction)
    norm = own @ own
    if norm <= 1e-12 * max(direction @ direction, 1e-300):
        return 0.0, 0.0
    return float(-(own @ rest) / norm), float((own @ rest) ** 2 / norm / max(rest @ rest, 1e-300))


def shapes(effect: type[AbstractEffect]) -> Iterator[dict[str, float]]:
    """Values (by path) of an effect's parameters from which a search begins; with its strength or without."""
    for shape in effect.starts:
        yield {effect_path(effect.name, name): value for name, value in shape.items()}


def strengths(
    slope: Float[np.ndarray, " n"],
    residual: Float[np.ndarray, " n"],
    nonnegative: bool,
    noise: float = 1.0,
) -> list[float]:
    """Strengths to try: a large effect is far from linear, one that others nearly imitate looks small.

    Args:
        slope: derivative of the weighted residuals with respect to the strength.
        residual: the weighted residuals.
        nonnegative: whether the strength cannot be negative.
        noise: size of the residuals that noise leaves.
    """
    counting = max(int(np.count_nonzero(residual)), 1)
    unit = float(np.sqrt((slope**2).sum() / counting))
    if not unit > 0 or not np.isfinite(unit):
        return []
    misfit = float(np.sqrt((residual**2).sum() / counting))
    sizes = np.geomspace(SEEN * noise, 3 * max(misfit, noise), LEVELS) / unit
    return [float(s) for s in (sizes if nonnegative else np.concatenate([sizes, -sizes]))]
