"""Workbench of a diagnosis: how its models are fitted, with what they leave as uncertainty."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import gain
from jaxmuscle.diagnosis.model_residuals import ModelResiduals
from jaxmuscle.diagnosis.settled_fit import (
    Factors,
    SettledFit,
    as_record,
    best_of,
    cost_of_noise,
    from_record,
    weight_factors,
)
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.checkpoint import NOTHING_KEPT, Checkpoint
from jaxmuscle.estimation.free_parameters import moved_machine
from jaxmuscle.estimation.losses import SQUARES, Loss
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import Lane, Limits, Tolerances
from jaxmuscle.optimization.levenberg_marquardt import descend
from jaxmuscle.optimization.secant_updates import descend_by_secants
from jaxmuscle.parallel import on_all_cores
from jaxmuscle.parameter_names import of_machine

SPARE = 6
"""Free parameters beyond the declared ones for which fits are laid out: two effects of three. A fit of more
takes its derivatives in several calls of one program."""
FALL = 3e-5
"""Expected fall of the cost, relative to what of it noise does not leave, at which a fit of a search ends.

With ten times as much, practice recording 14 ends at a tenth more cost, and an effect is found that is not
there.
"""
SLOW = 1e-3
"""Fall of the cost over eight steps, relative to the same, below which a candidate's search, and the fit of
any model to a fold, is at its end.

With the fits to all windows of the model without candidates ended like that, too, practice recording 14 has
effects found that are not there: what searches begin with must be as good as it can be.
"""
LEAST_EXCESS = 300.0
"""Cost beyond what noise leaves of which falls are at least taken: they end at 0.01 and 0.3.

Relative to the whole cost (7000 of two pressures beside 50 of an angle whose misfit lasts) a search ended at
falls of 7 of these 50.
"""
PLENTY = 0.2
"""Part of the excess error that is enough in any case, of the cost or of the losses of blocks. An error that
lasts as long as the recording is worth so few readings that the whole of it costs less than a likelihood
ratio of evidence does: of a drift of the load cell that left 5 noise units no candidate had hope. Nor had an
offset of the force of 18 noise units beside a current with coloured noise, whose excess cost more."""
REWEIGHTINGS, ALIKE = 8, 0.1
"""Fits by turns with weights from their own residuals, and change of a weight's logarithm that ends them."""

FEW = 20
"""Independent readings that are outweighed by the priors: half the sum of squares of what a model leaves is
half of these, and moving two constants by three standard deviations costs 9."""


class Goal(NamedTuple):
    """What a fit is made for: the cost that is of use, how near to a minimum is enough, after how many steps.

    The fields are those of :class:`~jaxmuscle.optimization.descents.Tolerances`.
    """

    goal: float
    enough: float
    patience: int


