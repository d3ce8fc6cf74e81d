"""A file that is written appears whole, or what was there before stays."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from allanscope.atomic_write import atomic_write
from allanscope.errors import InputError, UsageError


def test_nothing_is_seen_before_all_is_written(tmp_path: Path) -> None:
    out = tmp_path / "curve.csv"
    out.write_text("old")
    with atomic_write(out) as part:
        part.write_text("new")
        assert out.read_text() == "old"
    assert out.read_text() == "new"
    assert list(tmp_path.iterdir()) == [out]


def write_half(out: Path, error: BaseException) -> None:
    with atomic_write(out) as part:
        part.write_text("half")
        raise error


@pytest.mark.parametrize(
    ("error", "seen", "words"),
    [
        (InputError("torn"), InputError, "torn"),
        (OSError(28, "disk full"), UsageError, "cannot write {}: disk full; choose another place"),
    ],
)
def test_what_fails_leaves_the_old_file_and_no_other(
    tmp_path: Path, error: Exception, seen: type[Exception], words: str
) -> None:
    out = tmp_path / "curve.csv"
    out.write_text("old")
    with pytest.raises(seen) as caught:
        write_half(out, error)
    assert str(caught.value) == words.format(out)
    assert out.read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_what_a_killed_process_left_is_no_obstacle(tmp_path: Path) -> None:
    out = tmp_path / "curve.csv"
    (tmp_path / ".curve.csv.part").write_text("of another process")
    with atomic_write(out) as part:
        assert not part.exists()
        part.write_text("new")
    assert out.read_text() == "new"
    assert list(tmp_path.iterdir()) == [out]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    out, link = tmp_path / "curve.csv", tmp_path / "newest.csv"
    out.write_text("old")
    link.symlink_to(out)
    with atomic_write(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert out.read_text() == "new"
    assert sorted(tmp_path.iterdir()) == [out, link]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_nothing_takes_the_place_of_a_pipe_or_a_device(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with atomic_write(pipe) as part:
        part.write_text("new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot write .*: No such file"):
        write_half(tmp_path / "nowhere" / "curve.csv", RuntimeError("not reached"))
