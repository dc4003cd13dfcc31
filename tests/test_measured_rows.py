"""Rows on measured data: what a fit has seen is not counted; the makers' law is the goal of static force."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS, Driven
from jaxmuscle.components import McKibben

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield importlib.import_module
    for name in [name for name, rig in RIGS.items() if rig.__module__ == "sized_muscles"]:
        del RIGS[name]  # other tests know the rigs of the package


def test_the_unseen_run_of_a_drive_counts_against_the_better_of_two_errors(benchmark):
    rows, table = benchmark("measured_rows"), benchmark("published_rows")
    unseen = rows.drive_run("pulses", published=9.32, theirs=8.38, ours=8.5, fitted=False)
    fitted = rows.drive_run("estimation", published=6.81, theirs=5.37, ours=2.92, fitted=True)
    assert not unseen["ok"] and unseen["goal"] == "8.38" and unseen["why"]
    assert fitted["ok"]
    counted = table.counts([unseen, fitted])
    assert (counted["reached"], counted["of"]) == (0, 1)
    assert counted["aside"] == {table.SEEN: {"reached": 1, "of": 1}}


def test_a_predictor_told_the_coming_pressures_is_not_counted(benchmark):
    rows, table = benchmark("measured_rows"), benchmark("published_rows")
    errors = {"hold": 0.18, "linear, now": 0.07, "linear, coming": 0.04, "physical, now": 0.08,
              "physical, coming": 0.05}  # fmt: skip
    found = [
        rows.arm_predictor(0, 0.0735, errors, f"physical, {what}", coming=what == "coming")
        for what in ("now", "coming")
    ]
    counted = table.counts(found)
    assert (counted["reached"], counted["of"]) == (0, 1)
    assert counted["aside"] == {table.SEEN: {"reached": 1, "of": 1}}
    assert found[0]["beaten_by"] == ["linear, now", "linear, coming"]
    assert "0.0700" in found[0]["why"]


def test_the_makers_law_is_the_goal_of_static_force(benchmark):
    rows = benchmark("measured_rows")
    met, missed = (
        rows.static_force("233 mm", "16.8", ours, {"here": 16.5}, "unseen") for ours in (16.8, 16.81)
    )
    assert met["ok"] and not missed["ok"]
    assert missed["why"] == "unseen" and missed["makers_law_here"] == {"here": 16.5}


def test_the_makers_law_at_rest_slack_and_nearly_without_force_at_its_shortest(benchmark):
    psu = benchmark("psu_isometric")
    rest, shortest = psu.RESTING["25"], psu.SHORTEST["25"]
    full = 303.5 * np.arctan(19.03 * (rest - 0.0075))
    at = psu.makers_force("25", np.array([rest, rest, shortest, shortest]), np.array([620e3, 0, 620e3, 1e5]))
    np.testing.assert_allclose(at[:2], [full, 0.0], rtol=1e-12)
    assert 0 < at[2] < 0.02 * full and at[3] == 0


def test_the_makers_law_by_hand(benchmark):
    psu = benchmark("psu_isometric")
    # Half way to the shortest length under 310 kPa: 0.5682 (e^-2.127 - 1) + 0.5 e^-0.139925 = -0.0658.
    length = 0.5 * (psu.RESTING["27"] + psu.SHORTEST["27"])
    assert psu.makers_force("27", np.array([length]), np.array([310e3]))[0] == 0
    # A quarter of the way under 620 kPa: 0.5682 (e^-1.0635 - 1) + e^-0.03498125 = 0.5936.
    length = psu.RESTING["27"] - 0.25 * (psu.RESTING["27"] - psu.SHORTEST["27"])
    force = psu.makers_force("27", np.array([length]), np.array([620e3]))[0]
    assert force == pytest.approx(0.5936 * 303.5 * np.arctan(19.03 * 0.2495), rel=2e-4)


def test_where_the_error_of_lengths_left_out_arises(benchmark):
    folds = [{"after": error} for error in (42.77, 15.33, 11.09, 20.9)]
    said = benchmark("measured_rows").extrapolated(folds)
    assert "to 42.8 and 20.9 N" in said and "predicted to 15.3 and 11.1 N" in said


def test_gains_on_a_plant_are_counted_as_our_own_and_judged_with_their_effort(benchmark):
    rows, table = benchmark("measured_rows"), benchmark("published_rows")
    rule, own = {"tracking": 1.0, "effort": 10.0}, {"tracking": 0.5, "effort": 11.0}
    found = rows.closed_on_plant(
        "joint", "gravity", {"rule": rule, "left out": {**own, "effort": 22.0}, "diagnosed": own}
    )
    assert [entry["ok"] for entry in found] == [False, True]  # half the error, but with more effort
    assert (found[0]["effort_over"], found[1]["effort_over"]) == (1.1, 0.5)
    assert table.counts(found)["of"] == 0 and table.counts(found)["aside"] == {
        table.OWN: {"reached": 1, "of": 2}
    }
    cheaper = {**own, "effort": 10.0}
    assert rows.closed_on_plant("joint", "gravity", {"rule": rule, "left out": own, "diagnosed": cheaper})[0][
        "ok"
    ]


@pytest.mark.parametrize(("unstable", "ok"), [(0, True), (1, False)])
def test_gains_must_leave_no_drawn_plant_swinging(benchmark, unstable, ok):
    (entry,) = benchmark("measured_rows").stable_on_plants("joint", "gravity", unstable, 100)
    assert entry["ok"] == ok and entry["plants"] == 100 and "of 100" in entry["reason"]


@pytest.mark.parametrize(
    ("gains", "evaluations", "ok"), [(3, 90, False), (3, 100, True), (6, 490, False), (6, 500, True)]
)
def test_a_descent_has_to_be_as_quick_as_its_number_of_gains_asks(benchmark, gains, evaluations, ok):
    (entry,) = benchmark("measured_rows").faster(gains, "simplex", (100, 2.0), (evaluations, 5.0), 0.9)
    assert entry["ok"] == ok and entry["seconds_over"] == 2.5


def test_slopes_and_compilation_have_their_limits(benchmark):
    rows = benchmark("measured_rows")
    assert rows.slopes_agree([1e-9, 1e-8])[0]["ok"] and not rows.slopes_agree([1e-9, 1e-3])[0]["ok"]
    (quick,), (slow,) = rows.gradient_speed(10, 9.0, 2.0), rows.gradient_speed(10, 11.0, 2.0)
    assert quick["ok"] and quick["ours"] == 7.0 and not slow["ok"]


@pytest.mark.parametrize(
    ("ratio", "apart", "ok"), [(2.0, 1e-9, True), (0.5, 1e-9, False), (2.0, 1e-3, False)]
)
def test_a_peer_counts_only_if_it_finds_the_same_gradient(benchmark, ratio, apart, ok):
    (entry,) = benchmark("measured_rows").beside_peer("a peer", 1000, ratio, apart, 1e-6)
    assert entry["ok"] == ok and entry["apart"] == apart and "1000 scenarios" in entry["figure"]


@pytest.mark.parametrize(("correlation", "ok"), [(0.95, True), (0.85, False)])
def test_derivatives_have_to_lead_where_a_quantised_cost_falls(benchmark, correlation, ok):
    (entry,) = benchmark("measured_rows").slopes_lead(correlation, 0.05)
    assert entry["ok"] == ok and "5 %" in entry["reason"]


def test_what_naming_an_effect_is_worth_by_controller(benchmark):
    found = {"rule": {"tracking": 2.0, "effort": 1.0}}
    for name, left, named in (("PID", 1.0, 1.1), ("inverse", 5.0, 0.5), ("inverse and PID", 1.0, 0.5)):
        found[f"{name}, left out"] = {"tracking": left, "effort": 1.0}
        found[f"{name}, named"] = {"tracking": named, "effort": 2.0}
    rows = benchmark("measured_rows").worth_of_naming("joint", "gravity", found)
    assert [entry["ok"] for entry in rows] == [False, True, True]
    assert [entry["ours"] for entry in rows] == pytest.approx([1.1, 0.1, 0.5])
    assert rows[0]["effort_over"] == 2.0 and rows[1]["over_rule"] == 0.25


def muscle(length: float) -> McKibben:
    values: Any = (length, 5e-3, 0.42, 1.0)
    return McKibben(*values)


def test_muscles_of_several_lengths_are_each_a_muscle_of_its_length(sized_muscles):
    """Two runs in one recording, held at positions as read; all muscles are 2 mm longer at rest than said."""
    excess = 2e-3
    lengths, positions = np.repeat([0.083, 0.281], 20), np.repeat([5e-3, 2e-2], 20)
    pressure = 101325.0 + np.tile(np.linspace(1e5, 5e5, 20), 2)
    columns = {"pressure": pressure, "position": positions, "force": np.zeros(40)}
    one = sized_muscles(muscle=muscle(0.2), excess_length=excess)
    both = jm.recording(one, {**columns, "resting_length": lengths}, 0.1, breaks=[20])
    found = np.asarray(jm.simulate(one, both).readings["force"])
    for rows, length in ((slice(0, 20), 0.083), (slice(20, 40), 0.281)):
        alone = Driven(muscle=muscle(length + excess))
        moved = {name: values[rows] for name, values in columns.items()}
        held = jm.recording(alone, {**moved, "position": moved["position"] + excess}, 0.1)
        expected = np.asarray(jm.simulate(alone, held).readings["force"])
        np.testing.assert_allclose(found[rows], expected, rtol=1e-12)
        assert expected[-1] > 100
