"""Windows: every sample of every stretch in exactly one of them.

Residuals of a machine on a recording, against the oracle's readings.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.driven import driven
from oracles.recorded import NOISE, driven_card, driven_recording, smooth_motion

from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import chain_predictions, link_predictions, residuals
from jaxmuscle.estimation.weights import expected_spread
from jaxmuscle.estimation.windows import LONGEST_BATCH, bucket, cut
from jaxmuscle.optimization.descents import BROKEN
from jaxmuscle.parameters import replace

STRETCHES = [(0, 430, False), (430, 431, True), (431, 700, True), (700, 1333, False)]


def counted(windows, rows):
    """How often each row of the recording is in a window, and in one that is held out."""
    times, held = np.zeros(rows, int), np.zeros(rows, int)
    for row, mask, out in zip(windows.rows, windows.mask, windows.held_out, strict=True):
        inside = row + np.flatnonzero(mask)
        times[inside] += 1
        held[inside] += out
    return times, held


@pytest.mark.parametrize("rig", ["isotonic", "joint", "driven"])
@pytest.mark.parametrize("horizon", [None, 0.2, 0.25, 100.0])
def test_every_sample_once(rig, horizon):
    windows = cut(bench.model(rig), STRETCHES, 2e-3, horizon)
    times, held = counted(windows, 1333)
    np.testing.assert_array_equal(times, 1)
    np.testing.assert_array_equal(held, [out for a, b, out in STRETCHES for _ in range(a, b)])
    assert windows.mask.shape == (len(windows), windows.samples)
    assert len(windows.held_out) == len(windows)


def test_length_is_the_horizon():
    windows = cut(bench.model("isotonic"), STRETCHES, 2e-3, 0.2)
    assert windows.samples == 100
    np.testing.assert_array_equal(
        windows.rows, [*range(0, 430, 100), 430, *range(431, 700, 100), *range(700, 1333, 100)]
    )


def test_without_horizon_a_stretch_is_a_window():
    windows = cut(bench.model("joint"), STRETCHES, 2e-3, None)
    np.testing.assert_array_equal(windows.rows, [start for start, _, _ in STRETCHES])
    np.testing.assert_array_equal(windows.mask.sum(axis=1), [stop - start for start, stop, _ in STRETCHES])


def test_horizon_of_less_than_two_samples_and_of_more_than_a_stretch():
    assert cut(bench.model("isotonic"), STRETCHES, 2e-3, 1e-4).samples == 2
    assert cut(bench.model("isotonic"), [(0, 30, False)], 2e-3, 10.0).samples == 30


def test_imposed_rig_is_cut_into_batches():
    """Nothing starts anew at an edge, so that the horizon does not matter; the windows are many and alike."""
    rows = 20_000
    long = [(0, rows, False)]
    windows = cut(bench.model("driven"), long, 1e-2, None)
    assert windows.samples == bucket(-(-rows // LONGEST_BATCH))
    assert len(windows) == -(-rows // windows.samples) <= LONGEST_BATCH
    np.testing.assert_array_equal(windows.rows, cut(bench.model("driven"), long, 1e-2, 3.0).rows)
    assert cut(bench.model("driven"), [(0, 400, False)], 1e-2, None).samples == 50


def test_some_of_the_windows():
    windows = cut(bench.model("isotonic"), STRETCHES, 2e-3, 0.2)
    times, _ = counted(windows.only(windows.rows < 431), 1333)
    np.testing.assert_array_equal(times, np.arange(1333) < 431)


SECONDS = 6.0
IGNORED = np.isin(np.arange(600), [5, 130, 131])
ENDS = {"pressure_dependent_ends": bench.ENDS}


@pytest.fixture(scope="module")
def prepared():
    return case(driven_recording(ENDS, driven_card({}), seconds=SECONDS), 0.2, IGNORED)


def by_row(prepared, values):
    """Numbers of windows on the recording's clock; what no window holds is NaN."""
    series = np.full(prepared.observed.samples, np.nan)
    for row, mask, window in zip(
        prepared.windows.rows, prepared.windows.mask, np.asarray(values), strict=True
    ):
        series[row + np.flatnonzero(mask)] = window[mask]
    return series


@pytest.mark.slow
def test_residuals_are_those_of_the_oracle_in_units_of_noise(prepared):
    wrong = driven(bench.CARDS["driven"], {}, *smooth_motion(SECONDS))
    expected = (wrong - prepared.recording.columns["force"]) / NOISE
    found = residuals(prepared.actuator, prepared.problem)["force"]
    series = by_row(prepared, found)
    assert not np.isnan(series).any()
    np.testing.assert_array_equal(series[IGNORED], 0.0)
    # The pressure and the contraction are smoothed, which moves the force by a small part of its noise.
    np.testing.assert_allclose(series[~IGNORED], expected[~IGNORED], rtol=0, atol=0.02)
    assert np.abs(expected).max() > 10
    assert not np.asarray(found)[~prepared.windows.mask].any()


