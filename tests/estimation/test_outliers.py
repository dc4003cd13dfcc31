"""Outliers of sensors: single wrong readings are told, motion and noise are not."""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import NOISE, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.diagnosis.diagnose import diagnose
from jaxmuscle.estimation.outliers import outliers, sensor_outliers

RNG = np.random.default_rng(0)


def stepped(rows: int) -> np.ndarray:
    """Rest, a jump within a sample, a fast ramp, a fast oscillation."""
    time = np.arange(rows) / rows
    ramp = 400 * np.clip(time - 0.5, 0, 0.05)
    return np.where(time > 0.25, 30.0, 0.0) + ramp + 40 * np.sin(600 * time) * (time > 0.75)


def test_motion_and_noise_have_none() -> None:
    values = stepped(4000) + RNG.normal(size=4000)
    assert not outliers(values, 1.0).any()
    assert not outliers(stepped(4000), 1e-3).any()


def test_single_and_double_spikes_are_told() -> None:
    values, wrong = stepped(4000) + RNG.normal(size=4000), [100, 101, 900, 1500, 2950]
    values[wrong] += [25, 25, -40, 1e6, 1e3]
    np.testing.assert_array_equal(np.flatnonzero(outliers(values, 1.0)), wrong)


def test_a_jump_at_the_end_of_a_run_is_none() -> None:
    values = np.repeat([0.0, 50.0, 0.0], [50, 2, 50])
    assert not outliers(values, 1.0, (52,))[[50, 51]].any()
    assert outliers(values, 1.0)[[50, 51]].all()
    assert not outliers(values[:52], 1.0)[-2:].any()
    assert not outliers(values[:6], 1.0).any()


def test_missing_readings_are_passed_over() -> None:
    values = RNG.normal(size=200)
    values[[50, 51, 53]], values[52] = np.nan, 30.0
    np.testing.assert_array_equal(np.flatnonzero(outliers(values, 1.0)), [52])
    assert not outliers(values, 0.0).any()


def test_the_shipped_recordings_have_none() -> None:
    for name in ("lift", "swing", "bench"):
        recording = jm.read(jm.sample(name))
        assert sensor_outliers(jm.actuator(recording.card), recording, recording.card.noise) == {}


@pytest.mark.slow
def test_a_diagnosis_leaves_them_out_and_missing_readings_too() -> None:
    effects = {"thread_friction": bench.THREADS, "pressure_dependent_ends": {"amplitude": 0.8}}
    recording = driven_recording(effects, driven_card(bench.THREADS), seed=5)
    columns = {name: values.copy() for name, values in recording.columns.items()}
    rows = np.arange(5, len(recording) - 5, 150)
    columns["force"][rows] += 300 * NOISE
    columns["pressure"][rows + 40] = np.nan
    found = diagnose(dataclasses.replace(recording, columns=columns))
    assert [effect.name for effect in found.effects] == ["pressure_dependent_ends"]
    assert found.unused == {"force": len(rows), "pressure": len(rows)}
    assert found.effects[0].parameters["amplitude"].value == pytest.approx(0.8, rel=0.05)
    assert found.after["held_out"]["force"].in_noise < 1.5


@pytest.mark.parametrize(
    ("part", "rows"), [("held out", slice(1400, None)), ("to be fitted", slice(0, 1400))]
)
def test_a_sensor_without_readings_in_a_part_is_told(part: str, rows: slice) -> None:
    recording = driven_recording({}, driven_card({}), seed=5)
    columns = {name: values.copy() for name, values in recording.columns.items()}
    columns["force"][rows] = np.nan
    with pytest.raises(
        jm.InputError, match=f"no reading of 'force' that counts is left among the rows {part}"
    ):
        diagnose(dataclasses.replace(recording, columns=columns), held_out=np.arange(len(recording)) >= 1400)
