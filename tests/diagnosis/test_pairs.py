"""Pairs of effects on readings of the oracle: the right pair, and none where one effect is enough."""

import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO, Evidence
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.likelihood_evidence import by_likelihood
from jaxmuscle.diagnosis.pairs import best_pairs, needed, usual_first
from jaxmuscle.diagnosis.ranking import Candidate, rank
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
    return found.candidates[0] if found.candidates else None


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


def candidate(kinds, loss, evidence):
    model: Any = None
    return Candidate(kinds, evidence, np.log1p(loss + 0.1 * np.sin(np.arange(60.0)))[None], model, (model,))


def test_the_pair_of_more_usual_effects_comes_first_where_the_best_one_is_not_told_apart():
    shown, weak = Evidence(0.8, 1e-4, 1.0), Evidence(0.8, 0.02, 1.0)
    rare = candidate((ForceSensorNonlinearity, ThreadFriction), 4.0, shown)
    usual = (BladderStiffness, ThreadFriction)
    as_good, worse, unsupported = (
        candidate(usual, *each) for each in ((4.0, shown), (5.5, shown), (4.0, weak))
    )
    assert usual_first([rare, as_good], 1, 1) == [as_good, rare]
    assert usual_first([rare, worse], 1, 1) == [rare, worse]
    assert usual_first([rare, unsupported], 1, 1) == [rare, unsupported]


def test_ten_stretches_are_enough_for_a_first_effect_but_not_for_a_pair(monkeypatch):
    """The likelihood ratio allows for all pairs that were tried, where the sign flips cannot."""
    module = importlib.import_module("jaxmuscle.diagnosis.likelihood_evidence")
    monkeypatch.setattr(module, "likelihood_ratio_test", lambda *of: 1e-6)
    monkeypatch.setattr(module, "paths_of", lambda *of: ["strength"])
    anything: Any = SimpleNamespace(model=None, weights={})
    bench: Any = SimpleNamespace(
        with_card_values=lambda model: model,
        best_fit=lambda *of: anything,
        residuals=lambda *of: {},
    )
    told = Evidence(0.8, 0.0045, 1.0, stretches=10)
    pair: Any = ((BladderStiffness, ThreadFriction), anything)
    first, second = (
        by_likelihood(bench, anything, [], anything, [pair], [told], 12, found)[0] for found in (0, 1)
    )
    assert first == told
    assert second.test == LIKELIHOOD_RATIO and second.p_value == pytest.approx(12e-6)
    (of_dozens,) = by_likelihood(bench, anything, [], anything, [pair], [told], 12, 0, 12)
    assert of_dozens == second


def test_a_pair_has_to_do_better_than_either_of_its_effects():
    """Losses are logarithms: a fifth of the excess, or an error that is halved."""
    alone = np.full((1, 30), np.log1p(100.0**2))
    assert not needed(alone, np.full((1, 30), np.log1p(90.0**2)))
    assert needed(alone, np.full((1, 30), np.log1p(49.0**2)))
    assert needed(np.full((1, 30), np.log1p(3.0**2)), np.full((1, 30), np.log1p(2.3**2)))
