"""Models that carry many candidates in few structures, so that hundreds of fits share few compilations."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import Sought, carries_state, loaded, paths_of, strength_path
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.effects import CATALOGUE
from jaxmuscle.effects.base import AbstractEffect, AbstractFrictionEffect
from jaxmuscle.estimation.free_parameters import Prior, Unknown, Unknowns
from jaxmuscle.estimation.parameter_layout import unknown_within
from jaxmuscle.parameters import Parameter, get, parameters, replace


@dataclasses.dataclass(frozen=True)
class CandidateModels:
    """A declared model and the candidates that it may carry.

    Effects at zero strength change nothing but how long a model takes to run and to compile. A model carries
    those that it has and the ones that are tried together: of the usual effects those without a state of
    their own, or all where one with a state (creep, hysteresis, lags) is tried, which makes each step several
    times dearer; of the others those without, or those with a state. So hundreds of fits share a few
    compilations (one for each candidate with a state took 52 s of a core where one for all took 36), and
    none carries forty effects: twelve derivatives of a joint take 0.04 s with the twenty rarer effects
    without a state, 0.15 s with the usual ones beside them, 0.27 s with all. Where constants are tried models
    carry what they have alone.

    Attributes:
        model: the declared machine.
        declared: paths of the parameters that the card calls uncertain.
        priors: path → prior of the declared ones; those of the shapes of effects are added to them.
        constants: constants of the card that may be wrong; they are candidates too.
        refinements: names of candidates that change how friction builds up; they wait until an effect is
            found that is friction or stands beside some, against which they are tried, and beside which if
            much is left.
        rivals: names of candidates that are tried only against one that was found.
    """

    model: AbstractActuator
    candidates: tuple[type[AbstractEffect], ...]
    declared: tuple[str, ...]
    priors: Mapping[str, Prior]
    constants: tuple[CardConstant, ...]
    refinements: tuple[str, ...]
    rivals: tuple[str, ...]

    def sought(self, accepted: Sequence[str], much_is_left: bool) -> list[type[AbstractEffect]]:
        """Candidates that may be added to a model that has `accepted`.

        Refinements are among them only beside something that was found, where much is left: every guide has
        a little of them, and that is no finding.
        """
        refines = self.refining(accepted) if accepted and much_is_left else []
        waiting = {*self.rivals, *self.refinements} - {effect.name for effect in refines}
        return [e for e in self.candidates if e.name not in accepted and e.name not in waiting]

    def refining(self, accepted: Sequence[str]) -> list[type[AbstractEffect]]:
        """Refinements of a dry friction that is declared, or among what was `accepted`."""
        declared = (type(effect) for effect in self.model.effects.values())
        found = (effect for effect in self.candidates if effect.name in accepted)
        if not any(issubclass(effect, AbstractFrictionEffect) for effect in (*declared, *found)):
            return []
        return [e for e in self.candidates if e.name in self.refinements and e.name not in accepted]

    def dressed(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` carrying the candidates that are in `names`, and at zero strength those that are tried
        together with the last of them; only the former if that is a constant of the card.
        """
        own = {effect.name: effect for effect in self.candidates if effect.name in names}
        effect = own.get(names[-1]) if names else None
        beside = self.together(effect) if effect is not None or not names else []
        kept = {name: model.effects.get(name, e()) for name, e in own.items()}
        return self.bare(model, []).with_effects(**{e.name: e() for e in beside} | kept)

    def together(self, effect: type[AbstractEffect] | None) -> list[type[AbstractEffect]]:
        """Candidates that are tried together with one of them: by the same programs.

        With none the usual ones without a state, by which the model without any is fitted.
        """
        waiting = [e for e in self.candidates if e is not effect and e.name in self.refinements]
        at_once = [e for e in self.candidates if e not in waiting]
        usual = [e for e in at_once if e in CATALOGUE]
        if effect is None or effect in usual:
            return usual if effect is not None and carries_state(effect) else _stateless(usual)
        rest = [e for e in at_once if e not in usual]
        return [e for e in rest if carries_state(e) == carries_state(effect)]

    def one_of_each(self) -> list[type[AbstractEffect]]:
        """A candidate of each of those that are tried together, but for those that wait."""
        found: dict[frozenset[type[AbstractEffect]], type[AbstractEffect]] = {}
        for effect in self.sought((), False):
            found.setdefault(frozenset(self.together(effect)), effect)
        return [*found.values()]

    def in_turns(self, sought: Sequence[Sought]) -> list[Sought]:
        """Candidates in an order in which different programs are compiled side by side, those that take
        longest first.
        """
        groups: dict[object, list[Sought]] = {}
        for each in sorted(sought, key=carries_state, reverse=True):
            group = None if isinstance(each, CardConstant) else frozenset(self.together(each))
            groups.setdefault(group, []).append(each)
        return [each for turn in itertools.zip_longest(*groups.values()) for each in turn if each is not None]

    def bare(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` without the candidates that are not in `names`."""
        return model.without_effects(*(e.name for e in self.candidates if e.name not in names))

    def order(self, model: AbstractActuator, names: Sequence[str]) -> list[str]:
        """Every path that a fit of a model of this structure may ever move, with constants if `names` has
        one.
        """
        held = [effect.name for effect in self.candidates if effect.name in model.effects]
        constants = (constant.path for constant in self.constants if self.freed(names))
        effects = (path for name in held for path in paths_of(model, name))
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
        """The vector of the parameters `paths`, from their values in `model`, with their priors.

        A constant that is freed begins within its range, which a fit under the card's prior may have left.
        """
        priors, entries = {**self.priors, **self.shape_priors(model, effects)}, parameters(model)
        freed = self.freed(effects)
        return Unknowns(
            [
                _free_constant(entries[path], freed[path])
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


def _unknown(entry: Parameter, prior: Prior | None) -> Unknown:
    """One entry of the vector, from its value in the model."""
    return unknown_within(entry.path, entry, (0,), float(entry.value), prior, (None, None))


def _free_constant(entry: Parameter, constant: CardConstant) -> Unknown:
    start = constant.within(float(entry.value))
    return unknown_within(entry.path, entry, (0,), start, None, (constant.lower, constant.upper))


def _stateless(effects: Sequence[type[AbstractEffect]]) -> list[type[AbstractEffect]]:
    return [effect for effect in effects if not carries_state(effect)]
