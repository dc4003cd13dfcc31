"""Rivals of an effect that was found: the rarer ones that may explain as much, told without a search, and
which of two is the true one.
"""

from __future__ import annotations

from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.candidates import paths_of
from jaxmuscle.diagnosis.evidence import gain
from jaxmuscle.diagnosis.excitation import excited
from jaxmuscle.diagnosis.folds import STEPS
from jaxmuscle.diagnosis.likelihood_ratio import more_likely
from jaxmuscle.diagnosis.ranking import Candidate, told_apart
from jaxmuscle.diagnosis.screening import parts_removed
from jaxmuscle.diagnosis.settled_fit import SettledFit
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.estimation.windows import Problem

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


def does_better(
    bench: Workbench,
    accepted: Sequence[str],
    rival: Candidate,
    found: Candidate,
    training: Problem,
    stretch: int,
) -> bool:
    """Whether a rival comes before what was found: it predicts unseen windows significantly better, or, where
    neither does so, it is clearly the likelier one.

    Ranks of losses over stretches tell little of two models that differ by a few hundredths of the noise; the
    likelihood of thousands of readings does.

    Args:
        accepted: names of what the model has beside one of these.
        training: whole windows, on which likelihoods are compared; `stretch`: blocks over which residuals go
            together.
    """
    if told_apart(found, rival, stretch):
        return True
    if told_apart(rival, found, stretch):
        return False
    names = [[*accepted, each.name] for each in (found, rival)]
    fits = [
        bench.settled(each.model, own, training, STEPS).model
        for each, own in zip((found, rival), names, strict=True)
    ]
    more = len(paths_of(fits[1], rival.name)) - len(paths_of(fits[0], found.name))
    one, other = (bench.residuals(each, training) for each in fits)
    return more_likely(one, other, training.weights, more) >= CLEARLY
