r"""TMsg frames: byte stuffing, an 8-bit sum, and 0xF0 at the end.

ST's tools (Unicleo-GUI, MEMS-Studio) talk to evaluation boards this way. There is no start mark,
no length and no number::

    wire = stuffed(body, check) F0      F0 -> F1 F2,  F1 -> F1 F1

The check byte makes the sum of all bytes a multiple of 256, so a damaged frame passes once in 256
times; what a message says is checked as well before it is believed.
"""

from __future__ import annotations

from collections.abc import Iterator

__all__ = ["END", "LONGEST_BODY", "Unwrapper", "wrap"]

END = 0xF0
LONGEST_BODY = 512
_LONGEST_CHUNK = 2 * (LONGEST_BODY + 1)


def wrap(body: bytes) -> bytes:
    """Return a message as it goes over the wire.

    >>> wrap(bytes([0x32, 0x01, 0x01])).hex(" ")
    '32 01 01 cc f0'
    """
    checked = body + bytes((-sum(body) & 0xFF,))
    return checked.replace(b"\xf1", b"\xf1\xf1").replace(b"\xf0", b"\xf1\xf2") + bytes((END,))


def _unwrap(chunk: bytes) -> bytes | None:
    """Return the body of what came before an 0xF0, None when it is damaged."""
    first, *rest = chunk.split(b"\xf1")
    checked = bytearray(first)
    escaped = iter(rest)
    for piece in escaped:
        if piece[:1] == b"\xf2":
            checked += b"\xf0" + piece[1:]
            continue
        if piece:
            return None
        # Two escapes in a row are one byte 0xF1; what follows the second is plain.
        plain = next(escaped, None)
        if plain is None:
            return None
        checked += b"\xf1" + plain
    return bytes(checked[:-1]) if len(checked) > 3 and sum(checked) & 0xFF == 0 else None


class Unwrapper:
    """Bytes to the bodies of messages whose sum is right.

    Attributes
    ----------
    damaged : int
        Pieces between two ends that were no message, or too long for one. The first piece after a
        start is not counted: it may be the tail of a message.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self.reset()

    def reset(self) -> None:
        """Forget a partial message."""
        self._partial = bytearray()
        self._overlong = False
        self._joining = True

    def feed(self, data: bytes) -> Iterator[bytes | None]:
        """Yield the body of each message that the bytes complete, None for a damaged one."""
        *ended, rest = data.split(bytes((END,)))
        for piece in ended:
            self._keep(piece)
            chunk, overlong, joining = bytes(self._partial), self._overlong, self._joining
            self.reset()
            self._joining = False
            if not chunk and not overlong:
                continue
            body = None if overlong else _unwrap(chunk)
            if body is None and joining and not overlong:
                continue
            self.damaged += body is None
            yield body
        self._keep(rest)

    def _keep(self, piece: bytes) -> None:
        if self._overlong or len(self._partial) + len(piece) > _LONGEST_CHUNK:
            self._overlong = True
            self._partial = bytearray()
        else:
            self._partial += piece
