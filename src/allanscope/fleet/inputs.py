"""Where recordings lie: on this machine, or wherever fsspec reaches (s3, gs, https, sftp, memory).

A recording is read by seeking in its file, a chunk at a time, so a remote one is neither copied to
the disk nor held whole in memory. `RemotePath` is as much of a `pathlib.Path` as that and the
results take; files of this machine stay plain paths.

A night may lie in several files, ``session.mcap``, ``session-001.mcap``, ... Names alone do not
tell whether a numbered file goes on with another, only the files do. A `RecordingInput` therefore
keeps the numbered files that *could* follow, and the worker that reads the first says which of them
it took.
"""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import IO, Any, cast

from allanscope.errors import UsageError
from allanscope.pipeline import is_table_file
from allanscope.recording import segment_number

__all__ = ["READ_AHEAD_BYTES", "RecordingInput", "RemotePath", "find_inputs", "is_of_this_machine"]

_STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created")
"""What shows that a file has changed, the best first: an ETag goes with the content, a time may be
in whole seconds."""

READ_AHEAD_BYTES = 1 << 20
"""Fetched at a time from a remote file."""


@dataclass(frozen=True, slots=True)
class RecordingInput:
    """One recording that was found.

    Attributes
    ----------
    url : str
        A path of this machine, or a URL that fsspec opens.
    size : int
        Bytes of its first file.
    stamp : str
        When it was last changed, in whatever words the file system has; empty when it has none.
    later : tuple of RecordingInput
        Numbered files beside it that may go on with it.
    """

    url: str
    size: int
    stamp: str
    later: tuple[RecordingInput, ...] = ()

    @property
    def name(self) -> str:
        """The last part of the URL."""
        return PurePosixPath(self.url).name

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return PurePosixPath(self.url).parent.name

    @property
    def bytes(self) -> int:
        """Most bytes that the recording can have, all files together."""
        return self.size + sum(one.size for one in self.later)

    def open_path(self) -> Path:
        """Return what `Recording` takes."""
        if "://" not in self.url:
            return Path(self.url)
        names = tuple(PurePosixPath(one.url).name for one in self.later)
        return cast(Path, RemotePath(self.url, names))


def find_inputs(patterns: Iterable[str]) -> list[RecordingInput]:
    """Return the recordings that the patterns match, each once, sorted by name.

    Parameters
    ----------
    patterns : iterable of str
        Files, folders (everything ``.mcap`` below them) or globs (``**`` is any depth), on this
        machine or at any URL of fsspec. A folder of this machine that `import` makes a recording
        of, as one of HSDatalog, is one recording.

    Raises
    ------
    UsageError
        If a pattern matches nothing, or cannot be looked up.
    """
    found: dict[str, RecordingInput] = {}
    for pattern in patterns:
        matched = list(_matches(pattern))
        if not matched:
            raise UsageError(
                f"nothing matches {pattern}; quote it: allanscope fleet 'DIR/**/*.mcap'"
            )
        found |= {item.url: item for item in matched}
    return _sessions([found[url] for url in sorted(found)])


def _matches(pattern: str) -> Iterator[RecordingInput]:
    import fsspec

    try:
        filesystem, inside = fsspec.core.url_to_fs(pattern)
        filesystem.invalidate_cache()  # of what was there when this process last looked
        here = is_of_this_machine(filesystem)
        is_folder = filesystem.isdir(inside) and not (here and is_table_file(Path(inside)))
        if is_folder or filesystem.exists(inside):  # its name may hold brackets
            inside = glob.escape(inside.rstrip("/")) + ("/**/*.mcap" if is_folder else "")
        details = filesystem.glob(inside, detail=True)
    except Exception as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise UsageError(f"cannot look for {pattern}: {why}") from error
    for path, info in details.items():
        is_folder = here and info.get("type") == "directory" and is_table_file(Path(path))
        if info.get("type") != "file" and not is_folder:
            continue
        # Workers may have been started in another folder: paths are absolute.
        url = path if here else filesystem.unstrip_protocol(path)
        stamp = next((str(info[key]) for key in _STAMPS if info.get(key) is not None), "")
        yield RecordingInput(url, 0 if is_folder else int(info.get("size") or 0), stamp)


def is_of_this_machine(filesystem: Any) -> bool:
    """Whether a file system of fsspec is that of this machine."""
    protocol = filesystem.protocol
    return "file" in ((protocol,) if isinstance(protocol, str) else protocol)


def _sessions(files: list[RecordingInput]) -> list[RecordingInput]:
    """Put numbered files under the one that they may go on with."""
    by_path = {PurePosixPath(one.url): one for one in files}
    later: dict[PurePosixPath, list[RecordingInput]] = {}
    for path, one in by_path.items():
        first = _first_of(path)
        if first is not None and first in by_path:
            later.setdefault(first, []).append(one)
    followers = {one.url for group in later.values() for one in group}
    return [
        RecordingInput(one.url, one.size, one.stamp, tuple(later.get(path, ())))
        for path, one in by_path.items()
        if one.url not in followers
    ]


def _first_of(path: PurePosixPath) -> PurePosixPath | None:
    """Return the name that the session of a numbered file would begin with."""
    stem, dash, _ = path.stem.rpartition("-")
    first = path.with_name(f"{stem}{path.suffix}") if dash and stem else None
    fits = first is not None and segment_number(cast(Path, first), cast(Path, path)) is not None
    return first if fits else None


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
        """Return False: a recording's input is a file."""
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
