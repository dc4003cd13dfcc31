"""LeRobot datasets, written by pyarrow as LeRobot lays them out: episodes are recordings."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings.sample_table import FRAME, WHOLE, card
from typer.testing import CliRunner

from jaxmuscle.cli import app
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import read
from jaxmuscle.recordings.joining import of_one_bench
from jaxmuscle.recordings.read import table_in_file
from jaxmuscle.recordings.readers.lerobot_layout import names_of_entries

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

RATE = round(1 / WHOLE.step)
ROWS = (900, 700, 1000)
"""Rows of the episodes, one after the other in the sample."""
ENDS = np.cumsum([0, *ROWS])
CARD = card(
    {"t": "timestamp", "u": "action.valve_V", "p": "observation.state.p_bar", "x": "observation.state.x_mm"}
)
FEATURES: dict[str, Any] = {
    "observation.state": {"dtype": "float32", "shape": [2], "names": {"motors": ["p_bar", "x_mm"]}},
    "action": {"dtype": "float32", "shape": [2], "names": ["valve_V", "spare"]},
    "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["h", "w", "c"]},
    "observation.images.side": {"dtype": "image", "shape": [8, 8, 3], "names": ["h", "w", "c"]},
    **{name: {"dtype": "int64", "shape": [1], "names": None} for name in ("frame_index", "episode_index")},
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
}
VERSIONS = {
    "v2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
}


def lists(*columns: Any) -> Any:
    """Columns as fixed-size lists of single precision, a list in each row."""
    flat = pa.array(np.column_stack(columns).astype(np.float32).ravel())
    return pa.FixedSizeListArray.from_arrays(flat, len(columns))


def frames(episode: int) -> Any:
    """The data of an episode."""
    part = FRAME.iloc[ENDS[episode] : ENDS[episode + 1]]
    number = np.arange(len(part))
    pictures = [{"bytes": b"no picture", "path": None}] * len(part)
    return pa.table(
        {
            "observation.state": lists(part["p_bar"], part["x_mm"]),
            "action": lists(part["valve_V"], 0 * part["valve_V"]),
            "observation.images.side": pa.array(pictures),
            "timestamp": pa.array((number / RATE).astype(np.float32)),
            "frame_index": number,
            "episode_index": np.full(len(part), episode),
        }
    )


def write_table(file: Path, table: Any) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, file)
    return file


def dataset(root: Path, version: str, episodes: int = len(ROWS), **info: Any) -> Path:
    """A dataset of the first of the episodes."""
    said = {"codebase_version": version, "fps": RATE, "chunks_size": 2, "data_path": VERSIONS[version]}
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps({**said, "features": FEATURES, **info}))
    if version == "v2.1":
        lines = [{"episode_index": i, "tasks": ["lift"], "length": ROWS[i]} for i in range(episodes)]
        (root / "meta" / "episodes.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
        for i in range(episodes):
            write_table(root / f"data/chunk-{i // 2:03d}/episode_{i:06d}.parquet", frames(i))
        return root
    files = [i // 2 for i in range(episodes)]
    about = {
        "episode_index": list(range(episodes)),
        "tasks": [["lift"]] * episodes,
        "length": list(ROWS[:episodes]),
        "data/chunk_index": [0] * episodes,
        "data/file_index": files,
        "stats/action/mean": [[0.0, 0.0]] * episodes,
    }
    write_table(root / "meta/episodes/chunk-000/file-000.parquet", pa.table(about))
    for file in {*files}:
        whole = pa.concat_tables([frames(i) for i in range(episodes) if files[i] == file])
        write_table(root / f"data/chunk-000/file-{file:03d}.parquet", whole)
    return root


def assert_episode(recording: Any, episode: int) -> None:
    np.testing.assert_allclose(recording.time, np.arange(ROWS[episode]) / RATE, rtol=1e-15, atol=0)
    part = slice(ENDS[episode], ENDS[episode + 1])
    for name, values in WHOLE.columns.items():
        np.testing.assert_allclose(recording.columns[name], values[part], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("version", VERSIONS)
def test_each_episode_is_a_recording(tmp_path: Path, version: str) -> None:
    root = dataset(tmp_path / "lifts", version)
    for episode in range(len(ROWS)):
        recording = read(root / f"episode_{episode:06d}", CARD)
        assert recording.name == f"episode_{episode:06d}"
        assert_episode(recording, episode)
    assert_episode(read(root / "episode_1", CARD), 1)
    (root / "episode_000002.toml").write_text(CARD.to_toml())
    assert_episode(read(root / "episode_000002"), 2)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_data_file_or_a_dataset_of_one_episode(tmp_path: Path, version: str) -> None:
    root = dataset(tmp_path / "lifts", version)
    last = "data/chunk-001/episode_000002.parquet" if version == "v2.1" else "data/chunk-000/file-001.parquet"
    assert_episode(read(root / last, CARD), 2)
    assert_episode(read(dataset(tmp_path / "lift", version, 1), CARD), 0)


def test_several_episodes_are_joined_with_breaks(tmp_path: Path) -> None:
    root = dataset(tmp_path / "lifts", "v3.0")
    recordings = [read(root / f"episode_{i:06d}", CARD) for i in range(len(ROWS))]
    both = of_one_bench(recordings)
    assert both.breaks == tuple(ENDS[1:-1])
    np.testing.assert_array_equal(
        both.columns["position"][ENDS[1] :][: ROWS[1]], recordings[1].columns["position"]
    )


def test_columns_and_units(tmp_path: Path) -> None:
    table, _ = table_in_file(dataset(tmp_path / "lifts", "v3.0") / "episode_000000")
    named = {"observation.state.p_bar", "observation.state.x_mm", "action.valve_V", "action.spare"}
    assert {*table.columns} == named | {"timestamp", "frame_index", "episode_index"}
    assert table.units == {"timestamp": "s"}


def test_a_clock_in_single_precision(tmp_path: Path) -> None:
    """After half an hour at 1 kHz its steps are off by a tenth; a clock that is not the frame's is kept."""
    root = dataset(tmp_path / "lifts", "v2.1", 1, fps=1000)
    number = np.arange(ROWS[0])
    for clock, expected in (
        ((number + 1_800_000) / 1000, (number + 1_800_000) / 1000),
        ((number + 1_800_000) / 999, ((number + 1_800_000) / 999).astype(np.float32)),
    ):
        table = frames(0).set_column(3, "timestamp", pa.array(clock.astype(np.float32)))
        table = table.set_column(4, "frame_index", pa.array(number + 1_800_000))
        write_table(root / "data/chunk-000/episode_000000.parquet", table)
        found, _ = table_in_file(root)
        np.testing.assert_allclose(found.numbers("timestamp"), expected, rtol=1e-15, atol=0)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a", "b"], ["a", "b"]),
        ({"motors": ["a", "b"]}, ["a", "b"]),
        ({"arm": ["a"], "hand": ["b"]}, ["a", "b"]),
        ({"b": 1, "a": 0}, ["a", "b"]),
        (["a", "a"], []),
        (["a", 1], []),
        ({"motors": 2.5}, []),
        ({}, []),
        (None, []),
    ],
)
def test_names_of_entries(names: Any, expected: list[str]) -> None:
    assert list(names_of_entries({"names": names})) == expected


