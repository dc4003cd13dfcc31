"""One model that carries every candidate at zero strength: all fits of a diagnosis run on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.candidates import loaded, paths_of
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.fit import Minimum, minimise, sensitivities
from jaxmuscle.fitting.free import Free, Prior, free
from jaxmuscle.fitting.problem import Problem, Residuals, residuals
from jaxmuscle.parameters import get, parameters, replace

SPARE = 6
"""Free parameters beyond the declared ones for which a fit is laid out: two effects of three."""

_residuals = eqx.filter_jit(residuals)


@dataclasses.dataclass(frozen=True)
class Workbench:
    """A loaded model's structure and the order of its parameters, shared by all fits.

    Attributes:
        model: the declared machine with every candidate at zero strength.
        declared: paths of the parameters that the card calls uncertain.
        order: every path that a fit may ever move.
        priors: path → prior of the declared ones; those of the shapes of effects are added to them.
        width: number of tangents of a fit.
    """

    model: AbstractActuator
    candidates: tuple[type[AbstractEffect], ...]
    declared: tuple[str, ...]
    order: tuple[str, ...]
    priors: Mapping[str, Prior]
    width: int

    def shape_priors(self, model: AbstractActuator, names: Sequence[str]) -> dict[str, Prior]:
        """Weak priors on the parameters of effects other than their strengths: their value, by its size.

        They keep a time constant or a threshold that the data say nothing of where it began.
        """
        entries = parameters(self.model)
        strengths = {f"effects.{e.name}.{e.strength}" for e in self.candidates}
        priors = {}
        for path in (p for name in names for p in paths_of(self.model, name) if p not in strengths):
            default = float(entries[path].value)
            size = entries[path].typical or abs(default)
            centre = float(get(model, path)) if entries[path].positive else default
            priors[path] = Prior(centre, abs(centre) if entries[path].positive else size)
        return priors

    def free_paths(self, model: AbstractActuator, effects: Sequence[str]) -> list[str]:
        """Paths that a fit moves: the declared ones and those of `effects`."""
        return [*self.declared, *(path for name in effects for path in paths_of(model, name))]

    def free(self, model: AbstractActuator, effects: Sequence[str]) -> tuple[Free, NDArray[np.int64]]:
        """The declared parameters and those of `effects`, free, from their values in `model`."""
        chosen = self.free_paths(model, effects)
        scales = {path: 0.5 * abs(float(get(model, path))) for path in chosen}
        priors = {**self.priors, **self.shape_priors(model, effects)}
        free_parameters = free(model, chosen, priors, scales, self.order)
        return free_parameters, np.array([self.order.index(path) for path in chosen], dtype=int)

    def with_card_values(self, model: AbstractActuator) -> AbstractActuator:
        """`model` with its declared parameters back at the values of the card."""
        return replace(model, {path: prior.mean for path, prior in self.priors.items()})

    def best_fit(
        self, starts: Sequence[AbstractActuator], effects: Sequence[str], problem: Problem, steps: int
    ) -> tuple[AbstractActuator, Minimum]:
        """The best of the fits that begin at several models."""
        fits = [self.fit(start, effects, problem, steps) for start in starts]
        return min(fits, key=lambda fit: fit[1].cost)

    def fit(
        self, model: AbstractActuator, effects: Sequence[str], problem: Problem, steps: int
    ) -> tuple[AbstractActuator, Minimum]:
        """`model` with its declared parameters and those of `effects` fitted to `problem`."""
        description, chosen = self.free(model, effects)
        minimum = minimise(model, problem, description, chosen, self.width, steps)
        return description.apply(model, jnp.asarray(minimum.z)), minimum

    def residuals(self, model: AbstractActuator, problem: Problem) -> Residuals:
        """Weighted residuals, as NumPy arrays."""
        return {out: np.asarray(r) for out, r in _residuals(model, problem).items()}  # pyright: ignore

    def cost(self, model: AbstractActuator, problem: Problem) -> float:
        """Half the sum of squared weighted residuals, without priors."""
        return 0.5 * sum(float((r**2).sum()) for r in self.residuals(model, problem).values())

    def jacobian(
        self, model: AbstractActuator, problem: Problem, paths: Sequence[str], effects: Sequence[str]
    ) -> tuple[Float[NDArray, " n"], Float[NDArray, "k n"]]:
        """Residual vector and its derivatives with respect to the parameters `paths` (in their own units)."""
        description, _ = self.free(model, effects)
        linear = eqx.tree_at(
            lambda f: (f.kind, f.scale),
            description,
            (jnp.zeros_like(description.kind), jnp.ones_like(description.scale)),
        )
        rows = self.width + len(self.candidates)
        directions = np.zeros((rows, len(self.order)))
        directions[np.arange(len(paths)), [self.order.index(path) for path in paths]] = 1.0
        value, slopes = sensitivities(
            model, problem, linear, jnp.zeros(len(self.order)), jnp.asarray(directions)
        )
        return np.asarray(value), np.asarray(slopes)[: len(paths)]


def workbench(
    actuator: AbstractActuator, priors: Mapping[str, Prior], candidates: Sequence[type[AbstractEffect]]
) -> Workbench:
    """Load `actuator` with `candidates`."""
    model = loaded(actuator, candidates)
    extra = [path for effect in candidates for path in paths_of(model, effect.name)]
    return Workbench(
        model,
        tuple(candidates),
        tuple(priors),
        (*priors, *extra),
        dict(priors),
        len(priors) + SPARE,
    )
