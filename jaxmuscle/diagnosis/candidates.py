"""Candidate effects that a rig may have and its model lacks, their parameters, and strengths to try."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.card_constants import CardConstant, constant_path
from jaxmuscle.diagnosis.variable_projection import basis_of, outside_span
from jaxmuscle.effects import Presliding
from jaxmuscle.effects.base import (
    AbstractEffect,
    AbstractFrictionEffect,
    AbstractMemoryEffect,
    AbstractRateEffect,
    strengths_of,
)
from jaxmuscle.parameter_names import effect_path, split_effect
from jaxmuscle.parameters import get, parameters

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


Sought: TypeAlias = type[AbstractEffect] | CardConstant
"""What a search may add: an effect, or another value of a constant of the card."""


def carries_state(sought: Sought) -> bool:
    """Whether a candidate has a state or a memory of its own."""
    if isinstance(sought, CardConstant):
        return False
    return issubclass(sought, AbstractRateEffect | AbstractMemoryEffect)


def is_dry_friction(sought: Sought) -> bool:
    """Whether a candidate is a law of dry friction, or how that builds up over a distance."""
    return not isinstance(sought, CardConstant) and issubclass(sought, AbstractFrictionEffect | Presliding)


def signal_of(sought: Sought) -> str:
    """The signal on which a candidate acts, as results call it."""
    return sought.signal if isinstance(sought, CardConstant) else sought.slot.name


def loaded(actuator: AbstractActuator, effects: Sequence[type[AbstractEffect]]) -> AbstractActuator:
    """`actuator` carrying all `effects` at zero strength."""
    return actuator.with_effects(**{effect.name: effect() for effect in effects})


def paths_of(model: AbstractActuator, name: str) -> list[str]:
    """Paths of the parameters of the candidate `name`."""
    if (path := constant_path(model, name)) is not None:
        return [path]
    return [path for path in parameters(model) if split_effect(path)[0] == name]


def strength_path(sought: Sought) -> str:
    """Path of the strength of an effect; of a constant, its own."""
    return sought.path if isinstance(sought, CardConstant) else effect_path(sought.name, sought.strength)


def without(sought: Sought) -> dict[str, float]:
    """Path → value at which a candidate changes nothing: no strength, the card's value."""
    if isinstance(sought, CardConstant):
        return {sought.path: sought.declared}
    return {effect_path(sought.name, each): 0.0 for each in strengths_of(sought)}


def of_strength(sought: Sought, strength: float, model: AbstractActuator) -> dict[str, float]:
    """Path → value of a candidate of some strength, that of a constant being its distance from `model`'s."""
    path = strength_path(sought)
    if isinstance(sought, CardConstant):
        return {path: sought.within(float(get(model, path)) + strength)}
    return {path: strength}


def linear_strength(
    residual: Float[np.ndarray, " n"], free: Float[np.ndarray, "k n"], direction: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Least-squares strength of an effect whose residuals change by `direction` per unit, and its gain.

    The sensitivities of the parameters that are free anyway are projected off both, so that the gain is
    what no refit of the present model could achieve. Returns (strength, relative fall of the cost).
    """
    basis = basis_of(free)
    rest, own = outside_span(basis, residual), outside_span(basis, direction)
    norm = own @ own
    if norm <= 1e-12 * max(direction @ direction, 1e-300):
        return 0.0, 0.0
    return float(-(own @ rest) / norm), float((own @ rest) ** 2 / norm / max(rest @ rest, 1e-300))


def shapes(sought: Sought) -> Iterator[dict[str, float]]:
    """Values (by path) of a candidate's parameters from which a search begins, its strength or others."""
    if isinstance(sought, CardConstant):
        yield {}
        return
    for shape in sought.starts:
        yield {effect_path(sought.name, name): value for name, value in shape.items()}


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
