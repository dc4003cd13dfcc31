"""Files are written whole or not at all, as readable as any other."""

import errno
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from jaxmuscle import InputError, files
from jaxmuscle.files import abandon, atomic_folder, atomic_write, check_place, new_folder


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture(params=[0o022, 0o027, 0o077, 0o002])
def umask(request):
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_a_new_file_gets_the_mode_of_a_plain_open(tmp_path, umask):
    (tmp_path / "plain").write_text("")
    with atomic_write(tmp_path / "whole") as (file,):
        file.write_text("")
    assert mode(tmp_path / "whole") == mode(tmp_path / "plain") == 0o666 & ~umask


def test_a_file_that_is_replaced_keeps_its_mode(tmp_path):
    (tmp_path / "shared.json").write_text("old")
    (tmp_path / "shared.json").chmod(0o664)
    with atomic_write(tmp_path / "shared.json") as (file,):
        file.write_text("new")
    assert mode(tmp_path / "shared.json") == 0o664 and (tmp_path / "shared.json").read_text() == "new"


def test_a_link_is_followed(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    with atomic_write(tmp_path / "link") as (file,):
        file.write_text("new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_text() == "new"


@pytest.mark.parametrize(
    ("fault", "told"),
    [(OSError(28, "No space left on device"), InputError), (RuntimeError("x"), RuntimeError)],
)
def test_what_fails_leaves_all_as_it_was(tmp_path, fault, told):
    (tmp_path / "one.txt").write_text("old")
    with pytest.raises(told), atomic_write(tmp_path / "one.txt", tmp_path / "two.txt") as (one, _):
        one.write_text("half")
        raise fault
    assert [p.name for p in tmp_path.iterdir()] == ["one.txt"]
    assert (tmp_path / "one.txt").read_text() == "old"


def test_a_reader_never_sees_half_a_file(tmp_path):
    (tmp_path / "one.txt").write_text("old")
    with atomic_write(tmp_path / "one.txt") as (file,):
        file.write_text("half")
        assert (tmp_path / "one.txt").read_text() == "old" and file.suffix == ".txt"
    assert [p.name for p in tmp_path.iterdir()] == ["one.txt"]


def test_where_nothing_can_be_written(tmp_path):
    with (
        pytest.raises(InputError, match="cannot write .*absent.*No such file"),
        atomic_write(tmp_path / "absent" / "file"),
    ):
        pass
    (tmp_path / "folder").mkdir()
    with (
        pytest.raises(InputError, match="folder': it is a folder"),
        atomic_write(tmp_path / "other", tmp_path / "folder"),
    ):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (errno.ENOSPC, "No space left on device; free some space, or name a place on another disk"),
        (errno.EROFS, "Read-only file system; name a place that can be written"),
        (errno.EACCES, "Permission denied; name a place that can be written"),
    ],
)
def test_what_to_do_is_told(tmp_path, monkeypatch, fault, told):
    def refuse(descriptor):
        raise OSError(fault, os.strerror(fault))

    (tmp_path / "one.txt").write_text("old")
    monkeypatch.setattr(os, "fsync", refuse)
    with (
        pytest.raises(InputError, match=f"cannot write '.*one.txt': {told}"),
        atomic_write(tmp_path / "one.txt") as (file,),
    ):
        file.write_text("new")
    with (
        pytest.raises(InputError, match=f"cannot write '.*absent': {told}"),
        atomic_folder(tmp_path / "absent", ["a"]) as (file,),
    ):
        file.write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["one.txt"]
    assert (tmp_path / "one.txt").read_text() == "old"


def test_a_folder_comes_into_being_with_its_files(tmp_path):
    with atomic_folder(tmp_path / "new" / "inner", ["a.txt", "b.txt"]) as (one, two):
        one.write_text("a")
        two.write_text("b")
        assert [p.name for p in tmp_path.iterdir() if p.name[0] != "."] == []
    assert sorted(p.name for p in (tmp_path / "new" / "inner").iterdir()) == ["a.txt", "b.txt"]
    assert [p.name for p in tmp_path.iterdir()] == ["new"]
    with atomic_folder(tmp_path / "new" / "inner", ["b.txt"]) as (two,):
        two.write_text("c")
    assert (tmp_path / "new" / "inner" / "b.txt").read_text() == "c"
    assert (tmp_path / "new" / "inner" / "a.txt").read_text() == "a"


def test_a_block_within_a_block_writes_where_the_outer_one_says(tmp_path):
    with atomic_write(tmp_path / "one.txt") as (outer,):
        with atomic_write(outer) as (inner,):
            inner.write_text("whole")
        assert not (tmp_path / "one.txt").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["one.txt"]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("absent/file", "there is no folder '.*absent'; make it"),
        ("folder", "expected a file; it is a folder"),
    ],
)
def test_places_are_looked_at_before_the_work(tmp_path, name, told):
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=f"--out .*{told}"):
        check_place(tmp_path / name, "--out")
    check_place(tmp_path / "folder" / "new", "--out")


