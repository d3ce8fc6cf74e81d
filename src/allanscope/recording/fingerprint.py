"""The fingerprint of a recording: what was read and when, whatever files it lies in."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from allanscope.recording.reader import Buffer

__all__ = ["Fingerprint"]


class Fingerprint:
    """A hash of bytes and times that grows with a recording that is read for another purpose.

    How the reads are joined to Buffers does not change it; neither does recovery, or rotation over
    several files.
    """

    def __init__(self) -> None:
        self._content = hashlib.sha256()
        self._times = hashlib.sha256()

    def add(self, buffer: Buffer) -> None:
        """Take the next piece."""
        self._content.update(buffer.data)
        lengths = np.diff(buffer.offset, append=len(buffer.data))
        self._times.update(np.column_stack([buffer.host_ns, lengths]).astype("<i8").tobytes())

    def hexdigest(self) -> str:
        """Return the fingerprint of everything so far, 64 hexadecimal digits."""
        return hashlib.sha256(self._content.digest() + self._times.digest()).hexdigest()
