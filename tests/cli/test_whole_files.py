"""What commands write is there as a whole or not at all: killed, on a full or a read-only disk."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import jaxmuscle as jm
from jaxmuscle.cli import BAD_INPUT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="there, processes cannot be killed by a signal")

COMMANDS = {
    "init": (("init", "swing.csv", "--rig", "joint", "--picture", "swing.png"), ("swing.toml", "swing.png")),
    "store": (
        ("sweep", *"lift.toml --over mass=7:9:2 --duration 0.02 --out lift.zarr --no-picture".split()),
        ("lift.zarr",),
    ),
    "diagnose": (("diagnose", "lift.csv", "--out", "new/folder"), ("new",)),
}
"""Command → its arguments and what it writes: files side by side, a store, a folder, as the others do."""
FEWEST = {"init": 5, "store": 2, "diagnose": 5}
"""Moments at which a command can be killed, at least: a new file, its content, its place, for each."""
THREADED = {"store"}
"""Those that write from several threads: the moments of two runs are not the same."""
CODE = """
import jaxmuscle.diagnosis
from jaxmuscle.cli import main
from report.fake import diagnosis
jaxmuscle.diagnosis.diagnose = lambda *_, **__: diagnosis("effects found")
main()
"""
"""The program; what a diagnosis finds is not in question here."""
COUNTED = [pytest.param(name, marks=[] if name == "init" else pytest.mark.slow) for name in COMMANDS]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with what the commands read."""
    place = tmp_path / "here"
    place.mkdir()
    for name in ("lift.csv", "lift.toml", "swing.csv"):
        shutil.copyfile(jm.sample("lift").parent / name, place / name)
    time = 0.002 * np.arange(50)
    pd.DataFrame({"t_s": time, "valve_V": 5 * np.sin(9 * time)}).to_csv(place / "valve.csv", index=False)
    return place


def program(
    folder: Path, moment: int | str, *arguments: str, before: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run the program in `folder`, from a shell that has done `before`; `moment`: as of `killed.py`."""
    script = f'{before}cd "$0" && exec "$@"'
    tests = Path(__file__).parents[1]
    call = [sys.executable, str(tests / "killed.py"), str(moment), CODE, *arguments]
    paths = os.pathsep.join([str(tests), *sys.path])
    return subprocess.run(
        ["sh", "-c", script, str(folder), *call],
        text=True,
        capture_output=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": paths},
    )


def visible(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if not path.name.startswith(".")}


def is_whole(path: Path) -> bool:
    """Whether a file has its end, a folder its files and a store its mark."""
    if path.is_dir():
        inner = path / "folder"
        store = path / "zarr.json"
        names = ["card.toml", "report.html", "result.json"]
        whole = inner.is_dir() and sorted(p.name for p in inner.iterdir()) == names
        return "jaxmuscle_sweep" in store.read_text() if store.exists() else whole
    content = path.read_bytes()
    if path.suffix == ".png":
        return content.endswith(b"IEND\xaeB`\x82")
    return content.endswith(b"\n")


@pytest.mark.thorough
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_any_moment(folder: Path, tmp_path: Path, name: str) -> None:
    """Every moment is seen in one run; at the middle one the program is killed indeed."""
    arguments, files = COMMANDS[name]
    before, moments = visible(folder), tmp_path / "moments"
    moments.mkdir()
    ended = program(folder, str(moments), *arguments)
    assert ended.returncode == 0, ended.stderr
    seen = len(list(moments.iterdir()))
    assert seen >= FEWEST[name]
    for moment in moments.iterdir():
        whole_or_absent(moment, visible(moment) - before, files)
    removed(folder, files)
    ended, there = program(folder, seen // 2, *arguments), visible(folder) - before
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    whole_or_absent(folder, there, files)
    if name not in THREADED:
        assert there == visible(moments / str(seen // 2)) - before
    removed(folder, there)
    assert {path.name for path in folder.iterdir()} > before, "what was being written when it was killed"
    assert program(folder, 0, *arguments).returncode == 0
    # What those that were killed have left is gone now.
    assert {path.name for path in folder.iterdir()} == before | set(files)


def whole_or_absent(folder: Path, there: set[str], files: tuple[str, ...]) -> None:
    assert all(is_whole(folder / file) for file in there), there
    # Two files beside others take their places one after the other: a moment lies between them.
    assert there in (set(), set(files), {files[0]}), folder


def removed(folder: Path, files: Iterable[str]) -> None:
    for file in files:
        shutil.rmtree(folder / file) if (folder / file).is_dir() else (folder / file).unlink()


@pytest.mark.parametrize("name", COUNTED)
def test_files_that_may_not_grow(folder: Path, name: str) -> None:
    """As on a full disk, the writing of a file is refused in its middle; what stood there stays."""
    arguments, files = COMMANDS[name]
    if name == "init":
        (folder / files[1]).write_text("older")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    limit = "ulimit -f 0 && " if name == "store" else "ulimit -f 1 && "
    ended = program(folder, 0, *arguments, before=limit)
    assert ended.returncode == BAD_INPUT, ended.stderr
    assert "cannot write" in ended.stderr and files[0].split(".")[0] in ended.stderr
    assert "File too large; the system limits the size of files" in ended.stderr
    assert "Traceback" not in ended.stderr and "Exception ignored" not in ended.stderr
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


MOUNT = 'mount -t tmpfs -o size={size} tmpfs "$0" && cp -r "$0".saved/. "$0" && {then} && '
DISKS = {
    "full": ("2m", 'dd if=/dev/zero of="$0/fill" bs=4096 2>/dev/null; true'),
    "read-only": ("2m", 'mount -o remount,ro "$0"'),
}
"""Disks of one's own: their size, and what is done to them."""
SAID = {
    "full": "No space left on device; free some space, or name a place on another disk",
    "read-only": "no permission to write into",
}


@pytest.mark.slow
@pytest.mark.parametrize("disk", DISKS)
def test_disks_that_take_nothing(folder: Path, disk: str) -> None:
    namespace = ["unshare", "--user", "--map-root-user", "--mount"]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*namespace, "true"], capture_output=True).returncode
    ):
        pytest.skip("needs a system that lets its users mount a disk of their own")
    (folder / "lift.csv").unlink()
    shutil.copytree(folder, f"{folder}.saved")
    size, then = DISKS[disk]
    script = MOUNT.format(size=size, then=then) + (
        'cd "$0" && { "$@"; echo "status $?"; echo left $(ls -A); umount -l . ; }'
    )
    call = [sys.executable, "-m", "jaxmuscle.cli", *COMMANDS["init"][0]]
    ended = subprocess.run(
        [*namespace, "sh", "-c", script, str(folder), *call],
        text=True,
        capture_output=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert SAID[disk] in ended.stderr and "Traceback" not in ended.stderr, ended.stderr
    assert "swing.toml" in ended.stderr
    assert f"status {BAD_INPUT}" in ended.stdout
    left = ended.stdout.split("left ")[1].split()
    assert set(left) - {"fill"} == {"lift.toml", "swing.csv", "valve.csv"}
