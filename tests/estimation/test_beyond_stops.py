"""Readings beyond where the model ends: no window runs on there, and what is right elsewhere is found."""

import dataclasses

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.missing_data import BEYOND, beyond_stops, usable


@pytest.fixture(scope="module")
def recording():
    return jm.read(jm.sample("swing")).part(0, 3000)


def pushed(recording, rows, angle):
    columns = {name: values.copy() for name, values in recording.columns.items()}
    columns["angle"][rows] = angle
    return dataclasses.replace(recording, columns=columns)


def test_rows_beyond_a_stop(recording):
    machine = jm.actuator(recording.card)
    low, high = (float(np.asarray(end)) for end in machine.stops["angle"])
    noise = recording.card.noise["angle"]
    assert low == -high and beyond_stops(machine, recording) == {}
    inside = pushed(recording, slice(100, 110), high + 0.9 * BEYOND * noise)
    assert beyond_stops(machine, inside) == {}
    for end in (high + 0.1, low - 0.1):
        (found,) = beyond_stops(machine, pushed(recording, slice(100, 110), end)).values()
        np.testing.assert_array_equal(np.flatnonzero(found), np.arange(100, 110))


def test_no_window_holds_them(recording):
    away = np.arange(700, 740)
    gone = pushed(recording, away, 1.9)
    assert usable(jm.actuator(gone.card), gone, None).cut[away].all()
    prepared = case(gone, 0.3)
    windows = prepared.windows
    inside = np.concatenate(
        [row + np.flatnonzero(m) for row, m in zip(windows.rows, windows.mask, strict=True)]
    )
    np.testing.assert_array_equal(np.sort(inside), np.setdiff1d(np.arange(3000), away))
    assert 740 in windows.rows
    assert not prepared.usable["angle"][away].any() and prepared.usable["pressure_1"].all()


def test_rigs_without_stops_have_no_such_rows():
    recording = jm.read(jm.sample("lift"))
    machine = jm.actuator(recording.card)
    assert machine.stops == {} and beyond_stops(machine, recording) == {}
