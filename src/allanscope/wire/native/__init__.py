"""The native protocol, host and device side; the norm is ``firmware_protocol/PROTOCOL.md``.

::

    bytes ─▶ framing ─▶ table of frames ─▶ decoder ─▶ StreamInfo  Block  Gap  Notice
                                           epochs, losses, time
    Block ─▶ encoder ─▶ framing (many frames at once) ─▶ bytes

`layout` mirrors the numbers of the norm, `descriptor` says what the counts mean, and `messages` are
for people and for the device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.native.decoder import NativeDecoder
from allanscope.wire.native.encoder import NativeEncoder
from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.layout import VERSION_MAJOR, Flag, FrameType
from allanscope.wire.native.messages import request, settings_body

__all__ = ["Flag", "NativeDecoder", "NativeEncoder", "NativeFormat"]


@dataclass(frozen=True, slots=True)
class NativeFormat(WireFormat):
    """allanscope's own protocol: the only one that counts losses to the sample."""

    framed: ClassVar[bool] = True

    name: str = "native"
    summary: str = "allanscope's own protocol: int16 counts, device time, losses to the sample"

    def decoder(self, settings: WireSettings) -> NativeDecoder:
        """Return a fresh decoder; the stream describes itself, so no setting is needed."""
        return NativeDecoder()

    def encoder(self) -> NativeEncoder:
        """Return a fresh encoder."""
        return NativeEncoder()

    def start(self, settings: WireSettings) -> list[bytes]:
        """Ask for the settings that the user gave, for a descriptor, and for data."""
        body = settings_body(settings)
        kinds = [(FrameType.SET, body)] if body else []
        kinds += [(FrameType.DESCRIBE, b""), (FrameType.START, b"")]
        return [request(kind, seq, payload) for seq, (kind, payload) in enumerate(kinds)]

    def stop(self) -> list[bytes]:
        """Ask for silence."""
        return [request(FrameType.STOP, 0)]

    def describe(self) -> list[bytes]:
        """Ask for the descriptor."""
        return [request(FrameType.DESCRIBE, 0)]

    def score(self, sample: bytes) -> float:
        """Return 1 for two frames with a right CRC-32, 0.8 for one, else 0.

        Random bytes pass a CRC-32 once in four thousand million times: two frames are proof, one
        is nearly so, even where most of a sample is garbage.
        """
        frames = [
            frame
            for frame, _ in Deframer().feed(sample)
            if frame[1] >> 4 == VERSION_MAJOR and frame[0] < FrameType.START
        ]
        return (0.0, 0.8, 1.0)[min(len(frames), 2)]
