"""Windows that begin somewhere else than the smoothed readings say."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from estimation.made import lifted, pulled
from estimation.own_rig import STEP, drive, measured
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.estimation.initial_states import LOOSE, loosened
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.prepare import prepared
from jaxmuscle.estimation.request import Asked

FREE = ["mass", "load_damping.coefficient"]


@pytest.fixture(scope="module")
def objective():
    """The drive in four windows, at the truth."""
    machine = drive()
    recording = jm.recording(machine, measured(0), STEP, noise={"position": 1e-4}, horizon=1.0, name="own")
    return prepared(machine, [recording], Asked(FREE), None, None, Squares())


@pytest.fixture(scope="module")
def truth(objective):
    return objective.unknowns.coordinates(objective.unknowns.start)


def begun_at(objective, by):
    """Windows begin off by so many standard deviations of the smoothed position."""
    (station,) = objective.stations
    rows, spread = np.asarray(station.problem.rows), np.asarray(station.spread["position"])
    positions = station.problem.track.measured["position"]
    moved = positions.at[rows].add(by * spread[rows])
    problem = eqx.tree_at(lambda p: p.track.measured["position"], station.problem, moved)
    return dataclasses.replace(objective, stations=[dataclasses.replace(station, problem=problem)])


def test_changes_are_those_of_the_predictions(objective, truth):
    (station,) = loosened(objective, truth).stations
    (change,) = station.begins
    up, down = (begun_at(objective, by).residuals(0, truth[None])[0][0] for by in (LOOSE, -LOOSE))
    weight = np.asarray(station.problem.weights["position"])
    np.testing.assert_allclose((change["position"] * weight).ravel(), 0.5 * (up - down), rtol=1e-3, atol=1e-6)


def test_where_windows_begin_hardly_moves_the_cost(objective, truth):
    """Ten standard deviations off at every window: its readings tell that it began elsewhere."""
    free = loosened(objective, truth)
    rise = lambda cost: cost(begun_at(objective, 10.0)) - cost(objective)  # noqa: E731
    strict = rise(lambda each: each.at(truth[None])[0].cost)
    loose = rise(
        lambda each: dataclasses.replace(
            each, stations=[dataclasses.replace(each.stations[0], begins=free.stations[0].begins)]
        ).at(truth[None])[0].cost
    )  # fmt: skip
    assert strict > 100 and abs(loose) < 0.1 * strict


def test_derivatives_are_those_of_the_cost(objective, truth):
    free = loosened(objective, truth)
    local, step = free.at(truth[None])[0], 1e-5
    for i, slope in enumerate(local.gradient):
        ends = truth + step * np.array([[-1.0], [1.0]]) * (np.arange(len(truth)) == i)
        low, high = (free.at(end[None])[0].cost for end in ends)
        assert slope == pytest.approx((high - low) / (2 * step), rel=1e-4, abs=1e-4)


def test_what_a_bench_imposes_begins_no_window():
    recording = pulled()
    imposed = prepared(jm.actuator(recording.card), [recording], Asked(["end_factor"]), None, None, Squares())
    u = imposed.unknowns.coordinates(imposed.unknowns.start)
    (station,) = loosened(imposed, u).stations
    assert station.begins == ()
    np.testing.assert_array_equal(station.whitened(np.arange(5.0)), np.arange(5.0))


@pytest.mark.slow
def test_a_time_constant_is_not_taken_for_where_windows_begin():
    """With begins as smoothed it is 2 % too small, the same way in every draw, four standard errors here."""
    true, found = bench.CARDS["isotonic"]["valve_time_constant"], []
    for seed in range(8):
        recording = lifted(8.0, seed=seed)
        machine = jm.actuator(recording.card)
        result = jm.fit(machine, recording, ["valve_area", "valve_time_constant"])
        found.append(result.values["valve_time_constant"] / true - 1)
    assert abs(np.mean(found)) < 3 * np.std(found) / np.sqrt(len(found)) + 0.002
