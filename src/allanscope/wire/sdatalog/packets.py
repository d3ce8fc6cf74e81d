"""Packets of the serial link of ST's SDATALOG firmware: ASPEP headers, with SSTL headers inside.

::

    packet = ASPEP header (u32 little-endian), payload
        bits 0-3    0x9 data, 0xA response, 0x5 beacon, 0x6 ping, 0xF refusal
        bits 4-16   length of the payload;  bits 17-27  7: it begins with an SSTL header
        bits 28-31  CRC-4 of the bits below, x^4 + x^2 + x + 1, least significant nibble first
    payload = SSTL header (u32 little-endian), content
        bits 5-7    0 binary (HSDatalog), 1 request, 2 response, 3 notification, 4 binary, 7 text
        bit 8       last fragment;  bits 9-15  channel;  bits 16-31  number of the fragment,
        or bits 9-31 of the first fragment of several: bytes of all of them

Only headers have a check. A content has none, so that what a damaged line altered is found by its
neighbours alone. Beacons and pings have no payload. The number of a fragment is 0 in all data that
a sensor sends: it counts fragments and never packets.

Facts: the documentation of SimpleSerialTL and aspep_slave in STMicroelectronics' firmware
STAIOTCRAFT_SDATALOG (github.com/stm32-hotspot), and what its sources do. Their comment names the
polynomial x^4 + x + 1, but their tables are those of the one above.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

__all__ = [
    "BEACON",
    "BINARY",
    "CUSTOM",
    "DATA",
    "PING",
    "REFUSAL",
    "REQUEST",
    "RESPONSE",
    "Packet",
    "Unpacker",
    "beacon",
    "capabilities",
    "ping",
    "request",
]

DATA, RESPONSE_PACKET, BEACON, PING, REFUSAL = 0x9, 0xA, 0x5, 0x6, 0xF
BINARY, REQUEST, RESPONSE, _NOTIFICATION, CUSTOM, _TEXT = 0, 1, 2, 3, 4, 7
_KINDS = (BINARY, RESPONSE, _NOTIFICATION, CUSTOM, _TEXT)
_HEADER = 4
_SSTL = 7 << 17
_LENGTH_MASK, _RESERVED_MASK = 0x1FFF, 0x7FF << 17
_LONGEST = 8128
_LAST = 1 << 8

# What ST's boards can take: 2048 bytes of a request, 4096 of a response, 8128 of data. A board
# answers with its own, and connects once the host has asked for exactly these.
_CAPABILITIES = (2048 // 32 - 1) << 8 | (4096 // 32 - 1) << 14 | (8128 // 64) << 21

_STEPS = (0x0, 0x7, 0xE, 0x9, 0xB, 0xC, 0x5, 0x2, 0x1, 0x6, 0xF, 0x8, 0xA, 0xD, 0x4, 0x3)


def _crc(header: int) -> int:
    """Return the CRC-4 of all 32 bits; 0 where the last four are the CRC of the others."""
    crc = 0
    for at in range(0, 28, 4):
        crc = _STEPS[crc ^ (header >> at & 0xF)]
    return crc ^ header >> 28


def _sealed(header: int, payload: bytes = b"") -> bytes:
    return (header | _crc(header) << 28).to_bytes(_HEADER, "little") + payload


def beacon(capabilities: int = _CAPABILITIES) -> bytes:
    """Return what a host sends first.

    >>> beacon().hex(" ")
    '05 ff ff 0f'
    """
    return _sealed(BEACON | capabilities)


def ping() -> bytes:
    """Return what a host sends once a beacon was answered with what it asked for.

    >>> ping().hex(" ")
    '06 00 00 60'
    """
    return _sealed(PING)


def request(text: str = "") -> bytes:
    """Return a request of JSON text, or without any the answer to a fragment: send the next.

    The text is a C string with its zero: the board parses what stands in its buffer up to one.
    """
    header = ((REQUEST if text else RESPONSE) << 5 | _LAST).to_bytes(_HEADER, "little")
    content = header + (text.encode() + b"\0" if text else b"")
    return _sealed(DATA | len(content) << 4 | _SSTL, content)


def capabilities(header: int) -> int:
    """Return what a beacon says that its sender can do, in the bits in which it says so."""
    return header & 0x0FFF_FFF0


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet from a board.

    Attributes
    ----------
    type : int
        Bits 0-3 of its header.
    header : int
        All of it.
    kind, channel : int
        What the SSTL header says; -1 without one.
    last : bool
        Whether no fragment follows.
    number : int
        Bits 16-31 of the SSTL header.
    content : bytes
        What follows both headers.
    """

    type: int
    header: int
    kind: int = -1
    channel: int = -1
    last: bool = True
    number: int = 0
    content: bytes = b""


