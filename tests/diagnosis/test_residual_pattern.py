"""What no smooth function of the measured variables follows: tones, jumps, drifts, ripples."""

import numpy as np
import pytest

from jaxmuscle.diagnosis.dependence import dependence, variables
from jaxmuscle.diagnosis.diagnosis_data import Pattern
from jaxmuscle.diagnosis.discrepancy import MissingRate
from jaxmuscle.diagnosis.residual_pattern import highest_line, residual_pattern, share
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample

NOISE = 0.8


@pytest.fixture(scope="module")
def prepared():
    return case(read(sample("bench")), 0.3)


def pattern_of(prepared, values, deviation=None):
    """The pattern of a missing force with white noise on it."""
    deviation = np.full(len(values), NOISE) if deviation is None else deviation
    force = {"force": values + deviation * np.random.default_rng(6).normal(size=len(values))}
    missing = MissingRate(prepared.actuator.links[0], force, {"force": deviation}, "N")
    named = variables(prepared)
    rows = np.flatnonzero(prepared.usable["force"])
    rows = rows[rows < 0.69 * len(values)]
    return residual_pattern(missing, rows, named, prepared, dependence(missing, named, prepared).share)


def clock(prepared):
    return prepared.recording.time


@pytest.mark.parametrize("frequency", [0.9371, 6.7137])
def test_a_frame_that_shakes_is_a_tone(prepared, frequency):
    swing = 5 * np.sin(2 * np.pi * frequency * clock(prepared) + 1)
    found = pattern_of(prepared, swing)
    assert (found.kind, found.variable, found.unit) == ("tone", "time", "Hz")
    assert found.at == pytest.approx(frequency, abs=0.05 / np.ptp(clock(prepared)))
    assert 0.9 < found.share < 1 and str(found) == f"swings at {found.at:.3g} Hz, whatever the machine does"


def test_a_weight_that_was_put_on_is_a_jump(prepared):
    time = clock(prepared)
    found = pattern_of(prepared, 5.0 * (time >= time[800]) - 2)
    assert (found.kind, found.unit) == ("jump", "s") and found.at == pytest.approx(time[800], abs=0.021)
    assert str(found) == f"has another level from {found.at:.4g} s on"


def test_what_grows_evenly_is_a_drift_and_no_jump(prepared):
    time = clock(prepared)
    found = pattern_of(prepared, 12 * time / time[-1])
    assert (found.kind, found.at) == ("drift", None) and str(found) == "changes slowly in time"


def test_cogging_repeats_over_the_position(prepared):
    position = prepared.filled.columns["position"]
    pitch = np.ptp(position) / 7.3
    found = pattern_of(prepared, 5 * np.sin(2 * np.pi * position / pitch))
    assert (found.kind, found.variable, found.unit) == ("ripple", "position", "m")
    assert found.at == pytest.approx(pitch, rel=5e-3)
    assert str(found).startswith("repeats every ") and str(found).endswith(" mm of the position")


def test_what_smooth_functions_of_the_variables_explain_has_no_pattern(prepared):
    position, pressure = (prepared.filled.columns[name] for name in ("position", "pressure"))
    assert pattern_of(prepared, 2e4 * (position - position.mean())) is None
    assert pattern_of(prepared, 1e-4 * (pressure - pressure.mean())) is None
    assert pattern_of(prepared, np.zeros(len(position))) is None


def test_slow_noise_has_no_tone(prepared):
    """An autoregression with a memory of half a second, six times the sensor's noise."""
    draw, keep, slow = np.random.default_rng(1), np.exp(-prepared.recording.step / 0.5), [0.0]
    while len(slow) < len(prepared.recording):
        slow.append(keep * slow[-1] + 5 * np.sqrt(1 - keep**2) * draw.normal())
    assert pattern_of(prepared, np.array(slow)) is None


def test_what_swings_with_the_motion_is_no_tone(prepared):
    """The square of a velocity lag, and a force in step with the motion but at another phase."""
    time, position = clock(prepared), prepared.filled.columns["position"]
    own = highest_line(position, np.ones(len(position)), time, prepared.recording.step)
    late = 5 * np.sin(2 * np.pi * own * time + 0.7)
    found = pattern_of(prepared, late)
    assert found is None or found.kind != "tone"


def test_samples_that_say_nothing_have_no_say(prepared):
    time = clock(prepared)
    deviation = np.where(np.arange(len(time)) % 3 == 0, 100.0, 1.0) * NOISE
    found = pattern_of(prepared, 5 * np.sin(2 * np.pi * 3.3 * time), deviation)
    assert found.kind == "tone" and found.at == pytest.approx(3.3, abs=0.01) and found.share > 0.7


def test_a_share_counts_what_a_constant_leaves():
    time, ones = np.linspace(0, 8 * np.pi, 501)[1:], np.ones(500)
    basis = np.stack([ones, np.sin(time)], axis=1)
    assert share(np.full(500, 3.0), ones, basis) == 0.0
    assert share(np.sin(time), ones, basis) == pytest.approx(1.0, abs=0.02)
    assert share(3 + np.sin(time), ones, basis) == 0.0
    assert share(1 + np.sin(time), ones, basis) == pytest.approx(1.0, abs=0.02)


def test_it_comes_back_from_a_file():
    from jaxmuscle.diagnosis.diagnosis_files import _unexplained

    ripple = Pattern("ripple", "angle", 0.1, "rad", 0.8)
    data = {"signal": "load", "share": 0.1, "depends_on": ["angle"], "rms_in_noise": 4.0}
    assert _unexplained(data).pattern is None
    assert _unexplained({**data, "pattern": vars(ripple)}).pattern == ripple
    assert str(ripple) == "repeats every 5.73° of the angle"
