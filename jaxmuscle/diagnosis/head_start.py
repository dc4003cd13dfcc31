"""Head start of a model whose column is read late: its windows begin with later readings than other models'.

What a column showed a time δ after a window began is, by a clock offset δ, its true value there. So the
window begins with what others have to predict, and any error that grows along a window seems to shrink,
whatever its cause. The same offset of all columns and of the command moves nothing against anything else:
what that seems to gain is the head start, and no evidence.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.diagnosis.evidence import Blocks, Losses, block_losses
from jaxmuscle.diagnosis.model_residuals import ModelResiduals
from jaxmuscle.effects.readings import ClockOffset, measured_columns, reading_effect
from jaxmuscle.estimation.residuals import Evaluated
from jaxmuscle.estimation.windows import Problem
from jaxmuscle.simulation.track import with_earlier_commands

CLOCK = ClockOffset.kind


def sought_delays(bench: ModelResiduals, model: AbstractActuator) -> dict[str, float]:
    """Column → time by which a candidate in `model` says that it is read late [s]; of early ones nothing."""
    sought = {candidate.name for candidate in bench.candidates}
    offsets = [e for n, e in model.effects.items() if isinstance(e, ClockOffset) and n in sought]
    return {e.column: float(e.delay) for e in offsets if e.column and float(e.delay) > 0}


def residuals_begun_later(
    bench: ModelResiduals, model: AbstractActuator, problem: Problem, ahead: Mapping[str, float]
) -> Evaluated:
    """Weighted residuals of a model that gets a head start in some columns.

    Args:
        ahead: column → how much later the readings are with which windows begin [s].
    """
    found = {output: np.array(values) for output, values in bench.residuals(model, problem).items()}
    for delay in set(ahead.values()):
        late = bench.residuals(*_all_read_later(model, problem, delay))
        for output, columns in model.outputs.items():
            for i, column in enumerate(columns):
                if ahead.get(column) == delay and output in found:
                    place = (..., i) if len(columns) > 1 else ...
                    found[output][place] = late[output][place]
    return found


def head_start(
    bench: ModelResiduals,
    model: AbstractActuator,
    problem: Problem,
    block: Blocks,
    judged: NDArray[np.int64],
) -> Losses:
    """What the head start of a model takes off the losses of blocks; 0 where it has none.

    By how much the losses of the model with the clocks of these columns right fall if it gets the same.

    Args:
        block: number of the block of each sample; `judged`: numbers of those whose losses are asked for.
    """
    delays = sought_delays(bench, model)
    if not delays:
        return np.zeros((len(problem.weights), len(judged)))
    right = {f"{CLOCK}_{column}": reading_effect(CLOCK, column)(**{"delay": 0.0}) for column in delays}
    model = model.with_effects(**right)
    plain, begun_later = (residuals_begun_later(bench, model, problem, each) for each in ({}, delays))
    before, after = (block_losses(each, problem.weights, block, judged) for each in (plain, begun_later))
    return np.maximum(before - after, 0.0)


def _all_read_later(
    model: AbstractActuator, problem: Problem, delay: float
) -> tuple[AbstractActuator, Problem]:
    """Everything a time [s] later than it is: every column is read later, commands come earlier."""
    names = {column: f"{CLOCK}_{column}" for column in measured_columns(model)}
    present = {c: getattr(model.effects.get(name), "delay", 0.0) for c, name in names.items()}
    later = {name: reading_effect(CLOCK, c)(**{"delay": present[c] + delay}) for c, name in names.items()}
    track = with_earlier_commands(problem.track, delay)
    return model.with_effects(**later), dataclasses.replace(problem, track=track)
