"""The mapping that becomes result.json."""

import dataclasses
import json
import math

import pytest
from report.fake import diagnosis

from jaxmuscle.diagnosis.result import Estimate
from jaxmuscle.report.result_json import result

KEYS = {
    "verdict",
    "effects",
    "alternatives",
    "before",
    "after",
    "noise",
    "horizon",
    "held_out_fraction",
    "unexplained",
    "parameters",
    "recording",
    "jaxmuscle",
    "seconds",
}


@pytest.mark.parametrize("verdict", ["effects found", "complete", "unexplained"])
def test_round_trip_with_the_promised_keys(verdict: str) -> None:
    outcome = result(diagnosis(verdict))
    assert json.loads(json.dumps(outcome, allow_nan=False)) == outcome
    assert set(outcome) == KEYS
    assert outcome["verdict"] == verdict
    assert set(outcome["recording"]) == {"file", "sha256", "rig", "rows"}
    assert outcome["recording"]["file"] == "lift.csv" and outcome["recording"]["rows"] == 6000
    for when in ("before", "after"):
        assert set(outcome[when]) == {"training", "held_out"}
        for columns in outcome[when].values():
            assert set(columns) == {"position", "pressure"}
            assert all(set(error) == {"rmse", "unit", "nrmse"} for error in columns.values())


def test_effects_and_alternatives() -> None:
    outcome = result(diagnosis("effects found"))
    assert outcome["effects"] == [
        {
            "name": "load_friction",
            "signal": "load",
            "parameters": {"force": {"value": 16.21, "std": 0.38, "unit": "N"}},
            "evidence": {"held_out_gain": 0.93, "p_value": 1e-12},
        }
    ]
    assert outcome["alternatives"][0] == {"name": "load_damping", "held_out_gain": 0.71, "told_apart": True}
    assert "load_friction" not in [other["name"] for other in outcome["alternatives"]]
    assert outcome["unexplained"] == [{"signal": "mass_flow", "share": 0.12, "depends_on": ["pressure"]}]


def test_what_is_not_finite_becomes_null() -> None:
    estimate = Estimate(1.3, math.inf, "", "")
    outcome = result(
        dataclasses.replace(diagnosis("complete"), parameters={"end_factor": estimate}, seconds=math.nan)
    )
    assert outcome["parameters"] == {"end_factor": {"value": 1.3, "std": None, "unit": ""}}
    assert outcome["seconds"] is None