def test_only_the_given_samples_count(prepared):
    there = np.zeros(prepared.windows.mask.shape, bool)
    there[3], there[5, 10:20] = True, True
    whole = np.asarray(residuals(prepared.actuator, prepared.problem)["force"])
    part = np.asarray(residuals(prepared.actuator, prepared.problem.only(there))["force"])
    np.testing.assert_array_equal(part, np.where(there, whole, 0.0))


def test_weights_allow_for_a_variance(prepared):
    """1/w² and the variance add up; what does not count stays so, what is exact has the variance alone."""
    problem, rng = prepared.problem, np.random.default_rng(0)
    own = np.asarray(problem.weights["force"]).copy()
    own[0, :4] = 0.0, np.inf, np.inf, 1e120
    variance = rng.uniform(0, 4, own.shape)
    variance[0, 2] = 0.0
    given = problem.with_weights({"force": jnp.asarray(own)})
    found = np.asarray(given.allowing({"force": variance}).weights["force"])
    with np.errstate(divide="ignore", over="ignore"):
        expected = np.where(own > 0, (own**-2.0 + variance) ** -0.5, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert found[0, 0] == 0 and found[0, 2] == np.inf and found[0, 1] == pytest.approx(variance[0, 1] ** -0.5)
    np.testing.assert_allclose(given.allowing({"force": 0 * variance}).weights["force"], own, rtol=1e-12)


def test_what_is_not_a_number_is_large(prepared):
    broken = replace(prepared.actuator, {"muscle.end_factor": jnp.nan})
    found = np.asarray(residuals(broken, prepared.problem)["force"])
    np.testing.assert_array_equal(found, BROKEN)
    huge = replace(prepared.actuator, {"muscle.initial_radius": 1.0})
    found = np.asarray(residuals(huge, prepared.problem)["force"])
    assert np.abs(found).max() == BROKEN
    assert not found[~prepared.windows.mask].any()


def test_link_of_a_driven_rig_is_its_chain(prepared):
    link = link_predictions(prepared.actuator, prepared.problem)
    chain = chain_predictions(prepared.actuator, prepared.problem)
    np.testing.assert_array_equal(link["force"], chain["force"])
    assert np.ptp(link["force"]) > 100


def test_spread_of_the_velocity_reaches_the_force_by_friction_alone(prepared):
    """Friction is a tanh of v over 1e-4 m/s: what shifts v past zero turns the whole friction about."""
    velocity = prepared.observed.track.measured["velocity"]
    spread = {"velocity": jnp.full(len(velocity), 1e-3)}
    nothing = expected_spread(prepared.actuator, prepared.problem, spread)["force"]
    np.testing.assert_array_equal(nothing, 0.0)
    rough = bench.model("driven", thread_friction={"static_coefficient": 0.05, "kinetic_coefficient": 0.05})
    variance = by_row(prepared, expected_spread(rough, prepared.problem, spread)["force"])
    # By the given spread, and by a sample more or less of the clock.
    v = np.asarray(velocity)
    beside = np.stack([np.roll(v, 1), v, np.roll(v, -1)])[:, 1:-1]
    turning = np.pad((np.abs(v) < 5e-4)[1:-1] | (np.ptp(np.sign(beside), axis=0) > 0), 1)
    moving = np.pad((np.abs(beside) > 2e-3).all(0) & (np.ptp(np.sign(beside), axis=0) == 0), 1)
    assert variance[turning & ~IGNORED].min() > 100 * variance[moving & ~IGNORED].max()


def test_an_uncertain_clock_reaches_the_force_where_the_motion_turns(prepared):
    """The velocity itself is exact here: all friction is uncertain where a sample decides its sign."""
    exact = {"velocity": jnp.zeros(prepared.observed.samples)}
    coefficients = {"static_coefficient": 0.05, "kinetic_coefficient": 0.05}
    rough, plain = bench.model("driven", thread_friction=coefficients), bench.model("driven")
    variance = by_row(prepared, expected_spread(rough, prepared.problem, exact)["force"])
    with_friction, without = (
        by_row(prepared, link_predictions(model, prepared.problem)["force"]) for model in (rough, plain)
    )
    v = np.asarray(prepared.observed.track.measured["velocity"])
    friction = np.abs(with_friction - without) / np.tanh(np.abs(v) / 1e-4)
    clear = np.pad(np.minimum(np.abs(v[2:]), np.abs(v[:-2])) > 5e-4, 1) & (np.abs(v) > 1e-6) & ~IGNORED
    turned = np.pad(np.sign(v[2:]) != np.sign(v[:-2]), 1)
    assert (clear & turned).sum() > 3
    np.testing.assert_allclose(variance[clear & turned], friction[clear & turned] ** 2, rtol=0.02)
    assert (variance[clear & ~turned] < 1e-4 * friction[clear & ~turned] ** 2).all()
