"""The score of a diagnosis: effect, verdict and false additions, each by itself."""

import importlib.util
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "benchmarks" / "diagnosis_score.py"
OFFERED = {"load_friction", "creep", "gravity"}


@pytest.fixture(scope="module")
def scoring():
    spec = importlib.util.spec_from_file_location("diagnosis_score", FILE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("truth", "found", "verdict", "kind", "effect_ok", "verdict_ok", "false"),
    [
        ("none", [], "complete", "clean", True, True, []),
        ("none", [], "unexplained", "clean", True, False, []),
        ("none", ["creep"], "effects found", "clean", False, False, ["creep"]),
        ("creep", ["creep"], "effects found", "catalogue", True, True, []),
        ("creep", ["creep", "gravity"], "effects found", "catalogue", True, True, ["gravity"]),
        ("creep", ["gravity", "creep"], "effects found", "catalogue", False, True, ["gravity"]),
        ("creep", [], "complete", "catalogue", False, False, []),
        ("unknown_eccentricity", [], "unexplained", "outside", True, True, []),
        ("unknown_eccentricity", [], "complete", "outside", True, False, []),
        ("unknown_eccentricity", ["gravity"], "effects found", "outside", False, False, ["gravity"]),
    ],
)
def test_effect_verdict_and_false_additions(
    scoring, truth, found, verdict, kind, effect_ok, verdict_ok, false
):
    row = scoring.score(truth, found, verdict, OFFERED)
    assert (row["kind"], row["effect_ok"], row["verdict_ok"]) == (kind, effect_ok, verdict_ok)
    assert row["false_additions"] == false
    assert row["ok"] is (effect_ok and verdict_ok and not false)


def test_an_effect_that_the_rig_cannot_have_is_outside_its_catalogue(scoring):
    assert scoring.kind_of("valve_hysteresis", OFFERED) == "outside"


def test_totals_count_each_respect_by_kind(scoring):
    rows = [
        scoring.score("creep", ["creep", "gravity", "load_friction"], "effects found", OFFERED),
        scoring.score("creep", ["creep"], "effects found", OFFERED),
        scoring.score("none", [], "unexplained", OFFERED),
        scoring.score("elsewhere", ["gravity"], "effects found", OFFERED),
    ]
    assert scoring.totals(rows) == {
        "reached": 1,
        "of": 4,
        "effects": {"clean": [1, 1], "catalogue": [2, 2], "outside": [0, 1]},
        "verdicts": {"clean": [0, 1], "catalogue": [2, 2], "outside": [0, 1]},
        "false_additions": {"effects": 3, "recordings": 2},
    }
