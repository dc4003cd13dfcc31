"""What a diagnosis concludes: effects with which the last fit fails are none."""

from typing import Any

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle import effects
from jaxmuscle.diagnosis import conclusion
from jaxmuscle.diagnosis.conclusion import Outcome, _borne_out
from jaxmuscle.diagnosis.evidence import Evidence
from jaxmuscle.diagnosis.ranking import Candidate
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.errors import NoFitError
from jaxmuscle.estimation.case import case
from jaxmuscle.parameters import get


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
    last_fit = conclusion._final_fit

    def fails(*given: Any):
        if failing & {*given[-1]}:
            raise NoFitError("the only start failed: 1 × no finite prediction at its start")
        return last_fit(*given)

    monkeypatch.setattr(conclusion, "_final_fit", fails)
    outcome = Outcome(tools.model, model, found, (), (), True, {})
    outcome, final, refused = _borne_out(prepared, tools, prepared.training, outcome)
    assert final is not None and np.isfinite([entry.value for entry in final.parameters.values()]).all()
    return outcome, refused


def test_an_effect_with_which_the_last_fit_fails_is_taken_out(prepared, monkeypatch):
    outcome, refused = concluded(prepared, monkeypatch, {"creep"})
    assert [each.name for each in outcome.found] == ["pressure_dependent_ends"]
    assert refused == {"creep": "the last fit with it failed: its predictions are not numbers everywhere"}
    assert float(get(outcome.model, "effects.pressure_dependent_ends.amplitude")) == pytest.approx(
        0.8, rel=0.1
    )


def test_a_machine_that_cannot_be_fitted_at_all_is_told(prepared, monkeypatch):
    def fails(*given: Any):
        raise NoFitError("the only start failed: 1 × no finite prediction at its start")

    monkeypatch.setattr(conclusion, "_final_fit", fails)
    tools = workbench(prepared, [])
    with pytest.raises(NoFitError, match="the only start failed"):
        outcome = Outcome(tools.model, tools.model, (), (), (), True, {})
        _borne_out(prepared, tools, prepared.training, outcome)
