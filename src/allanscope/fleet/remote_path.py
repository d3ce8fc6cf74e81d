"""Files that fsspec reaches (s3, gs, https, sftp, memory), as far as recordings and results ask."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import PurePosixPath
from typing import IO, Any, cast

__all__ = ["READ_AHEAD_BYTES", "RemotePath"]

READ_AHEAD_BYTES = 1 << 20
"""Fetched at a time from a remote file."""


class RemotePath:
    """A file or folder that fsspec reaches, with the part of `pathlib.Path` that is needed here.

    Whatever a file system throws is raised as an OSError, which the recording room knows.

    Parameters
    ----------
    url : str
        E.g. ``s3://bench/night.mcap``.
    beside : tuple of str, optional
        Names of files in the same folder; `glob` then looks for nothing else there, so that a
        folder of a hundred thousand objects is listed once and not once for each of them.
    """

    def __init__(self, url: str, beside: tuple[str, ...] | None = None) -> None:
        self.url = url
        self._beside = beside

    @property
    def name(self) -> str:
        """The last part."""
        return PurePosixPath(self.url).name

    @property
    def stem(self) -> str:
        """The last part without its suffix."""
        return PurePosixPath(self.url).stem

    @property
    def suffix(self) -> str:
        """E.g. ``.mcap``."""
        return PurePosixPath(self.url).suffix

    @property
    def parent(self) -> RemotePath:
        """The folder; knows the same files."""
        return RemotePath(self.url.rpartition("/")[0], self._beside)

    def __truediv__(self, name: str) -> RemotePath:
        return RemotePath(f"{self.url}/{name}")

    def with_name(self, name: str) -> RemotePath:
        """Return a file of the same folder."""
        return RemotePath(f"{self.parent.url}/{name}", self._beside)

    def glob(self, pattern: str) -> Iterator[RemotePath]:
        """Yield the files below this folder that fit, or those of the known names."""
        if self._beside is not None:
            for name in self._beside:
                if fnmatchcase(name, pattern):
                    yield RemotePath(f"{self.url}/{name}", self._beside)
            return
        with _os_errors():
            filesystem, inside = self._where()
            filesystem.invalidate_cache()
            found = filesystem.glob(f"{inside}/{pattern}")
        yield from (RemotePath(filesystem.unstrip_protocol(path)) for path in found)

    def is_dir(self) -> bool:
        """Return False: a place is a file."""
        return False

    def open(self, mode: str = "rb") -> IO[Any]:
        """Open for reading, with a window that moves through the file.

        Raises
        ------
        OSError
            If it is not there, or the other side fails.
        """
        with _os_errors():
            filesystem, inside = self._where()
            return cast("IO[Any]", filesystem.open(inside, mode, block_size=READ_AHEAD_BYTES))

    def read_bytes(self) -> bytes:
        """Return the whole content."""
        with _os_errors():
            filesystem, inside = self._where()
            return bytes(filesystem.cat_file(inside))

    def write_bytes(self, data: bytes) -> int:
        """Write the whole content in one request: an object store shows it whole or not at all."""
        with _os_errors():
            filesystem, inside = self._where()
            try:
                filesystem.pipe_file(inside, data)
            except FileNotFoundError:
                _make_folders(filesystem, inside.rpartition("/")[0])
                filesystem.pipe_file(inside, data)
        return len(data)

    def unlink(self, missing_ok: bool = False) -> None:
        """Remove the file."""
        try:
            with _os_errors():
                filesystem, inside = self._where()
                filesystem.rm_file(inside)
        except FileNotFoundError:
            if not missing_ok:
                raise

    def stat(self) -> _Size:
        """Return the size."""
        with _os_errors():
            filesystem, inside = self._where()
            return _Size(int(filesystem.size(inside)))

    def _where(self) -> tuple[Any, str]:
        """Return the file system and the path inside it."""
        import fsspec

        filesystem, inside = fsspec.core.url_to_fs(self.url)
        return filesystem, str(inside)

    def __str__(self) -> str:
        return self.url

    def __repr__(self) -> str:
        return f"RemotePath({self.url!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RemotePath) and self.url == other.url

    def __hash__(self) -> int:
        return hash(self.url)


@dataclass(frozen=True, slots=True)
class _Size:
    st_size: int


def _make_folders(filesystem: Any, folder: str) -> None:
    """Make a folder and those above it, but never the first of a relative path: a bucket.

    One with a typing error would be paid for by whoever made the error.
    """
    parts = folder.split("/")
    for count in range(2, len(parts) + 1):
        above = "/".join(parts[:count])
        if not filesystem.isdir(above):
            filesystem.mkdir(above, create_parents=False)


@contextmanager
def _os_errors() -> Iterator[None]:
    """Raise what is no OSError as one; the errors of a cloud's library are of its own classes."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(0, str(error) or type(error).__name__) from error
