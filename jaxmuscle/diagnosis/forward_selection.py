"""Forward selection of effects: rank all candidates, add the best one that unseen windows support, refit
everything, repeat.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from jaxmuscle.actuators import AbstractImposed
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidate_search import from_other_shapes
from jaxmuscle.diagnosis.candidates import is_dry_friction
from jaxmuscle.diagnosis.constant_ranking import explains, rank_with_constants
from jaxmuscle.diagnosis.diagnosis_data import Round
from jaxmuscle.diagnosis.folds import FOLDS
from jaxmuscle.diagnosis.last_fit import FIT_STEPS
from jaxmuscle.diagnosis.pairs import best_pairs
from jaxmuscle.diagnosis.ranking import (
    DECLARED,
    REFIT,
    Candidate,
    Ranking,
    rank,
)
from jaxmuscle.diagnosis.rivals import WholeWindowFits, against_waiting, likeliest_first
from jaxmuscle.diagnosis.search_rounds import round_of
from jaxmuscle.diagnosis.sequential_replacement import others_for_its_place, replacements, still_needed
from jaxmuscle.diagnosis.verdict import MISSING, MUCH, VIOLATED, within_form_of_friction
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.case import Case
from jaxmuscle.estimation.weights import expected_spread
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.parallel import in_background
from jaxmuscle.progress import Meter

MOST_EFFECTS = 3
NOTHING_LEFT = 1.1
"""Typical mean square weighted residual (1 = noise) below which most windows miss nothing."""
PARTS = 4
"""Parts of a window that candidates are searched and judged on: starting anew keeps the cost smooth. In them
what grows slowly hardly shows: of a drift of the force that leaves 39 mean squares over whole windows, 3
(joint 90003 of `blind_recordings.drawn`)."""
ALL_PARTS, SHORTEST = 16, 50
"""Parts that all windows have together at least, and samples that each part keeps. Where whole runs are
asked for windows are few: the four parts of a drive's only run, 6 s each, left few independent stretches, and
of its damping and its dry friction the damping alone was found, twice what it is. Short windows of a machine
that is integrated are not cut: over three samples nothing was seen that a joint of an arm lacks, over eleven
(0.11 s) its friction. Where the motion is imposed nothing has to grow, and four parts only make four of one.
"""
SPREAD = 2.0
"""Standard deviations by which smoothed states are shifted to see what they leave uncertain."""


@dataclasses.dataclass
class ForwardSelection:
    """A model that grows.

    Attributes:
        parts, training: the training windows, as candidates are searched and judged on them, and whole.
        ready: waits for what a search needs compiled.
        model: as found so far, fitted to `training`; `converged`: whether that fit was.
        found: what was added, effect by effect; `rounds`: the searches; `folds`: fits of the last one.
        given: how many of `found` the search among all candidates began with.
        at_first: mean square of what the declared model leaves over whole windows, of the worst output.
        before: the model and the ranking of the last search that added something.
        rankings: effect that was added alone → ranking of the search that added it.
        removed: effects that were taken out again, once each.
    """

    bench: Workbench
    parts: Problem
    training: Problem
    meter: Meter
    ready: Callable[[], object]
    model: AbstractActuator
    converged: bool
    found: list[Candidate] = dataclasses.field(default_factory=list)
    rounds: list[Round] = dataclasses.field(default_factory=list)
    folds: tuple[AbstractActuator, ...] = ()
    before: tuple[AbstractActuator, Ranking] | None = None
    rankings: dict[str, Ranking] = dataclasses.field(default_factory=dict)
    given: int = 0
    at_first: float = 1.0
    removed: set[str] = dataclasses.field(default_factory=set)

    @property
    def names(self) -> list[str]:
        """Names of the effects that were added."""
        return [candidate.name for candidate in self.found]

    def seek(self, whole: bool = False) -> None:
        """Add effects until nothing is missing, none is supported, or there are :data:`MOST_EFFECTS`.

        Something is missing, too, where all readings are explained by a value that contradicts the card.

        Args:
            whole: whether candidates are searched and judged on whole windows, not on parts of them; on as
                many parts as there are folds where there are fewer windows.
        """
        if whole:
            self.parts = self.training.in_parts(math.ceil(FOLDS / len(self.training.rows)))
        most = min(self.given + MOST_EFFECTS, len(self.bench.candidates) + len(self.bench.constants))
        while len(self.found) < most:
            left = self._left()
            much = left > 1 + MUCH**2
            quiet = left < NOTHING_LEFT or self._may_be_form_of_friction(left)
            quiet = quiet and not self._contradicts_the_card()
            if quiet or not (self._single(much) or (much and self._pair())):
                break
            self._replace_earlier()
            self._remove_unneeded()

    def _left(self) -> float:
        """Mean square of what the model leaves over whole windows, of the worst output (1 = noise)."""
        return self.bench.worst_mean_square(self.model, self.training)

    def _may_be_form_of_friction(self, left: float) -> bool:
        """Whether dry friction was found and leaves so little that its law may be the cause."""
        friction = any(is_dry_friction(effect) for candidate in self.found for effect in candidate.effects)
        return friction and within_form_of_friction(left, self.at_first)

    def _contradicts_the_card(self) -> bool:
        """Whether a value has run far from the card's: it may make up for what is missing."""
        freed = [*self.bench.freed(self.names)]
        return self.bench.farthest_from_card(self.model, but=freed) > VIOLATED

    def begin_with(self, effect: type[AbstractEffect]) -> bool:
        """Add one candidate before any other is tried, if unseen windows support it."""
        ranking = rank(self.bench, self.model, [], [effect], self.parts, self.meter)
        best = ranking.supported(0)
        if best is None:
            return False
        self.rounds.append(round_of(ranking, best))
        self._add(best)
        self.given = 1
        self.ready = compiling(self.bench, self.parts)
        return True

    def _single(self, much_is_left: bool) -> bool:
        """Add the best candidate, if unseen windows support it."""
        self.ready()
        effects = self.bench.sought(self.names, much_is_left)
        if not effects and all(constant.name in self.names for constant in self.bench.constants):
            return False  # nothing is left but what waits for an effect that was not found
        ranking = rank_with_constants(self.bench, self.model, self.names, effects, self.parts, self.meter)
        if ranking.valley is not None:
            self._refit((self.model, ranking.valley))
            ranking = self._ranked_again(ranking, effects)
        best = ranking.supported(len(self.found))
        if best is not None and not explains(best, len(self.found)):
            best = None
        if best is not None:
            fits = WholeWindowFits(self.bench, self.names, self.training)
            ranking = likeliest_first(fits, ranking, len(self.found))
            later = len(self.found) > self.given
            ranking = against_waiting(fits, self.model, ranking, effects, self.parts, self.meter, later)
            best = ranking.candidates[0]
        self.rounds.append(round_of(ranking, best))
        if best is not None or len(self.found) == self.given:
            self.before = self.model, ranking
        if best is None:
            self.folds = ranking.folds
            return False
        self._add(best)
        self.rankings[best.name] = ranking
        return True

    def _replace_earlier(self) -> None:
        """Put another effect in the place of one that was added before the last, if it does better there."""
        for place, earlier in enumerate(self.found[self.given : -1], self.given):
            alone = self.rankings.get(earlier.name)
            if alone is None:
                continue
            others = [name for name in self.names if name != earlier.name]
            tried = others_for_its_place(alone, self.names, something_is_left=self._left() > 1 + MISSING**2)
            fits = WholeWindowFits(self.bench, others, self.training)
            again = replacements(fits, self.model, earlier, tried, self.parts, self.meter)
            if again is None:
                continue
            best = again.candidates[0]
            self.rounds.append(dataclasses.replace(round_of(again, best), beside=tuple(others)))
            if best.name != earlier.name:
                self.found[place] = best
                self._refit_with(best)

    def _remove_unneeded(self) -> None:
        """Take out what was added before the last, if unseen windows do not support it beside that."""
        for earlier in self.found[self.given : -1]:
            if earlier.name not in self.rankings or earlier.name in self.removed:
                continue
            others = [name for name in self.names if name != earlier.name]
            (effect,) = earlier.effects
            again, bare = still_needed(self.bench, self.model, self.names, effect, self.parts, self.meter)
            if again.supported(len(others)) is None:
                self.before = None  # the search that added the last effect was beside this one
                self.removed.add(earlier.name)
                self.found = [each for each in self.found if each is not earlier]
                self.rounds.append(dataclasses.replace(round_of(again, None), beside=tuple(others)))
                self._refit((bare, self.bench.with_card_values(bare)))
                self.folds = again.folds

    def _ranked_again(self, ranking: Ranking, effects: Sequence[type[AbstractEffect]]) -> Ranking:
        """The ranking for the model in its better valley, of what was worth judging beside that valley."""
        judged = {effect for each in ranking.candidates if each.judged for effect in each.effects}
        again = [effect for effect in effects if effect in judged]
        if not again:
            return ranking
        found = rank_with_constants(
            self.bench, self.model, self.names, again, self.parts, self.meter, len(effects)
        )
        names = {each.name for each in found.candidates}
        rest = [each for each in ranking.candidates if each.name not in names]
        return dataclasses.replace(found, candidates=(*found.candidates, *rest))

    def _pair(self) -> bool:
        """Add a pair, in place of a single effect that was added, which may imitate the two, or of none."""
        further = len(self.found) - self.given
        if self.before is None or further > 1:
            return False
        model, ranking = self.before
        pairs = best_pairs(self.bench, model, self.names[: self.given], ranking, self.parts, self.meter)
        pair = pairs.supported(len(self.found) + 1)
        if pair is None or not explains(pair, len(self.found)):
            return False
        fits = WholeWindowFits(self.bench, self.names[: self.given], self.training)
        pairs = likeliest_first(fits, pairs, len(self.found) + 1)
        pair = pairs.candidates[0]
        del self.found[self.given :]
        ranking = dataclasses.replace(pairs, candidates=(*pairs.candidates, *ranking.candidates))
        self.rounds.append(round_of(ranking, pair))
        self._add(pair)
        return True

    def _add(self, best: Candidate) -> None:
        """Add what was found and refit everything."""
        self.found += best.apart()
        self._refit_with(best)

    def _refit_with(self, best: Candidate) -> None:
        """Refit everything, from the model with what was added."""
        self.meter.expect(REFIT)
        self.meter.did(0.0, f"adding {best.name}, refitting everything")
        self._refit((best.model, self.bench.with_card_values(best.model)))
        self.folds = best.folds
        self.meter.did(REFIT, f"looking whether the model with {best.name} lacks anything else")

    def _refit(self, begins: Sequence[AbstractActuator]) -> None:
        """Fit everything, from several models, and where something is left from other shapes, too."""
        fitted = self.bench.best_fit(begins, self.names, self.training, FIT_STEPS)
        if self.bench.worst_mean_square(fitted.model, self.training) > NOTHING_LEFT:
            effects = [effect for candidate in self.found for effect in candidate.effects]
            fitted = from_other_shapes(self.bench, fitted, self.names, effects, self.training)
        self.model, self.converged = fitted.model, fitted.converged


