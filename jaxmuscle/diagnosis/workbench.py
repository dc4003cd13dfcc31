"""Workbench of a diagnosis: how its models are fitted, in programs that they share, and what they leave."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_models import CandidateModels
from jaxmuscle.diagnosis.card_constants import CardConstant
from jaxmuscle.diagnosis.evidence import Losses, block_losses, blocks
from jaxmuscle.diagnosis.settled_fit import (
    Factors,
    SettledFit,
    as_record,
    best_of,
    from_record,
    noise_squares,
    weight_factors,
)
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.checkpoint import NOTHING_KEPT, Checkpoint
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.free_parameters import moved_machine
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.objective import Objective, SharedProgram
from jaxmuscle.estimation.predicted_inputs import with_inputs_of, with_predicted_inputs
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import Evaluated, evaluate
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN, Lane, Limits, Tolerances
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
class Workbench(CandidateModels):
    """The models of a diagnosis, its recording, and how the ones are fitted to the other.

    Attributes:
        case: the recording, made ready.
        width: number of tangents of a fit.
        checkpoint: keeps what is finished for a diagnosis that goes on after an interruption.
        predicting: whether links have inputs as the model that is looked at predicts them, where it may
            (:func:`~jaxmuscle.estimation.predicted_inputs.with_predicted_inputs`); else as measured.
    """

    case: Case
    width: int
    checkpoint: Checkpoint = NOTHING_KEPT
    predicting: bool = False

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
        return Objective([station], unknowns, Squares(), program=self.program(model, effects))

    def program(self, model: AbstractActuator, effects: Sequence[str]) -> SharedProgram:
        """What evaluates every fit of models of one structure."""
        return SharedProgram(tuple(self.order(model, effects)), self.width)

    def seen_by(self, model: AbstractActuator, problem: Problem) -> Problem:
        """A problem with inputs of links as they are for `model`."""
        if not self.predicting:
            return problem
        return with_predicted_inputs(model, with_inputs_of(problem, self.case.problem))

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
        """The best of the fits (:meth:`settled`) that begin at several models."""
        fits = on_all_cores(lambda start: self.settled(start, effects, problem, steps), starts)
        return fits[best_of(fits)]

    def discrepancies(self, model: AbstractActuator, problem: Problem) -> dict[str, list[Discrepancy]]:
        """What `model` leaves of each output, column by column."""
        layout, left = ResidualLayout.of(model, problem), self.residuals(model, problem)
        found = {}
        for output, columns in layout.columns.items():
            values, weights = (layout.table(output, each[output]) for each in (left, problem.weights))
            found[output] = [
                Discrepancy.of(values[..., i].ravel(), weights[..., i].ravel() > 0)
                for i in range(len(columns))
            ]
        return found

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
        priors = self.unknowns(model, self.free_paths(model, effects), effects)
        far = priors.prior_residuals(priors.coordinates(priors.start))
        return SettledFit(model, lane.cost, lane.code, left, 0.5 * float((far**2).sum()))

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
        floor = 0.5 * noise_squares(factors, problem)
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

    def compile_ahead(self, problem: Problem) -> None:
        """Have the programs compiled by which candidates are searched, but for those of the model itself."""

        def compiled(effect: type[AbstractEffect]) -> None:
            model = self.dressed(self.model, [effect.name])
            self.jacobian(model, problem, self.free_paths(model, [effect.name]), [effect.name])
            self.residuals(model, problem)

        own = {*self.together(None)}
        others = [effect for effect in self.one_of_each() if {*self.together(effect)} != own]
        if others:
            on_all_cores(compiled, others)

    def residuals(self, model: AbstractActuator, problem: Problem) -> Evaluated:
        """Weighted residuals."""
        return evaluate(model, self.seen_by(model, problem))

    def cost(self, model: AbstractActuator, problem: Problem) -> float:
        """Half the sum of squared weighted residuals, without priors."""
        return squares(self.residuals(model, problem))

    def mean_squares(self, model: AbstractActuator, problem: Problem) -> dict[str, float]:
        """Mean square weighted residual of every output, 1 being what noise and smoothing leave."""
        found = {}
        for output, values in self.residuals(model, problem).items():
            weighted = np.asarray(problem.weights[output]) > 0
            found[output] = float((values[weighted] ** 2).mean())
        return found

    def losses(self, model: AbstractActuator, problem: Problem) -> Losses:
        """Loss of every block of windows that the model may have been fitted to."""
        block = blocks(len(problem.rows), problem.samples, int(problem.period))
        judged = np.arange(int(block.max()) + 1)
        return block_losses(self.residuals(model, problem), problem.weights, block, judged)

    def least_mean_squares(self, model: AbstractActuator, problem: Problem) -> dict[str, float]:
        """:meth:`mean_squares` with inputs of links as measured or as predicted: the less.

        Their noise is no error of the model.
        """
        both = [
            dataclasses.replace(self, predicting=each).mean_squares(model, problem) for each in (False, True)
        ]
        return {output: min(each[output] for each in both) for output in both[0]}

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


def squares(residuals: Evaluated) -> float:
    """Half the sum of squares."""
    return 0.5 * sum(float((r**2).sum()) for r in residuals.values())


def workbench(
    case: Case,
    candidates: Sequence[type[AbstractEffect]],
    constants: Sequence[CardConstant] = (),
    refinements: Sequence[type[AbstractEffect]] = (),
    rivals: Sequence[type[AbstractEffect]] = (),
    checkpoint: Checkpoint = NOTHING_KEPT,
    predicting: bool = False,
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
        checkpoint,
        predicting,
    )
