"""Logs of robots: MCAP and ROS bags, by topic and field."""

import json
from pathlib import Path

import numpy as np
import pytest
from recordings.sample_table import FRAME, WHOLE, card

from jaxmuscle import InputError
from jaxmuscle.actuators import RIGS
from jaxmuscle.recordings import read
from jaxmuscle.recordings.column_guess import guess_columns
from jaxmuscle.recordings.read import table_in_file

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
    if ending != ".bag":  # ros2 bag record names the folder, and so do its users.
        of_folder = read(place, card(columns))
        assert (of_folder.name, of_folder.sha256) == ("lift", recording.sha256)
        np.testing.assert_array_equal(of_folder.columns["position"], recording.columns["position"])
    table, _ = table_in_file(file)
    guesses = guess_columns(table, RIGS["isotonic"])
    clock = guesses["time"].column or ""
    assert guesses["time"].unit == "s" and clock.endswith("/time")
    taken = {guess.column for name, guess in guesses.items() if name != "time"}
    assert not [column for column in taken if column and column.endswith(("/time", "/logged"))]


@pytest.mark.parametrize(
    ("files", "told"),
    [((), "expected a file .db3 or .mcap"), (("a_0.db3", "a_1.db3"), "in 2 files, a_0.db3 to a_1.db3")],
)
def test_the_folder_of_a_bag_of_which_no_file_can_be_taken(tmp_path: Path, files: tuple, told: str) -> None:
    for name in ("metadata.yaml", *files):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError, match=told):
        read(tmp_path, card({"t": "t", "u": "u", "p": "p", "x": "x"}))
