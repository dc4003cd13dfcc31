"""Levenberg-Marquardt for many starts at once, within bounds.

Our own beside optimistix, which steps one start, knows no bounds, and, compiled as a whole, cannot be stopped
by a deadline. Measured on two cores that others used too (a muscle that lifts a mass, 850 samples, four
parameters up to 40 % off): from one start 5 evaluations of residuals and Jacobian to the minimum;
`optimistix.LevenbergMarquardt` with the simulation in its program 6, but 22 s to compile it, where the
program here takes 11 s and serves all starts and stages. Twenty starts: 97 evaluations in 6 iterations,
0.06 s; by the steps of optimistix on the same program (`optimistix_solver`) 260 in 42, 0.6 s.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float

from jaxmuscle.estimation.lane import BUDGET, FAILED, Course, Lane, Limits, Local
from jaxmuscle.estimation.marquardt import advance


def descend(
    evaluate: Callable[[Float[np.ndarray, "lanes k"]], list[Local]],
    starts: Float[np.ndarray, "starts k"],
    limits: Limits,
    held: Bool[np.ndarray, "starts k"] | None = None,
    tell: Callable[[Course], None] = lambda course: None,
) -> list[Lane]:
    """Descend from every start; as soon as one lane has ended the next start takes its place.

    At most `limits.lanes` are under way at a time. A step minimises the quadratic model within a radius, in
    which coordinates count by diag(JᵀJ) (Marquardt 1963; Moré 1978); a coordinate at a bound that the
    gradient pushes on is left out.
    """
    keep = np.zeros(starts.shape, dtype=bool) if held is None else held
    lanes = [Lane(u.copy(), h, u.copy(), trial=u.copy()) for u, h in zip(starts, keep, strict=True)]
    waiting = iter(lanes)
    active: list[Lane] = []
    for iteration in _forever():
        active += _next(waiting, limits.lanes - len(active))
        if not active:
            break
        if iteration and time.monotonic() > limits.deadline:
            for lane in lanes:
                if lane in active or lane.local is None:
                    lane.code, lane.reason = (
                        (FAILED, "not begun in time") if lane.local is None else (BUDGET, "")
                    )
            break
        trials = [lane.trial for lane in active if lane.trial is not None]
        for lane, local in zip(active, evaluate(np.stack(trials)), strict=True):
            (limits.solver or advance)(lane, local, limits)
        active = [lane for lane in active if lane.trial is not None]
        begun = sum(lane.local is not None or lane.code == FAILED for lane in lanes)
        best = min((lane.cost for lane in lanes if lane.code != FAILED), default=np.inf)
        tell(Course(iteration, best, len(active), len(lanes) - begun, begun - len(active)))
    return lanes


def _forever() -> Iterator[int]:
    number = 0
    while True:
        yield number
        number += 1


def _next(waiting: Iterator[Lane], count: int) -> list[Lane]:
    return [lane for _, lane in zip(range(count), waiting, strict=False)]
