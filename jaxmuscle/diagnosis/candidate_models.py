"""Models that carry many candidates in few structures, so that hundreds of fits share few compilations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import carries_state, loaded, paths_of, strength_path
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.effects.base import AbstractEffect, AbstractFrictionEffect
from jaxmuscle.estimation.free_parameters import Prior, Unknown, Unknowns
from jaxmuscle.estimation.parameter_layout import unknown_within
from jaxmuscle.estimation.request import Bounds
from jaxmuscle.parameters import Parameter, get, parameters, replace


@dataclasses.dataclass(frozen=True)
class CandidateModels:
    """A declared model and the candidates that it may carry.

    Candidates without a state of their own cost next to nothing at zero strength: every model carries them
    all. Those with a state (creep, hysteresis, lags) make each step several times dearer: a model carries
    all of them where one is tried or has been added, and none otherwise, but for those that are `carried`
    always. Two structures are compiled (one for each candidate with a state took 52 s of a core where these
    two take 36), and a small one where constants are tried.

    Attributes:
        model: the declared machine with every candidate without a state, at zero strength.
        declared: paths of the parameters that the card calls uncertain.
        priors: path → prior of the declared ones; those of the shapes of effects are added to them.
        carried: names of candidates with a state that every model carries.
        constants: constants of the card that may be wrong; they are candidates too, in every model.
        refinements: names of candidates that change how friction builds up; they wait until some is found
            and much is left all the same.
    """

    model: AbstractActuator
    candidates: tuple[type[AbstractEffect], ...]
    declared: tuple[str, ...]
    priors: Mapping[str, Prior]
    carried: tuple[str, ...]
    constants: tuple[CardConstant, ...]
    refinements: tuple[str, ...]

    @property
    def changing(self) -> list[type[AbstractEffect]]:
        """Candidates with a state that not every model carries."""
        return [e for e in self.candidates if carries_state(e) and e.name not in self.carried]

    def sought(self, accepted: Sequence[str], much_is_left: bool) -> list[type[AbstractEffect]]:
        """Candidates that may be added to a model that has `accepted`.

        Refinements are among them only where dry friction was found and much is left: every guide has a
        little of them, and that is no finding.
        """
        found = {effect for effect in self.candidates if effect.name in accepted}
        rubs = any(issubclass(effect, AbstractFrictionEffect) for effect in found)
        refines = rubs and much_is_left
        return [e for e in self.candidates if e not in found and (refines or e.name not in self.refinements)]

    def dressed(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` carrying every candidate that has a state if `names` has one, else none.

        Those that are not in `names` are at zero strength; of refinements only those in `names` are carried.
        Where constants of the card alone are tried it carries no candidate: this structure is soon compiled.
        """
        if names and not any(effect.name in names for effect in self.candidates):
            return self.bare(model, names)
        stateful = self.changing
        wanted = [effect.name for effect in stateful if effect.name in names]
        bare = model.without_effects(*(effect.name for effect in stateful))
        still = {name: effect for name, effect in self.model.effects.items() if name not in model.effects}
        had = {name: model.effects[name] for name in wanted if name in model.effects}
        borne = [e for e in stateful if e.name in wanted or e.name not in self.refinements]
        carried = {e.name: had.get(e.name, e()) for e in borne} if wanted else {}
        return bare.with_effects(**still, **carried)

    def bare(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` without the candidates that are not in `names`."""
        return model.without_effects(*(e.name for e in self.candidates if e.name not in names))

    def order(self, model: AbstractActuator) -> list[str]:
        """Every path that a fit of a model of this structure may ever move."""
        carried = [effect.name for effect in self.candidates if effect.name in model.effects]
        constants = (constant.path for constant in self.constants)
        effects = (path for name in carried for path in paths_of(model, name))
        return list(dict.fromkeys([*self.declared, *constants, *effects]))

    def shape_priors(self, model: AbstractActuator, names: Sequence[str]) -> dict[str, Prior]:
        """Weak priors on the parameters of effects other than their strengths: their value, by its size.

        They keep a time constant or a threshold that the data say nothing of where it began.
        """
        entries, defaults = parameters(model), loaded(self.model, self.candidates)
        strengths = {strength_path(e) for e in (*self.candidates, *self.constants)}
        priors = {}
        for path in (p for name in names for p in paths_of(model, name) if p not in strengths):
            default = float(get(defaults, path))
            size = entries[path].typical or abs(default)
            centre = float(get(model, path)) if entries[path].positive else default
            priors[path] = Prior(centre, abs(centre) if entries[path].positive else size)
        return priors

    def free_paths(self, model: AbstractActuator, effects: Sequence[str]) -> list[str]:
        """Paths that a fit moves: the declared ones and those of `effects`, effects or constants."""
        own = (path for name in effects for path in paths_of(model, name))
        return list(dict.fromkeys([*self.declared, *own]))

    def freed(self, names: Sequence[str]) -> dict[str, CardConstant]:
        """Path → constant of the card that is among `names`, and so free of what the card says of it."""
        return {constant.path: constant for constant in self.constants if constant.name in names}

    def unknowns(self, model: AbstractActuator, paths: Sequence[str], effects: Sequence[str]) -> Unknowns:
        """The vector of the parameters `paths`, from their values in `model`, with their priors."""
        priors, entries = {**self.priors, **self.shape_priors(model, effects)}, parameters(model)
        freed = self.freed(effects)
        return Unknowns(
            [
                _unknown(entries[path], None, (freed[path].lower, freed[path].upper))
                if path in freed
                else _unknown(entries[path], priors.get(path))
                for path in paths
            ]
        )

    def with_card_values(self, model: AbstractActuator) -> AbstractActuator:
        """`model` with its declared parameters back at the values of the card."""
        return replace(model, {path: prior.mean for path, prior in self.priors.items()})

    def farthest_from_card(self, model: AbstractActuator, but: Sequence[str] = ()) -> float:
        """Distance of the declared parameter that is farthest from the card's value, in its standard
        deviations; of parameters other than the paths `but`.
        """
        far = (abs(float(get(model, p)) - q.mean) / q.std for p, q in self.priors.items() if p not in but)
        return max(far, default=0.0)


def _unknown(entry: Parameter, prior: Prior | None, bounds: Bounds = (None, None)) -> Unknown:
    """One entry of the vector, from its value in the model."""
    return unknown_within(entry.path, entry, (0,), float(entry.value), prior, bounds)
