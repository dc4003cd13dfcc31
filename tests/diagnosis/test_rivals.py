"""Rarer effects against the one that was found: which are tried, and what becomes of it."""

import dataclasses
import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.evidence import Evidence
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.ranking import Candidate, Ranking
from jaxmuscle.diagnosis.rivals import against_waiting
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import BladderStiffness, ForceDrift, ThreadFriction, reading_effect
from jaxmuscle.estimation.case import case
from jaxmuscle.progress import Meter

ranking_module = importlib.import_module("jaxmuscle.diagnosis.ranking")
rivals_module = importlib.import_module("jaxmuscle.diagnosis.rivals")
OFFSET, DRIFT = (reading_effect(kind, "force") for kind in ("sensor_offset", "sensor_drift"))
THREADS = {"static_coefficient": 0.015, "kinetic_coefficient": 0.08, "velocity_constant": 0.15}


def selected(effects, offset):
    """A search among two usual effects, with three rarer ones that wait, on readings of the oracle."""
    prepared = case(driven_recording(effects, driven_card({}), extra=offset, seed=3), 0.3, None)
    of = lambda *kinds: missing(prepared.actuator, kinds)  # noqa: E731
    bench = workbench(prepared, of(BladderStiffness, ThreadFriction), rivals=of(OFFSET, DRIFT, ForceDrift))
    selection = forward_selection(prepared, bench, Meter(lambda progress: None))
    selection.seek()
    return selection


@pytest.mark.slow
def test_an_effect_is_tried_against_the_rarer_one_that_it_may_imitate():
    """An offset of the force, which the bladder explains as well, or nearly."""
    found = selected({}, -6.0)
    alternatives = {each.name: each for each in found.rounds[0].ranking}
    assert alternatives["sensor_offset_force"].judged and "force_drift" not in alternatives
    rivals = {name for name, each in alternatives.items() if not each.told_apart}
    assert "sensor_offset_force" in rivals and found.names[0] in rivals


@pytest.mark.slow
def test_no_rarer_effect_is_tried_against_one_that_none_can_imitate():
    found = selected({"thread_friction": THREADS}, 0.0)
    assert found.names == ["thread_friction"]
    assert {each.name for each in found.rounds[0].ranking} == {"thread_friction", "bladder_stiffness"}


LOSSES = np.log1p(4.0 + np.sin(np.arange(60.0)))[None]
FIRST: Any = SimpleNamespace(name="bladder_stiffness")
RARER: Any = SimpleNamespace(name="sensor_offset_force")
OTHER: Any = SimpleNamespace(name="creep")
MODEL: Any = SimpleNamespace()


def candidate(effect, losses, gain=0.9):
    return Candidate((effect,), Evidence(gain, 1e-4, float(losses.mean())), losses, MODEL, (MODEL,))


@dataclasses.dataclass
class Bench:
    """A bench of which models are their own fits; `explains`: whether they leave only noise."""

    explains: bool = True
    inputs: Any = lambda model: frozenset()
    predicting: bool = False
    fitted: list[str] = dataclasses.field(default_factory=list)
    rivals = ("sensor_offset_force",)

    def refining(self, names):
        return [RARER]

    def settled(self, model, *of_fit):
        self.fitted.append(model)
        return SimpleNamespace(model=model)

    def residuals(self, model, training):
        return {"force": model, "predicting": self.predicting}

    def predicted_inputs(self, model, training):
        return self.inputs(model) if self.predicting else set()

    def sought(self, names, much_is_left):
        return [FIRST, OTHER]

    def least_mean_squares(self, model, parts):
        return {"force": 50.0 if model is MODEL and not self.explains else 1.0}


def after_rivals(monkeypatch, first_losses, rival_losses, *, likelier=0.0, explains=True, before=()):
    """The candidates, best first, after what waits was tried against the one that was found: a rarer effect,
    or, after others that were found `before`, what refines a friction. `likelier`: by how much it is.
    """
    first, rival = candidate(FIRST, first_losses), candidate(RARER, rival_losses)
    of = lambda *each: Ranking(5.0, (), each, 1)  # noqa: E731
    monkeypatch.setattr(rivals_module, "rivals", lambda *of_model: [RARER])
    monkeypatch.setattr(rivals_module, "rank", lambda *of_model: of(candidate(FIRST, first_losses), rival))
    monkeypatch.setattr(rivals_module, "paths_of", lambda *of_model: ["strength"])
    monkeypatch.setattr(rivals_module, "more_likely", lambda *residuals: likelier)
    bench: Any = Bench(explains)
    anything: Any = SimpleNamespace(weights={})
    fits = rivals_module.WholeWindowFits(bench, [each.name for each in before], anything)
    later = bool(before)
    ranking = against_waiting(fits, MODEL, of(first), [FIRST, OTHER], anything, anything, later)
    return [each.effects[0] for each in ranking.candidates]