def compiling(bench: Workbench, parts: Problem) -> Callable[[], object]:
    """Begin to compile what searches of candidates need; returns what waits for it."""
    return in_background(lambda: bench.compile_ahead(parts)).result


def parts_of_a_window(windows: int, samples: int, imposed: bool = False) -> int:
    """Number of parts that each of so many windows, of so many samples, is cut into.

    Args:
        imposed: whether nothing is integrated.
    """
    wanted = max(PARTS, math.ceil(ALL_PARTS / max(windows, 1)))
    least = PARTS if imposed else math.ceil(FOLDS / max(windows, 1))
    return max(min(wanted, samples // SHORTEST), least)


def forward_selection(
    case: Case, bench: Workbench, meter: Meter, first: type[AbstractEffect] | None = None
) -> ForwardSelection:
    """The declared model fitted, before anything but the `first` effect is tried."""
    windows, samples = len(case.training.rows), case.training.samples
    imposed = isinstance(case.actuator, AbstractImposed)
    parts = case.training.in_parts(parts_of_a_window(windows, samples, imposed))
    meter.did(0.0, "fitting the declared model")
    ready = compiling(bench, parts) if first is None else (lambda: None)
    declared = bench.first_fit(parts, FIT_STEPS).model
    meter.did(DECLARED, "fitting the declared model with its final weights")
    parts = _with_spread(case, bench, parts, declared)
    declared = bench.settled(declared, [], parts, FIT_STEPS).model
    training = _with_spread(case, bench, case.training, declared)
    fitted = bench.settled(declared, [], training, FIT_STEPS)
    left = bench.worst_mean_square(fitted.model, training)
    return ForwardSelection(
        bench, parts, training, meter, ready, fitted.model, fitted.converged, at_first=left
    )


def _with_spread(case: Case, bench: Workbench, training: Problem, model: AbstractActuator) -> Problem:
    """The training windows, with weights that allow for what the smoothed states leave uncertain."""
    wider = {name: SPREAD * values for name, values in case.observed.spread.items()}
    variance = bench.checkpoint.remember(
        "spread", (bench.bare(model, []), training), lambda: expected_spread(model, training, wider)
    )
    return training.allowing(variance)
