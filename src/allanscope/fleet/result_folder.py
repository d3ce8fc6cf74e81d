"""The folder that a fleet writes to: of this machine, or wherever fsspec writes."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from allanscope.errors import UsageError
from allanscope.fleet.places import is_of_this_machine
from allanscope.fleet.remote_path import RemotePath
from allanscope.whole_file import written_whole

__all__ = ["Folder", "put_file", "result_folder", "staged"]

Folder = Path | RemotePath

_SQUEEZED_URL = re.compile(r"\w{2,}:/")


def result_folder(out: str | Path) -> Folder:
    """Return the folder that a path or URL names.

    Raises
    ------
    UsageError
        If fsspec has no file system for the URL, or a URL was made a `Path`, which squeezes it.

    Examples
    --------
    >>> result_folder("lot-result")
    PosixPath('lot-result')
    >>> result_folder("memory://bench/result/")
    RemotePath('memory://bench/result')
    """
    text = str(out)
    if isinstance(out, Path) and _SQUEEZED_URL.match(text):
        raise UsageError(f"cannot write to {text}: give a URL as text, a Path loses its slashes")
    if "://" not in text:
        return Path(out)
    import fsspec

    try:
        filesystem, inside = fsspec.core.url_to_fs(text)
    except Exception as error:
        raise UsageError(f"cannot write to {text}: {error}") from error
    return Path(inside) if is_of_this_machine(filesystem) else RemotePath(text.rstrip("/"))


def put_file(path: Folder, data: bytes) -> None:
    """Write a file, whole or not at all.

    Raises
    ------
    UsageError
        If it cannot be written.
    """
    if isinstance(path, Path):
        with written_whole(path) as part:
            path.parent.mkdir(exist_ok=True)
            part.write_bytes(data)
        return
    try:
        path.write_bytes(data)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def staged(folder: Folder) -> Iterator[Path]:
    """Yield a folder of this machine whose files are in `folder` when all went well."""
    if isinstance(folder, Path):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="allanscope-") as here:
        yield Path(here)
        for path in sorted(Path(here).iterdir()):
            put_file(folder / path.name, path.read_bytes())
