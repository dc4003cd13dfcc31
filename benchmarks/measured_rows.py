"""Rows of the benchmarks on measured data: what no fit has seen is counted, what one has seen is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from published_rows import OWN, SEEN, Row, aside, at_most, row


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


def closed_on_plant(rig: str, effect: str, found: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """Tracking errors on a plant with an effect that the card does not name, beside two other controllers'.

    `found`: "rule", "left out" (tuned on a model without the effect) and "diagnosed" → root mean square
    "tracking" error and "effort", both over runs that no tuning has seen.
    """
    own, rule = found["diagnosed"], found["rule"]
    share, effort = own["tracking"] / rule["tracking"], own["effort"] / rule["effort"]
    against = row("Ziegler and Nichols", f"{rig}, hidden {effect}: tracking error tuned over by rule", "0.6",
                  share, share <= 0.6 and effort <= 1.0, "", "at most, with no more effort",
                  "unseen references, payloads and supplies, on the oracle of the rig",
                  f"{share:.2f} of the error with {effort:.2f} of the effort")  # fmt: skip
    bare = found["left out"]
    without, less = own["tracking"] / bare["tracking"], own["effort"] / bare["effort"]
    worth = row("the model without it", f"{rig} with hidden {effect}: tracking error tuned on the diagnosed "
                "model over tuned without the effect", "1", without, without <= 1.0, "", "not more",
                "what closing the loop with data is worth", f"with {less:.2f} of the effort")  # fmt: skip
    return [aside({**against, "effort_over": effort}, OWN), aside({**worth, "effort_over": less}, OWN)]


def worth_of_naming(rig: str, effect: str, found: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """Tracking errors of controllers on a model without an effect, and with it named, on a plant that has it.

    `found`: "PID, left out", "inverse, named", … → "tracking" and "effort", beside "rule".
    """
    rows = []
    for name in ("PID", "inverse", "inverse and PID"):
        own, bare = found[f"{name}, named"], found[f"{name}, left out"]
        ratio, effort = own["tracking"] / bare["tracking"], own["effort"] / bare["effort"]
        over = own["tracking"] / found["rule"]["tracking"]
        entry = row("the model without it", f"{rig} with hidden {effect}, {name}: tracking error with the "
                    "effect named over that without", "1", ratio, ratio <= 1.0, "", "not more",
                    "unseen references on the oracle of the rig",
                    f"with {effort:.2f} of the effort; {over:.2f} of the error by rule")  # fmt: skip
        rows.append(aside({**entry, "effort_over": effort, "over_rule": over}, OWN))
    return rows


def stable_on_plants(rig: str, effect: str, unstable: int, count: int) -> list[Row]:
    """Drawn plants with an effect that the card does not name: how many do tuned gains leave swinging?"""
    entry = row("every plant", f"{rig}, hidden {effect}: drawn plants that tuned gains leave swinging", "0",
                float(unstable), unstable == 0, "", "none",
                f"of {count}, of other constants, payloads, pressures, sizes of effects")  # fmt: skip
    return [aside({**entry, "plants": count}, OWN)]


def faster(
    gains: int, name: str, own: tuple[float, float], other: tuple[float, float], lead: float
) -> list[Row]:
    """A descent by derivatives beside a method without, to one cost that both reach.

    `own`, `other`: evaluations and seconds, those of the descent with derivatives; `lead`: lowest cost of the
    descent over the other's.
    """
    ratio, least = other[0] / own[0], 50 if gains >= 30 else 5 if gains >= 6 else 1
    entry = row(name, f"{gains} gains: its evaluations over those of the descent", f"{least}", ratio,
                ratio >= least, "", "at least", "the same simulations, to a cost that both reach",
                f"lowest cost of the descent over its own: {lead:.3f}")  # fmt: skip
    return [aside({**entry, "seconds_over": other[1] / own[1], "lowest_over": lead}, OWN)]


def slopes_agree(errors: Sequence[float]) -> list[Row]:
    """Directional derivatives beside central differences, errors relative to the length of the gradient."""
    worst, middle = max(errors), sorted(errors)[len(errors) // 2]
    entry = row("finite differences", f"largest error of {len(errors)} directional derivatives", "1e-05",
                worst, worst <= 1e-5, "", "at most", "of the gradient's length",
                "a direction crosses a kink of friction or of a limit")  # fmt: skip
    return [aside({**entry, "median": middle}, OWN)]


def slopes_lead(correlation: float, change: float) -> list[Row]:
    """Directional derivatives beside differences of the cost over a large change of the gains."""
    entry = row("finite differences", "correlation of directional derivatives with differences of the "
                "quantised cost", "0.9", correlation, correlation >= 0.9, "", "at least",
                f"over {100 * change:g} % of the gains: where the descent is led")  # fmt: skip
    return [aside(entry, OWN)]


def beside_peer(peer: str, scenarios: int, ratio: float, apart: float, agreement: float) -> list[Row]:
    """Time of a peer for the cost and gradient of closed loops over the package's, if it finds the same.

    `apart`: largest relative difference of cost and gradient.
    """
    same = apart <= agreement
    entry = row(peer, f"cost and gradient of 6 gains, {scenarios} scenarios of 3 s: its time over ours", "1",
                ratio, same and ratio >= 1, "", "at least", "the same loop, in the same run; shared cores",
                "it is quicker" if same else f"it finds another gradient, {apart:.1e} apart")  # fmt: skip
    return [aside({**entry, "apart": apart}, OWN)]


def gradient_speed(scenarios: int, first: float, next_ones: float) -> list[Row]:
    """Time of a cost with its gradient, with and without compilation [s]."""
    compiling = first - next_ones
    entry = row("compilation", f"cost, gradient and curvature of 6 gains, {scenarios} scenarios of 3 s", "8",
                compiling, compiling <= 8, "s", "at most", "of the program; shared cores")  # fmt: skip
    return [aside({**entry, "seconds_once_compiled": next_ones}, OWN)]
