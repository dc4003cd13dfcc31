"""Files are written whole or not at all, as readable as any other."""

import os
import stat

import pytest

from jaxmuscle import InputError
from jaxmuscle.files import atomic_write


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
