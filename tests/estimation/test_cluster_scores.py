"""Scores of windows, and of the parts of the only one."""

import numpy as np
import pytest

from jaxmuscle.estimation.covariance import PARTS, window_scores
from jaxmuscle.estimation.residual_analysis import Series

ROWS = 60
RNG = np.random.default_rng(0)


def line(window, recording=0, column="y"):
    """Random slopes by two unknowns where a row belongs to a window."""
    counts = window >= 0
    slopes = RNG.normal(size=(2, len(window))) * counts
    return Series(recording, "y", column, counts, RNG.normal(size=len(window)) * counts, slopes, window)


def test_all_columns_of_a_window_together_and_each_recording_by_itself():
    whole, late = np.arange(ROWS) // 20, np.where(np.arange(ROWS) < 25, -1, np.arange(ROWS) // 20)
    lines = [line(whole), line(late, column="z"), line(whole[:40], recording=1)]
    errors = [each.residual for each in lines]
    found = window_scores(lines, errors)

    def score(recording, window):
        own = [x for x in lines if x.recording == recording]
        return sum(((x.slopes * x.residual)[:, x.window == window].sum(axis=1) for x in own), np.zeros(2))

    expected = np.array([score(*key) for key in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1))])
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(expected, axis=0))


@pytest.mark.parametrize("begin", [0, 17])
def test_the_only_window_in_parts(begin):
    window = np.where(np.arange(ROWS) < begin, -1, 0)
    lines = [line(window), line(window, column="z")]
    found = window_scores(lines, [each.residual for each in lines])
    assert found.shape == (PARTS, 2)
    total = sum(each.slopes @ each.residual for each in lines)
    np.testing.assert_allclose(found.sum(axis=0), total)
    sizes = np.bincount((np.arange(ROWS - begin)) * PARTS // (ROWS - begin))
    assert sizes.min() >= 2 and np.ptp(sizes) <= 1
