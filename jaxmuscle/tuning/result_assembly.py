"""From the best point of a search to the result: gains, sensitivities, terms, the last word of what was held
out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.estimation.free_parameters import at_bound, settled
from jaxmuscle.formatting import quantity
from jaxmuscle.optimization.descents import BUDGET, FAILED, STEPS, Lane
from jaxmuscle.tuning.cost_terms import TERMS, sensitivity, units
from jaxmuscle.tuning.evaluation import MOST_FORWARD, Evaluation, Seen
from jaxmuscle.tuning.gains import gain_unit
from jaxmuscle.tuning.scenario_costs import Gain, Judged
from jaxmuscle.tuning.tuning_result import Tuning

CHANGE = 0.1
"""Relative change of a gain by which its sensitivity is told."""
OUT_OF = {STEPS: "steps", BUDGET: "time"}


def concluded(
    evaluation: Evaluation,
    winner: Lane | None,
    told: Sequence[str],
    count: int,
    seconds: float,
    given: Any,
    settings: dict[str, Any],
) -> Tuning:
    """The result at the best point of a search, or at the start gains where these cost less.

    `given`: the controller that was to be tuned; `settings`: of the request, to be kept.
    """
    unknowns, training, rig = evaluation.unknowns, evaluation.rows, evaluation.rig
    unseen = range(len(training), len(evaluation.stacked.names))
    notes = list(told)
    ends = np.zeros(len(unknowns), dtype=int)
    values, code = unknowns.start, FAILED
    first = evaluation.seen(unknowns.start, training)
    last = first
    if winner is not None:
        at = settled(unknowns, winner.u)
        there = evaluation.seen(at, training)
        if evaluation.cost(there) < evaluation.cost(first):
            values, last, code, ends = at, there, winner.code, at_bound(unknowns, winner.u)
        else:
            code = winner.code
            notes.append("No gains were found that cost less than those at the start.")
    groups: list[tuple[Sequence[int], Seen, Seen]] = [(training, first, last)]
    if unseen:
        groups.append((unseen, evaluation.seen(unknowns.start, unseen), evaluation.seen(values, unseen)))
    judged = [_judged(evaluation, seen, own) for own, *both in groups for seen in both]
    less, more = _sensitivities(evaluation, values, evaluation.cost(last))
    gains, wired = {}, rig.attached is not None or rig.actuator.channel is None
    for i, entry in enumerate(unknowns.entries):
        gains[entry.name] = Gain(
            value=float(values[i]),
            start=entry.start,
            unit=gain_unit(rig.actuator, entry.place.unit, rig.controller.controller)
            if wired
            else entry.place.unit,
            meaning=entry.place.meaning,
            lower=entry.lower,
            upper=entry.upper,
            at_bound={-1: "lower", 0: "", 1: "upper"}[int(ends[i])],
            less=float(less[i]),
            more=float(more[i]),
        )
    tuned = Tuning(
        gains=gains,
        before=judged[0],
        after=judged[1],
        held_out_before=judged[2] if unseen else None,
        held_out_after=judged[3] if unseen else None,
        units=units(rig.actuator, rig.objective.reading, rig.objective.margin),
        code=code,
        notes=(),
        traces=_traces(evaluation, groups),
        settings=settings,
        evaluations=count,
        seconds=seconds,
    )
    names = evaluation.stacked.names
    unstable = evaluation.unstable(values, range(len(names)))
    notes += _doubts(tuned) + _instability([name for name, no in zip(names, unstable, strict=True) if no])
    return dataclasses.replace(tuned, notes=tuple(notes), controller=tuned.put_into(given))


def _judged(evaluation: Evaluation, seen: Seen, rows: Sequence[int]) -> Judged:
    names = [evaluation.stacked.names[row] for row in rows]
    columns = {"cost": seen.cost, **{name: seen.terms[name] for name in TERMS if name in seen.terms}}
    table = pd.DataFrame(
        {n: np.asarray(c, dtype=float) for n, c in columns.items()}, index=pd.Index(names, name="scenario")
    )
    return Judged(evaluation.cost(seen), table)


def _sensitivities(
    evaluation: Evaluation, values: Float[np.ndarray, " k"], cost: float
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Relative rise of the cost with 10 % less, and with 10 % more, of each gain."""
    found = np.full((2, len(values)), np.nan)
    if len(values) <= MOST_FORWARD and math.isfinite(cost) and cost > 0:
        for side, factor in enumerate((1 - CHANGE, 1 + CHANGE)):
            for i in range(len(values)):
                other = np.where(np.arange(len(values)) == i, factor * values, values)
                found[side, i] = evaluation.cost(evaluation.seen(other, evaluation.rows)) / cost - 1
    return found[0], found[1]