def test_entries_without_names_are_numbered(tmp_path: Path) -> None:
    """Also where one name stands for all of them."""
    bare: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [2]} for name in ("observation.state", "action")
    }
    bare["action"]["names"] = ["actions"]
    features = {**FEATURES, **bare}
    table, _ = table_in_file(dataset(tmp_path / "lift", "v2.1", 1, features=features))
    assert {f"{name}.{i}" for name in ("action", "observation.state") for i in (0, 1)} < {*table.columns}


def test_from_a_draft_to_a_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = dataset(tmp_path / "lifts", "v3.0")
    monkeypatch.chdir(root)
    drafted = CliRunner().invoke(app, ["init", "episode_000001", "--rig", "isotonic"])
    assert drafted.exit_code == 0, drafted.output
    for column in CARD.columns.values():
        assert f'"{column.column}"' in (root / "episode_000001.toml").read_text()
    (root / "episode_000001.toml").write_text(CARD.to_toml())
    checked = CliRunner().invoke(app, ["check", "episode_000001.toml"])
    assert checked.exit_code == 0, checked.output
    assert f"{ROWS[1]} samples" in checked.output and "(not used)" in checked.output


Spoil = Callable[[Path], object]


def spoilt_info(**entries: Any) -> Spoil:
    def spoil(root: Path) -> None:
        file = root / "meta" / "info.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), **entries}))

    return spoil


