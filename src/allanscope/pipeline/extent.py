"""How long a file is: seconds of a recording, bytes of anything else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from allanscope.recording import Buffer
from allanscope.sources import RecordedSource, Source

__all__ = ["Extent"]

_GZIP_MAGIC = b"\x1f\x8b"


@dataclass(slots=True)
class Extent:
    """What there is to read, for a bar that says how much is left.

    Attributes
    ----------
    total : float or None
        None where it cannot be told before the end, as of a compressed file.
    unit : {'s', 'B'}
        What it is counted in.
    """

    total: float | None
    unit: Literal["s", "B"]
    _last_ns: int | None = None

    @classmethod
    def of(cls, source: Source, path: Path) -> Self:
        """Return the extent of a source that has an end."""
        if isinstance(source, RecordedSource):
            return cls(source.recording.duration_s or None, "s")
        with path.open("rb") as file:
            packed = file.read(len(_GZIP_MAGIC)) == _GZIP_MAGIC
        return cls(None if packed else float(path.stat().st_size), "B")

    def of_buffer(self, buffer: Buffer) -> float:
        """Return how much of it a piece is, given the one before."""
        if self.unit == "B":
            return float(len(buffer.data))
        if not len(buffer.host_ns):
            return 0.0
        first = int(buffer.host_ns[0]) if self._last_ns is None else self._last_ns
        self._last_ns = int(buffer.host_ns[-1])
        return max(0.0, (self._last_ns - first) * 1e-9)