def test_a_folder_below_a_file_is_refused_and_forgotten(tmp_path):
    (tmp_path / "page.html").write_text("")
    told = pytest.raises(InputError, match="cannot write .*frames.*: Not a directory")
    with told, new_folder(tmp_path / "page.html" / "frames"):
        pytest.fail("there is no such folder")
    assert not files._unfinished and [file.name for file in tmp_path.iterdir()] == ["page.html"]


@pytest.mark.parametrize("opens", ["before", "after"])
def test_at_the_end_of_a_process_nothing_unfinished_stays(tmp_path, monkeypatch, opens):
    """As after Ctrl-C, when another thread is writing, or has not opened its file yet."""
    monkeypatch.setattr(files, "_renaming", threading.RLock())
    begun, go_on, gone = threading.Event(), threading.Event(), []

    def write():
        places = tmp_path / "one.txt", tmp_path / "new"
        with (
            pytest.raises(InputError),
            atomic_write(places[0]) as (one,),
            atomic_folder(places[1], "a") as (two,),
        ):
            if opens == "before":
                one.write_text("half")
                two.write_text("half")
            begun.set()
            go_on.wait(60)
            for file in (one, two) if opens == "after" else ():
                with pytest.raises(FileNotFoundError):
                    file.write_text("late")
                gone.append(file.name)

    thread = threading.Thread(target=write)
    thread.start()
    assert begun.wait(60)
    assert len(list(tmp_path.iterdir())) == 2
    abandon()
    assert list(tmp_path.iterdir()) == []
    go_on.set()
    files._renaming.release()  # The process would be over; here its thread is waited for.
    thread.join()
    assert list(tmp_path.iterdir()) == [] and gone == (["one.txt", "a"] if opens == "after" else [])


def test_a_folder_that_another_thread_is_removing_does_not_stay(tmp_path, monkeypatch):
    """The process ended between the removal's two steps, and an empty folder stayed."""
    monkeypatch.setattr(files, "_renaming", threading.RLock())
    removing, remove = threading.Event(), shutil.rmtree

    def slowly(*args, **kwargs):
        removing.set()
        time.sleep(0.2)
        remove(*args, **kwargs)

    monkeypatch.setattr(files.shutil, "rmtree", slowly)

    def write():
        with atomic_write(tmp_path / "one.txt") as (one,):
            one.write_text("whole")

    thread = threading.Thread(target=write)
    thread.start()
    assert removing.wait(60)
    abandon()
    assert [p.name for p in tmp_path.iterdir()] == ["one.txt"]
    files._renaming.release()
    thread.join()


PAIR = """
from pathlib import Path
from jaxmuscle.files import {kind}
with {call} as files:
    for file in files:
        file.write_text("new" * 100_000)
"""
HERE = "*(Path.cwd() / name for name in ('a.txt', 'b.txt'))"
KINDS = {
    "new folder": ("atomic_folder", "atomic_folder(Path.cwd() / 'new', ['a.txt', 'b.txt'])", "new"),
    "one file": ("atomic_write", "atomic_write(Path.cwd() / 'a.txt')", "."),
    "files that are there": ("atomic_write", f"atomic_write({HERE})", "."),
}


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="there, processes cannot be killed by a signal")
@pytest.mark.parametrize("kind", KINDS)
def test_killed_at_any_moment(tmp_path, kind):
    function, call, place = KINDS[kind]
    names = ["a.txt"] if kind == "one file" else ["a.txt", "b.txt"]
    old = [tmp_path / name for name in names if kind != "new folder"]
    for file in old:
        file.write_text("old")
    code = PAIR.format(kind=function, call=call)
    seen = []
    for moment in range(1, 100):
        script = [sys.executable, str(Path(__file__).with_name("killed.py")), str(moment), code]
        paths = os.pathsep.join(sys.path)
        ended = subprocess.run(script, cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}, timeout=60)
        texts = {p.name: p.read_text() for p in (tmp_path / place).glob("[ab].txt")}
        assert set(texts.values()) <= {"old", "new" * 100_000}
        assert set(texts) in (set(names), set(names) if old else set())
        seen.append(sorted({text[:3] for text in texts.values()}))
        if ended.returncode == 0:
            break
        assert ended.returncode == -signal.SIGKILL
        if not old and texts:
            shutil.rmtree(tmp_path / place)
    assert len(seen) > 4 and seen[0] == (["old"] if old else []) and seen[-1] == ["new"]
    # What the killed ones have left is gone.
    assert all(p.name[0] != "." for p in tmp_path.iterdir())
