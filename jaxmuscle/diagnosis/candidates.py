"""Candidate effects that a rig may have and its model lacks, and the models that carry them in few
structures, so that hundreds of fits share few compilations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.effects.base import AbstractEffect, AbstractMemoryEffect, AbstractRateEffect
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.free_parameters import Prior, Unknown, Unknowns, moved_machine
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective, SharedProgram
from jaxmuscle.estimation.parameter_layout import unknown_within
from jaxmuscle.estimation.residuals import BROKEN, Evaluated, evaluate
from jaxmuscle.estimation.windows import Case, Problem
from jaxmuscle.optimization.levenberg_marquardt import CONVERGED, STALLED, Lane, Limits, Tolerances, descend
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameter_names import effect_path, split_effect
from jaxmuscle.parameters import Parameter, get, parameters, replace

LEVELS = 6
"""Strengths that are tried, of either sign, from one that is just seen to one that explains everything."""
SEEN = 0.5
"""Root mean square change of the predictions, in units of the noise, that is just seen."""


def missing(
    actuator: AbstractActuator, catalogue: Sequence[type[AbstractEffect]]
) -> list[type[AbstractEffect]]:
    """The effects of `catalogue` that the rig can have and the model does not."""
    return [effect for effect in catalogue if actuator.offers(effect) and effect.name not in actuator.effects]


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
    slope: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"], nonnegative: bool
) -> list[float]:
    """Strengths to try: a large effect is far from linear, one that others nearly imitate looks small.

    Args:
        slope: derivative of the weighted residuals with respect to the strength.
        residual: the weighted residuals.
        nonnegative: whether the strength cannot be negative.
    """
    counting = max(int(np.count_nonzero(residual)), 1)
    unit = float(np.sqrt((slope**2).sum() / counting))
    if not unit > 0 or not np.isfinite(unit):
        return []
    misfit = float(np.sqrt((residual**2).sum() / counting))
    sizes = np.geomspace(SEEN, 3 * max(misfit, 1.0), LEVELS) / unit
    return [float(s) for s in (sizes if nonnegative else np.concatenate([sizes, -sizes]))]


SPARE = 6
"""Free parameters beyond the declared ones for which fits are laid out: two effects of three. A fit of more
takes its derivatives in several calls of one program."""
FALL = 3e-5
"""Expected fall of the cost, relative to it, at which a fit of a search ends.

With ten times as much, practice recording 14 ends at a tenth more cost, and an effect is found that is not
there.
"""
SLOW = 1e-3
"""Fall of the cost over eight steps, relative to it, below which a candidate's search, and the fit of any
model to a fold, is at its end.

