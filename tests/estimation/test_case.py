"""A recording made ready: what is held out is out of sight, what the card says arrives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.recorded import STDS, THREAD_STDS, driven_card, driven_recording

from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import link_predictions
from jaxmuscle.estimation.weights import SPREAD, expected_spread
from jaxmuscle.parameters import get
from jaxmuscle.recordings import read
from jaxmuscle.recordings.joining import joined
from jaxmuscle.recordings.smoothing import noise_level, rate_from_past
from jaxmuscle.samples import sample


@pytest.fixture(scope="module")
def lift():
    return read(sample("lift"))


@pytest.fixture(scope="module")
def driven():
    return driven_recording({}, driven_card(bench.THREADS), seconds=6.0)


def rows_of(windows, chosen):
    """All rows of the chosen windows."""
    each = zip(windows.rows[chosen], windows.mask[chosen], strict=True)
    return np.concatenate([row + np.flatnonzero(mask) for row, mask in each])


def test_the_end_is_held_out(lift):
    windows = case(lift, 0.3).windows
    np.testing.assert_array_equal(rows_of(windows, ~windows.held_out), np.arange(4200))
    np.testing.assert_array_equal(rows_of(windows, windows.held_out), np.arange(4200, 6000))
    assert windows.samples == 500


def test_a_mask_is_held_out(lift):
    mask = np.zeros(6000, bool)
    mask[1000:1750] = True
    prepared = case(lift, mask)
    np.testing.assert_array_equal(rows_of(prepared.windows, prepared.windows.held_out), np.arange(1000, 1750))
    assert prepared.training.total == 6000


def test_training_has_the_other_windows_only(lift):
    prepared = case(lift, 0.3)
    training, keep = prepared.training, ~prepared.windows.held_out
    assert keep.sum() < len(keep)
    np.testing.assert_array_equal(training.rows, prepared.windows.rows[keep])
    for output in ("pressure", "position"):
        np.testing.assert_array_equal(training.targets[output], prepared.problem.targets[output][keep])
        np.testing.assert_array_equal(training.weights[output], prepared.problem.weights[output][keep])


@pytest.mark.parametrize("name", ["lift", "bench"])
def test_held_out_readings_do_not_reach_the_training(name):
    """Nor by smoothing across the edge, nor by the level of the noise."""
    recording = read(sample(name))
    first = round(0.7 * len(recording))
    rng = np.random.default_rng(1)
    spoilt = {
        column: np.concatenate([v[:first], v[first:] + 0.3 * np.ptp(v) * rng.normal(size=len(v) - first)])
        if column != "command"
        else v
        for column, v in recording.columns.items()
    }
    clean = case(recording, 0.3)
    dirty = case(dataclasses.replace(recording, columns=spoilt), 0.3)

    def seen(prepared):
        training, observed = prepared.training, prepared.observed
        smoothed = jax.tree.map(lambda values: values[:first], (observed.track.measured, observed.spread))
        masked = {out: jnp.where(w > 0, training.targets[out], 0.0) for out, w in training.weights.items()}
        return masked, training.weights, smoothed

    jax.tree.map(np.testing.assert_array_equal, seen(clean), seen(dirty))
    unseen = [prepared.observed.track.measured["pressure"][first:] for prepared in (clean, dirty)]
    assert not np.allclose(*unseen, rtol=1e-3)


def begun_from(recording, state_from, held_out=0.3):
    card = dataclasses.replace(recording.card, state_from=state_from)
    return case(dataclasses.replace(recording, card=card), held_out)


def test_windows_begin_with_what_the_past_tells(lift):
    track = begun_from(lift, "past", 0.3).problem.track
    begun = track.at_start(jnp.arange(6000))
    for state in ("pressure", "position"):
        np.testing.assert_allclose(begun[state], lift.columns[state], rtol=1e-12, atol=1e-12)
    seen, unseen = np.split(lift.columns["position"], [4200])
    told = [rate_from_past(part, lift.step, noise_level(part)) for part in (seen, unseen)]
    np.testing.assert_allclose(begun["velocity"], np.concatenate([rate for rate, _ in told]), atol=1e-9)
    spread = track.start_spread("velocity", np.zeros(6000))
    np.testing.assert_array_equal(spread, np.concatenate([std for _, std in told]))


def test_what_is_smoothed_for_other_ends_stays(lift):
    """Inputs of links, and missing rates; a smoothed velocity is better known."""
    past, both = begun_from(lift, "past", 0.3), case(lift, 0.3)
    jax.tree.map(np.testing.assert_array_equal, past.problem.track.measured, both.problem.track.measured)
    jax.tree.map(np.testing.assert_array_equal, past.observed.spread, both.observed.spread)
    assert not both.problem.track.start_errors
    spread = [np.median(c.problem.track.start_spread("velocity", c.observed.spread["velocity"]))
              for c in (past, both)]  # fmt: skip
    assert spread[0] > 2 * spread[1]


@pytest.mark.slow
def test_a_prediction_begins_there_and_its_inputs_are_the_smoothed_ones(lift):
    """Of the first row of a window a reading is what the past tells; parts of windows begin so, too."""
    past, both = (begun_from(lift, state_from, 0.3) for state_from in ("past", "both"))
    machine, readings = past.actuator, {}
    for name, prepared in (("past", past), ("both", both)):
        parts = prepared.problem.in_parts(4)
        readings[name] = {o: np.asarray(v) for o, v in link_predictions(machine, parts).items()}
    rows, within = past.windows.rows, slice(0, None, 125)
    here = past.windows.sample_rows(6000)[:, within]
    np.testing.assert_allclose(readings["past"]["position"][:, within], lift.columns["position"][here])
    smoothed = np.asarray(both.observed.track.measured["position"])[here]
    np.testing.assert_allclose(readings["both"]["position"][:, within], smoothed)
    assert len(rows) == len(here)


def test_what_a_bench_imposes_is_known_from_both_sides(driven):
    """A prediction is told the motion and the pressure that are to come."""
    assert not begun_from(driven, "past").problem.track.start_errors


@pytest.mark.slow
def test_the_past_of_a_run_begins_with_it(lift):
    """Across a break nothing is told."""
    twice = joined([lift.part(0, 1000), lift.part(3000, 4000)], "twice")
    whole, alone = begun_from(twice, "past", 0.1), begun_from(lift.part(3000, 4000), "past", 0.2)
    ahead, own = (prepared.problem.track.at_start(jnp.arange(2000)) for prepared in (whole, alone))
    for state in ("pressure", "position", "velocity"):
        np.testing.assert_allclose(ahead[state][1000:1600], own[state][:600], rtol=1e-9, atol=1e-12)
    (first,) = np.flatnonzero(whole.windows.rows == 1000)
    begun = link_predictions(whole.actuator, whole.problem)["position"][first, 0]
    assert begun == pytest.approx(twice.columns["position"][1000], rel=1e-12)


@pytest.mark.slow
def test_weights_allow_for_what_the_past_does_not_know(lift):
    """By the uncertain velocity a prediction is off at its end by more than when both sides tell it."""
    variances = []
    for state_from in ("past", "both"):
        prepared = begun_from(lift, state_from)
        spread = {name: SPREAD * values for name, values in prepared.observed.spread.items()}
        variances.append(expected_spread(prepared.actuator, prepared.problem, spread))
    past, both = (np.median(variance["position"][:, 20]) for variance in variances)
    assert past > 3 * both > 0
    # A pressure begins as it was read, with the noise of its sensor; flow through the valve takes some off.
    past, both = (np.median(np.asarray(variance["pressure"]), axis=0) for variance in variances)
    more = (past - both) / lift.card.noise["pressure"] ** 2
    assert more[1] == pytest.approx(1.0, abs=0.1) and 0 < more[400] < 0.9


def test_ignored_rows_have_no_weight(driven):
    ignored = np.zeros(600, bool)
    ignored[[3, 77, 599]] = True
    whole, less = case(driven, 0.0).problem, case(driven, 0.0, ignored).problem
    lost = np.asarray(whole.weights["force"] != less.weights["force"])
    assert lost.sum() == 3
    assert not np.asarray(less.weights["force"])[lost].any()


def test_priors_are_those_of_the_card(driven):
    priors = case(driven, 0.3).priors
    assert set(priors) == {
        *(f"muscle.{name}" for name in STDS),
        *(f"effects.thread_friction.{name}" for name in THREAD_STDS),
    }
    assert (priors["muscle.end_factor"].mean, priors["muscle.end_factor"].std) == (1.303, 0.05)
    friction = priors["effects.thread_friction.kinetic_coefficient"]
    assert (friction.mean, friction.std) == (bench.THREADS["kinetic_coefficient"], 0.02)


def test_machine_is_that_of_the_card(driven):
    actuator = case(driven, 0.3).actuator
    assert float(get(actuator, "muscle.end_factor")) == 1.303
    assert float(get(actuator, "effects.thread_friction.velocity_constant")) == 0.15


@pytest.mark.parametrize(("step", "substeps"), [(0.001, 1), (0.002, 1), (0.004, 2), (0.005, 3)])
def test_steps_of_the_solver(lift, step, substeps):
    slower = dataclasses.replace(lift, step=step, time=np.arange(6000) * step)
    assert case(slower, 0.3).problem.substeps == substeps


def test_no_window_reaches_over_a_break(driven):
    twice = joined([driven.part(0, 230), driven.part(0, 370)], "twice")
    windows = case(twice, 0.3).windows
    ends = windows.rows + windows.mask.sum(axis=1)
    assert ((ends <= 230) | (windows.rows >= 230)).all()
    assert 230 in windows.rows
    assert 420 in windows.rows