@dataclasses.dataclass(frozen=True)
class Workbench(ModelResiduals):
    """The models of a diagnosis, its recording, and how the ones are fitted to the other.

    Attributes:
        checkpoint: keeps what is finished for a diagnosis that goes on after an interruption.
    """

    checkpoint: Checkpoint = NOTHING_KEPT

    def first_fit(self, problem: Problem, steps: int) -> SettledFit:
        """The fit of the declared model from the values of the card.

        An error that lasts as long as the recording is worth one reading by its own weights, and then the
        priors hold the constants where they are: a jet pipe that lacks nothing was left with 32 noise units,
        as two constants were two standard deviations off (blind recording 110195). Where so little weighs
        against them (:data:`FEW`) it is fitted with weights by the sensors' noise first, too, and the better
        one counts.
        """
        own = self.settled(self.model, [], problem, steps)
        if own.independent_readings >= FEW:
            return own
        moved, _ = self.fit(self.model, [], problem, steps)
        both = own, self.settled(moved, [], problem, steps)
        return both[best_of(both)]

    def best_fit(
        self, starts: Sequence[AbstractActuator], effects: Sequence[str], problem: Problem, steps: int
    ) -> SettledFit:
        """The best of the fits (:meth:`settled`) that begin at several models.

        Where what it leaves weighs little, the best one with weights by the sensors' noise comes before it,
        if that removes plenty of the losses of blocks.
        """
        fits = on_all_cores(lambda start: self.settled(start, effects, problem, steps), starts)
        best = fits[best_of(fits)]
        if not best.weighs_little:
            return best
        fits = on_all_cores(lambda start: self.by_sensor_noise(start, effects, problem, steps), starts)
        other = min(fits, key=lambda fit: float(self.losses(fit.model, problem).sum()))
        return other if self.removes_plenty(best.model, other.model, problem) else best

    def by_sensor_noise(
        self, start: AbstractActuator, effects: Sequence[str], problem: Problem, steps: int
    ) -> SettledFit:
        """The fit of a model with weights by the noise of the sensors, carried on with its own weights unless
        that spoils it.
        """
        moved, lane = self.fit(start, effects, problem, steps, SLOW)
        left = self.discrepancies(moved, problem)
        first = SettledFit(moved, lane.cost, lane.code, left, self._far_from_priors(moved, effects))
        found = self.settled(moved, effects, problem, steps, SLOW)
        return first if self.removes_plenty(found.model, moved, problem) else found

    def removes_plenty(self, present: AbstractActuator, model: AbstractActuator, problem: Problem) -> bool:
        """Whether a model removes :data:`PLENTY` of the losses of blocks, where the sensors' noise weighs."""
        return gain(self.losses(present, problem), self.losses(model, problem)) >= PLENTY

    def settled(
        self,
        model: AbstractActuator,
        effects: Sequence[str],
        problem: Problem,
        steps: int,
        slow: float = 0.0,
    ) -> SettledFit:
        """:meth:`fit` with what the fitted model itself leaves counted as uncertainty beside the noise.

        A model that lacks something would else be bent away from its priors, which thousands of readings
        outweigh. Weights and fit are found by turns, from the weights of `model`.
        """
        return self.kept(
            "settled",
            model,
            effects,
            (problem, steps, slow),
            lambda: self._settled(model, effects, problem, steps, slow),
        )

    def kept(
        self,
        kind: str,
        model: AbstractActuator,
        effects: Sequence[str],
        inputs: object,
        compute: Callable[[], SettledFit],
        passed_over: Callable[[], None] = lambda: None,
    ) -> SettledFit:
        """A fit of `model` with `effects` out of the checkpoint, or computed and kept there.

        Candidates that are not in `effects` change nothing: what one bench has fitted serves another one of
        the same recording that has other candidates.

        Args:
            kind: what is done; `inputs`: all that determines its outcome beside model, effects and recording.
            passed_over: called in place of `compute` where the checkpoint has it.
        """
        of = self.bare(model, effects), list(effects), (self.predicting, inputs)

        def restored(record: object) -> SettledFit:
            passed_over()
            return from_record(record, self.dressed(model, effects))

        def record(fit: SettledFit) -> object:
            return as_record(fit, self.dressed(model, effects))

        (found,) = self.checkpoint.recall(kind, [of], lambda _: [compute()], record, restored)
        return found

    def _settled(
        self, model: AbstractActuator, effects: Sequence[str], problem: Problem, steps: int, slow: float
    ) -> SettledFit:
        model, fits = self.dressed(model, effects), 0
        factors = weight_factors(self.discrepancies(model, problem))
        while True:
            model, lane = self.fit(model, effects, problem, steps, slow, factors)
            fits, left = fits + 1, self.discrepancies(model, problem)
            before, factors = factors, weight_factors(left)
            alike = (np.abs(np.log(before[out]) - np.log(factors[out])) <= ALIKE for out in factors)
            if fits == REWEIGHTINGS or all(each.all() for each in alike):
                break
        return SettledFit(model, lane.cost, lane.code, left, self._far_from_priors(model, effects))

    def _far_from_priors(self, model: AbstractActuator, effects: Sequence[str]) -> float:
        """Half the sum of squared distances of a model's free parameters from their priors."""
        priors = self.unknowns(model, self.free_paths(model, effects), effects)
        far = priors.prior_residuals(priors.coordinates(priors.start))
        return 0.5 * float((far**2).sum())

    def fit(
        self,
        model: AbstractActuator,
        effects: Sequence[str],
        problem: Problem,
        steps: int,
        slow: float = 0.0,
        factors: Factors | None = None,
        goal: Goal | None = None,
    ) -> tuple[AbstractActuator, Lane]:
        """`model` with its declared parameters and those of `effects` fitted to `problem`.

        A search compares costs that differ by more than the last steps to a minimum would lower them: a
        descent ends when its next step is expected to lower the cost by less than :data:`FALL` of what of it
        noise does not leave, or when several steps together have lowered it by less than `slow` of that.

        Args:
            factors: what the weights of `problem`, by the noise of the sensors, are multiplied by, if not
                by 1.
            goal: cost that is of use, if not any.
        """
        model = self.dressed(model, effects)
        paths = self.free_paths(model, effects)
        problem = self.seen_by(model, problem)
        factors = {out: np.ones(1) for out in problem.weights} if factors is None else factors
        objective = self.objective(model, problem.reweighted(factors), paths, effects)
        unknowns, samples = objective.unknowns, objective.samples
        bounds = (unknowns.lower, unknowns.upper)
        floor = cost_of_noise(factors, problem, self.loss)
        ends = Tolerances(fall=FALL, slow=slow, floor=floor, least=LEAST_EXCESS)
        if goal is not None:
            ends = dataclasses.replace(ends, **goal._asdict())
        limits = Limits(*bounds, steps, 1, samples=samples, reach=unknowns.reach, tolerances=ends)
        start = unknowns.coordinates(unknowns.start)
        # Where a search begins, and what it ends with, is found by derivatives: secants end a little higher
        # in a rugged valley (practice recording 10: 1 % of the cost, 5.4 mean squares held out for 4.7).
        if slow and all(of_machine(path) for path in paths):
            lane = descend_by_secants(objective.values_with_priors, objective.with_priors, start, limits)
        else:
            (lane,) = descend(objective.at, start[None], limits)
        return moved_machine(model, unknowns, lane.u, 0), lane


def workbench(
    case: Case,
    candidates: Sequence[type[AbstractEffect]],
    constants: Sequence[CardConstant] = (),
    refinements: Sequence[type[AbstractEffect]] = (),
    rivals: Sequence[type[AbstractEffect]] = (),
    checkpoint: Checkpoint = NOTHING_KEPT,
    predicting: bool = False,
    loss: Loss = SQUARES,
) -> Workbench:
    """The workbench of a case, for candidates, and for refinements and rivals that wait until something was
    found.
    """
    candidates = [*candidates, *refinements, *rivals]
    priors, width = case.priors, len(case.priors) + SPARE
    return Workbench(
        case.actuator,
        tuple(candidates),
        tuple(priors),
        dict(priors),
        tuple(constants),
        tuple(effect.name for effect in refinements),
        tuple(effect.name for effect in rivals),
        case,
        width,
        predicting,
        loss,
        checkpoint,
    )
