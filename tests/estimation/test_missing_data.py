"""Gaps that are bridged, and the noise of columns with gaps.

Readings that are missing, masked, wild, or noisier than was said; the band in which they lie.
"""

import dataclasses

import numpy as np
import pytest
from estimation.made import TRUE, changed, fitted, pulled, within
from oracles.recorded import NOISE

from jaxmuscle.estimation.missing_data import LONGEST_BRIDGE, OVERSHOOT, bridged, noise_beside_gaps
from jaxmuscle.recordings.smoothing import noise_level

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


def test_noise_on_what_the_bench_imposes(recording):
    """Smoothed inputs that were cut at their peaks had put the radius 30 standard errors off."""
    off = []
    for seed in range(12):
        rng = np.random.default_rng([seed, 4])
        drawn = {"position": 3e-5 * rng.normal(size=800), "pressure": 400 * rng.normal(size=800)}
        noisy = {name: recording.columns[name] + each for name, each in drawn.items()}
        found = fitted(changed(pulled(seed), **noisy))
        off.append([(found.values[name] - true) / found.std[name] for name, true in TRUE.items()])
    assert (np.abs(np.mean(off, axis=0)) < 3 / np.sqrt(len(off))).all()
    assert np.mean(np.abs(off) < 1.96) > 0.85


def test_missing_samples_do_not_count(recording, result):
    rng = np.random.default_rng(5)
    gone = rng.random(len(recording)) < 0.3
    gone[200:320] = True
    force = np.where(gone, np.nan, recording.columns["force"])
    found = fitted(changed(recording, force=force))
    assert found.samples == int((~gone).sum())
    assert all(within(found, name, true) for name, true in TRUE.items())
    assert found.std["end_factor"] > result.std["end_factor"]
    table = found.predictions["pull"]
    np.testing.assert_array_equal(np.isnan(table["force fitted"]), gone)


def test_a_mask_is_as_good_as_missing(recording):
    bad = np.zeros(len(recording), bool)
    bad[100:260] = True
    broken = np.where(bad, 900.0, recording.columns["force"])
    masked = fitted(changed(recording, force=broken), masks={"force": bad})
    missing = fitted(changed(recording, force=np.where(bad, np.nan, broken)))
    assert masked.values == missing.values
    assert masked.samples == len(recording) - 160


@pytest.mark.parametrize("loss", ["huber", "student"])
def test_outliers_do_not_pull_a_robust_fit(recording, loss):
    rng = np.random.default_rng(8)
    wild = rng.random(len(recording)) < 0.06
    force = recording.columns["force"] + wild * rng.uniform(60, 120, len(recording))
    spoilt = changed(recording, force=force)
    robust, plain = fitted(spoilt, loss=loss), fitted(spoilt)
    for name, true in TRUE.items():
        assert within(robust, name, true), name
        assert abs(robust.values[name] - true) < 0.3 * abs(plain.values[name] - true)


def test_noise_can_be_estimated(recording):
    """Of the card's noise only the shape is used; the answer does not depend on what it says."""
    loud = fitted(recording, noise={"force": 20 * NOISE}, priors={"initial_radius": None, "end_factor": None})
    assert loud.noise["pull"]["force"].assumed == pytest.approx(20 * NOISE, rel=1e-3)
    found = fitted(recording, noise="estimated")
    assert found.noise["pull"]["force"].assumed == pytest.approx(NOISE, rel=0.1)
    assert found.cost == pytest.approx(0.5 * found.samples, rel=0.02)
    # Standard deviations come from the residuals, whatever the noise is said to be.
    assert loud.std["end_factor"] == pytest.approx(found.std["end_factor"], rel=0.05)


@pytest.mark.parametrize("loss", ["huber", "student"])
def test_robust_noise_is_right_for_normal_noise(recording, loss):
    """What the residuals are by squares; tails that count for less are allowed for."""
    given = fitted(recording, loss=loss)
    plain = fitted(recording).noise["pull"]["force"].residual
    assert given.noise["pull"]["force"].ratio == pytest.approx(plain / NOISE, rel=0.03)
    found = fitted(recording, loss=loss, noise="estimated")
    assert found.noise["pull"]["force"].assumed == pytest.approx(plain, rel=0.03)


def test_each_recording_has_its_own_noise():
    """A quiet bench and a loud one: the quiet one decides, as it should."""
    quiet, loud = pulled(1, name="quiet"), pulled(2, name="loud")
    rough = 12 * np.random.default_rng(0).normal(size=len(loud))
    loud = changed(loud, force=loud.columns["force"] + rough)
    free = {"priors": {"initial_radius": None, "end_factor": None}}
    both, alone = (fitted(r, noise="estimated", **free) for r in ([quiet, loud], quiet))
    assert both.noise["quiet"]["force"].assumed == pytest.approx(NOISE, rel=0.1)
    assert both.noise["loud"]["force"].assumed == pytest.approx(12, rel=0.1)
    assert both.std["end_factor"] < 1.05 * alone.std["end_factor"]
    assert all(within(both, name, true) for name, true in TRUE.items())


def test_readings_lie_in_the_band(recording, result):
    """95 % of them, on the data that were fitted and on another draw of the noise."""
    other = pulled(seed=9)
    table = result.predictions["pull"]
    for force in (recording.columns["force"], other.columns["force"]):
        off = np.abs(force - table["force fitted"]) / table["force std"]
        assert 0.93 < (off < 1.96).mean() < 0.985
    # Where the parameters are uncertain too, the band is wider than the sensor's noise.
    assert table["force std"].min() > NOISE and table["force std"].max() < 1.2 * NOISE


@pytest.mark.parametrize("loss", ["squares", "student"])
def test_outliers_do_not_widen_the_band(recording, loss):
    """Four readings in a hundred are wild: 95 % lie in the band still, and it is not as wide as the wild."""
    rng = np.random.default_rng(4)
    wild = rng.random(len(recording)) < 0.04
    spoilt = changed(recording, force=recording.columns["force"] + wild * rng.normal(size=len(wild)) * 80)
    found = fitted(spoilt, loss=loss)
    table = found.predictions["pull"]
    off = np.abs(table["force"] - table["force fitted"]) / table["force std"]
    assert 0.93 < (off < 1.96).mean() < 0.975
    if loss == "student":
        assert float(table["force std"].to_numpy().max()) < 2 * NOISE
        # Of the size of the residuals the sensor's noise is what counts, and the model lacks nothing.
        noise = found.noise["pull"]["force"]
        assert noise.ratio < 1.3 < noise.residual / NOISE
        assert not any("the model may lack something" in note for note in found.notes())