def spoilt_data(alter: Callable[[Any], Any]) -> Spoil:
    return lambda root: write_table(root / "data/chunk-000/episode_000000.parquet", alter(frames(0)))


LONGER = {**FEATURES, "action": {"dtype": "float32", "shape": [3], "names": None}}
FAULTS: dict[str, tuple[Spoil, str]] = {
    "no info.json": (
        lambda root: (root / "meta/info.json").unlink(),
        r"expected a table.*there is no meta/info",
    ),
    "no JSON": (lambda root: (root / "meta/info.json").write_text("{"), "info.json: cannot be read as JSON"),
    "no features": (spoilt_info(features=None), "expected what LeRobot writes, with an entry 'features'"),
    "another version": (spoilt_info(codebase_version="v1.6"), r"version 2\.x or 3\.x; got 'v1.6'"),
    "no version": (spoilt_info(codebase_version=None), r"version 2\.x or 3\.x; got 'None'"),
    "no size of chunks": (spoilt_info(chunks_size=0), "episodes in a chunk as chunks_size"),
    "another path": (
        spoilt_info(data_path="data/{name}.parquet"),
        "expected data_path, .*{episode_index} and",
    ),
    "a path out of it": (spoilt_info(data_path="../{episode_index}.parquet"), "expected data_path"),
    "no episodes": (lambda root: (root / "meta/episodes.jsonl").unlink(), "episodes.jsonl: cannot be read"),
    "spoilt episodes": (
        lambda root: (root / "meta/episodes.jsonl").write_text('{"length": 3}\n'),
        "episodes.jsonl: cannot be read as lines of JSON",
    ),
    "another version's episodes": (spoilt_info(codebase_version="v3.0"), "holds no table of the episodes"),
    "no data": (
        lambda root: (root / "data/chunk-000/episode_000000.parquet").unlink(),
        "no recording 'episode_000000.parquet'",
    ),
    "not fetched": (
        lambda root: (root / "data/chunk-000/episode_000000.parquet").write_bytes(
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
        ),
        "pointer of Git LFS.*git lfs pull",
    ),
    "fewer rows": (spoilt_data(lambda t: t.slice(0, 850)), "expected 900 rows of episode 0, .* has 850"),
    "no such column": (spoilt_data(lambda t: t.drop_columns(["episode_index"])), "episode_index"),
    "longer lists": (spoilt_info(features=LONGER), "'action': expected lists of 3 entries.*has lists of 2"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_dataset_that_is_spoilt(tmp_path: Path, fault: str) -> None:
    root = dataset(tmp_path / "lift", "v2.1", 1)
    spoil, message = FAULTS[fault]
    spoil(root)
    for path in (root, root / "episode_000000"):
        with pytest.raises(InputError, match=message):
            read(path, CARD)


@pytest.mark.parametrize("version", VERSIONS)
def test_an_episode_that_is_not_there(tmp_path: Path, version: str) -> None:
    root = dataset(tmp_path / "lifts", version)
    with pytest.raises(InputError, match="no episode 7; it has 0 to 2. Write .*episode_000000"):
        read(root / "episode_000007", CARD)
    with pytest.raises(InputError, match="lifts: expected one episode of the dataset; it has 0 to 2"):
        read(root, CARD)


def test_a_folder_that_is_not_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(dataset(tmp_path / "lift", "v2.1", 1))
    with pytest.raises(
        InputError, match="expected one episode of the dataset; it has 0. Write episode_000000"
    ):
        read(".")
    drafted = CliRunner().invoke(app, ["init", "."])
    assert drafted.exit_code == 2 and "expected one episode of the dataset" in drafted.stderr
    assert_episode(read("episode_000000", CARD), 0)


def test_a_data_file_of_several_episodes_or_of_none(tmp_path: Path) -> None:
    root = dataset(tmp_path / "lifts", "v3.0")
    with pytest.raises(
        InputError, match="file-000.parquet: expected a file of one episode; this holds 2; it has"
    ):
        read(root / "data/chunk-000/file-000.parquet", CARD)
    other = write_table(root / "data/chunk-000/file-002.parquet", frames(0).drop_columns(["episode_index"]))
    with pytest.raises(InputError, match="expected a data file of LeRobot, with a column 'episode_index'"):
        read(other, CARD)
    foreign = frames(0).set_column(5, "episode_index", pa.array(np.full(ROWS[0], 9)))
    with pytest.raises(InputError, match="the dataset has no episode 9"):
        read(write_table(other, foreign), CARD)


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("observation.images.top", "kind 'video', which is no column"),
        ("observation.images.side", "kind 'image', which is no column"),
        ("observation.state", r"list in every row, whose entries are .*observation\.state\.p_bar, "),
        ("observation.state.p", "is not in the table; did you mean 'observation.state.p_bar'"),
    ],
)
def test_a_column_that_is_none(tmp_path: Path, column: str, message: str) -> None:
    root = dataset(tmp_path / "lift", "v2.1", 1)
    with pytest.raises(InputError, match=message):
        read(
            root, card({"t": "timestamp", "u": "action.valve_V", "p": column, "x": "observation.state.x_mm"})
        )