def test_the_effect_that_was_found_stays_unless_a_rarer_one_is_clearly_better(monkeypatch):
    better = LOSSES - 0.5
    assert after_rivals(monkeypatch, LOSSES, LOSSES - 1e-9) == [FIRST, RARER]
    assert after_rivals(monkeypatch, better, LOSSES) == [FIRST, RARER]
    assert after_rivals(monkeypatch, LOSSES, better) == [RARER, FIRST]


def test_of_two_that_unseen_windows_do_not_tell_apart_the_likelier_one_is_first(monkeypatch):
    for likelier, first in ((5.9, FIRST), (6.1, RARER)):
        assert after_rivals(monkeypatch, LOSSES, LOSSES - 1e-9, likelier=likelier)[0] is first
    better = LOSSES - 0.5
    assert after_rivals(monkeypatch, better, LOSSES, likelier=1e3) == [FIRST, RARER]


def the_likelier(monkeypatch, odds, supported=2, **of_bench):
    """Names of three effects, so many of them supported, after the likeliest of them came first; whether they
    were compared with predicted inputs, one after the other; what was fitted.

    `odds`: of a pair of models by their names, the second to the first; of what is not named, even.
    """
    told: list[bool] = []

    def more_likely(one, other, weights, parameters):
        told.append(one["predicting"])
        assert one["predicting"] == other["predicting"] and parameters == 0
        return odds.get((one["force"], other["force"]), 0.0)

    monkeypatch.setattr(rivals_module, "paths_of", lambda *of_model: ["strength"])
    monkeypatch.setattr(rivals_module, "more_likely", more_likely)
    judged = [
        dataclasses.replace(candidate(effect, LOSSES + 1e-9 * i), model=effect.name)
        for i, effect in enumerate((FIRST, RARER, OTHER))
    ]
    for i in range(supported, len(judged)):
        judged[i] = dataclasses.replace(judged[i], evidence=Evidence(0.9, 0.5, 1.0))
    bench: Any = Bench(**of_bench)
    anything: Any = SimpleNamespace(weights={})
    fits = rivals_module.WholeWindowFits(bench, [], anything)
    ranking = rivals_module.likeliest_first(fits, Ranking(5.0, (), tuple(judged), 1), 0)
    return [each.name for each in ranking.candidates], told, bench.fitted


def test_of_usual_effects_the_likelier_one_is_first_too_if_it_is_supported(monkeypatch):
    names = [FIRST.name, RARER.name, OTHER.name]
    found, told, _ = the_likelier(monkeypatch, {(FIRST.name, OTHER.name): 1e3})
    assert found == names and told == [True], "by inputs as both predict them, of what is supported"
    found, _, _ = the_likelier(monkeypatch, {(FIRST.name, RARER.name): 7.0})
    assert found == [RARER.name, FIRST.name, OTHER.name]


def test_each_is_fitted_once(monkeypatch):
    odds = {(FIRST.name, RARER.name): 7.0, (RARER.name, OTHER.name): 7.0}
    found, _, fitted = the_likelier(monkeypatch, odds, supported=3)
    assert found == [OTHER.name, FIRST.name, RARER.name]
    assert fitted == [FIRST.name, RARER.name, OTHER.name]


def test_models_are_compared_with_the_same_inputs(monkeypatch):
    """As measured, where one of two models does not know one that the other predicts."""
    _, told, _ = the_likelier(
        monkeypatch, {}, inputs=lambda name: {"pressure"} if name == RARER.name else set()
    )
    assert told == [False]


def test_a_constant_of_the_card_stays_first(monkeypatch):
    constant = SimpleNamespace(name="constant:mass")
    monkeypatch.setattr(ranking_module, "CardConstant", SimpleNamespace)
    ranking = Ranking(5.0, (), (candidate(constant, LOSSES), candidate(RARER, LOSSES - 1.0)), 1)
    anything: Any = None
    assert rivals_module.likeliest_first(anything, ranking, 0) is ranking


def test_no_rarer_effect_is_tried_beside_one_that_leaves_a_part(monkeypatch):
    """All are tried then, in a search of their own."""
    assert after_rivals(monkeypatch, LOSSES, LOSSES - 0.5, explains=False) == [FIRST]


def test_what_refines_a_friction_is_tried_against_an_effect_that_is_found_after_it(monkeypatch):
    friction = [candidate(SimpleNamespace(name="thread_friction"), LOSSES)]
    assert after_rivals(monkeypatch, LOSSES, LOSSES - 0.5, before=friction, explains=False) == [RARER, FIRST]
    assert after_rivals(monkeypatch, LOSSES, LOSSES, before=friction) == [FIRST, RARER]
