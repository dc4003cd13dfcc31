"""What the models of a diagnosis leave: residuals, losses, derivatives, in programs that they share."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_models import CandidateModels
from jaxmuscle.diagnosis.evidence import Losses, block_losses, blocks
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.dataset import Station
from jaxmuscle.estimation.losses import SQUARES, Loss
from jaxmuscle.estimation.objective import Objective, SharedProgram
from jaxmuscle.estimation.predicted_inputs import with_inputs_of, with_predicted_inputs
from jaxmuscle.estimation.residual_layout import ResidualLayout
from jaxmuscle.estimation.residuals import Evaluated, evaluate
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.optimization.descents import BROKEN
from jaxmuscle.parallel import on_all_cores


@dataclasses.dataclass(frozen=True)
class ModelResiduals(CandidateModels):
    """The models of a diagnosis and its recording, with what the ones leave of the other.

    Attributes:
        case: the recording, made ready.
        width: number of tangents of a fit.
        predicting: whether links have inputs as the model that is looked at predicts them, where it may
            (:func:`~jaxmuscle.estimation.predicted_inputs.with_predicted_inputs`); else as measured.
        loss: by which models are fitted.
    """

    case: Case
    width: int
    predicting: bool
    loss: Loss = SQUARES

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
        return Objective([station], unknowns, self.loss, program=self.program(model, effects))

    def program(self, model: AbstractActuator, effects: Sequence[str]) -> SharedProgram:
        """What evaluates every fit of models of one structure."""
        return SharedProgram(tuple(self.order(model, effects)), self.width)

    def seen_by(self, model: AbstractActuator, problem: Problem) -> Problem:
        """A problem with inputs of links as they are for `model`."""
        if not self.predicting:
            return problem
        return with_predicted_inputs(model, with_inputs_of(problem, self.case.problem))

    def predicted_inputs(self, model: AbstractActuator, problem: Problem) -> set[str]:
        """Measured states that `model` takes as it predicts them."""
        seen, measured = self.seen_by(model, problem).track.measured, self.case.problem.track.measured
        return {state for state, values in seen.items() if values is not measured[state]}

    def discrepancies(self, model: AbstractActuator, problem: Problem) -> dict[str, list[Discrepancy]]:
        """What `model` leaves of each output, column by column."""
        layout, left = ResidualLayout.of(model, problem), self.residuals(model, problem)
        found = {}
        for output, columns in layout.columns.items():
            values, weights = (layout.table(output, each[output]) for each in (left, problem.weights))
            found[output] = [
                Discrepancy.of(values[..., i].ravel(), weights[..., i].ravel() > 0, self.loss)
                for i in range(len(columns))
            ]
        return found

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

    def worst_mean_square(self, model: AbstractActuator, problem: Problem) -> float:
        """:meth:`mean_squares` of the output of which most is left."""
        return max(self.mean_squares(model, problem).values())

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


def squares(residuals: Evaluated) -> float:
    """Half the sum of squares."""
    return 0.5 * sum(float((r**2).sum()) for r in residuals.values())
