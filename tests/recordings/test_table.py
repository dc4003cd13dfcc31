"""Spoilt tables: file, column and row are named, with what to do.

Irregular clocks brought to a uniform one.
"""

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.recordings.clocks import resampled


def test_missing_table(lift) -> None:
    with pytest.raises(InputError, match="no recording 'lfit.csv'.*did you mean 'lift.csv'"):
        read(lift.table.with_name("lfit.csv"))


def test_missing_table_in_an_empty_folder(tmp_path) -> None:
    with pytest.raises(InputError, match=r"no recording 'lift.csv'.*holds no \.csv, .*\.mat"):
        read(tmp_path / "lift.csv")


@pytest.mark.parametrize("name", ["lift.toml", "lift", "lift.doc"])
def test_another_kind_of_file(lift, name: str) -> None:
    with pytest.raises(InputError, match=r"expected a table with the ending \.csv, .*\.mat, .*; got"):
        read(lift.table.with_name(name))


def test_column_not_in_the_table(lift) -> None:
    lift.write('"p_bar"', '"p_bra"')
    complaint = lift.complaint()
    for word in ["lift.csv", "'p_bra'", "(pressure)", "did you mean 'p_bar'", "t_s, valve_V, p_bar, x_mm"]:
        assert word in complaint


def test_text_in_a_column(lift) -> None:
    lift.line(17, "0.03,5,fault,0.1")
    lift.line(20, "0.036,5,fault,0.1")
    complaint = lift.complaint()
    for word in ["lift.csv", "'p_bar'", "row 17", "'fault'", "2 such rows"]:
        assert word in complaint


@pytest.mark.parametrize(("field", "word"), [("", "empty"), ("NaN", "NaN"), ("inf", "inf")])
def test_no_number_in_a_column(lift, field: str, word: str) -> None:
    lift.line(17, f"0.03,5,{field},0.1")
    complaint = lift.complaint()
    for expected in ["'p_bar'", "row 17", word]:
        assert expected in complaint


def test_a_blank_line_keeps_its_row_number(lift) -> None:
    lift.line(17, "")
    assert "row 17" in lift.complaint()


def test_all_bad_columns_are_told(lift) -> None:
    lift.line(17, "0.03,5,,")
    complaint = lift.complaint()
    assert "2 problems" in complaint
    assert "'p_bar'" in complaint and "'x_mm'" in complaint


def spread(lift, header: str, separator: str, comma: str = ".") -> None:
    """The table with another header and separator, and `comma` in its numbers."""
    rows = [line.split(",") for line in lift.table.read_text().splitlines()[1:]]
    lines = [separator.join(field.replace(".", comma) for field in row) for row in rows]
    lift.table.write_text("\n".join([header, *lines]) + "\n")


def test_numbers_with_commas_between_commas(lift) -> None:
    spread(lift, "t_s,valve_V,p_bar,x_mm", ",", ",")
    complaint = lift.complaint()
    assert (
        "more fields than row 1 holds names (4)" in complaint and "write points in the numbers" in complaint
    )


def test_a_row_with_too_many_fields(lift) -> None:
    lift.line(17, "0.03,5,0.2,0.1,7")
    complaint = lift.complaint()
    assert "line 17" in complaint and "lift.csv" in complaint


def test_rows_longer_than_the_header(lift) -> None:
    lift.line(1, "valve_V,p_bar,x_mm")
    assert "row 1" in lift.complaint()


def test_two_columns_of_one_name(lift) -> None:
    lift.line(1, "t_s,valve_V,p_bar,p_bar")
    complaint = lift.complaint()
    assert "row 1" in complaint and "'p_bar'" in complaint


def test_empty_table(lift) -> None:
    lift.table.write_text("")
    assert "lift.csv: cannot be read as a comma-separated table" in lift.complaint()


def test_header_without_rows(lift) -> None:
    lift.table.write_text("t_s,valve_V,p_bar,x_mm\n")
    complaint = lift.complaint()
    assert "at least 200" in complaint and "got 0" in complaint


def test_a_table_that_is_no_text(lift) -> None:
    lift.table.write_bytes(b"\xff\xfe\x00\x01" * 100)
    assert "UTF-8" in lift.complaint()


def spoilt_mat(lift, **columns) -> str:
    table = {name: values.to_numpy() for name, values in pd.read_csv(lift.table).items()}
    file = lift.table.with_suffix(".mat")
    savemat(file, {**table, **columns})
    with pytest.raises(InputError) as caught:
        read(file)
    return str(caught.value)


def test_mat_with_a_matrix_for_a_column(lift) -> None:
    complaint = spoilt_mat(lift, p_bar=np.zeros((6000, 2)))
    for word in ["lift.mat", "'p_bar'", "vector", "(6000, 2)"]:
        assert word in complaint


def test_mat_with_columns_of_different_length(lift) -> None:
    complaint = spoilt_mat(lift, p_bar=np.zeros(5999))
    for word in ["lift.mat", "one length", "5999", "6000"]:
        assert word in complaint


def test_mat_counts_samples_from_one(lift) -> None:
    pressure = np.linspace(0, 1, 6000)
    pressure[16] = np.nan
    assert "row 17" in spoilt_mat(lift, p_bar=pressure)


def test_mat_of_another_kind(lift) -> None:
    file = lift.table.with_suffix(".mat")
    file.write_bytes(b"no matrices here" * 40)
    with pytest.raises(InputError, match="lift.mat: cannot be read as a MATLAB file"):
        read(file)


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
