"""Rivals of an effect that was found: the rarer ones that may explain as much, told without a search."""

from __future__ import annotations

from collections.abc import Sequence

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.evidence import gain
from jaxmuscle.diagnosis.excitation import excited
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
