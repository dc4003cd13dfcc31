"""A recording made ready: what is held out is out of sight, what the card says arrives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.recorded import STDS, THREAD_STDS, driven_card, driven_recording

from jaxmuscle.estimation.case import case
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
    past = begun_from(lift, "past", 0.3)
    begun = past.problem.track.measured
    for state in ("pressure", "position"):
        np.testing.assert_array_equal(begun[state], lift.columns[state])
    seen, unseen = np.split(lift.columns["position"], [4200])
    told = [rate_from_past(part, lift.step, noise_level(part)) for part in (seen, unseen)]
    np.testing.assert_array_equal(begun["velocity"], np.concatenate([rate for rate, _ in told]))
    np.testing.assert_array_equal(past.starts.spread["velocity"], np.concatenate([std for _, std in told]))


def test_what_is_smoothed_for_other_ends_stays(lift):
    past, both = begun_from(lift, "past", 0.3), case(lift, 0.3)
    assert both.starts is both.observed
    jax.tree.map(np.testing.assert_array_equal, past.observed.track.measured, both.observed.track.measured)
    assert np.median(past.starts.spread["velocity"]) > 2 * np.median(both.starts.spread["velocity"])


def test_what_a_bench_imposes_is_known_from_both_sides(driven):
    """A prediction is told the motion that is to come."""
    past, both = (begun_from(driven, state_from).problem.track.measured for state_from in ("past", "both"))
    jax.tree.map(np.testing.assert_array_equal, past, both)


def test_the_past_of_a_run_begins_with_it(lift):
    """Across a break nothing is told."""
    twice = joined([lift.part(0, 1000), lift.part(3000, 4000)], "twice")
    whole, alone = begun_from(twice, "past", 0.1), begun_from(lift.part(3000, 4000), "past", 0.2)
    for state in ("pressure", "position", "velocity"):
        np.testing.assert_allclose(
            whole.problem.track.measured[state][1000:1600], alone.problem.track.measured[state][:600]
        )


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
