"""DataFrames and datasets as recordings."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from recordings.sample_table import CARD, FRAME, WHOLE

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read


def test_a_frame_and_a_dataset_in_memory() -> None:
    for data in (FRAME, FRAME.set_index("t_s"), xr.Dataset.from_dataframe(FRAME.set_index("t_s"))):
        recording = read(data, CARD)
        assert (recording.file, recording.sha256) == (None, None)
        for name, values in WHOLE.columns.items():
            np.testing.assert_array_equal(recording.columns[name], values)
    dataset = xr.Dataset.from_dataframe(FRAME.set_index("t_s"))
    dataset["p_bar"].attrs["units"] = "kPa"
    with pytest.raises(InputError, match="xarray Dataset: .*the table gives its unit as 'kPa'"):
        read(dataset, CARD)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (FRAME, "DataFrame: expected its card as card="),
        (FRAME.set_axis(["t_s", "p", "p", "x"], axis=1), "DataFrame: several columns named 'p'"),
        (xr.Dataset({"p": (("a", "b"), np.zeros((2, 3)))}), "expected one axis, that of the samples"),
        ([1, 2], "expected the path of a table, a pandas DataFrame or an xarray Dataset; got list"),
    ],
)
def test_what_is_no_table_in_memory(data, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read(data)


def test_recording_takes_frames_and_datasets_in_si() -> None:
    """They are mappings of columns; without a clock, in SI."""
    frame = pd.DataFrame(WHOLE.columns)
    actuator = jm.actuator(CARD)
    for columns in (frame, xr.Dataset.from_dataframe(frame)):
        recording = jm.recording(actuator, columns, step=0.002)
        np.testing.assert_array_equal(recording.columns["pressure"], WHOLE.columns["pressure"])
