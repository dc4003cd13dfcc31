"""Evidence from unseen windows: what counts, and what must not."""

import numpy as np
import pytest

from jaxmuscle.diagnosis.evidence import NOISE, TELLING, block_losses, blocks, compare

BLOCKS = 160
JITTER = np.random.default_rng(11).uniform(0.8, 1.2, size=BLOCKS)


def losses(mean_square):
    return np.log1p(np.broadcast_to(mean_square, BLOCKS))


def test_clear_gain():
    evidence = compare(losses(30 * JITTER), losses(1.0))
    assert evidence.gain == pytest.approx(1.0)
    assert evidence.p_value < 1e-12
    assert evidence.loss == pytest.approx(1.0)


def test_half_of_the_excess():
    before = losses(30 * JITTER)
    evidence = compare(before, 0.5 * (before + NOISE))
    assert evidence.gain == pytest.approx(0.5)
    assert evidence.p_value < 1e-12


def test_no_difference():
    before = losses(5 * JITTER)
    evidence = compare(before, before.copy())
    assert (evidence.gain, evidence.p_value) == (0.0, 1.0)
    assert evidence.loss == pytest.approx(np.exp(np.log1p(5 * JITTER).mean()) - 1)


def test_worse_model():
    evidence = compare(losses(5 * JITTER), losses(8 * JITTER))
    assert evidence.gain < -0.2
    assert evidence.p_value > 0.999


def test_blocks_in_which_neither_model_misses_do_not_count():
    quiet, telling = 1.9 * np.minimum(JITTER, 1.0), np.arange(BLOCKS) < 30
    assert np.log1p(quiet).max() < TELLING
    evidence = compare(losses(quiet), losses(0.2))
    assert (evidence.gain, evidence.p_value) == (0.0, 1.0)
    few = compare(losses(np.where(telling, 30 * JITTER, quiet)), losses(np.where(telling, 1.0, 1.04 * quiet)))
    assert few.gain == pytest.approx(1.0)
    assert few.p_value < 1e-6


def test_random_differences_are_no_evidence():
    """Of 200 comparisons without a difference about two have p < 0.01."""
    rng = np.random.default_rng(5)
    pairs = np.log1p(5 * rng.chisquare(30, size=(200, 2, BLOCKS)) / 30)
    found = sum(compare(before, after).p_value < 0.01 for before, after in pairs)
    assert found <= 8


def test_a_single_huge_window_does_not_speak_against():
    before, after = 4.0 * JITTER, 1.2 * JITTER
    after[12:16] = 1e6
    evidence = compare(np.log1p(before), np.log1p(after))
    assert after.mean() > 100 * before.mean()
    assert evidence.gain > 0.1
    assert evidence.p_value < 1e-6


def test_a_single_huge_window_does_not_speak_for():
    before, after = 4.0 * JITTER, 4.8 * JITTER
    before[12:16], after[12:16] = 1e6, 1.0
    evidence = compare(np.log1p(before), np.log1p(after))
    assert before.mean() > 100 * after.mean()
    assert evidence.p_value > 0.99


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
    found = block_losses(values, weights, blocks(3, 16, 4), judged)
    np.testing.assert_allclose(found[:3], np.log1p(4.0))
    # Block 0 of the angle has no weighted sample, block 9 the samples 6 and 7 of window 2, block 10 four.
    expected = [1.0, np.mean([38.0**2, 39.0**2]), np.mean(np.arange(40.0, 44.0) ** 2)]
    np.testing.assert_allclose(found[3:], np.log1p(expected))
    assert np.log1p(1.0) == NOISE
