"""Recordings that are read: values in SI, the kinds of files, what is kept of them."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card, Recording, actuator_from_card, read
from jaxmuscle.samples import NAMES, sample


@pytest.mark.parametrize(
    ("name", "rows", "step"), [("lift", 6000, 0.002), ("bench", 4000, 0.01), ("swing", 6000, 0.002)]
)
def test_samples_are_read(name: str, rows: int, step: float) -> None:
    recording = read(sample(name))
    assert len(recording) == rows
    assert recording.name == name
    assert recording.file == sample(name)
    assert recording.sha256 == hashlib.sha256(sample(name).read_bytes()).hexdigest()
    assert recording.step == pytest.approx(step, rel=1e-9)
    assert set(recording.columns) == set(recording.card.columns) - {"time"}
    assert all(values.dtype == np.float64 for values in recording.columns.values())


def test_first_rows_in_si() -> None:
    # The first rows of the tables, by hand: gauge bar and kPa, mm, deg.
    lift, bench, swing = (read(sample(name)).columns for name in NAMES)
    np.testing.assert_allclose(lift["pressure"][:3], [121595, 121874, 125225], rtol=1e-14)
    np.testing.assert_allclose(lift["position"][:3], [-15.0e-6, -35.9e-6, 30.5e-6], rtol=1e-13)
    np.testing.assert_allclose(lift["command"][:3], 5.0)
    np.testing.assert_allclose(bench["pressure"][0], 227110 + 101325, rtol=1e-14)
    np.testing.assert_allclose(bench["force"][0], 546.159)
    np.testing.assert_allclose(swing["command_1"][0], 279795 + 101325, rtol=1e-14)
    np.testing.assert_allclose(swing["angle"][1], 0.02 * np.pi / 180, rtol=1e-14)


def test_absolute_pressures_are_left_as_they_are(lift) -> None:
    lift.write('"p_bar", unit = "bar", reference = "gauge"', '"p_bar", unit = "bar", reference = "absolute"')
    lift.change(lambda table: table.assign(p_bar=table.p_bar + 1.01325))
    np.testing.assert_allclose(
        read(lift.table).columns["pressure"], read(sample("lift")).columns["pressure"], rtol=1e-12
    )


def test_time_in_milliseconds(lift) -> None:
    lift.write('"t_s", unit = "s"', '"t_s", unit = "ms"')
    lift.change(lambda table: table.assign(t_s=1000 * table.t_s + 5e6))
    recording = read(lift.table)
    assert recording.time[0] == 5000.0
    assert recording.step == pytest.approx(0.002, rel=1e-9)


def vectors(table: pd.DataFrame) -> dict[str, np.ndarray]:
    return {name: table[name].to_numpy() for name in table}


@pytest.mark.parametrize("layout", ["variables", "columns", "struct"])
def test_mat_equals_csv(lift, layout: str) -> None:
    columns = vectors(pd.read_csv(lift.table))
    content: dict = {**columns, "sampling_rate": 500.0, "note": "lift", "matrix": np.eye(3)}
    if layout == "columns":
        content = {name: values[:, None] for name, values in columns.items()}
    if layout == "struct":
        content = {"recording": columns}
    file = lift.table.with_suffix(".mat")
    savemat(file, content)
    from_mat, from_csv = read(file), read(lift.table)
    np.testing.assert_array_equal(from_mat.time, from_csv.time)
    for name, values in from_csv.columns.items():
        np.testing.assert_array_equal(from_mat.columns[name], values)


def test_byte_order_mark_blanks_and_empty_last_lines_do_no_harm(lift) -> None:
    text = lift.table.read_text().replace("t_s,valve_V", "t_s, valve_V ") + "\n\n,,,\n"
    lift.table.write_text(text, encoding="utf-8-sig")
    np.testing.assert_array_equal(
        read(lift.table).columns["pressure"], read(sample("lift")).columns["pressure"]
    )


def test_columns_that_the_card_does_not_name_may_hold_anything(lift) -> None:
    lift.change(lambda table: table.assign(note="ok", empty=np.nan))
    assert set(read(lift.table).columns) == {"command", "pressure", "position"}


def test_part_counts_like_a_slice() -> None:
    recording = read(sample("lift"))
    part = recording.part(100, 350)
    assert len(part) == 250
    assert part.step == recording.step
    np.testing.assert_array_equal(part.time, recording.time[100:350])
    np.testing.assert_array_equal(part.columns["position"], recording.columns["position"][100:350])
    assert len(recording.part(-50, None)) == 50


def test_columns_of_another_length_are_refused() -> None:
    card = Card.read(sample("bench").with_suffix(".toml"))
    with pytest.raises(ValueError, match="force: expected the shape of time"):
        Recording("made", None, None, card, np.arange(3.0), 1.0, {"force": np.zeros(4)})


def test_unknown_sample() -> None:
    with pytest.raises(InputError, match="did you mean 'swing'"):
        sample("swinging")


def test_practice_recordings_are_read(shared: Path) -> None:
    files = sorted((shared / "recordings" / "practice").glob("*.csv"))
    assert files
    for file in files:
        recording = read(file)
        assert len(recording) >= 10000
        assert actuator_from_card(recording.card).rig == recording.card.rig
