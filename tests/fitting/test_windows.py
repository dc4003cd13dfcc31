"""Windows: every sample of every stretch in exactly one of them."""

import numpy as np
import pytest
from oracles import bench

from jaxmuscle.fitting.windows import LONGEST_BATCH, cut

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
    assert windows.samples == -(-rows // LONGEST_BATCH)
    assert len(windows) == LONGEST_BATCH
    np.testing.assert_array_equal(windows.rows, cut(bench.model("driven"), long, 1e-2, 3.0).rows)
    assert cut(bench.model("driven"), [(0, 400, False)], 1e-2, None).samples == 50


def test_ignoring():
    windows = cut(bench.model("isotonic"), STRETCHES, 2e-3, 0.2)
    ignored = np.zeros(1333, bool)
    ignored[[0, 99, 100, 431, 1332]] = True
    times, _ = counted(windows.ignoring(ignored), 1333)
    np.testing.assert_array_equal(times, ~ignored)
    assert windows.mask.sum() == 1333
