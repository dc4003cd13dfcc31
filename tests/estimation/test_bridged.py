"""Gaps that are bridged, and the noise of columns with gaps."""

import dataclasses

import numpy as np
import pytest
from estimation.made import TRUE, changed, fitted, pulled, within
from oracles.recorded import NOISE

from jaxmuscle.estimation.bridged import LONGEST_BRIDGE, OVERSHOOT, bridged, noise_beside_gaps
from jaxmuscle.recordings.smooth import noise_level

ROWS = np.arange(600)
WAVE = np.sin(2 * np.pi * ROWS / 100)


def gap(begin, many, rows=600):
    """Rows of one gap."""
    bad = np.zeros(rows, bool)
    bad[begin : begin + many] = True
    return bad


@pytest.mark.parametrize("many", [1, 3, 8, LONGEST_BRIDGE])
def test_a_cubic_is_kept(many):
    curve = 1e-6 * (ROWS - 300.0) ** 3 - 2e-3 * ROWS
    bad = gap(290, many) | gap(330, 1)
    np.testing.assert_allclose(bridged(np.where(bad, np.nan, curve), bad), curve, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("many", "off"), [(1, 1e-5), (3, 1e-4), (8, 2e-3), (LONGEST_BRIDGE, 0.022)])
def test_the_top_of_a_wave_is_not_cut_off(many, off):
    """Off by ω⁴/24 times the squared distances of the nearest and the farthest readings at most."""
    bad = gap(125 - many // 2, many)
    line = np.interp(ROWS, ROWS[~bad], WAVE[~bad])
    assert np.abs(bridged(WAVE, bad) - WAVE).max() < off < 0.3 * np.abs(line - WAVE).max()


def test_noise_beside_a_gap_is_not_drawn_out():
    """Across ten samples a spline through the two next to the gap would go off four times as far."""
    off = []
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(size=600)
        off.append(bridged(noise, gap(300, 10))[300:310])
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_no_farther_than_the_readings_beside_it_allow():
    """A ramp that ends in a gap."""
    ramp, bad = np.minimum(np.maximum(ROWS - 290.0, 0.0), 12.0), gap(300, 15)
    found = bridged(ramp, bad)
    assert found.max() <= 12 + OVERSHOOT * 12 and found.min() >= 0
    step = (ROWS >= 305).astype(float)
    assert np.abs(bridged(step, bad) - 0.5).max() <= 0.5 + OVERSHOOT


def test_long_gaps_ends_and_breaks():
    long = gap(100, LONGEST_BRIDGE + 1)
    np.testing.assert_allclose(bridged(WAVE, long), np.interp(ROWS, ROWS[~long], WAVE[~long]))
    ends = gap(0, 3) | gap(596, 4)
    found = bridged(WAVE, ends)
    assert (found[:3] == WAVE[3]).all() and (found[596:] == WAVE[595]).all()
    two = np.where(ROWS < 300, 1.0, 5.0)
    np.testing.assert_array_equal(bridged(two, gap(297, 6), breaks=(300,)), two)
    assert (bridged(np.full(600, np.nan), gap(0, 600)) == 0).all()
    nearly = bridged(WAVE, gap(300, 300), breaks=(300,))
    assert (nearly[300:] == WAVE[299]).all()


def test_without_a_gap_the_noise_is_what_it_was():
    noise = np.random.default_rng(1).normal(size=600)
    assert noise_beside_gaps(noise, gap(0, 0)) == pytest.approx(noise_level(noise), rel=1e-12)
    assert noise_beside_gaps(noise, gap(4, 596)) == 0


@pytest.mark.parametrize("part", [0.2, 0.4, 0.6, 0.8])
def test_the_noise_of_readings_with_gaps(part):
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        bad = rng.random(600) < part
        values = 50 * WAVE + 0.8 * rng.normal(size=600)
        found.append(noise_beside_gaps(np.where(bad, np.nan, values), bad))
    assert np.mean(found) == pytest.approx(0.8, rel=0.08) and np.std(found) < 0.2


def test_no_stencil_goes_across_a_break():
    rng, bad = np.random.default_rng(1), gap(0, 0)
    values = np.where(ROWS % 10 < 5, 0.0, 1e6) + rng.normal(size=600)
    breaks = tuple(range(5, 600, 5))
    assert noise_beside_gaps(values, bad, breaks) == pytest.approx(1.0, rel=0.2)


def changed_card(recording, **changes):
    """A copy with another card."""
    return dataclasses.replace(recording, card=dataclasses.replace(recording.card, **changes))


def test_missing_readings_of_what_a_bench_imposes_do_not_bias_a_fit():
    """Straight lines cut the strokes short: the fit was five standard deviations off."""
    recording = pulled()
    miss = np.random.default_rng(3).random(len(recording)) < 0.3
    miss[[0, -1]] = False
    found = fitted(changed(recording, position=np.where(miss, np.nan, recording.columns["position"])))
    for name, true in TRUE.items():
        assert within(found, name, true, 2.5), name


def test_the_noise_that_a_fit_assumes_beside_gaps():
    recording = changed_card(pulled(), noise={})
    miss = np.random.default_rng(3).random(len(recording)) < 0.4
    gappy = changed(recording, force=np.where(miss, np.nan, recording.columns["force"]))
    noise = fitted(gappy).noise["pull"]["force"]
    assert noise.assumed == pytest.approx(NOISE, rel=0.2) and noise.ratio == pytest.approx(1.0, abs=0.2)
    given = fitted(gappy, noise={"force": 2.0}).noise["pull"]["force"]
    assert given.assumed == pytest.approx(2.0)
    card = fitted(changed_card(gappy, noise={"force": 3.0})).noise["pull"]["force"]
    assert card.assumed == pytest.approx(3.0)


def test_readings_in_steps_are_off_by_a_part_of_a_step():
    """A slow signal behind a converter; its differences are zero."""
    values = np.round(100 * np.sin(np.arange(6000) / 1000)).astype(np.float64)
    bad = np.arange(6000) % 700 < 30
    expected = pytest.approx(1 / np.sqrt(12), rel=1e-6)
    assert noise_beside_gaps(np.where(bad, np.nan, values), bad) == expected == noise_level(values)
