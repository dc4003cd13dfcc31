"""Each kind of file, written by its own library, gives the samples that were put in."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from recordings.sample_table import CARD, FRAME, WHOLE, assert_whole

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.recordings.readers import READERS, read_table, table_name


def write_parquet(file: Path) -> None:
    pytest.importorskip("pyarrow")
    FRAME.set_index("t_s").to_parquet(file)


def write_excel(file: Path) -> None:
    pytest.importorskip("openpyxl")
    FRAME.to_excel(file, index=False)


def write_hdf5(file: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w") as store:
        for name, values in FRAME.items():
            store[name] = values
        store["remark"] = "steady"
        store["picture"] = np.zeros((4, 5))


def write_mat73(file: Path) -> None:
    """As MATLAB does: rows of one struct, behind a block of 512 bytes of its own."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w", userblock_size=512) as store:
        for name, values in FRAME.items():
            store[f"run/{name}"] = values.to_numpy()[None, :]
        store["#refs#/a"] = np.zeros(3)
    content = file.read_bytes()
    file.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:])


def write_npz(file: Path) -> None:
    columns: dict[str, Any] = {str(name): values.to_numpy() for name, values in FRAME.items()}
    np.savez(file, **columns, note=np.array("x"))


def write_npy(file: Path) -> None:
    np.save(file, FRAME.to_records(index=False))


WRITERS = {
    ".parquet": write_parquet,
    ".xlsx": write_excel,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
    ".mat": write_mat73,
    ".npz": write_npz,
    ".npy": write_npy,
}


@pytest.mark.parametrize("ending", WRITERS)
def test_columns_by_name(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"lift{ending}"
    WRITERS[ending](file)
    assert_whole(read(file, CARD))


@pytest.mark.parametrize("ending", [e for e in READERS if e not in (".csv", ".tsv", ".txt")])
def test_a_file_that_is_none(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"lift{ending}"
    for content in (b"", b"no such file " * 100, b"\x89HDF\r\n\x1a\n" + bytes(50), b"PK\x03\x04" + bytes(80)):
        file.write_bytes(content)
        with pytest.raises(InputError, match=f"lift{ending}"):
            read(file, CARD)


@pytest.mark.parametrize(
    ("ending", "module", "package"),
    [
        (".parquet", "pyarrow", "pyarrow"),
        (".xlsx", "openpyxl", "openpyxl"),
        (".h5", "h5py", "h5py"),
        (".tdms", "nptdms", "nptdms"),
        (".mf4", "asammdf", "asammdf"),
        (".mcap", "mcap.reader", "mcap"),
        (".bag", "rosbags.highlevel", "rosbags"),
    ],
)
def test_a_library_that_is_not_there(monkeypatch, ending: str, module: str, package: str) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        InputError, match=rf"lift{ending}: .*python -m pip install {package}, .*jaxmuscle\[files\]"
    ):
        read_table(Path(f"lift{ending}"), b"")


def test_parquet_with_time_stamps(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    zones = {"naive": None, "zoned": "Europe/Berlin"}
    for name, zone in zones.items():
        start = pd.Timestamp("2026-03-29T00:59:59", tz=zone)
        file = tmp_path / f"{name}.parquet"
        FRAME.assign(t_s=start + pd.to_timedelta(np.asarray(FRAME["t_s"]), unit="s")).to_parquet(file)
        np.testing.assert_allclose(read(file, CARD).time, WHOLE.time, rtol=0, atol=1e-9)


def test_excel_with_remarks_units_and_several_sheets(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for title in ("valve", "muscle"):
        sheet = book.create_sheet(title)
        sheet.append(["Bench 3", None, "fine"])
        sheet.append([])
        sheet.append(["t", "p", "x"])
        sheet.append(["s", "bar", "mm"])
        for i in range(300):
            sheet.append([0.01 * i, 1.5, i])
    file = tmp_path / "bench.xlsx"
    book.save(file)
    table = read_table(file, file.read_bytes())
    assert set(table.columns) == {f"{s}/{c}" for s in ("valve", "muscle") for c in "tpx"}
    assert table.units["valve/p"] == "bar"
    del book["valve"]
    book.save(file)
    table = read_table(file, file.read_bytes())
    assert list(table.columns) == ["t", "p", "x"] and table.row(0) == 5
    np.testing.assert_array_equal(table.numbers("x"), np.arange(300.0))


def test_hdf5_with_groups_units_and_records(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    file = tmp_path / "bench.h5"
    with h5py.File(file, "w") as store:
        store["valve/u"] = np.arange(5.0)
        store["valve/u"].attrs["unit"] = "V"
        store["log"] = np.zeros(3, dtype=[("a", float), ("b", int)])
    table = read_table(file, file.read_bytes())
    assert set(table.columns) == {"valve/u", "log/a", "log/b"}
    assert table.units == {"valve/u": "V"}


def test_npy_without_names(tmp_path: Path) -> None:
    np.save(tmp_path / "lift.npy", FRAME.to_numpy())
    with pytest.raises(InputError, match=r"expected an array of records.*\(6000, 4\).*savez"):
        read(tmp_path / "lift.npy", CARD)


def test_pickles_are_not_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "lift.npz", t_s=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="cannot be read as a file of NumPy: Object arrays"):
        read(tmp_path / "lift.npz", CARD)


def test_a_card_beside_any_table(tmp_path: Path) -> None:
    write_npz(tmp_path / "lift.npz")
    (tmp_path / "lift.toml").write_text(CARD.to_toml())
    assert_whole(read(tmp_path / "lift.npz"))
    assert table_name(Path("a/run.2.CSV.GZ")) == "run.2"
