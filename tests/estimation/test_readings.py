"""Readings that are missing, masked, wild, or noisier than was said; the band in which they lie."""

import numpy as np
import pytest
from estimation.made import TRUE, changed, fitted, pulled, within
from oracles.recorded import NOISE


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
