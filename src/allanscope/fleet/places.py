"""Where recordings lie: on this machine, or wherever fsspec reaches (s3, gs, https, sftp, memory).

A recording is read by seeking in its file, a chunk at a time, so a remote one is neither copied to
the disk nor held whole in memory. `RemotePath` is as much of a `pathlib.Path` as that takes; files
of this machine stay plain paths.

A night may lie in several files, ``session.mcap``, ``session-001.mcap``, ... Names alone do not
tell whether a numbered file goes on with another, only the files do. A `Place` therefore keeps the
numbered files that *could* follow, and the worker that reads the first says which of them it took.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, cast

from allanscope.errors import UsageError
from allanscope.fleet.remote_path import RemotePath
from allanscope.recording import segment_number

__all__ = ["Place", "find_places", "is_of_this_machine"]

_STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created")
"""What tells that a file has changed, the best first: an ETag goes with the content, a time may be
in whole seconds."""


@dataclass(frozen=True, slots=True)
class Place:
    """One recording that was found.

    Attributes
    ----------
    url : str
        A path of this machine, or a URL that fsspec opens.
    size : int
        Bytes of its first file.
    stamp : str
        When it was last changed, in whatever words the file system has; empty when it has none.
    later : tuple of Place
        Numbered files beside it that may go on with it.
    """

    url: str
    size: int
    stamp: str
    later: tuple[Place, ...] = ()

    @property
    def name(self) -> str:
        """The last part of the URL."""
        return PurePosixPath(self.url).name

    @property
    def folder(self) -> str:
        """Name of the folder that it lies in."""
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


def find_places(patterns: Iterable[str]) -> list[Place]:
    """Return the recordings that the patterns match, each once, sorted by name.

    Parameters
    ----------
    patterns : iterable of str
        Files, folders (everything ``.mcap`` below them) or globs (``**`` is any depth), on this
        machine or at any URL of fsspec.

    Raises
    ------
    UsageError
        If a pattern matches nothing, or cannot be looked up.
    """
    found: dict[str, Place] = {}
    for pattern in patterns:
        matched = list(_matches(pattern))
        if not matched:
            raise UsageError(
                f"nothing matches {pattern}; quote it: allanscope fleet 'DIR/**/*.mcap'"
            )
        found |= {place.url: place for place in matched}
    return _sessions([found[url] for url in sorted(found)])


def _matches(pattern: str) -> Iterator[Place]:
    import fsspec

    try:
        filesystem, inside = fsspec.core.url_to_fs(pattern)
        filesystem.invalidate_cache()  # of what was there when this process last looked
        if filesystem.isdir(inside):
            inside = f"{inside.rstrip('/')}/**/*.mcap"
        details = filesystem.glob(inside, detail=True)
    except Exception as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise UsageError(f"cannot look for {pattern}: {why}") from error
    here = is_of_this_machine(filesystem)
    for path, info in details.items():
        if info.get("type") != "file":
            continue
        # Workers may have been started in another folder: paths are absolute.
        url = path if here else filesystem.unstrip_protocol(path)
        stamp = next((str(info[key]) for key in _STAMPS if info.get(key) is not None), "")
        yield Place(url, int(info.get("size") or 0), stamp)


def is_of_this_machine(filesystem: Any) -> bool:
    """Whether a file system of fsspec is that of this machine."""
    protocol = filesystem.protocol
    return "file" in ((protocol,) if isinstance(protocol, str) else protocol)


def _sessions(files: list[Place]) -> list[Place]:
    """Put numbered files under the one that they may go on with."""
    by_path = {PurePosixPath(one.url): one for one in files}
    later: dict[PurePosixPath, list[Place]] = {}
    for path, one in by_path.items():
        first = _first_of(path)
        if first is not None and first in by_path:
            later.setdefault(first, []).append(one)
    followers = {one.url for group in later.values() for one in group}
    return [
        Place(one.url, one.size, one.stamp, tuple(later.get(path, ())))
        for path, one in by_path.items()
        if one.url not in followers
    ]


def _first_of(path: PurePosixPath) -> PurePosixPath | None:
    """Return the name that the session of a numbered file would begin with."""
    stem, dash, _ = path.stem.rpartition("-")
    first = path.with_name(f"{stem}{path.suffix}") if dash and stem else None
    fits = first is not None and segment_number(cast(Path, first), cast(Path, path)) is not None
    return first if fits else None
