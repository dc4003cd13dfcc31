"""The last fit of a diagnosis: effects with which it fails, and those that no machine has, are none."""

import importlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle import effects
from jaxmuscle.diagnosis import last_fit
from jaxmuscle.diagnosis.evidence import Evidence
from jaxmuscle.diagnosis.last_fit import Outcome, borne_out
from jaxmuscle.diagnosis.ranking import Candidate
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.errors import NoFitError
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get

diagnosing = importlib.import_module("jaxmuscle.diagnosis.diagnose")


@pytest.fixture(scope="module")
def prepared():
    return case(driven_recording({"pressure_dependent_ends": {"amplitude": 0.8}}, driven_card({})), 0.0)


def concluded(prepared, monkeypatch, failing):
    """Names of what is left of ends and a creep that were added, and what was refused, where the last fit
    with any of `failing` fails.
    """
    kinds = (effects.PressureDependentEnds, effects.Creep)
    tools = workbench(prepared, kinds)
    ends = effects.PressureDependentEnds(amplitude=0.8)  # pyright: ignore
    model = tools.dressed(tools.model, ["creep"]).with_effects(pressure_dependent_ends=ends)
    evidence, losses = Evidence(0.9, 1e-3, 1.0), np.zeros((1, 4))
    found = tuple(Candidate((kind,), evidence, losses, model, ()) for kind in kinds)
    final_fit = last_fit._final_fit

    def fails(*given: Any):
        if failing & {*given[-1]}:
            raise NoFitError("the only start failed: 1 × no finite prediction at its start")
        return final_fit(*given)

    monkeypatch.setattr(last_fit, "_final_fit", fails)
    outcome = Outcome(tools.model, model, found, (), (), True, {})
    last = borne_out(prepared, tools, prepared.training, outcome)
    assert last.fit is not None and np.isfinite([entry.value for entry in last.fit.parameters.values()]).all()
    return last


@pytest.mark.slow
def test_an_effect_with_which_the_last_fit_fails_is_taken_out(prepared, monkeypatch):
    last = concluded(prepared, monkeypatch, {"creep"})
    outcome, refused = last.outcome, last.refused
    assert [each.name for each in outcome.found] == ["pressure_dependent_ends"]
    assert refused == {"creep": "the last fit with it failed: its predictions are not numbers everywhere"}
    assert float(get(outcome.model, "effects.pressure_dependent_ends.amplitude")) == pytest.approx(
        0.8, rel=0.1
    )


def test_a_machine_that_cannot_be_fitted_at_all_is_told(prepared, monkeypatch):
    def fails(*given: Any):
        raise NoFitError("the only start failed: 1 × no finite prediction at its start")

    monkeypatch.setattr(last_fit, "_final_fit", fails)
    tools = workbench(prepared, [])
    with pytest.raises(NoFitError, match="the only start failed"):
        outcome = Outcome(tools.model, tools.model, (), (), (), True, {})
        borne_out(prepared, tools, prepared.training, outcome)


@pytest.mark.parametrize(("by_folds", "named"), [((0.7, 0.8, 0.9, 0.8), True), ((0.1, 0.8, 1.6, 0.7), False)])
def test_an_effect_on_whose_strength_folds_disagree_altogether_is_none(prepared, by_folds, named):
    """It helps on unseen stretches, and 0.8 +- 0.9 may as well be nothing."""
    tools = workbench(prepared, (effects.PressureDependentEnds,))
    of = lambda amplitude: effects.PressureDependentEnds(amplitude=amplitude)  # pyright: ignore # noqa: E731
    model, *folds = (tools.model.with_effects(pressure_dependent_ends=of(each)) for each in (0.8, *by_folds))
    sought = (effects.PressureDependentEnds,)
    found = (Candidate(sought, Evidence(0.9, 1e-3, 1.0), np.zeros((1, 4)), model, ()),)
    outcome = Outcome(tools.model, model, found, (), tuple(folds), True, {})
    last = borne_out(prepared, tools, prepared.training, outcome)
    assert (not last.outcome.found, "two standard deviations" in str(last.refused)) == (not named, not named)


@pytest.mark.parametrize(
    ("alone", "held", "judged"),
    [(0.03, 0.003, 0.006), (0.03, 0.03, 0.06), (0.0, 0.0, 0.06), (np.inf, 0.1, 0.1), (1.0, 0.1, 0.1)],
)
def test_folds_disagree_along_the_shapes_of_an_effect(alone, held, judged, monkeypatch):
    monkeypatch.setattr(last_fit, "disagreement", lambda folds, path: 0.06)
    final: Any = SimpleNamespace(std={"effects.force_drift.share": alone})
    got = last_fit._with_folds(final, "effects.force_drift.share", held, ())
    assert got == pytest.approx(judged)


@pytest.mark.slow
def test_an_effect_that_no_machine_has_leaves_its_place(monkeypatch):
    """It is searched again without it: another one that explains some of what is missing is found."""
    ends, bladder = effects.PressureDependentEnds, effects.BladderStiffness
    monkeypatch.setattr(ends, "largest", 0.1)
    asked, search = [], diagnosing.forward_selection
    monkeypatch.setattr(
        diagnosing,
        "forward_selection",
        lambda case, bench, *rest: asked.append(bench.candidates) or search(case, bench, *rest),
    )
    recording = driven_recording({"pressure_dependent_ends": {"amplitude": 0.8}}, driven_card({}))
    found = jm.diagnose(recording, catalogue=(ends, bladder), constants=False)
    assert asked == [(ends, bladder), (bladder,)]
    assert [effect.name for effect in found.added] == ["bladder_stiffness"]
    why = "its strength, 0.80, is beyond what real machines have, 0.10"
    assert found.refused == {"pressure_dependent_ends": why}
