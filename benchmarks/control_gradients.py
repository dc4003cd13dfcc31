"""Derivatives through whole closed loops beside finite differences."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from control_race import SIZES, TIMES, cost_of, problem
from measured_rows import slopes_agree, slopes_lead
from numpy.typing import NDArray
from published_rows import Row

from jaxmuscle.control import DigitalController, Reference
from jaxmuscle.control.quantisation import quantised
from jaxmuscle.tuning.cases import Told
from jaxmuscle.tuning.evaluation import Evaluation
from jaxmuscle.tuning.tune import prepared

DIRECTIONS, SIZE = 200, 1e-5
JUMP = 0.9
"""Of the reference [rad]."""
PERIOD, DELAY, RESOLUTION = 6e-3, 2e-3, 2 * np.pi / 4096
"""Sample time of the controller and time until its output acts [s], step of its 12-bit encoder [rad]."""
LARGE = 0.05
"""Change of the gains over which the cost of a loop with an encoder has a slope of its own."""


def digital_loop() -> Evaluation:
    """Joint 1 of [T] with two payloads under six gains of variable structure, sampled, late and quantised.

    It follows a wave, and a jump that takes the command to its limits.
    """
    joint, controller, waves = problem(6)
    kind: Any = DigitalController
    jump: Any = np.where(TIMES < 0.1, 0.0, JUMP), np.zeros(len(TIMES)), np.zeros(len(TIMES))
    jumps = [dataclasses.replace(each, reference=Reference(*jump)) for each in waves]
    seen = [dataclasses.replace(each, resolution={"angle": RESOLUTION}) for each in (*waves, *jumps)]
    return prepared(joint, kind(controller, PERIOD, DELAY), seen, SIZES)


def with_rounding_kept(evaluation: Evaluation, at: NDArray) -> Evaluation:
    """The same loop, in which the encoder adds what it adds at a point, whatever the gains.

    Rounding has steps, and no finite difference is a derivative across them. What the descent takes for the
    derivative is that of this loop.
    """
    seen = evaluation.seen(evaluation.unknowns.values(at), evaluation.rows)
    stacked, told = evaluation.stacked, evaluation.stacked.cases.told
    shown = seen.readings["angle"] + told.noise["angle"]
    rounded = quantised(shown, RESOLUTION) - seen.readings["angle"]
    cases = dataclasses.replace(stacked.cases, told=Told(told.reference, {"angle": rounded}), resolution={})
    return dataclasses.replace(evaluation, stacked=dataclasses.replace(stacked, cases=cases))


def differences(cost: Callable[[Any], float], at: NDArray, ways: NDArray, size: float) -> NDArray:
    """Central differences of a cost in some directions."""
    return np.array([(cost(at + size * way) - cost(at - size * way)) / (2 * size) for way in ways])


def gradient_rows() -> Iterator[Row]:
    """Stick-slip, saturation, encoder, a sample time and a delay of its own: 200 directions in six gains."""
    evaluation = digital_loop()
    at = evaluation.unknowns.coordinates(evaluation.unknowns.start)
    slope = evaluation(at[None])[0].gradient
    ways = np.random.default_rng(0).standard_normal((DIRECTIONS, len(at)))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    seen = evaluation.seen(evaluation.unknowns.start, evaluation.rows)
    attached = evaluation.rig.attached
    assert attached is not None
    ends = ((seen.commands == attached.lowest) | (seen.commands == attached.highest)).mean()
    still = (np.abs(np.diff(seen.readings["angle"], axis=1)) < 1e-8).mean()
    print(f"    {100 * ends:.1f} % of the commands are at a limit, in {100 * still:.1f} % of the samples the "
          f"joint sticks")  # fmt: skip
    kept = with_rounding_kept(evaluation, at)
    found = differences(cost_of(kept), at, ways, SIZE)
    yield from slopes_agree((np.abs(found - ways @ slope) / np.linalg.norm(slope)).tolist())
    over = differences(cost_of(evaluation), at, ways, LARGE)
    yield from slopes_lead(float(np.corrcoef(over, ways @ slope)[0, 1]), LARGE)
