"""Rivals of an effect that was found: the rarer ones that may explain as much, told without a search, and
which of two is the true one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence, Set

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import paths_of
from jaxmuscle.diagnosis.evidence import gain
from jaxmuscle.diagnosis.excitation import excited
from jaxmuscle.diagnosis.folds import STEPS
from jaxmuscle.diagnosis.likelihood_ratio import more_likely
from jaxmuscle.diagnosis.ranking import Candidate, Ranking, rank, told_apart, unseen_loss
from jaxmuscle.diagnosis.screening import parts_removed
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.verdict import EXPLAINED, MISSING
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.residuals import Evaluated
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.progress import Meter

AS_MUCH = 0.8
"""Part of what the effect that was found removes of the excess error which a rival has to remove, before it
is fitted. Seen at an offset of a load cell that a bladder imitates (rivals 1.0 and 0.9 of 0.99, the next one
0.4), at an offset of a valve that a leak imitates (0.3 of 0.27; 0.1), and at load friction (0.1 of 0.92).
"""
MOST = 3
"""Rivals that are searched at most: those that take away most."""
CLEARLY = 6.0
"""Twice the logarithm of the odds from which a rival comes before what was found: strong evidence (Kass
and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2). An offset of a valve for a leak had 8.8, where
losses of 1.310 and 1.319 on unseen windows did not tell them apart (lift 122001 of
`blind_recordings.drawn`)."""


def rivals(
    bench: Workbench,
    accepted: Sequence[str],
    found: AbstractActuator,
    problem: Problem,
    present: SettledFit,
) -> list[type[AbstractEffect]]:
    """The candidates that wait as rivals, or to refine a friction, which may explain as much as what was
    found.

    Args:
        accepted: names of what the model has without it; `present`: its fit to `problem`.
        found: the model fitted with it.
    """
    least = AS_MUCH * gain(bench.losses(present.model, problem), bench.losses(found, problem))
    waiting = [e for e in bench.candidates if e.name in bench.rivals and e.name not in accepted]
    waiting += bench.refining(accepted)
    parts = parts_removed(bench, accepted, waiting, problem, present)
    near = sorted((-part, i) for i, part in enumerate(parts) if part >= least)
    return excited(bench.case, bench.case.actuator, [waiting[i] for _, i in near[:MOST]])


@dataclasses.dataclass(frozen=True)
class Fitted:
    """The model of a candidate fitted to whole windows, what it leaves, states taken as it predicts them."""

    model: AbstractActuator
    residuals: Evaluated
    predicted_inputs: Set[str]


class WholeWindowFits:
    """Candidates fitted to whole windows, each once; effects, or pairs, beside what the model has."""

    def __init__(self, bench: Workbench, accepted: Sequence[str], training: Problem) -> None:
        """Fit nothing yet. `accepted`: names of what the model has; `training`: the windows."""
        self.bench, self.accepted, self.training = bench, accepted, training
        self._found: dict[tuple[str, bool], Fitted] = {}

    def of(self, candidate: Candidate, predicting: bool) -> Fitted:
        """The fit of a candidate with inputs of links as its model predicts them, else as measured."""
        key = candidate.name, predicting
        if key not in self._found:
            bench, training = dataclasses.replace(self.bench, predicting=predicting), self.training
            names = [*self.accepted, *(effect.name for effect in candidate.effects)]
            model = bench.settled(candidate.model, names, training, STEPS).model
            inputs = bench.predicted_inputs(model, training)
            self._found[key] = Fitted(model, bench.residuals(model, training), inputs)
        return self._found[key]

    def on_equal_terms(self, one: Candidate, other: Candidate) -> tuple[Fitted, Fitted]:
        """Two candidates with inputs as the models predict them, if both predict the same; else as measured.

        A slow error of a pressure that is taken as measured hides which muscle effect moves a joint: over 470
        readings went together what a bladder left, called ends that depend on the pressure, and over 110 with
        pressures as predicted (joint 123030 of `blind_recordings.drawn`: -1.7 in twice the logarithm of the
        odds, and 8.9).
        """
        both = self.of(one, True), self.of(other, True)
        if both[0].predicted_inputs == both[1].predicted_inputs:
            return both
        return self.of(one, False), self.of(other, False)


def does_better(fits: WholeWindowFits, rival: Candidate, found: Candidate, stretch: int) -> bool:
    """Whether a rival comes before what was found: it predicts unseen windows significantly better, or, where
    neither does so, it is clearly the likelier one.

    Ranks of losses over stretches tell little of two models that differ by a few hundredths of the noise; the
    likelihood of thousands of readings does.

    Args:
        fits: by which likelihoods are compared; `stretch`: blocks over which residuals go together.
    """
    if told_apart(found, rival, stretch):
        return True
    if told_apart(rival, found, stretch):
        return False
    one, other = fits.on_equal_terms(found, rival)
    more = _parameters(other.model, rival) - _parameters(one.model, found)
    return more_likely(one.residuals, other.residuals, fits.training.weights, more) >= CLEARLY


def _parameters(model: AbstractActuator, candidate: Candidate) -> int:
    return sum(len(paths_of(model, effect.name)) for effect in candidate.effects)


def likeliest_first(fits: WholeWindowFits, ranking: Ranking, found: int) -> Ranking:
    """The ranking of effects, or of pairs, with that first which does better (:func:`does_better`) than the
    first one and those between, of those that unseen windows support after so many effects `found`.

    With a constant of the card the first one stays first.
    """
    best, *others = ranking.candidates
    if best.has_constant:
        return ranking
    for each in others:
        may = each.judged and each.evidence.supports(found) and not each.has_constant
        if may and does_better(fits, each, best, ranking.stretch):
            best = each
    rest = (each for each in ranking.candidates if each is not best)
    return dataclasses.replace(ranking, candidates=(best, *rest))


def against_waiting(
    fits: WholeWindowFits,
    model: AbstractActuator,
    ranking: Ranking,
    sought: Sequence[type[AbstractEffect]],
    parts: Problem,
    meter: Meter,
    later: bool,
) -> Ranking:
    """The ranking with what waits and may explain as much as its best one; first that stays, unless one of
    those does better (:func:`does_better`).

    Args:
        fits: of candidates beside what the `model` has, to whole windows.
        sought: the effects of which that is the ranking.
        parts: the windows as candidates are judged on them.
        later: whether anything was found before.
    """
    bench, accepted = fits.bench, fits.accepted
    best = ranking.candidates[0]
    waiting = [] if best.has_constant else _waiting(bench, model, accepted, best, sought, parts, later)
    if not waiting:
        return ranking
    tried, among = [*best.effects, *waiting], len(sought) + len(waiting)
    rarer = rank(bench, model, accepted, tried, parts, meter, among)
    (same,) = (each for each in rarer.candidates if each.effects == best.effects)
    better = [
        each
        for each in rarer.candidates
        if each.judged and each is not same and each.evidence.supports(len(accepted))
        if does_better(fits, each, same, rarer.stretch)
    ]
    first = min(better, key=unseen_loss, default=same)
    rest = [*(each for each in rarer.candidates if each is not same), same, *ranking.candidates]
    rest = [each for each in rest if each is not first and each is not best]
    rest.sort(key=lambda each: (not each.judged, unseen_loss(each)))
    return dataclasses.replace(ranking, candidates=(best if first is same else first, *rest))


def _waiting(
    bench: Workbench,
    model: AbstractActuator,
    accepted: Sequence[str],
    best: Candidate,
    sought: Sequence[type[AbstractEffect]],
    parts: Problem,
    later: bool,
) -> Sequence[type[AbstractEffect]]:
    """What waits and may be imitated by the best one of those that were sought.

    Against the first effect that is found, if it leaves little, rarer ones and what refines a friction
    that is declared; where it leaves a part all are tried anyway. Against a later one what refines a
    friction: one that builds up delays a force as a lag of its sensor does.
    """
    if later:
        return [effect for effect in bench.refining(accepted) if effect not in sought]
    if not (bench.rivals or bench.refining(accepted)) or not _explains(bench, model, best.model, parts):
        return []
    present = bench.settled(model, accepted, parts, STEPS)
    return rivals(bench, accepted, best.model, parts, present)


def _explains(bench: Workbench, model: AbstractActuator, found: AbstractActuator, parts: Problem) -> bool:
    """Whether what was found leaves little, or little of what is missing without it."""
    before, after = (max(bench.least_mean_squares(each, parts).values()) - 1 for each in (model, found))
    return after <= max(MISSING**2, EXPLAINED**2 * before)
