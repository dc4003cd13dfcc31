"""Evidence from unseen windows: what counts, and what must not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmuscle.diagnosis.evidence import (
    FLIPS,
    NOISE,
    TELLING,
    block_losses,
    block_means,
    blocks,
    compare,
    correlated_blocks,
    gain,
    sign_flip_bound,
    sign_flip_test,
    signed_ranks,
    telling_excess,
)
from jaxmuscle.estimation.losses import LIMIT, Huber

BLOCKS = 160
JITTER = np.random.default_rng(11).uniform(0.8, 1.2, size=BLOCKS)


def losses(mean_square):
    return np.log1p(np.broadcast_to(mean_square, (1, BLOCKS)))


def one(before, after, stretch=1):
    (found,) = compare(before, [after], stretch)
    return found


def test_clear_gain():
    evidence = one(losses(30 * JITTER), losses(1.0))
    assert evidence.gain == pytest.approx(1.0)
    assert evidence.p_value == 1 / FLIPS
    assert evidence.loss == pytest.approx(1.0)


def test_half_of_the_excess():
    before = losses(30 * JITTER)
    evidence = one(before, 0.5 * (before + NOISE))
    assert evidence.gain == pytest.approx(0.5)
    assert evidence.p_value == 1 / FLIPS


def test_no_difference():
    before = losses(5 * JITTER)
    evidence = one(before, before.copy())
    assert (evidence.gain, evidence.p_value) == (0.0, 1.0)
    assert evidence.loss == pytest.approx(np.exp(np.log1p(5 * JITTER).mean()) - 1)


def test_worse_model():
    evidence = one(losses(5 * JITTER), losses(8 * JITTER))
    assert evidence.gain < -0.2
    assert evidence.p_value == 1.0


def test_blocks_in_which_neither_model_misses_do_not_count():
    quiet, telling = 1.9 * np.minimum(JITTER, 1.0), np.arange(BLOCKS) < 30
    assert np.log1p(quiet).max() < TELLING
    evidence = one(losses(quiet), losses(0.2))
    assert (evidence.gain, evidence.p_value) == (0.0, 1.0)
    few = one(losses(np.where(telling, 30 * JITTER, quiet)), losses(np.where(telling, 1.0, 1.04 * quiet)))
    assert few.gain == pytest.approx(1.0)
    assert few.p_value == 1 / FLIPS


def null_p_values(rng, models, correlation, stretch, tries=250):
    """Smallest p-value of several models that differ from the first one by chance only."""

    def line():
        white = np.sqrt(1 - correlation**2) * rng.normal(size=BLOCKS)
        return np.asarray(lfilter([1.0], [1.0, -correlation], white))

    found = []
    for _ in range(tries):
        before = losses(5.0)
        common = line()
        others = [before + 0.1 * (common + line())[None] for _ in range(models)]
        found.append(min(e.p_value for e in compare(before, others, stretch)))
    return np.array(found)


@pytest.mark.parametrize(("models", "correlation", "stretch"), [(1, 0.0, 1), (6, 0.0, 1), (6, 0.7, 20)])
def test_chance_finds_something_as_often_as_it_says(models, correlation, stretch):
    """Of 250 comparisons without a difference, whatever the number of models and the correlation."""
    p_values = null_p_values(np.random.default_rng(5), models, correlation, stretch)
    for level in (0.01, 0.05, 0.2):
        spread = np.sqrt(level * (1 - level) / len(p_values))
        # Ties at the edge of few stretches make the test a little conservative.
        assert np.mean(p_values <= level) < level + 3 * spread
    assert np.mean(p_values <= 0.2) > 0.08


def test_correlation_that_is_not_allowed_for_misleads():
    """The same correlated differences flipped block by block: what the stretches are for."""
    p_values = null_p_values(np.random.default_rng(5), 6, 0.7, 1)
    assert np.mean(p_values <= 0.05) > 0.12


def test_a_single_huge_window_does_not_speak_against():
    before, after = 4.0 * JITTER, 1.2 * JITTER
    after[12:16] = 1e6
    evidence = one(losses(before), losses(after))
    assert after.mean() > 100 * before.mean()
    assert evidence.gain > 0.1
    assert evidence.p_value < 1e-3


def test_a_single_huge_window_does_not_speak_for():
    before, after = 4.0 * JITTER, 4.8 * JITTER
    before[12:16], after[12:16] = 1e6, 1.0
    evidence = one(losses(before), losses(after))
    assert before.mean() > 100 * after.mean()
    assert evidence.p_value > 0.99


def test_few_stretches_are_counted_exactly_and_cannot_show_much():
    falls = np.array([3.0, 1.0, 2.0, 0.5])
    assert sign_flip_test(signed_ranks(falls)[None]) == [0.5**4]
    # Beside another model the largest of the two is as large in 2 of 16 flips: as they are, and with the
    # smallest one flipped.
    both = np.stack([signed_ranks(falls), signed_ranks(falls * [1, 1, 1, -1])])
    assert sign_flip_test(both) == [2 / 16, 2 / 16]


def test_stretches_that_tell_the_models_apart_are_counted():
    before, after = losses(5 * JITTER), losses(5 * JITTER).copy()
    after[:, 10:14] -= 0.5
    after[:, 20] += 1e-4  # too little to tell anything
    found = one(before, after)
    assert (found.stretches, found.p_value) == (4, pytest.approx(1 / 16, rel=0.1))


def test_nothing_to_compare():
    assert compare(losses(5.0), []) == []
    assert gain(losses(0.5), losses(0.4)) == 0.0


@pytest.mark.parametrize(("correlation", "least", "most"), [(0.0, 1, 1), (0.8, 15, 48)])
def test_correlated_blocks(correlation, least, most):
    """Of a first-order autoregression the time is (1 + a)/(1 - a): 9 for 0.8."""
    rng = np.random.default_rng(3)
    line = np.asarray(lfilter([1.0], [1.0, -correlation], rng.normal(size=400)))
    assert least <= correlated_blocks(line[None]) <= most


def test_correlation_is_that_of_the_worst_column_and_at_most_a_quarter():
    rng = np.random.default_rng(4)
    steady = np.repeat([1.0, -1.0], 20)
    assert correlated_blocks(np.stack([rng.normal(size=40), steady])) >= 8
    assert correlated_blocks(np.zeros((1, 3))) == 1


def test_means_of_blocks_by_column():
    values = {"pressure": np.arange(24.0).reshape(2, 6, 2), "angle": np.full((2, 6), 50.0)}
    weights = {"pressure": np.ones((2, 6, 2)), "angle": np.zeros((2, 6))}
    weights["pressure"][0, 0, 0] = 0.0
    means = block_means(values, weights, blocks(2, 6, 3))
    # Of the first column two rows count in block 0; beyond ten a residual counts as ten.
    np.testing.assert_allclose(means[0], [3.0, 8.0, 10.0, 10.0])
    np.testing.assert_allclose(means[1], [3.0, 26 / 3, 10.0, 10.0])
    np.testing.assert_array_equal(means[2], 0.0)


def test_blocks_are_numbered_window_after_window():
    np.testing.assert_array_equal(blocks(2, 8, 2), [[0, 0, 1, 1, 2, 2, 3, 3], [4, 4, 5, 5, 6, 6, 7, 7]])
    uneven = blocks(3, 50, 13)
    assert np.bincount(uneven.ravel()).tolist() == [13, 13, 13, 11] * 3
    np.testing.assert_array_equal(blocks(2, 3, 3), [[0, 0, 0], [1, 1, 1]])


def test_losses_of_the_judged_blocks():
    """Means over weighted samples only, output by output; a block without any counts as noise."""
    values = {
        "pressure": np.full((3, 16, 2), 2.0),
        "angle": np.arange(48, dtype=float).reshape(3, 16),
    }
    weights = {name: np.ones_like(array) for name, array in values.items()}
    weights["angle"][:, :6], values["angle"][:, :6] = 0.0, 1e9
    weights["pressure"][..., 1], values["pressure"][..., 1] = 0.0, 7.0
    judged = np.array([0, 9, 10])
    pressure, angle = block_losses(values, weights, blocks(3, 16, 4), judged)
    np.testing.assert_allclose(pressure, np.log1p(4.0))
    # Block 0 of the angle has no weighted sample, block 9 the samples 6 and 7 of window 2, block 10 four.
    expected = [1.0, np.mean([38.0**2, 39.0**2]), np.mean(np.arange(40.0, 44.0) ** 2)]
    np.testing.assert_allclose(angle, np.log1p(expected))
    assert np.log1p(1.0) == NOISE


def test_what_a_model_misses_is_counted_where_it_misses():
    """Two outputs in four blocks: one whose noise is declared too large, one that is missed in a block."""
    block = blocks(2, 20, 10)
    quiet = np.full((2, 20, 2), np.sqrt(0.9))
    wrong = np.zeros((2, 20))
    wrong[1, :10] = 3.0
    weights = {"pressure": np.ones((2, 20, 2)), "angle": np.ones((2, 20))}
    residuals = {"pressure": quiet, "angle": wrong}
    assert telling_excess(residuals, weights, block) == pytest.approx(10 * (9.0 - 1.0))
    assert telling_excess({**residuals, "angle": 0 * wrong}, weights, block) == 0.0
    halves = {"pressure": np.array([1.0, 0.5]), "angle": np.array([0.5])}
    assert telling_excess(residuals, weights, block, halves) == pytest.approx(0.25 * 10 * (9.0 - 1.0))


def test_what_is_missed_counts_by_the_loss():
    """A reading of 9 noise units costs twice 11.2 under Huber's loss; the others leave what noise does."""
    residuals, weights = {"force": np.ones((1, 10))}, {"force": np.ones((1, 10))}
    residuals["force"][0, 4] = 9.0
    costs = 2 * LIMIT * (9.0 - 0.5 * LIMIT) - 1.0
    found = telling_excess(residuals, weights, blocks(1, 10, 10), None, Huber())
    assert found == pytest.approx(costs)
    assert telling_excess(residuals, weights, blocks(1, 10, 10)) == pytest.approx(80.0)


def test_readings_without_weight_are_no_part_of_what_is_missed():
    weights = np.ones((1, 10))
    weights[0, :5] = 0.0
    found = telling_excess({"angle": np.full((1, 10), 3.0)}, {"angle": weights}, blocks(1, 10, 10))
    assert found == pytest.approx(5 * 8.0)


def test_a_bound_on_the_p_value_goes_on_where_too_few_flips_are_drawn():
    """No smaller than an exact p-value; the smallest that could be multiplied by dozens of pairs."""
    few = np.log1p(20 * JITTER[:12])[None]
    exact = one(few, few - 1.0).p_value
    assert exact == 0.5**12 < sign_flip_bound(few, few - 1.0) < 0.05
    many = losses(30 * JITTER)
    assert one(many, losses(1.0)).p_value == 1 / FLIPS
    assert sign_flip_bound(many, losses(1.0)) < 1e-20
    assert sign_flip_bound(losses(1.0), many) == sign_flip_bound(many, many) == 1.0
    assert sign_flip_bound(many, losses(1.0), stretch=40) > 1 / 16
