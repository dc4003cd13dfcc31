"""What no smooth function of the measured variables follows: tones, jumps, drifts, ripples."""

import dataclasses

import numpy as np
import pytest

from jaxmuscle.diagnosis.dependence import dependence, variables
from jaxmuscle.diagnosis.diagnosis_data import Pattern
from jaxmuscle.diagnosis.discrepancy import MissingRate
from jaxmuscle.diagnosis.residual_pattern import Residual, highest_line, left_by, residual_pattern, share
from jaxmuscle.estimation.case import case
from jaxmuscle.recordings import read
from jaxmuscle.samples import sample


@pytest.fixture(scope="module")
def prepared():
    return case(read(sample("bench")), 0.3)


def pattern_of(prepared, values, grown=False):
    """The pattern of a residual force in units of the noise, white noise on it, in parts of a second."""
    noisy = values + np.random.default_rng(6).normal(size=len(values))
    missing = MissingRate(prepared.actuator.links[0], {"force": noisy}, {"force": np.ones(len(values))}, "N")
    named = variables(prepared)
    rows = np.flatnonzero(prepared.usable["force"])
    rows = rows[rows < 0.69 * len(values)]
    left = residual(prepared, noisy, rows, grown)
    none = {"force": np.zeros((len(values), 0))}
    return residual_pattern(left, named, prepared, dependence(missing, named, prepared, none).share)


def found_in(prepared, values, grown=False) -> Pattern:
    found = pattern_of(prepared, values, grown)
    assert found is not None
    return found


def residual(prepared, values, rows, grown=False):
    return Residual("force", values[rows], rows, rows // round(1 / prepared.recording.step), grown)


def clock(prepared):
    return prepared.recording.time


@pytest.mark.parametrize("frequency", [0.9371, 6.7137])
def test_a_frame_that_shakes_is_a_tone(prepared, frequency):
    swing = 5 * np.sin(2 * np.pi * frequency * clock(prepared) + 1)
    found = found_in(prepared, swing)
    assert (found.kind, found.variable, found.unit) == ("tone", "time", "Hz")
    assert found.at == pytest.approx(frequency, abs=0.05 / np.ptp(clock(prepared)))
    assert 0.9 < found.share < 1 and str(found) == f"swings at {found.at:.3g} Hz, whatever the machine does"


def test_a_weight_that_was_put_on_is_a_jump(prepared):
    time = clock(prepared)
    found = found_in(prepared, 5.0 * (time >= time[800]) - 2)
    assert (found.kind, found.unit) == ("jump", "s") and found.at == pytest.approx(time[800], abs=0.021)
    assert str(found) == f"has another level from {found.at:.4g} s on"


def test_what_grows_evenly_is_a_drift_and_no_jump(prepared):
    time = clock(prepared)
    found = found_in(prepared, 12 * time / time[-1])
    assert (found.kind, found.at) == ("drift", None) and str(found) == "changes slowly in time"


def test_cogging_repeats_over_the_position(prepared):
    position = prepared.filled.columns["position"]
    pitch = np.ptp(position) / 7.3
    found = found_in(prepared, 5 * np.sin(2 * np.pi * position / pitch))
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
    rows = np.arange(len(position))
    own = highest_line(residual(prepared, position, rows), time, prepared.recording.step)
    late = 5 * np.sin(2 * np.pi * own * time + 0.7)
    found = pattern_of(prepared, late)
    assert found is None or found.kind != "tone"


def test_a_tone_beside_what_builds_up_along_every_part(prepared):
    """From a measured state that is off, positions run away in every part of a window."""
    time, draw = clock(prepared), np.random.default_rng(3)
    within = time % 1.0
    starts, rates = (20 * draw.normal(size=len(time))[np.floor(time).astype(int)] for _ in range(2))
    swing = 4 * np.sin(2 * np.pi * 3.3 * time)
    found = found_in(prepared, swing + starts + rates * within, grown=True)
    assert found.kind == "tone" and found.at == pytest.approx(3.3, abs=0.01) and found.share > 0.8
    assert pattern_of(prepared, swing + starts + rates * within) is None


def test_the_column_of_which_most_is_left_is_looked_at():
    recording = read(sample("swing"))
    whole = case(recording, 0.3)
    problem = whole.problem
    shape = {out: np.asarray(each).shape for out, each in problem.weights.items()}
    residuals = {out: np.ones(each) for out, each in shape.items()}
    residuals["pressure"][..., 1] = 3.0
    pressure, angle = (left_by(whole.actuator, residuals, problem, out) for out in ("pressure", "angle"))
    assert (pressure.column, pressure.grown) == ("pressure_2", True) and (pressure.values == 3.0).all()
    assert angle.column == "angle" and len(angle.values) == (np.asarray(problem.weights["angle"]) > 0).sum()


def test_what_stands_still_or_is_short_has_no_pattern(prepared):
    column = np.full(len(prepared.recording), 5.0)
    still = dataclasses.replace(prepared.filled, columns={**prepared.filled.columns, "force": column})
    rows = np.arange(2000)
    nothing = residual(prepared, np.zeros(2000), rows)
    assert residual_pattern(nothing, {}, dataclasses.replace(prepared, filled=still), 0.0) is None
    swing = np.sin(np.arange(2000.0))
    assert residual_pattern(residual(prepared, swing, rows), {}, prepared, 0.0) is not None
    assert residual_pattern(residual(prepared, swing, rows[:90]), {}, prepared, 0.0) is None


def test_predictions_that_are_no_numbers_do_not_count(prepared):
    problem = prepared.problem
    residuals = {out: np.ones(np.asarray(each).shape) for out, each in problem.weights.items()}
    residuals["force"][0] = np.nan
    left = left_by(prepared.actuator, residuals, problem, "force")
    assert np.isfinite(left.values).all() and not left.grown
    assert len(left.values) == (np.asarray(problem.weights["force"])[1:] > 0).sum()


def test_a_share_counts_what_a_constant_leaves():
    time = np.linspace(0, 8 * np.pi, 501)[1:]
    basis = np.sin(time)[:, None]
    assert share(np.full(500, 3.0), basis) == 0.0
    assert share(np.sin(time), basis) == pytest.approx(1.0, abs=0.02)
    assert share(3 + np.sin(time), basis) == 0.0
    assert share(1 + np.sin(time), basis) == pytest.approx(1.0, abs=0.02)


def test_it_comes_back_from_a_file():
    from jaxmuscle.diagnosis.diagnosis_files import _unexplained

    ripple = Pattern("ripple", "angle", 0.1, "rad", 0.8)
    data = {"signal": "load", "share": 0.1, "depends_on": ["angle"], "rms_in_noise": 4.0}
    assert _unexplained(data).pattern is None
    assert _unexplained({**data, "pattern": vars(ripple)}).pattern == ripple
    assert str(ripple) == "repeats every 5.73° of the angle"
