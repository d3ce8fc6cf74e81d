"""The wire: bytes to events and back, without ever having heard of a serial port.

::

    bytes ──▶ decoder.feed(data, host_s) ──▶ [StreamInfo, Block, Gap, Notice, ...]
    bytes ◀── encoder.encode(block) ◀── Block          (the simulated device)

Every format is one entry of a registry and provides the same five things (`WireFormat`): a decoder,
an encoder, what to write to start and stop a device, and a score by which it is recognised.
A decoder never raises, whatever it is fed, and never holds more than a frame or a line; what it
throws away it counts in its `LinkStats`.
"""

from __future__ import annotations

from allanscope.wire.base import Command, Decoder, Encoder, LinkStats, WireFormat, WireSettings
from allanscope.wire.chunks import feed_chunks
from allanscope.wire.printable import excerpt, text_of
from allanscope.wire.registry import format_named, formats
from allanscope.wire.sniffing import SniffResult, sniff

__all__ = [
    "Command",
    "Decoder",
    "Encoder",
    "LinkStats",
    "SniffResult",
    "WireFormat",
    "WireSettings",
    "excerpt",
    "feed_chunks",
    "format_named",
    "formats",
    "sniff",
    "text_of",
]