With the fits to all windows of the model without candidates ended like that, too, practice recording 14 has
effects found that are not there: what searches begin with must be as good as it can be.
"""
SETTLED = (CONVERGED, STALLED)
"""How a fit ends that more steps would not carry on."""


@dataclasses.dataclass(frozen=True)
class Workbench:
    """A declared model, the candidates, and how they are fitted.

    Candidates without a state of their own cost next to nothing at zero strength: every model carries them
    all. Those with a state (creep, hysteresis, lags) make each step several times dearer: a model carries
    all of them where one is tried or has been added, and none otherwise. Two structures are compiled; one
    for each candidate with a state took 52 s of a core where these two take 36.

    Attributes:
        case: the recording, made ready.
        model: the declared machine with every candidate without a state, at zero strength.
        declared: paths of the parameters that the card calls uncertain.
        priors: path → prior of the declared ones; those of the shapes of effects are added to them.
        width: number of tangents of a fit.
    """

    case: Case
    model: AbstractActuator
    candidates: tuple[type[AbstractEffect], ...]
    declared: tuple[str, ...]
    priors: Mapping[str, Prior]
    width: int

    def dressed(self, model: AbstractActuator, names: Sequence[str]) -> AbstractActuator:
        """`model` carrying every candidate that has a state if `names` has one, else none.

        Those that are not in `names` are at zero strength.
        """
        stateful = [effect for effect in self.candidates if carries_state(effect)]
        wanted = [effect.name for effect in stateful if effect.name in names]
        bare = model.without_effects(*(effect.name for effect in stateful))
        had = {name: model.effects[name] for name in wanted if name in model.effects}
        carried = {e.name: had.get(e.name, e()) for e in stateful} if wanted else {}
        return bare.with_effects(**carried)

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

    def unknowns(self, model: AbstractActuator, paths: Sequence[str], effects: Sequence[str]) -> Unknowns:
        """The vector of the parameters `paths`, from their values in `model`, with their priors."""
        priors, entries = {**self.priors, **self.shape_priors(model, effects)}, parameters(model)
        free = {path: priors.get(path) for path in paths}
        return Unknowns([_unknown(entries[path], prior) for path, prior in free.items()])

    def objective(
        self, model: AbstractActuator, problem: Problem, paths: Sequence[str], effects: Sequence[str]
    ) -> Objective:
        """The cost of the parameters `paths` on `problem`, in the program that `model`'s structure shares."""
        case = self.case
        station = Station(
            case.recording.name,
            model,
            case.recording,
            case.recording,
            problem,
            problem.samples,
            case.observed.spread,
        )
        unknowns = self.unknowns(model, paths, effects)
        return Objective([station], unknowns, Squares(), program=self.program(model))

    def program(self, model: AbstractActuator) -> SharedProgram:
        """What evaluates every fit of models of one structure."""
        return SharedProgram(tuple(self.order(model)), self.width)

    def with_card_values(self, model: AbstractActuator) -> AbstractActuator:
        """`model` with its declared parameters back at the values of the card."""
        return replace(model, {path: prior.mean for path, prior in self.priors.items()})

    def best_fit(
        self, starts: Sequence[AbstractActuator], effects: Sequence[str], problem: Problem, steps: int
    ) -> tuple[AbstractActuator, Lane]:
        """The best of the fits that begin at several models."""
        fits = on_all_cores(lambda start: self.fit(start, effects, problem, steps), starts)
        return min(fits, key=lambda fit: fit[1].cost)

    def fit(
        self,
        model: AbstractActuator,
        effects: Sequence[str],
        problem: Problem,
        steps: int,
        slow: float = 0.0,
    ) -> tuple[AbstractActuator, Lane]:
        """`model` with its declared parameters and those of `effects` fitted to `problem`.

        A search compares costs that differ by more than the last steps to a minimum would lower them: a
        descent ends when its next step is expected to lower the cost by less than :data:`FALL` of it, or
        when several steps together have lowered it by less than `slow` of it.
        """
        model = self.dressed(model, effects)
        paths = self.free_paths(model, effects)
        objective = self.objective(model, problem, paths, effects)
        unknowns, samples = objective.unknowns, objective.samples
        bounds = (unknowns.lower, unknowns.upper)
        ends = Tolerances(fall=FALL, slow=slow)
        limits = Limits(*bounds, steps, 1, samples=samples, reach=unknowns.reach, tolerances=ends)
        (lane,) = descend(objective.at, unknowns.coordinates(unknowns.start)[None], limits)
        return moved_machine(model, unknowns, lane.u, 0), lane

    def compile_stateful(self, problem: Problem) -> None:
        """Have the programs for candidates with a state compiled; nothing if there is none."""
        name = next((effect.name for effect in self.candidates if carries_state(effect)), None)
        if name is not None:
            model = self.dressed(self.model, [name])
            self.jacobian(model, problem, self.free_paths(model, [name]), [name])
            self.residuals(model, problem)

    def residuals(self, model: AbstractActuator, problem: Problem) -> Evaluated:
        """Weighted residuals."""
        return evaluate(model, problem)

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
        objective = self.objective(model, problem, paths, effects)
        unknowns = objective.unknowns
        point = unknowns.coordinates(unknowns.start)
        residual, slopes = (each[0] for each in objective.residuals(0, point[None]))
        to_values = unknowns.slopes(point)
        priors = unknowns.prior_residuals(point), np.diag(unknowns.prior_slopes / to_values)
        whole = np.where(np.isfinite(residual), residual, BROKEN)
        by_value = slopes / to_values[:, None]
        return np.concatenate([whole, priors[0]]), np.concatenate([by_value, priors[1]], axis=1)


def workbench(case: Case, candidates: Sequence[type[AbstractEffect]]) -> Workbench:
    """Load the actuator of `case` with those of the `candidates` that have no state."""
    priors = case.priors
    model = loaded(case.actuator, [effect for effect in candidates if not carries_state(effect)])
    return Workbench(case, model, tuple(candidates), tuple(priors), dict(priors), len(priors) + SPARE)


def _unknown(entry: Parameter, prior: Prior | None) -> Unknown:
    """One entry of the vector, from its value in the model."""
    return unknown_within(entry.path, entry, (0,), float(entry.value), prior, (None, None))
