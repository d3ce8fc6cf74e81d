"""What a device says of itself only when a host has asked."""

from __future__ import annotations

from allanscope.wire import Encoder
from allanscope.wire.sdatalog import packets
from allanscope.wire.sdatalog.conversation import STATUS

__all__ = ["said_when_asked"]


def said_when_asked(encoder: Encoder, name: str) -> bytes:
    """Return what a device of a format answers to the question what it sends; mostly nothing."""
    if name != "sdatalog":
        return b""
    requests = packets.beacon() + packets.ping() + packets.request(STATUS)
    return b"".join(map(encoder.reply, encoder.receive(requests)))
