"""Groups of signals with clocks of their own are brought to one, and gaps stay gaps."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recordings.sample_table import FRAME, WHOLE, card

from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card, read
from jaxmuscle.recordings.readers import read_table
from jaxmuscle.recordings.si_columns import si_columns
from jaxmuscle.recordings.survey import survey
from jaxmuscle.recordings.table import Table


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
    assert table.units == {"run/valve_V": "V", "run/p_bar": "bar", "run/x_mm": "mm", "run/time": "s"}
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
    measured = {"control/valve_V": "V", "control/x_mm": "mm", "sensor/p_bar": "bar"}
    assert table.units == {**measured, "control/time": "s", "sensor/time": "s"}
    recording = read(file, card({**COLUMNS, "p": "sensor/p_bar"}))
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