class Unpacker:
    """Bytes to packets.

    Attributes
    ----------
    resyncs : int
        Resynchronisations: bytes discarded to find the next header. What may be the tail of a
        packet at the start is not counted.
    """

    def __init__(self) -> None:
        self.resyncs = 0
        self.reset()

    def reset(self) -> None:
        """Forget a partial packet."""
        self._held = bytearray()
        self._in_step = True
        self._joining = _LONGEST

    def feed(self, data: bytes) -> Iterator[Packet | None]:
        """Yield the packets that the bytes complete, None where something was discarded."""
        self._held += data
        at = 0
        while len(self._held) - at >= _HEADER:
            length = self._length(at)
            if length is None:
                if self._in_step and not self._joining:
                    self._in_step = False
                    self.resyncs += 1
                    yield None
                self._joining = max(self._joining - 1, 0)
                at += 1
                continue
            if len(self._held) - at < _HEADER + length:
                if self._held.endswith(beacon()):  # of a board that was reset in the middle
                    yield _packet(beacon())
                    at = len(self._held)
                break
            packet = _packet(bytes(self._held[at : at + _HEADER + length]))
            self._in_step, self._joining = True, 0
            at += _HEADER + length
            yield packet
        del self._held[:at]

    def _length(self, at: int) -> int | None:
        """Return how long the payload behind a header is, None where there is none."""
        held = self._held
        kind = held[at] & 0xF
        if kind not in (DATA, RESPONSE_PACKET, BEACON, PING, REFUSAL):
            return None
        header = int.from_bytes(held[at : at + _HEADER], "little")
        if _crc(header):
            return None
        if kind not in (DATA, RESPONSE_PACKET):
            return 0 if _is_control(header) else None
        length = header >> 4 & _LENGTH_MASK
        sound = header & _RESERVED_MASK == _SSTL and _HEADER <= length <= _LONGEST
        first = held[at + _HEADER] if len(held) - at > _HEADER else 0
        return length if sound and first & 0x1F == 0 and first >> 5 in _KINDS else None


def _is_control(header: int) -> bool:
    """Return whether a header of a beacon, a ping or a refusal has what these have in its bits."""
    low, high = header >> 8 & 0xFF, header >> 16 & 0xFF
    if header & 0xF == BEACON:
        return header & 0xF0 == 0  # version 0, data without a CRC
    if header & 0xF == PING:
        return header >> 4 & 3 in (0, 3) and header >> 6 & 3 in (0, 3) and low & 0xF == 0
    return low == high and low in (1, 2, 4, 5) and header >> 4 & 0xF == 0


def _packet(raw: bytes) -> Packet:
    header = int.from_bytes(raw[:_HEADER], "little")
    if len(raw) == _HEADER:
        return Packet(header & 0xF, header)
    inner = int.from_bytes(raw[_HEADER : 2 * _HEADER], "little")
    return Packet(
        header & 0xF,
        header,
        kind=inner >> 5 & 7,
        channel=inner >> 9 & 0x7F,
        last=bool(inner & _LAST),
        number=inner >> 16,
        content=raw[2 * _HEADER :],
    )
