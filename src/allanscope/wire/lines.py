"""Bytes to lines, whatever ends them: LF, CR LF, LF CR or CR alone."""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["Lines"]

LONGEST_LINE = 4096


class Lines:
    """Cut a stream into lines without their ends; empty ones are left out.

    Attributes
    ----------
    dropped : int
        Lines that were longer than 4096 bytes and were thrown away.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._partial = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the lines that the bytes complete."""
        *ended, rest = data.replace(b"\r", b"\n").split(b"\n")
        for piece in ended:
            self._keep(piece)
            line, overlong = bytes(self._partial), self._overlong
            self.reset()
            if line and not overlong:
                yield line
        self._keep(rest)

    def rest(self) -> bytes:
        """Return the last line, which nothing ended, and forget it."""
        line = bytes(self._partial)
        self.reset()
        return line

    def reset(self) -> None:
        """Forget a partial line."""
        self._partial = bytearray()
        self._overlong = False

    def _keep(self, piece: bytes) -> None:
        if self._overlong:
            return
        self._partial += piece
        if len(self._partial) > LONGEST_LINE:
            self._partial = bytearray()
            self._overlong = True
            self.dropped += 1
