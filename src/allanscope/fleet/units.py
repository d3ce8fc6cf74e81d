"""Which board a recording is of: what makes two recordings runs of one unit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any

from allanscope.errors import UsageError

__all__ = ["UnitNames"]

_IDENTITIES = ("unit", "unique_id", "serial_number")
"""What a recording says of its board, the best first: a name given at import, the controller's own
number, the USB serial number."""


class UnitNames:
    r"""Names the unit of a recording.

    A pattern overrules what the recording says of its board, and that overrules where it lies. By
    place, all recordings of a folder are runs of one unit; where all lie in one folder nothing
    tells which belong together, and each is a unit of its own.

    Parameters
    ----------
    urls : iterable of str
        All recordings of the lot.
    pattern : str
        Regular expression whose first group, found in the path, is the name; empty for none.

    Raises
    ------
    UsageError
        If it is no regular expression with a group.

    Examples
    --------
    >>> names = UnitNames(["/lot/a/1.mcap", "/lot/a/2.mcap", "/lot/b/1.mcap"])
    >>> names.of("/lot/a/2.mcap", {}), names.of("/lot/b/1.mcap", {"serial_number": "0042"})
    ('a', '0042')
    >>> UnitNames(["/lot/a7-1.mcap"], r"/(\w+)-").of("/lot/a7-1.mcap", {})
    'a7'
    """

    def __init__(self, urls: Iterable[str], pattern: str = "") -> None:
        self._by_folder = len({PurePosixPath(url).parent for url in urls}) > 1
        try:
            self._pattern = re.compile(pattern) if pattern else None
        except re.error as error:
            raise UsageError(f"--unit-name {pattern!r} is no regular expression: {error}") from None
        if self._pattern is not None and self._pattern.groups < 1:
            raise UsageError(f"--unit-name {pattern!r} has no group; write e.g. '/(unit-[0-9]+)/'")

    def of(self, url: str, circumstances: Mapping[str, Any]) -> str:
        """Return the name of the unit of one recording."""
        found = self._pattern.search(url) if self._pattern is not None else None
        if found is not None and found[1]:
            return str(found[1])
        for name in _IDENTITIES:
            if circumstances.get(name):
                return str(circumstances[name])
        path = PurePosixPath(url)
        return path.parent.name if self._by_folder else path.stem
