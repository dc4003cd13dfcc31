"""How much a candidate has to explain to be carried on, and from where each is searched."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis import candidate_search
from jaxmuscle.diagnosis.candidate_search import (
    AGAIN,
    BENT,
    HOPE,
    LEAST,
    PLENTY,
    _needed,
    from_other_shapes,
    search_all,
)
from jaxmuscle.diagnosis.settled_fit import best_of
from jaxmuscle.diagnosis.workbench import Workbench, workbench
from jaxmuscle.effects import BladderStiffness, ForceDrift
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.losses import SQUARES
from jaxmuscle.parameters import get, replace
from jaxmuscle.progress import Meter

WINDOWS, SAMPLES, PERIOD, MISSED = 4, 100, 25, 5.0
EXCESS = WINDOWS * SAMPLES * (MISSED**2 - 1) / 2
"""Half of the squared residuals beyond noise, of an error of five noise units everywhere."""


def needed(factor: float) -> float:
    """Of a model whose weights, for what it leaves, were multiplied by a factor."""
    shape = (WINDOWS, SAMPLES)
    weights = {"force": np.ones(shape)}
    problem: Any = SimpleNamespace(
        rows=np.zeros(WINDOWS), samples=SAMPLES, period=float(PERIOD), weights=weights
    )
    bench: Any = SimpleNamespace(
        residuals=lambda model, problem: {"force": np.full(shape, MISSED)}, loss=SQUARES
    )
    present: Any = SimpleNamespace(model=None, factors={"force": np.array([factor])})
    return _needed(bench, present, problem)


def test_a_part_of_what_is_missing_is_enough_where_that_is_worth_many_readings():
    assert needed(1.0) == pytest.approx(HOPE * EXCESS) and HOPE * EXCESS > LEAST


def test_no_less_than_a_likelihood_ratio_that_says_something():
    assert needed((50.0 / EXCESS) ** 0.5) == pytest.approx(LEAST)


def test_an_error_as_long_as_the_recording_leaves_candidates_hope():
    """All of it costs 1.6: less than the least fall, which no candidate could have reached."""
    assert needed((1.6 / EXCESS) ** 0.5) == pytest.approx(PLENTY * 1.6)


@pytest.mark.parametrize(("after", "plenty"), [(2.0, True), (4.8, False)])
def test_a_constant_error_beside_coloured_noise_leaves_hope(after, plenty):
    """Of the force, by losses of blocks: to its cost that of the current, which nothing takes away, adds."""
    left = {"before": MISSED, "after": after}
    losses = lambda model, problem: np.log1p(np.array([[left[model] ** 2] * 40, [2.5] * 40]))  # noqa: E731
    bench: Any = SimpleNamespace(losses=losses)
    present: Any = "before"
    fitted: Any = "after"
    problem: Any = None
    assert Workbench.removes_plenty(bench, present, fitted, problem) is plenty


COSTS = {"creep": 7.0, "delay": 3.0, "leak": 5.0, "gravity": 1.0}
"""Cost of the model with each candidate; that of the last one was not carried on to a minimum."""


def searched_from_card(monkeypatch: pytest.MonkeyPatch, distance: float) -> tuple[list[str], list[float]]:
    """What is searched from the card's values, of a model so far from them, and the costs that are found."""
    from_card = []

    def search(bench: Any, bases: Any, accepted: Any, effect: Any, *rest: Any) -> Any:
        cost = COSTS[effect.name]
        if "card" in bases:
            from_card.append(effect.name)
            cost -= 0.5
        return SimpleNamespace(model=cost, hopeful=effect.name != "gravity")

    monkeypatch.setattr(candidate_search, "search", search)
    monkeypatch.setattr(candidate_search, "search_work", lambda effect: 1.0)
    bench: Any = SimpleNamespace(
        farthest_from_card=lambda model: distance,
        with_card_values=lambda model: "card",
        cost=lambda model, problem: float(model),
    )
    effects: Any = [SimpleNamespace(name=name) for name in COSTS]
    nothing: Any = None
    found = search_all(bench, nothing, [], effects, nothing, nothing, Meter(lambda progress: None))
    return sorted(from_card), [float(each.model) for each in found]  # pyright: ignore[reportArgumentType]


def test_of_a_bent_model_every_candidate_is_searched_from_the_card_too(monkeypatch):
    names, costs = searched_from_card(monkeypatch, BENT + 0.1)
    assert names == sorted(COSTS)
    assert costs == [cost - 0.5 for cost in COSTS.values()]


def test_of_one_that_agrees_with_the_card_only_the_best_are(monkeypatch):
    names, costs = searched_from_card(monkeypatch, BENT - 0.1)
    assert names == ["delay", "leak"] and len(names) == AGAIN
    assert costs == [7.0, 2.5, 4.5, 1.0]


def test_a_fit_that_came_to_rest_at_a_wrong_shape_is_carried_on_from_others():
    drift = {"share": 0.038, "time_constant": 6.5}
    prepared = case(driven_recording({"force_drift": drift}, driven_card({}), seed=2), 0.3, None)
    bench, names = workbench(prepared, [ForceDrift, BladderStiffness]), ["force_drift"]
    slow = {"effects.force_drift.share": 0.3, "effects.force_drift.time_constant": 3000.0}
    begun = replace(bench.dressed(prepared.actuator, names), slow)
    rested = bench.settled(begun, names, prepared.training, steps=1)
    found = from_other_shapes(bench, rested, names, [ForceDrift, BladderStiffness], prepared.training)
    assert float(get(rested.model, "effects.force_drift.time_constant")) > 1000.0
    assert float(get(found.model, "effects.force_drift.time_constant")) == pytest.approx(6.5, rel=0.1)
    assert best_of([rested, found]) == 1
    again = from_other_shapes(bench, found, names, [ForceDrift], prepared.training)
    assert best_of([found, again]) == 0
    assert from_other_shapes(bench, found, names, [BladderStiffness], prepared.training) is found
