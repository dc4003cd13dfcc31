"""The models of a diagnosis in few structures, so that its hundreds of fits share few compilations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from jaxmuscle.actuators.base import AbstractActuator
from jaxmuscle.diagnosis.candidates import carries_state, loaded, paths_of, strength_path
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.fitting.fit import Minimum, minimise, sensitivities
from jaxmuscle.fitting.free import Free, Prior, free
from jaxmuscle.fitting.problem import Problem, Residuals
from jaxmuscle.fitting.residuals import evaluate
from jaxmuscle.parameters import get, parameters, replace

SPARE = 6
"""Free parameters beyond the declared ones for which fits are laid out: two effects of three. A fit of more
is compiled for itself."""


@dataclasses.dataclass(frozen=True)
class Workbench:
    """A declared model, the candidates, and how they are fitted.

    Candidates without a state of their own cost next to nothing at zero strength: every model carries them
    all. Those with a state (creep, hysteresis, lags) make each step several times dearer: a model carries
    them only where they are tried or have been added.

    Attributes:
        model: the declared machine with every candidate without a state, at zero strength.
        declared: paths of the parameters that the card calls uncertain.
        priors: path → prior of the declared ones; those of the shapes of effects are added to them.
        width: number of tangents of a fit.
    """

    model: AbstractActuator
    candidates: tuple[type[AbstractEffect], ...]
    declared: tuple[str, ...]
    priors: Mapping[str, Prior]
    width: int

    def dressed(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` carrying, of the candidates that have a state, exactly those in `names`."""
        stateful = [effect for effect in self.candidates if carries_state(effect)]
        wanted = [effect for effect in stateful if effect.name in names]
        bare = model.without_effects(*(effect.name for effect in stateful))
        had = {e.name: model.effects[e.name] for e in wanted if e.name in model.effects}
        return bare.with_effects(**{effect.name: had.get(effect.name, effect()) for effect in wanted})

    def order(self, model: AbstractActuator) -> list[str]:
        """Every path that a fit of a model of this structure may ever move."""
        carried = [effect.name for effect in self.candidates if effect.name in model.effects]
        return [*self.declared, *(path for name in carried for path in paths_of(model, name))]

    def shape_priors(self, model: AbstractActuator, names: Sequence[str]) -> dict[str, Prior]:
        """Weak priors on the parameters of effects other than their strengths: their value, by its size.

        They keep a time constant or a threshold that the data say nothing of where it began.
        """
        entries, defaults = parameters(model), loaded(self.model, self.candidates)
        strengths = {strength_path(e) for e in self.candidates}
        priors = {}
        for path in (p for name in names for p in paths_of(model, name) if p not in strengths):
            default = float(get(defaults, path))
            size = entries[path].typical or abs(default)
            centre = float(get(model, path)) if entries[path].positive else default
            priors[path] = Prior(centre, abs(centre) if entries[path].positive else size)
        return priors

    def free_paths(self, model: AbstractActuator, effects: Sequence[str]) -> list[str]:
        """Paths that a fit moves: the declared ones and those of `effects`."""
        return [*self.declared, *(path for name in effects for path in paths_of(model, name))]

    def free(self, model: AbstractActuator, effects: Sequence[str]) -> tuple[Free, NDArray[np.int64]]:
        """The declared parameters and those of `effects`, free, from their values in `model`."""
        chosen, order = self.free_paths(model, effects), self.order(model)
        scales = {path: 0.5 * abs(float(get(model, path))) for path in chosen}
        priors = {**self.priors, **self.shape_priors(model, effects)}
        return free(model, chosen, priors, scales, order), np.array([order.index(p) for p in chosen], int)

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
        model = self.dressed(model, effects)
        description, chosen = self.free(model, effects)
        width = max(self.width, len(chosen))
        minimum = minimise(model, problem, description, chosen, width, steps)
        return description.apply(model, jnp.asarray(minimum.z)), minimum

    def residuals(self, model: AbstractActuator, problem: Problem) -> Residuals:
        """Weighted residuals, as NumPy arrays."""
        return {out: np.asarray(r) for out, r in evaluate(model, problem).items()}  # pyright: ignore

    def cost(self, model: AbstractActuator, problem: Problem) -> float:
        """Half the sum of squared weighted residuals, without priors."""
        return 0.5 * sum(float((r**2).sum()) for r in self.residuals(model, problem).values())

    def jacobian(
        self, model: AbstractActuator, problem: Problem, paths: Sequence[str], effects: Sequence[str]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "k n"]]:
        """Residual vector and its derivatives with respect to the parameters `paths` (in their own units).

        The residual vector ends with the distances from the priors of the declared parameters and of the
        shapes of `effects`.
        """
        model = self.dressed(model, effects)
        description, _ = self.free(model, effects)
        linear = eqx.tree_at(
            lambda f: (f.kind, f.scale),
            description,
            (jnp.zeros_like(description.kind), jnp.ones_like(description.scale)),
        )
        order = self.order(model)
        return sensitivities(
            model, problem, linear, np.array([order.index(path) for path in paths], int), self.width
        )


def workbench(
    actuator: AbstractActuator, priors: Mapping[str, Prior], candidates: Sequence[type[AbstractEffect]]
) -> Workbench:
    """Load `actuator` with those of the `candidates` that have no state."""
    model = loaded(actuator, [effect for effect in candidates if not carries_state(effect)])
    return Workbench(model, tuple(candidates), tuple(priors), dict(priors), len(priors) + SPARE)