@pytest.mark.parametrize("version", VERSIONS)
def test_without_pyarrow(tmp_path: Path, version: str, monkeypatch: pytest.MonkeyPatch) -> None:
    root = dataset(tmp_path / "lift", version, 1)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"lift: .*python -m pip install pyarrow, .*jaxmuscle\[files\]"):
        read(root, CARD)


def test_lists_in_a_plain_file_and_in_a_frame(tmp_path: Path) -> None:
    """Of one length they are columns by number; others are set aside, and told when they are asked for."""
    rows = len(FRAME)
    pairs = list(FRAME[["p_bar", "x_mm"]].to_numpy())
    pairs[7] = None
    frame = FRAME[["t_s", "valve_V"]].assign(
        y=pairs,
        ragged=[[1.0] * (1 + i % 3) for i in range(rows)],
        texts=[["a", "b"]] * rows,
        long=[np.zeros(65)] * rows,
        nested=[[[1.0, 2.0], [3.0, 4.0]]] * rows,
        record=[{"a": 1}] * rows,
    )
    frame.to_parquet(tmp_path / "lift.parquet")
    by_number = card({"t": "t_s", "u": "valve_V", "p": "y.0", "x": "y.1"})
    told = {
        "ragged": "lists of 1 to 3 entries; expected as many in every row",
        "texts": "lists of something else than numbers",
        "long": "lists of 65 entries; expected 1 to 64",
        "nested": "lists of something else than numbers",
        "record": "records, which are no columns",
    }
    for data in (tmp_path / "lift.parquet", frame):
        with pytest.raises(
            InputError, match=r"column 'y\.0' \(pressure\): row . *: expected a number; got an empty"
        ):
            read(data, by_number)
        for column, message in told.items():
            with pytest.raises(InputError, match=f"column '{column}' \\(position\\): holds {message}"):
                read(data, card({"t": "t_s", "u": "valve_V", "p": "y.0", "x": column}))
    frame["y"] = frame["y"].bfill()
    recording = read(frame, by_number)
    np.testing.assert_array_equal(
        np.delete(recording.columns["position"], 7), np.delete(WHOLE.columns["position"], 7)
    )
    with pytest.raises(InputError, match=r"several columns named 'y\.0'"):
        read(frame.rename(columns={"valve_V": "y.0"}), by_number)
