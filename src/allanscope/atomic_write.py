"""Files that appear whole or not at all: written beside their place, and moved there at the end."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from allanscope.errors import UsageError

__all__ = ["atomic_folder", "atomic_write", "require_writable", "write_text"]


def require_writable(path: Path) -> None:
    """Say before long work is begun that its result could not be written there.

    Raises
    ------
    UsageError
        When the place is a folder, or lies in none that could be written to.
    """
    folder = path.resolve().parent
    if path.is_dir():
        why = errno.EISDIR
    elif not folder.is_dir():
        why = errno.ENOENT
    elif not os.access(folder, os.W_OK) and not path.exists():
        why = errno.EACCES
    else:
        return
    raise UsageError(f"cannot write {path}: {os.strerror(why)}; choose another place")


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write beside `path`, which takes its place when all went well.

    Whatever was at `path` stays until then, and for good when the block raises; the other file is
    gone in every case. What is there afterwards survives a power cut. A link stays a link. A pipe
    or a device, as ``/dev/stdout``, is written to as it is: nothing may take its place.

    Raises
    ------
    UsageError
        When the place cannot be written to.

    Examples
    --------
    >>> with atomic_write(Path("curve.csv")) as part:  # doctest: +SKIP
    ...     part.write_text("tau,deviation")
    """
    try:
        if path.is_fifo() or path.is_char_device():
            yield path
        else:
            with _replaced(path.resolve() if path.is_symlink() else path) as part:
                yield part
    except OSError as error:
        why = error.strerror or error
        raise UsageError(f"cannot write {path}: {why}; choose another place") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 so that no reader ever sees half of it.

    Raises
    ------
    UsageError
        When the place cannot be written to.
    """
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a folder beside `path`, which takes its place, whatever was there, when all went well.

    Raises
    ------
    UsageError
        When the place cannot be written to.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        _removed(part)
        part.mkdir()
        yield part
        _removed(path)
        part.rename(path)
    except OSError as error:
        why = error.strerror or error
        raise UsageError(f"cannot write {path}: {why}; choose another place") from error
    finally:
        _removed(part)


def _removed(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def _replaced(path: Path) -> Iterator[Path]:
    part = path.with_name(f".{path.name}.part")
    try:
        part.unlink(missing_ok=True)
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
