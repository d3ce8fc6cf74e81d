"""What is done, on the disk of whoever started the fleet; written by one process alone.

::

    OUT/results/ab/abcd....json.gz   one result, named by content, settings and version
    OUT/index.jsonl                  a line for each file that was seen: size, time, fingerprint;
                                     at a URL index-NUMBER.jsonl, see `allanscope.fleet.index`

A result is there whole or not at all. The index spares reading a file again only to know that it is
done: a file whose size and time of change are as they were has the fingerprint it had. A line that
a crash has torn is passed over; its recording is then looked at anew.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

from allanscope.errors import UsageError
from allanscope.fleet.index import RemoteIndex
from allanscope.fleet.outcome import Outcome, result_key, unpacked
from allanscope.fleet.places import Place
from allanscope.fleet.result_folder import Folder, put_file, result_folder
from allanscope.pipeline.settings import DeviceSettings

__all__ = ["Store"]


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
            self._seen = dict(_lines(self.folder))
            kept = self.folder.glob("results/*/*.json.gz")
            self._kept = {path.name.removesuffix(".json.gz") for path in kept}
        except (OSError, NotImplementedError) as error:
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise UsageError(f"cannot write to {folder}: {why}") from None
        self._sizes = {seen["size"] for seen in self._seen.values()}

    def known(self, place: Place) -> str:
        """Return the key of the result of a recording that has not changed since; else nothing."""
        seen = self._seen.get(place.url)
        if not seen or not place.stamp or seen["state"] != _state(place):
            return ""
        key = result_key(seen["sha256"], self._device)
        return key if key in self._kept else ""

    def files_of(self, place: Place) -> tuple[str, ...]:
        """Return the names of the files that made up a known recording."""
        return tuple(self._seen[place.url]["files"])

    def may_know(self, place: Place) -> bool:
        """Whether some known recording is as long, so that this may be it under another name."""
        return place.size in self._sizes

    def note(self, place: Place, outcome: Outcome) -> str:
        """Remember what file has which fingerprint; return the key of its result.

        Raises
        ------
        UsageError
            If the disk does not take it.
        """
        seen = {
            "url": place.url,
            "size": place.size,
            "state": _state(place),
            "sha256": outcome.sha256,
            "files": list(outcome.files),
        }
        self._seen[place.url] = seen
        self._sizes.add(place.size)
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
        return unpacked(self.path(key).read_bytes())

    def forget(self, key: str) -> None:
        """Take a result away, so that it is asked for again."""
        self._kept.discard(key)
        self.path(key).unlink(missing_ok=True)

    def path(self, key: str) -> Folder:
        """Return where a result lies, or would."""
        return self.folder / "results" / key[:2] / f"{key}.json.gz"

    def close(self) -> None:
        """Write the rest of the index and let go of it.

        Raises
        ------
        UsageError
            If it cannot be written.
        """
        try:
            self._index.close()
        except OSError as error:
            raise UsageError(f"cannot write {self._index.name}: {error.strerror}") from None


def _state(place: Place) -> list[list[str]]:
    """Return what changes when one of the files does."""
    return [[one.url, str(one.size), one.stamp] for one in (place, *place.later)]


def _opened_index(folder: Folder) -> TextIO | RemoteIndex:
    if not isinstance(folder, Path):
        return RemoteIndex(folder)
    (folder / "results").mkdir(parents=True, exist_ok=True)
    return (folder / "index.jsonl").open("a", encoding="utf-8")


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
