"""Inputs of links as predicted: without the slow errors of readings, where the model is right."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from estimation.made import pulled
from estimation.slow_errors import COMMANDS, MACHINES, NOISE, recorded
from oracles import bench

import jaxmuscle as jm
import jaxmuscle.estimation.multistart
from jaxmuscle.estimation.dataset import station
from jaxmuscle.estimation.losses import Squares
from jaxmuscle.estimation.missing_data import noise_of_readings
from jaxmuscle.estimation.multistart import predicted_at
from jaxmuscle.estimation.predicted_inputs import with_inputs_of, with_predicted_inputs
from jaxmuscle.estimation.prepare import prepared
from jaxmuscle.estimation.request import Asked
from jaxmuscle.estimation.residuals import evaluate
from jaxmuscle.parameters import replace


def problem_of(rig):
    recording, true = recorded(rig)
    noise = noise_of_readings(MACHINES[rig], recording, None)
    return station(MACHINES[rig], recording, rig, None, noise).problem, true


def squares(machine, problem, output):
    weights = np.asarray(problem.weights[output])
    return float((evaluate(machine, problem)[output][weights > 0] ** 2).mean())


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "moved"), [("joint", "angle"), ("isotonic", "position")])
def test_slow_errors_of_a_pressure_do_not_reach_the_motion(rig, moved):
    measured, _ = problem_of(rig)
    predicted = with_predicted_inputs(MACHINES[rig], measured)
    before, after = (squares(MACHINES[rig], each, moved) for each in (measured, predicted))
    assert before > 3 and after < 0.5 * before
    # What has a rate that is an input too stays with it, and rates stay.
    for state in measured.track.measured.keys() - {"pressure"}:
        np.testing.assert_array_equal(predicted.track.measured[state], measured.track.measured[state])


def test_a_right_model_knows_regulated_pressures_better_than_their_sensors():
    measured, true = problem_of("joint")
    truth = np.stack([true["pressure_1"], true["pressure_2"]], axis=-1)

    def off(problem):
        return np.sqrt(np.mean((np.asarray(problem.track.measured["pressure"]) - truth) ** 2))

    assert off(with_predicted_inputs(MACHINES["joint"], measured)) < 0.5 * off(measured)


def test_a_model_that_is_wrong_about_an_input_takes_it_as_measured():
    measured, _ = problem_of("joint")
    slow = replace(MACHINES["joint"], {"regulator.frequency": 3.0})
    assert with_predicted_inputs(slow, measured) is measured


def test_rows_that_do_not_count_stay_as_measured():
    measured, _ = problem_of("joint")
    weights = np.array(measured.weights["pressure"])
    weights[1, 20:40, 0] = 0.0
    gap = measured.with_weights({**measured.weights, "pressure": jnp.asarray(weights)})
    predicted = with_predicted_inputs(MACHINES["joint"], gap)
    rows = measured.sample_rows[1, 20:40]
    before, after = (np.asarray(each.track.measured["pressure"])[rows] for each in (gap, predicted))
    np.testing.assert_array_equal(after[:, 0], before[:, 0])
    assert (after[:, 1] != before[:, 1]).all()


def test_a_bench_that_imposes_all_states_has_no_such_input():
    machine, recording = bench.model("driven"), pulled()
    problem = station(machine, recording, "pull", None, noise_of_readings(machine, recording, None)).problem
    assert with_predicted_inputs(machine, problem) is problem
    assert with_inputs_of(problem, problem) is problem


def test_an_offset_of_a_sensor_is_put_back_on_what_is_predicted():
    """Inputs stand for readings: freed of the offset, the machine sees the pressure that it predicted."""
    recording, true = recorded("joint")
    shifted = {**recording.columns, "pressure_1": recording.columns["pressure_1"] + 5e3}

    recording = dataclasses.replace(recording, columns=shifted)
    objective = prepared(MACHINES["joint"], [recording], Asked(["offset.pressure_1"]), None, None, Squares())
    u = objective.unknowns.coordinates(np.array([5e3]))
    found = predicted_at(objective, u)
    series = np.asarray(found.stations[0].problem.track.measured["pressure"])
    assert found is not objective
    assert np.abs(np.mean(series[:, 0] - true["pressure_1"]) - 5e3) < 0.5 * NOISE["pressure"]
    assert np.abs(np.mean(series[:, 1] - true["pressure_2"])) < 0.5 * NOISE["pressure"]


@pytest.mark.slow
def test_a_fit_comes_nearer_to_the_true_motion(monkeypatch):
    """Pressures are off by three times their noise on the card of the other tests, half of it for long."""
    monkeypatch.setitem(NOISE, "pressure_1", 1200.0)
    monkeypatch.setitem(NOISE, "pressure_2", 1200.0)
    free = {"inertia": 0.04, "end_factor": 1.303, "load_damping.coefficient": 0.05}
    command = np.tile(COMMANDS["joint"], (4, 1))
    track = bench.joint_track(command)

    def off(seed):
        """Error of the fitted machine's angle in noise units; of values in standard deviations."""
        recording, true = recorded("joint", seed, command)
        found = jm.fit(MACHINES["joint"], recording, list(free))
        angle = np.asarray(bench.simulated(found.actuator, track, 4).readings["angle"])
        error = np.sqrt(np.mean((angle - true["angle"]) ** 2)) / NOISE["angle"]
        return error, [(found.values[name] - value) / found.std[name] for name, value in free.items()]

    errors, deviations = zip(*(off(seed) for seed in range(4)), strict=True)
    assert np.abs(deviations).max() < 4
    monkeypatch.setattr(jaxmuscle.estimation.multistart, "INPUTS", 0)
    without = [off(seed)[0] for seed in range(4)]
    assert np.max(errors) < 0.2 * np.max(without)
