"""Starts that have come to one place go on as one; those that failed stay where they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from jaxmuscle.errors import InputError
from jaxmuscle.estimation.descent import descend
from jaxmuscle.estimation.lane import FAILED, Course, Lane, Limits, best
from jaxmuscle.estimation.objective import Objective

SAME = 1e-3
"""Distance of two points in every coordinate up to which they are one."""


def ends(lanes: Sequence[Lane]) -> tuple[Float[np.ndarray, "starts k"], dict[int, Lane]]:
    """Where lanes are, and those that failed, by number."""
    return np.stack([lane.u for lane in lanes]), {i: e for i, e in enumerate(lanes) if e.code == FAILED}


def descend_distinct(
    objective: Objective,
    points: Float[np.ndarray, "starts k"],
    failed: dict[int, Lane],
    limits: Limits,
    tell: Callable[[Course], None],
) -> list[Lane]:
    """Descend from points that differ; those at one place share the outcome, failed ones stay as they are."""
    groups: list[list[int]] = []
    for i, point in enumerate(points):
        if i in failed:
            continue
        twin = next((g for g in groups if np.allclose(points[g[0]], point, rtol=0, atol=SAME)), None)
        groups.append([i]) if twin is None else twin.append(i)
    found = descend(objective.at, np.stack([points[g[0]] for g in groups]), limits, tell=tell)
    lanes = dict(failed)
    for group, end in zip(groups, found, strict=True):
        lanes |= dict.fromkeys(group, end)
    return [lanes[i] for i in range(len(points))]


def winner_of(lanes: Sequence[Lane]) -> Lane:
    """The best lane.

    Raises:
        InputError: all failed; the reasons are counted.
    """
    winner = best(lanes)
    if winner is not None:
        return winner
    reasons = [lane.reason for lane in lanes]
    counted = "; ".join(f"{reasons.count(r)} × {r}" for r in dict.fromkeys(reasons))
    many = f"all {len(lanes)} starts failed" if len(lanes) > 1 else "the only start failed"
    raise InputError(
        f"{many}: {counted}. Check the values and units on the card, narrow the priors, or set bounds"
    )
