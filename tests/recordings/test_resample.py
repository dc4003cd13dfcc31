"""Irregular clocks brought to a uniform one."""

import numpy as np
import pytest

from jaxmuscle.recordings import read
from jaxmuscle.recordings.resample import resampled


def test_a_straight_line_stays_one() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0, 4.5, 5.0, 6.0])
    clock, columns = resampled(time, {"position": 2 * time + 1}, held=())
    np.testing.assert_allclose(clock, np.arange(7.0))
    np.testing.assert_allclose(columns["position"], 2 * clock + 1)


def test_a_held_command_is_averaged_over_the_new_interval() -> None:
    # 0 until 1.25, then 4 until 3, then 8: means over [0, 1), [1, 2), [2, 3), [3, 4).
    time = np.array([0.0, 1.25, 2.0, 3.0])
    clock, columns = resampled(time, {"command": np.array([0.0, 4.0, 4.0, 8.0])}, held=("command",))
    np.testing.assert_allclose(clock, [0, 1, 2, 3])
    np.testing.assert_allclose(columns["command"], [0.0, 3.0, 4.0, 8.0])


def test_a_uniform_clock_is_kept() -> None:
    time = np.linspace(0.1, 0.1 + 0.002 * 499, 500)
    values = np.random.default_rng(0).normal(size=500)
    clock, columns = resampled(time, {"command": values, "force": values}, held=("command",))
    np.testing.assert_allclose(clock, time, rtol=1e-12)
    np.testing.assert_allclose(columns["force"], values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(columns["command"], values, rtol=0, atol=1e-9)


def test_reading_with_lost_samples(lift) -> None:
    whole = read(lift.table)
    lost = [1000, 3000, 3001]
    lift.change(lambda table: table.drop(index=lost))
    recording = read(lift.table, resample=True)
    assert len(recording) == 6000
    assert recording.step == pytest.approx(0.002, rel=1e-9)
    kept = np.setdiff1d(np.arange(6000), lost)
    for name, values in whole.columns.items():
        span = np.ptp(values)
        np.testing.assert_allclose(recording.columns[name][kept], values[kept], rtol=0, atol=1e-6 * span)
    middle = whole.columns["pressure"][[999, 1001]].mean()
    assert recording.columns["pressure"][1000] == pytest.approx(middle, rel=1e-9)


def test_a_regular_recording_is_not_touched(lift) -> None:
    np.testing.assert_array_equal(
        read(lift.table, resample=True).columns["pressure"], read(lift.table).columns["pressure"]
    )
