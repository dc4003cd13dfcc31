"""Rows of the benchmarks on measured data: what no fit has seen is counted, what one has seen is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from published_rows import SEEN, Row, aside, at_most, row


def drive_run(name: str, *, published: float, theirs: float, ours: float, fitted: bool) -> Row:
    """Open-loop errors of a run of a drive [mm]: as published, and simulated here with both parameter sets.

    The goal is the better error of the published parameters; a run that was fitted is not counted.
    """
    goal = min(theirs, published)
    entry = row("EMPS", f"{name}: open-loop RMSE", f"{goal:.2f}", ours, ours < goal, "mm", "less",
                "the better error of the published parameters",
                "the fitted parameters predict no better than the published ones")  # fmt: skip
    entry |= {"published": published, "published_parameters_here": theirs}
    return aside(entry, SEEN) if fitted else entry


def arm_predictor(joint: int, goal: float, errors: Mapping[str, float], name: str, *, coming: bool) -> Row:
    """Errors [rad] of one physical predictor of an arm's joint beside a published linear one.

    `errors`: of every predictor, "physical, X" having a counterpart "linear, X"; `coming`: the predictor is
    told the pressures of the future, which no controller has: it is not counted.
    """
    ours, linear = errors[name], errors[name.replace("physical", "linear")]
    why = f"the physical model does not beat it; a linear one told the same has {linear:.4f} here"
    entry = row("linear model", f"joint {joint}, RMSE: {name}", f"{goal:g}", ours, ours < goal, "rad", "less",
                "held-out episodes", why)  # fmt: skip
    better = [n for n, error in errors.items() if n.startswith("linear") and error < ours]
    entry |= {"beaten_by": better}
    return aside(entry, SEEN) if coming else entry


def static_force(figure: str, law: str, ours: float, here: Mapping[str, float], why: str) -> Row:
    """Error [N] on lengths, or a muscle, that no fit has seen, beside the printed error of the makers' law.

    `here`: errors of that law evaluated on the very points that are judged.
    """
    entry = at_most("Bolen et al. 2026", figure, law, ours, "N", "the makers' law", why)
    return {**entry, "makers_law_here": dict(here)}


def extrapolated(folds: Sequence[Mapping[str, Any]]) -> str:
    """Where the error of lengths left out one by one arises: at the ends, which are extrapolated, or between.

    `folds`: in the order of the lengths, the error "after" of each [N].
    """
    errors = [fold["after"] for fold in folds]
    between = " and ".join(f"{error:.1f}" for error in errors[1:-1])
    return (
        f"the longest and the shortest length are extrapolated, to {errors[0]:.1f} and {errors[-1]:.1f} N; "
        f"those between are predicted to {between} N"
    )
