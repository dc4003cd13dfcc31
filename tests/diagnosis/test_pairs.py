"""Pairs of effects on readings of the oracle: the right pair, and none where one effect is enough."""

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.pairs import best_pairs, needed
from jaxmuscle.diagnosis.ranking import rank
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import BladderStiffness, ForceSensorNonlinearity, PressureDependentEnds, ThreadFriction
from jaxmuscle.estimation.case import case
from jaxmuscle.progress import Meter

STIFF = {"stiffness": 400.0, "threshold_pressure": 5e4}
THREADS = {"static_coefficient": 0.015, "kinetic_coefficient": 0.08, "velocity_constant": 0.15}
CANDIDATES = (PressureDependentEnds, BladderStiffness, ThreadFriction, ForceSensorNonlinearity)


def pair_in(effects):
    """What is tried first, and the best pair, of a recording with some effects."""
    prepared = case(driven_recording(effects, driven_card({}), seed=6), 0.3, None)
    bench = workbench(prepared, missing(prepared.actuator, CANDIDATES))
    meter = Meter(lambda progress: None)
    start = forward_selection(prepared, bench, meter)
    ranking = rank(bench, start.model, [], bench.sought([], True), start.parts, meter)
    found = best_pairs(bench, start.model, [], ranking, start.parts, meter)
    assert len(found) <= 1, "nothing here has a constant"
    return found[0] if found else None


@pytest.mark.slow
def test_two_effects_are_found_together():
    pair = pair_in({"bladder_stiffness": STIFF, "thread_friction": THREADS})
    assert pair is not None and set(pair.name.split(" + ")) == {"bladder_stiffness", "thread_friction"}
    assert pair.evidence.supports(1)
    assert [candidate.evidence for candidate in pair.apart()] == [pair.evidence] * 2
    assert [candidate.name for candidate in pair.apart()] == pair.name.split(" + ")


@pytest.mark.slow
def test_a_second_effect_that_is_not_there_is_not_needed():
    assert pair_in({"bladder_stiffness": STIFF}) is None


def test_a_pair_has_to_do_better_than_either_of_its_effects():
    """Losses are logarithms: a fifth of the excess, or an error that is halved."""
    alone = np.full((1, 30), np.log1p(100.0**2))
    assert not needed(alone, np.full((1, 30), np.log1p(90.0**2)))
    assert needed(alone, np.full((1, 30), np.log1p(49.0**2)))
    assert needed(np.full((1, 30), np.log1p(3.0**2)), np.full((1, 30), np.log1p(2.3**2)))
