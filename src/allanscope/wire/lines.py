"""Bytes to lines, whatever ends them: LF, CR LF, LF CR or CR alone."""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["Lines", "is_text"]

LONGEST_LINE = 4096
_TEXT_BYTES = frozenset(b"\t\r\n\x1b") | frozenset(range(0x20, 0x7F))
_MOSTLY = 0.9


def is_text(sample: bytes) -> bool:
    """Return whether a sample is nothing but text, or nearly: nine bytes in ten are printable."""
    return bool(sample) and sum(byte in _TEXT_BYTES for byte in sample) >= _MOSTLY * len(sample)


class Lines:
    """Cut a stream into lines without their ends; empty ones are left out.

    Attributes
    ----------
    dropped : int
        Lines that were longer than 4096 bytes and were discarded.
    number : int
        Number of the line that was yielded last, as an editor counts: empty ones too.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self.number = 1
        self._newlines = 0
        self._partial = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the lines that the bytes complete."""
        *ended, last = data.split(b"\n")
        for piece in ended:
            yield from self._end(piece)
            self._newlines += 1
        *ended, rest = last.split(b"\r")
        for piece in ended:
            yield from self._end(piece)
        self._keep(rest)

    def _end(self, pieces: bytes) -> Iterator[bytes]:
        """Yield the lines that end with, or inside, what came before a line feed."""
        for piece in pieces.split(b"\r") if b"\r" in pieces else (pieces,):
            self._keep(piece)
            line, overlong = bytes(self._partial), self._overlong
            self.reset()
            if line and not overlong:
                self.number = self._newlines + 1
                yield line

    @property
    def partial(self) -> bool:
        """Whether a line has begun."""
        return bool(self._partial) or self._overlong

    def skip(self, newlines: int) -> None:
        """Count whole lines that were read elsewhere."""
        self._newlines += newlines
        self.number = self._newlines

    def flush(self) -> bytes:
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
