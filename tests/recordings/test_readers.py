"""Each kind of file, written by its own library, gives the samples that were put in."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card, read
from jaxmuscle.recordings.readers import READERS, read_table, table_name
from jaxmuscle.recordings.si_columns import si_columns
from jaxmuscle.recordings.survey import survey
from jaxmuscle.recordings.table import Table
from jaxmuscle.samples import sample

FRAME = pd.read_csv(sample("lift"))
CARD = Card.read(sample("lift").with_suffix(".toml"))
WHOLE = read(sample("lift"))


def assert_whole(recording) -> None:
    assert recording.name == "lift"
    np.testing.assert_array_equal(recording.time, WHOLE.time)
    for name, values in WHOLE.columns.items():
        np.testing.assert_array_equal(recording.columns[name], values)


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


def card(columns: dict[str, str]) -> Card:
    """The card of the sample with other columns."""
    text = CARD.to_toml()
    for old, new in zip(FRAME.columns, columns.values(), strict=True):
        text = text.replace(f'"{old}"', f'"{new}"')
    return Card.from_toml(text)


def tdms(**groups: dict) -> bytes:
    """A file with groups of waveforms: name → channel → (samples, properties)."""
    nptdms = pytest.importorskip("nptdms")
    target = io.BytesIO()
    with nptdms.TdmsWriter(target) as writer:
        for group, channels in groups.items():
            found = [
                nptdms.ChannelObject(group, name, values, properties=properties)
                for name, (values, properties) in channels.items()
            ]
            writer.write_segment([nptdms.RootObject(), nptdms.GroupObject(group), *found])
    return target.getvalue()


def test_tdms_waveforms_have_their_clock(tmp_path: Path) -> None:
    wave = {
        "wf_increment": 0.002,
        "wf_start_offset": 0.0,
        "wf_start_time": np.datetime64("2026-03-01T12:00:00"),
    }
    channels = {
        n: (FRAME[n].to_numpy(), {**wave, "unit_string": u})
        for n, u in zip(FRAME.columns[1:], ("V", "bar", "mm"), strict=True)
    }
    file = tmp_path / "lift.tdms"
    file.write_bytes(tdms(run=channels))
    table = read_table(file, file.read_bytes())
    assert list(table.columns) == ["run/valve_V", "run/p_bar", "run/x_mm", "run/time"] and table.clocks == {}
    assert table.units == {"run/valve_V": "V", "run/p_bar": "bar", "run/x_mm": "mm"}
    recording = read(file, card({"t": "run/time", "u": "run/valve_V", "p": "run/p_bar", "x": "run/x_mm"}))
    np.testing.assert_allclose(recording.time, WHOLE.time, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(recording.columns["pressure"], WHOLE.columns["pressure"])


def two_clocks(tmp_path: Path) -> Path:
    """Valve and position at 500 Hz; the pressure 0.3 s later, at 200 Hz, for a shorter time."""
    start = np.datetime64("2026-03-01T12:00:00", "ms")
    fast = {"wf_increment": 0.002, "wf_start_offset": 0.0, "wf_start_time": start}
    slow = {**fast, "wf_increment": 0.005, "wf_start_time": start + np.timedelta64(300, "ms")}
    times = 0.3 + 0.005 * np.arange(2000)
    pressure = np.interp(times, FRAME["t_s"], FRAME["p_bar"])
    channels = {name: (FRAME[name].to_numpy(), fast) for name in ("valve_V", "x_mm")}
    file = tmp_path / "lift.tdms"
    file.write_bytes(tdms(control=channels, sensor={"p": (pressure, slow)}))
    return file


COLUMNS = {"t": "control/time", "u": "control/valve_V", "p": "sensor/p", "x": "control/x_mm"}


def test_groups_are_brought_to_the_clock_of_the_card(tmp_path: Path) -> None:
    recording = read(two_clocks(tmp_path), card(COLUMNS))
    assert recording.time[[0, -1]] == pytest.approx([0.3, 0.3 + 0.005 * 1999], abs=2e-3)
    rows = np.round(recording.time / 0.002).astype(int)
    np.testing.assert_array_equal(recording.columns["position"], WHOLE.columns["position"][rows])
    # Where both clocks tick together nothing is interpolated twice.
    both = np.flatnonzero(np.isclose(recording.time / 0.01, np.round(recording.time / 0.01)))
    expected = WHOLE.columns["pressure"][rows]
    np.testing.assert_allclose(recording.columns["pressure"][both], expected[both], rtol=0, atol=1e-6)
    assert np.abs(recording.columns["pressure"] - expected).max() < 0.05 * np.ptp(expected)


def test_the_other_clock_averages_the_held_command(tmp_path: Path) -> None:
    recording = read(two_clocks(tmp_path), card({**COLUMNS, "t": "sensor/time"}))
    assert recording.step == pytest.approx(0.005)
    first = WHOLE.columns["command"]
    expected = [
        (first[150] * 2 + first[151] * 2 + first[152]) / 5,
        (first[152] + 2 * first[153] + 2 * first[154]) / 5,
    ]
    np.testing.assert_allclose(recording.columns["command"][:2], expected, rtol=1e-9)


def test_a_gap_of_a_sensor_stays_one(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    file, kept = tmp_path / "lift.h5", np.r_[0:1000, 1100:6000]
    with h5py.File(file, "w") as store:
        for name in ("valve_V", "x_mm"):
            store[f"control/{name}"] = FRAME[name]
        store["control/time"], store["sensor/time"] = FRAME["t_s"], FRAME["t_s"].to_numpy()[kept]
        store["sensor/p"] = FRAME["p_bar"].to_numpy()[kept]
    recording = read(file, card(COLUMNS))
    (tmp_path / "lift.toml").write_text(card(COLUMNS).to_toml())
    assert survey(tmp_path / "lift.toml").gaps == {"pressure": 100}
    gap = np.isnan(recording.columns["pressure"])
    np.testing.assert_array_equal(np.flatnonzero(gap), np.arange(1000, 1100))
    np.testing.assert_array_equal(recording.columns["pressure"][~gap], WHOLE.columns["pressure"][~gap])


def test_clocks_that_never_meet(tmp_path: Path) -> None:
    late = {"wf_increment": 0.002, "wf_start_time": np.datetime64("2026-03-02T12:00:00", "ms")}
    early = {**late, "wf_start_time": np.datetime64("2026-03-01T12:00:00", "ms")}
    control = {name: (FRAME[name].to_numpy(), early) for name in ("valve_V", "x_mm")}
    file = tmp_path / "lift.tdms"
    file.write_bytes(tdms(control=control, sensor={"p": (FRAME["p_bar"].to_numpy(), late)}))
    with pytest.raises(InputError, match="have no instant in common"):
        read(file, card(COLUMNS))


@pytest.mark.filterwarnings("ignore::DeprecationWarning:canmatrix", "ignore::DeprecationWarning:asammdf")
def test_mdf_groups_with_units(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    file, time = tmp_path / "lift.mf4", FRAME["t_s"].to_numpy()
    with asammdf.MDF() as store:
        for group, names in {"control": ("valve_V", "x_mm"), "sensor": ("p_bar",)}.items():
            signals = [asammdf.Signal(FRAME[n].to_numpy(), time, name=n, unit=n.split("_")[1]) for n in names]
            store.append(signals, acq_name=group)
        store.save(file)
    table = read_table(file, file.read_bytes())
    assert table.units == {"control/valve_V": "V", "control/x_mm": "mm", "sensor/p_bar": "bar"}
    recording = read(file, card({**COLUMNS, "p": "sensor/p_bar"}))
    np.testing.assert_array_equal(recording.columns["pressure"], WHOLE.columns["pressure"])


START = 1_770_000_000_000_000_000
"""When the bags begin [ns]."""


def nanoseconds(i: int) -> int:
    return START + round(float(WHOLE.time[i]) * 1_000_000_000)


def test_mcap_of_json(tmp_path: Path) -> None:
    writer = pytest.importorskip("mcap.writer")
    file = tmp_path / "lift.mcap"
    with file.open("wb") as stream:
        to = writer.Writer(stream)
        to.start()
        schema = to.register_schema(name="any", encoding="jsonschema", data=b"{}")
        topics = {"/valve": ("valve_V",), "/muscle/state": ("p_bar", "x_mm")}
        for topic, names in topics.items():
            channel = to.register_channel(topic=topic, message_encoding="json", schema_id=schema)
            for i in range(600):
                data = json.dumps({"value": {n: FRAME[n][i] for n in names}, "note": "x"}).encode()
                to.add_message(channel, log_time=nanoseconds(i), data=data, publish_time=0)
        to.finish()
    columns = {
        "t": "valve/time",
        "u": "valve/value.valve_V",
        "p": "muscle/state/value.p_bar",
        "x": "muscle/state/value.x_mm",
    }
    recording = read(file, card(columns))
    np.testing.assert_allclose(recording.time, WHOLE.time[:600], rtol=0, atol=1e-9)
    np.testing.assert_allclose(recording.columns["pressure"], WHOLE.columns["pressure"][:600], rtol=1e-9)


@pytest.mark.parametrize("ending", [".db3", ".mcap", ".bag"])
def test_bags_of_ros(tmp_path: Path, ending: str) -> None:
    """A topic with stamps in its headers, written late, and one without."""
    pytest.importorskip("mcap")
    rosbag1, rosbag2 = (pytest.importorskip(f"rosbags.rosbag{i}") for i in (1, 2))
    typesys = pytest.importorskip("rosbags.typesys")
    stores = typesys.Stores
    types = typesys.get_typestore(stores.ROS1_NOETIC if ending == ".bag" else stores.ROS2_HUMBLE)
    float64, joint = (types.types[f"{n}"] for n in ("std_msgs/msg/Float64", "sensor_msgs/msg/JointState"))
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    place = tmp_path / "lift.bag" if ending == ".bag" else tmp_path / "lift"
    if ending == ".bag":
        bag, first, encode = rosbag1.Writer(place), {"seq": 0}, types.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin.MCAP if ending == ".mcap" else rosbag2.StoragePlugin.SQLITE3
        bag, first, encode = rosbag2.Writer(place, version=9, storage_plugin=plugin), {}, types.serialize_cdr
    with bag:
        valve = bag.add_connection("/valve", float64.__msgtype__, typestore=types)
        state = bag.add_connection("/joint_states", joint.__msgtype__, typestore=types)
        for i in range(600):
            now = nanoseconds(i)
            bag.write(valve, now, encode(float64(FRAME["valve_V"][i]), float64.__msgtype__))
            head = header(**first, stamp=stamp(*divmod(now, 10**9)), frame_id="")
            values = np.array([FRAME["x_mm"][i], FRAME["p_bar"][i]])
            said = joint(head, ["mass", "muscle"], values, np.array([]), np.array([]))
            bag.write(state, now + 1_500_000, encode(said, joint.__msgtype__))
    file = place if ending == ".bag" else next(place.glob(f"*{ending}"))
    begin = "joint_states/position"
    columns = {"t": "joint_states/time", "u": "valve/data", "p": f"{begin}[muscle]", "x": f"{begin}[mass]"}
    recording = read(file, card(columns))
    np.testing.assert_allclose(recording.time, WHOLE.time[:600], rtol=0, atol=1e-6)
    np.testing.assert_allclose(recording.columns["command"], WHOLE.columns["command"][:600], rtol=1e-3)
    np.testing.assert_array_equal(recording.columns["position"], WHOLE.columns["position"][:600])


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


def own_clocks(clock: np.ndarray, other: np.ndarray, units: dict[str, str] | None = None) -> Table:
    """Valve and position by one clock, the pressure by another one."""
    columns = {"control/valve_V": FRAME["valve_V"], "control/x_mm": FRAME["x_mm"], "sensor/p": FRAME["p_bar"]}
    clocks = {name: f"{name.partition('/')[0]}/time" for name in (*columns, "control/time", "sensor/time")}
    columns = {**columns, "control/time": clock, "sensor/time": other}
    return Table(Path("lift.h5"), columns, 1, units=units or {}, clocks=clocks)


@pytest.mark.parametrize(
    ("unit", "scales", "units"),
    [
        ("ms", (1e3, 1e3), {}),
        ("s", (1, 1e3), {"sensor/time": "ms"}),
        ("ms", (1e3, 1), {"sensor/time": "s"}),
    ],
)
def test_clocks_are_in_the_unit_of_the_card_or_in_their_own(unit: str, scales, units) -> None:
    time = FRAME["t_s"].to_numpy()
    in_unit = Card.from_toml(card(COLUMNS).to_toml().replace('unit = "s" }', f'unit = "{unit}" }}', 1))
    _, columns = si_columns(own_clocks(scales[0] * time, scales[1] * (time + 0.5), units), in_unit)
    assert columns["time"][[0, -1]] == pytest.approx([0.5, WHOLE.time[-1]])
    np.testing.assert_allclose(columns["pressure"], WHOLE.columns["pressure"][:5750], rtol=1e-9)
    np.testing.assert_array_equal(columns["position"], WHOLE.columns["position"][250:])


@pytest.mark.parametrize("zone", [None, "UTC"])
def test_stamps_of_several_clocks_have_one_zero(zone: str | None) -> None:
    steps = pd.to_timedelta(np.round(FRAME["t_s"].to_numpy() * 1e3), unit="ms")
    first = np.asarray(pd.Timestamp("2026-03-01T12:00:00") + steps)
    second = (pd.Timestamp("2026-03-01T12:00:00.500", tz=zone) + steps).map(lambda stamp: stamp.isoformat())
    _, columns = si_columns(own_clocks(first, np.asarray(second)), card(COLUMNS))
    assert columns["time"][[0, -1]] == pytest.approx([0.5, WHOLE.time[-1]])
    np.testing.assert_allclose(columns["pressure"], WHOLE.columns["pressure"][:5750], rtol=1e-6)


def test_a_clock_of_stamps_and_one_of_numbers() -> None:
    stamps = np.asarray(pd.Timestamp("2026-03-01") + pd.to_timedelta(FRAME["t_s"].to_numpy(), unit="s"))
    with pytest.raises(InputError, match="'sensor/time' holds numbers and 'control/time' time stamps"):
        si_columns(own_clocks(stamps, FRAME["t_s"].to_numpy()), card(COLUMNS))


def test_a_clock_of_a_group_that_goes_back() -> None:
    time = FRAME["t_s"].to_numpy()
    back = np.where(np.arange(6000) == 3000, 1.0, time)
    with pytest.raises(InputError, match=r"\(pressure\): its clock 'sensor/time' does not increase after"):
        si_columns(own_clocks(time, back), card(COLUMNS))
