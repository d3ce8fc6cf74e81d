"""What is done, on the disk of whoever started the fleet; written by one process alone.

::

    OUT/results/ab/abcd....json.gz   one result, named by content, settings and version
    OUT/index.jsonl                  a line for each file that was seen: size, time, fingerprint

A result is there whole or not at all. The index spares reading a file again only to know that it is
done: a file whose size and time of change are as they were has the fingerprint it had. A line that
a crash has torn is passed over; its recording is then looked at anew.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from allanscope.errors import UsageError
from allanscope.fleet.outcome import Outcome, result_key, unpacked
from allanscope.fleet.places import Place
from allanscope.pipeline.settings import DeviceSettings
from allanscope.whole_file import written_whole

__all__ = ["Store"]


class Store:
    """The results of a fleet.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    device : DeviceSettings
        What results are asked for.

    Raises
    ------
    UsageError
        If the folder cannot be written to.
    """

    def __init__(self, folder: Path, device: DeviceSettings) -> None:
        self.folder = folder
        self._device = device
        try:
            (folder / "results").mkdir(parents=True, exist_ok=True)
            self._seen = dict(_lines(folder / "index.jsonl"))
            self._index = (folder / "index.jsonl").open("a", encoding="utf-8")
        except OSError as error:
            raise UsageError(f"cannot write to {folder}: {error.strerror}") from None
        self._sizes = {seen["size"] for seen in self._seen.values()}

    def known(self, place: Place) -> str:
        """Return the key of the result of a recording that has not changed since; else nothing."""
        seen = self._seen.get(place.url)
        if not seen or not place.stamp or seen["state"] != _state(place):
            return ""
        key = result_key(seen["sha256"], self._device)
        return key if self.path(key).exists() else ""

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
        path = self.path(key)
        with written_whole(path) as part:
            path.parent.mkdir(exist_ok=True)
            part.write_bytes(result)

    def has(self, key: str) -> bool:
        """Whether a result is there."""
        return self.path(key).exists()

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
        self.path(key).unlink(missing_ok=True)

    def path(self, key: str) -> Path:
        """Return where a result lies, or would."""
        return self.folder / "results" / key[:2] / f"{key}.json.gz"

    def close(self) -> None:
        """Let go of the index."""
        self._index.close()


def _state(place: Place) -> list[list[str]]:
    """Return what changes when one of the files does."""
    return [[one.url, str(one.size), one.stamp] for one in (place, *place.later)]


def _lines(path: Path) -> list[tuple[str, dict[str, Any]]]:
    if not path.exists():
        return []
    found = []
    for line in path.read_text("utf-8", errors="replace").splitlines():
        try:
            seen = json.loads(line)
        except ValueError:
            continue
        if isinstance(seen, dict) and seen.keys() >= {"url", "size", "state", "sha256", "files"}:
            found.append((seen["url"], seen))
    return found
