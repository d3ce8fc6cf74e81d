"""What is done, where whoever started the fleet wants it: on the disk, or wherever fsspec writes.

::

    OUT/results/ab/abcd....json.gz   one result, named by content, settings and version
    OUT/index.jsonl                  a line for each file that was seen: size, time, fingerprint;
                                     at a URL index-NUMBER.jsonl, see `RemoteIndex`

One process alone writes. A result is there whole or not at all. The index spares reading a file
again only to know that it is done: a file whose size and time of change are as they were has the
fingerprint it had. A line that a crash has truncated is skipped; its recording is then looked at
anew.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from allanscope.atomic_write import atomic_write
from allanscope.errors import UsageError
from allanscope.fleet.inputs import RecordingInput, RemotePath, is_of_this_machine
from allanscope.fleet.outcome import Outcome, result_key, result_of_bytes
from allanscope.pipeline import DeviceSettings

__all__ = ["Folder", "RemoteIndex", "Store", "put_file", "result_folder", "staged"]

FLUSH_S = 30.0
"""A killed run forgets the files that it saw in this time, and looks at them anew."""

Folder = Path | RemotePath

_SQUEEZED_URL = re.compile(r"\w{2,}:/")


class Store:
    """The results of a fleet.

    Parameters
    ----------
    folder : Path or str
        Made if it is not there; a URL of fsspec is text.
    device : DeviceSettings
        What results are asked for.

    Raises
    ------
    UsageError
        If the folder cannot be written to.
    """

    def __init__(self, folder: Path | str, device: DeviceSettings) -> None:
        self.folder: Folder = result_folder(folder)
        self._device = device
        try:
            self._index = _opened_index(self.folder)
            self._known = dict(_lines(self.folder))
            kept = self.folder.glob("results/*/*.json.gz")
            self._kept = {path.name.removesuffix(".json.gz") for path in kept}
        except (OSError, NotImplementedError) as error:
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise UsageError(f"cannot write to {folder}: {why}") from None
        self._sizes = {seen["size"] for seen in self._known.values()}

    def known(self, item: RecordingInput) -> str:
        """Return the key of the result of a recording that has not changed since; else nothing."""
        seen = self._known.get(item.url)
        if not seen or not item.stamp or seen["state"] != _state(item):
            return ""
        key = result_key(seen["sha256"], self._device)
        return key if key in self._kept else ""

    def files_of(self, item: RecordingInput) -> tuple[str, ...]:
        """Return the names of the files that made up a known recording."""
        return tuple(self._known[item.url]["files"])

    def may_contain(self, item: RecordingInput) -> bool:
        """Whether some known recording is as long, so that this may be it under another name."""
        return item.size in self._sizes

    def note(self, item: RecordingInput, outcome: Outcome) -> str:
        """Remember what file has which fingerprint; return the key of its result.

        Raises
        ------
        UsageError
            If the disk does not take it.
        """
        seen = {
            "url": item.url,
            "size": item.size,
            "state": _state(item),
            "sha256": outcome.sha256,
            "files": list(outcome.files),
        }
        self._known[item.url] = seen
        self._sizes.add(item.size)
        try:
            self._index.write(json.dumps(seen) + "\n")
            self._index.flush()
        except OSError as error:
            raise UsageError(f"cannot write {self._index.name}: {error.strerror}") from None
        return result_key(outcome.sha256, self._device)

    def put(self, key: str, result: bytes) -> None:
        """Keep a result.

        Raises
        ------
        UsageError
            If the disk does not take it.
        """
        put_file(self.path(key), result)
        self._kept.add(key)

    def has(self, key: str) -> bool:
        """Whether a result is there."""
        return key in self._kept

    def get(self, key: str) -> dict[str, Any]:
        """Return a result.

        Raises
        ------
        ValueError
            If it is damaged.
        """
        return result_of_bytes(self.path(key).read_bytes())

    def forget(self, key: str) -> None:
        """Take a result away, so that it is asked for again."""
        self._kept.discard(key)
        self.path(key).unlink(missing_ok=True)

    def path(self, key: str) -> Folder:
        """Return the path of a result, which need not exist."""
        return self.folder / "results" / key[:2] / f"{key}.json.gz"

    def close(self) -> None:
        """Write the rest of the index and close it.

        Raises
        ------
        UsageError
            If it cannot be written.
        """
        try:
            self._index.close()
        except OSError as error:
            raise UsageError(f"cannot write {self._index.name}: {error.strerror}") from None


def _state(item: RecordingInput) -> list[list[str]]:
    """Return what changes when one of the files does."""
    return [[one.url, str(one.size), one.stamp] for one in (item, *item.later)]


def _opened_index(folder: Folder) -> TextIO | RemoteIndex:
    if not isinstance(folder, Path):
        return RemoteIndex(folder)
    (folder / "results").mkdir(parents=True, exist_ok=True)
    index = (folder / "index.jsonl").open("a", encoding="utf-8")
    try:
        _lock(index, folder)
    except UsageError:
        index.close()
        raise
    return index


def _lock(index: TextIO, folder: Path) -> None:
    """Refuse a folder that another fleet writes to; where files cannot be locked, hope."""
    if sys.platform == "win32":
        return
    import fcntl

    try:
        fcntl.flock(index, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(
            f"another fleet is writing to {folder}; wait for its end, or choose another --out"
        ) from None
    except OSError:  # a file system without locks
        return


def _lines(folder: Folder) -> list[tuple[str, dict[str, Any]]]:
    found = []
    there: Iterator[Folder] = folder.glob("index*.jsonl")
    files = sorted(there, key=lambda path: path.name)
    text = b"".join(path.read_bytes() + b"\n" for path in files).decode("utf-8", "replace")
    for line in text.splitlines():
        try:
            seen = json.loads(line)
        except ValueError:
            continue
        if isinstance(seen, dict) and seen.keys() >= {"url", "size", "state", "sha256", "files"}:
            found.append((seen["url"], seen))
    return found


class RemoteIndex:
    """Lines that go into numbered files of a folder, one every half minute and one at the end.

    The first is written at once, empty: a folder that cannot be written to is refused before work.

    Parameters
    ----------
    folder : RemotePath
        Where ``index-NUMBER.jsonl`` go; numbers are times, so that those of later runs are higher.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """

    def __init__(self, folder: RemotePath) -> None:
        self._folder = folder
        self._lines: list[str] = []
        self._flushed_s = time.monotonic()
        self._next()
        self._path.write_bytes(b"")

    @property
    def name(self) -> str:
        """The file that is written next."""
        return str(self._path)

    def write(self, line: str) -> None:
        """Add a line."""
        self._lines.append(line)

    def flush(self) -> None:
        """Write the buffered entries, when it is time."""
        if time.monotonic() - self._flushed_s > FLUSH_S:
            self._put()
            self._next()

    def close(self) -> None:
        """Write the rest."""
        if self._lines:
            self._put()

    def _put(self) -> None:
        self._path.write_bytes("".join(self._lines).encode())
        self._lines = []
        self._flushed_s = time.monotonic()

    def _next(self) -> None:
        self._path = self._folder / f"index-{time.time_ns():020d}.jsonl"


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
        with atomic_write(path) as part:
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
        made = [path.relative_to(here).as_posix() for path in sorted(Path(here).rglob("*.*"))]
        if not made:  # what is there stays
            return
        if any(name.startswith("lot.parquet/") for name in made):
            # Of a run that did not part it: an object store keeps a file beside a folder so named.
            (folder / "lot.parquet").unlink(missing_ok=True)
        for name in made:
            if (path := Path(here) / name).is_file():
                put_file(folder / name, path.read_bytes())
        # A table with other partitions, pages of other units.
        for top in ("lot.parquet", "units"):
            for old in folder.glob(f"{top}/**/*.*"):
                if f"{top}/{old.url.rpartition(f'/{top}/')[2]}" not in made:
                    old.unlink(missing_ok=True)