def _traces(
    evaluation: Evaluation, groups: Sequence[tuple[Sequence[int], Seen, Seen]]
) -> dict[str, pd.DataFrame]:
    """Tables over time of the worst scenario of each group."""
    scenarios, rig = evaluation.stacked, evaluation.rig
    found = {}
    for title, (rows, before, after) in zip(("training", "held out"), groups, strict=False):
        own = int(np.argmax(np.where(np.isfinite(after.cost), after.cost, np.inf)))
        counts = np.asarray(scenarios.cases.counts)[rows[own]]
        target = target_of(scenarios.cases.told.reference)
        columns: dict[str, Any] = {}
        if hasattr(target, "shape"):
            columns |= _numbered("reference", np.asarray(target)[rows[own]])
        for when, seen in (("before", before), ("after", after)):
            followed = rig.objective.reading
            shown = {n: v for n, v in seen.readings.items() if followed in (None, n)}
            for name, values in [*shown.items(), ("command", seen.commands)]:
                own_columns = _numbered(name, np.asarray(values)[own])
                columns |= {f"{column} {when}": each for column, each in own_columns.items()}
        time = pd.Index(scenarios.step * np.arange(scenarios.samples), name="time")
        name = f"{title}: {scenarios.names[rows[own]]}"
        found[name] = pd.DataFrame(columns, index=time)[counts]
    return found


def _numbered(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of one signal; several are numbered from 1 on."""
    table = values.reshape(len(values), -1)
    return {f"{name}{f'_{i + 1}' if table.shape[1] > 1 else ''}": own for i, own in enumerate(table.T)}


def _instability(names: Sequence[str]) -> list[str]:
    """The doubt about loops that are unstable."""
    return [
        f"The linearised loop is unstable in scenario {', '.join(names)}: only what a linear model leaves "
        "out, such as dry friction, holds it. Start from smaller gains."
    ] if names else []  # fmt: skip


IDLE = 1e-3
"""Relative change of the cost below which a gain that changes by 10 % has no influence on it."""


def _doubts(tuned: Tuning) -> list[str]:
    """What speaks against a result."""
    found = [
        f"{name} ended at its {gain.at_bound} bound, {quantity(gain.value, gain.unit)}."
        for name, gain in tuned.gains.items()
        if gain.at_bound
    ]
    if tuned.code in OUT_OF:
        found.append(f"It ended before a minimum was reached: out of {OUT_OF[tuned.code]}.")
    changes = [abs(rise) for gain in tuned.gains.values() for rise in (gain.less, gain.more)]
    if tuned.after.cost > 0 and changes and max(changes) < IDLE:
        found.append(
            "The cost hardly depends on the gains here, as where friction holds the machine: a start with "
            "larger gains, or more starts, may lead elsewhere."
        )
    after = tuned.held_out_after
    if after is None:
        found.append("Nothing was held out: whether the gains hold elsewhere is not known.")
    else:
        # Without the sensitivity, which is infinite where a loop is unstable that may run on all the same.
        runs = after.terms.drop(columns=["cost", sensitivity.__name__], errors="ignore")
        shown = runs if len(runs.columns) else after.terms
        wild = np.flatnonzero(~np.isfinite(shown.to_numpy()).all(axis=1))
        lost = [str(after.terms.index[i]) for i in wild]
        if lost:
            found.append(f"With the tuned gains the loop runs away in held-out scenario {', '.join(lost)}.")
        elif not tuned.holds:
            found.append(
                "On the held-out scenarios the cost did not fall: the tuned gains do not hold there."
            )
    return found
