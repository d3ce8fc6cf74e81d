"""SDATALOG, what ST's boards of today send over their serial port to ST's own tools.

::

    bytes ─▶ packets ─▶ decoder (pairs of sensors) ─▶ rows (losses, Blocks)
      ▲         └─────▶ conversation (status, answers)
      └───────────────────────┘

A board is silent until it is connected to and told to start (`conversation`). Samples are counts
with a time each; they have neither number nor check, so losses are counted from the times.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.sdatalog import packets
from allanscope.wire.sdatalog.conversation import STOP
from allanscope.wire.sdatalog.decoder import SDatalogDecoder
from allanscope.wire.sdatalog.encoder import SDatalogEncoder
from allanscope.wire.sdatalog.packets import Unpacker

__all__ = ["SDatalogDecoder", "SDatalogEncoder", "SDatalogFormat"]


@dataclass(frozen=True, slots=True)
class SDatalogFormat(WireFormat):
    """What boards with STSW-SDATALOG or STAIOTCRAFT_SDATALOG send."""

    # A board that has read a wrong header waits for a reset: its receiver is not armed again.
    must_start_first: ClassVar[bool] = True
    baud: ClassVar[int] = 1_843_200

    name: str = "sdatalog"
    summary: str = "ST's SDATALOG firmware: ASPEP and SSTL packets, JSON commands (1843200 baud)"

    def decoder(self, settings: WireSettings) -> SDatalogDecoder:
        """Return a fresh decoder."""
        return SDatalogDecoder(settings)

    def encoder(self) -> SDatalogEncoder:
        """Return a fresh encoder."""
        return SDatalogEncoder()

    def start(self, settings: WireSettings) -> list[bytes]:
        """Ask whether a board is there; the rest is said in answer to what it answers."""
        return [packets.beacon()]

    def stop(self) -> list[bytes]:
        """End the stream."""
        return [packets.request(STOP)]

    def describe(self) -> list[bytes]:
        """Return nothing: the decoder asks, in its `answers`."""
        return []

    def score(self, sample: bytes) -> float:
        """Return 1 for two packets of samples or a response, 0.7 for one or a beacon alone."""
        found = [packet for packet in Unpacker().feed(sample) if packet is not None]
        payloads = sum(_is_valid(packet) for packet in found)
        alone = len(sample) < 64 and any(packet.type == packets.BEACON for packet in found)
        return 1.0 if payloads > 1 else 0.7 if payloads or alone else 0.0


def _is_valid(packet: packets.Packet) -> bool:
    """Return whether it is one that a board sends, with a number of 0 where nothing counts."""
    if packet.kind == packets.RESPONSE:
        return packet.last or bool(packet.content)
    return packet.kind in (packets.BINARY, packets.CUSTOM) and packet.last and packet.number == 0
